"""A machine whose system libraries cannot load Open3D: only what needs it says so."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest


@pytest.fixture
def without_open3d(tmp_path: Path) -> dict[str, str]:
    """Environment in which Open3D fails as it does where libGL is missing."""
    package = tmp_path / "broken" / "open3d"
    package.mkdir(parents=True)
    message = "libGL.so.1: cannot open shared object file: No such file or directory"
    (package / "__init__.py").write_text(f"raise OSError({message!r})\n")
    root = Path(__file__).parents[2]
    return {**os.environ, "PYTHONPATH": os.pathsep.join([str(package.parent), str(root)])}


def run(environment: dict[str, str], *arguments: object) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "lcdata", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=False, env=environment)


def test_the_simulator_names_the_packages_that_it_needs(without_open3d, tmp_path):
    done = run(without_open3d, "simulate", tmp_path / "out", "--poses", 1)
    assert done.returncode == 1
    assert done.stderr.count("\n") == 1
    assert "libGL.so.1" in done.stderr
    assert "apt-get install" in done.stderr and "libgl1" in done.stderr
    assert not (tmp_path / "out").exists() or not any((tmp_path / "out").iterdir())


@pytest.mark.slow
def test_the_main_job_does_not_need_it(without_open3d, sample_recordings, tmp_path):
    out = tmp_path / "dataset"
    done = run(without_open3d, "build", sample_recordings / "gym", "-o", out)
    assert done.returncode == 0, done.stderr
    assert (out / "review.rrd").is_file() and (out / "report" / "index.html").is_file()
