"""Builds that are killed, interrupted or out of space go on where they stopped."""

from __future__ import annotations

import json
import signal
import subprocess
import time
from pathlib import Path

import pytest

from lcdata.dataset import atomic, build, validate
from lcdata.dataset.journal import NAME
from lcdata.errors import DatasetError

from . import runs

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """80 pairs of 1 MB, so that a build takes long enough to be interrupted."""
    folder = tmp_path_factory.mktemp("source") / "in"
    return runs.recordings(folder, run=runs.run(poses=2, pairs=40, shape=(32, 1024)))


@pytest.fixture(scope="module")
def whole(source: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """What a build gives that nobody interrupts."""
    out = tmp_path_factory.mktemp("whole") / "out"
    build(source, out)
    return runs.contents(out)


def wait_for_pairs(out: Path, count: int, process: subprocess.Popen[str]) -> None:
    """Until the journal holds some pairs."""
    journal = out / NAME
    for _ in range(20_000):
        if journal.is_file() and journal.read_bytes().count(b"\n") > count:
            return
        assert process.poll() is None, process.communicate()
        time.sleep(0.001)
    raise AssertionError("the build does not get on")


def finished(out: Path) -> dict[str, int]:
    """Files of journalled pairs and when they were written."""
    lines = (out / NAME).read_bytes().split(b"\n")[1:-1]
    names = [json.loads(line)[key] for line in lines for key in ("image", "cloud")]
    return {name: (out / name).stat().st_mtime_ns for name in names}


@pytest.mark.parametrize("kill", [signal.SIGKILL, signal.SIGINT])
def test_a_build_goes_on_where_it_was_stopped(
    source: Path, whole: dict[str, bytes], tmp_path: Path, kill: signal.Signals
) -> None:
    out = tmp_path / "out"
    for count in (3, 12):  # stopped twice
        process = runs.start_build(source, out)
        wait_for_pairs(out, count, process)
        process.send_signal(kill)
        process.communicate()
        assert process.returncode == -kill
        assert not (out / "dataset.json").exists()
    if kill == signal.SIGINT:
        assert not [path for path in out.rglob("*") if atomic.MARK in path.name]
    before = finished(out)
    assert len(before) >= 24
    build(source, out)
    assert {name: (out / name).stat().st_mtime_ns for name in before} == before
    assert runs.contents(out) == whole
    assert validate(out) == []


def test_a_damaged_file_is_written_anew(
    source: Path, whole: dict[str, bytes], tmp_path: Path
) -> None:
    out = tmp_path / "out"
    process = runs.start_build(source, out)
    wait_for_pairs(out, 4, process)
    process.kill()
    process.communicate()
    first, second = list(finished(out))[:2]
    (out / first).unlink()
    (out / second).write_bytes(b"?")
    with (out / NAME).open("ab") as journal:  # a line that was cut off
        journal.write(b'{"pair_id": "run/pose_0')
    build(source, out)
    assert runs.contents(out) == whole


def test_two_builds_do_not_write_one_data_set(source: Path, tmp_path: Path) -> None:
    process = runs.start_build(source, tmp_path / "out")
    wait_for_pairs(tmp_path / "out", 1, process)
    process.send_signal(signal.SIGSTOP)
    with pytest.raises(DatasetError, match="another lcdata command"):
        build(source, tmp_path / "out")
    process.kill()
    process.communicate()


def test_a_full_disk(source: Path, whole: dict[str, bytes], tmp_path: Path) -> None:
    """No file may exceed 500 kB: the first cloud does not fit."""
    out = tmp_path / "out"
    limit = "import resource; resource.setrlimit(resource.RLIMIT_FSIZE, (500_000, 500_000))"
    process = runs.start_build(source, out, setup=limit)
    output, errors = process.communicate()
    assert process.returncode == 1, errors
    assert len(output.splitlines()) == 1
    assert "no space left" in output
    assert not [path for path in out.rglob("*") if atomic.MARK in path.name]
    assert not list(out.rglob("*.pcd"))
    build(source, out)
    assert runs.contents(out) == whole
