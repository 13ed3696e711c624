"""lcdata import, as a user types it."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path

import numpy as np
import pytest
from dataset.importers import layouts
from typer.testing import CliRunner

from lcdata.cli.app import app

from .conftest import Lcdata
from .test_errors import assert_one_line

Done = subprocess.CompletedProcess[str]


def typed(*arguments: object) -> Done:
    """A command in this process: starting one costs a second of imports."""
    result = CliRunner().invoke(app, list(map(str, arguments)), env={"COLUMNS": "200"})
    return subprocess.CompletedProcess([], result.exit_code, result.stdout, result.stderr)


FORMATS = ["kitti-raw", "kitti-odometry", "nuscenes", "opencalib", "folder"]


@pytest.fixture(scope="module")
def published(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """A tiny data set of each format."""
    root = tmp_path_factory.mktemp("published")
    layouts.kitti_calibration(root / "raw" / "2011_09_26")
    layouts.kitti_drive(root / "raw" / "2011_09_26")
    layouts.kitti_sequence(root / "odometry")
    layouts.NuScenesFiles(root / "nuscenes")
    layouts.opencalib(root / "opencalib")
    layouts.folder_of_pairs(root / "folder")
    return dict(zip(FORMATS, (root / n for n in ("raw", "odometry", *FORMATS[2:])), strict=True))


@pytest.mark.parametrize("name", FORMATS)
def test_each_format_becomes_a_valid_data_set(
    published: dict[str, Path], tmp_path: Path, name: str
) -> None:
    done = typed("import", name, published[name], "-o", tmp_path / "out", "--json")
    assert done.returncode == 0, done.stderr
    content = json.loads(done.stdout)
    assert content["pairs"] == (1 if name == "opencalib" else 3)
    assert content["poses"] == 1 and content["format"] == name and content["failures"] == []
    done = typed("validate", tmp_path / "out")
    assert done.returncode == 0, done.stdout
    done = typed("import", name, "--help")
    assert f"Example:  lcdata import {name}" in done.stdout and "--json" in done.stdout


@pytest.mark.slow
def test_an_imported_data_set_goes_through_every_command(
    lcdata: Lcdata, published: dict[str, Path], tmp_path: Path
) -> None:
    out = tmp_path / "out"
    sigmas = ("--sigma-rotation", "0.1", "--sigma-translation", "0.02")
    done = lcdata("import", "folder", published["folder"], "-o", out, *sigmas)
    assert done.returncode == 0 and done.stdout == f"{out}: 3 pairs of 1 extrinsic\n"
    # random pictures: what a method makes of them does not matter, that it is stored does
    done = lcdata("calibrate", out, "--methods", "projection", "--joint", "--jobs", "1")
    assert done.returncode in (0, 3), done.stderr
    for command in (("report", out), ("review", out, "--save", out / "review.rrd")):
        done = lcdata(*command)
        assert done.returncode == 0, done.stderr
    assert (out / "report" / "index.html").is_file() and (out / "review.rrd").is_file()
    from lcdata.dataset import Dataset

    pose = Dataset.open(out).poses[0]
    std = np.sqrt(np.diag(pose.covariance))
    np.testing.assert_allclose(std, [0.02] * 3 + [np.deg2rad(0.1)] * 3)
    assert lcdata("groundtruth", out, "--dry-run").returncode == 0


def test_what_failed_is_named_and_the_rest_is_there(
    lcdata: Lcdata, published: dict[str, Path], tmp_path: Path
) -> None:
    layouts.folder_of_pairs(tmp_path / "road")
    (tmp_path / "road" / "000001.pcd").write_bytes(b"no cloud")
    done = lcdata("import", "folder", tmp_path / "road", "-o", tmp_path / "out")
    assert_one_line_beside_notes(done.stderr, "000001.pcd cannot be read")
    assert done.returncode == 3 and "2 pairs" in done.stdout


def assert_one_line_beside_notes(text: str, *words: str) -> None:
    (line,) = [line for line in text.splitlines() if "note:" not in line]
    assert line.startswith("lcdata: ") and all(word in line for word in words)


def test_wrong_input_has_one_line(published: dict[str, Path], tmp_path: Path) -> None:
    out = tmp_path / "out"
    for name in FORMATS:
        assert_one_line(typed("import", name, tmp_path / "none", "-o", out), "does not exist")
        (tmp_path / "empty").mkdir(exist_ok=True)
        assert_one_line(typed("import", name, tmp_path / "empty", "-o", out), "empty")
    assert not out.exists()
    folder = published["folder"]
    assert typed("import", "folder", folder, "-o", out, "--limit", "1").returncode == 0
    assert_one_line(typed("import", "folder", folder, "-o", out), "already holds", "--force")
    done = typed("import", "folder", folder, "-o", out, "--force")
    assert done.returncode == 0 and "3 pairs" in done.stdout


def test_options_that_do_not_go_together_are_wrong_usage(
    published: dict[str, Path], tmp_path: Path
) -> None:
    folder = published["folder"]
    assert typed("import", "folder", folder, "--sigma-rotation", "1").returncode == 2
    assert typed("import", "folder", folder, "--every", "0").returncode == 2
    assert typed("import", "waymo", folder).returncode == 2
    (tmp_path / "c.json").write_text(json.dumps(np.eye(5).tolist()))
    done = typed(
        "import", "folder", folder, "-o", tmp_path / "o", "--covariance", tmp_path / "c.json"
    )
    assert_one_line(done, "c.json: covariance has 25 values")
