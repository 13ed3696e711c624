"""Imports that are interrupted, repeated or in the way of something."""

from __future__ import annotations

import errno
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from lcdata.dataset import Dataset, atomic, validate
from lcdata.dataset.importers import Choice, Folder, import_dataset
from lcdata.dataset.journal import NAME
from lcdata.errors import DatasetError, SourceError

from . import layouts


def contents(folder: Path) -> dict[str, bytes]:
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


@pytest.fixture
def road(tmp_path: Path) -> Path:
    layouts.folder_of_pairs(tmp_path / "road", 6)
    layouts.mask(tmp_path / "road" / "masks" / "000000.png")
    return tmp_path / "road"


def test_the_same_again_changes_nothing(road: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    import_dataset(Folder(road), out)
    before = {path: path.stat().st_mtime_ns for path in out.rglob("*") if path.is_file()}
    again = import_dataset(Folder(road), out)
    assert again.pairs == 6
    assert {p: p.stat().st_mtime_ns for p in out.rglob("*") if p.is_file()} == before


def test_other_pairs_are_refused_without_force(road: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    import_dataset(Folder(road), out)
    whole = contents(out)
    few = Choice(limit=2)
    with pytest.raises(DatasetError, match="already holds a data set"):
        import_dataset(Folder(road), out, choice=few)
    content = json.loads((road / "reference.json").read_text())
    content["T_camera_lidar"][0][3] += 0.01
    (road / "reference.json").write_text(json.dumps(content))
    with pytest.raises(DatasetError, match="already holds a data set"):
        import_dataset(Folder(road), out)
    assert contents(out) == whole
    made = import_dataset(Folder(road), out, choice=few, force=True)
    assert made.pairs == 2 and validate(out) == []
    assert len(list((out / "road").rglob("*.png"))) == 2


def test_force_leaves_masks_of_a_build_alone(road: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    (road / "masks" / "000000.png").unlink()
    import_dataset(Folder(road), out)
    own = layouts.mask(out / "masks" / "road" / "pose_000" / "000001.png")
    import_dataset(Folder(road), out, choice=Choice(limit=2), force=True)
    assert (out / "masks" / "road" / "pose_000" / "000001.png").read_bytes() == own


def test_something_else_in_the_way(road: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    out.mkdir()
    (out / "notes.txt").write_text("mine")
    with pytest.raises(DatasetError, match="is not empty and holds no lcdata data set"):
        import_dataset(Folder(road), out)
    with pytest.raises(DatasetError, match="is a file"):
        import_dataset(Folder(road), out / "notes.txt", force=True)
    road.rename(tmp_path / "results")
    with pytest.raises(SourceError, match="a name that a data set uses itself"):
        import_dataset(Folder(tmp_path / "results"), tmp_path / "other")
    with pytest.raises(SourceError, match="is a file"):
        import_dataset(Folder(tmp_path / "results" / "reference.json"), tmp_path / "other")


def test_a_full_disk_is_told_and_the_import_goes_on(
    road: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = tmp_path / "whole"
    import_dataset(Folder(road), whole)
    out, real = tmp_path / "out", atomic.write_bytes

    def full(path: Path, *chunks: bytes, sync_folder: bool = True) -> None:
        if path.name.startswith("000003"):
            raise atomic.full_disk(path) from OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        real(path, *chunks, sync_folder=sync_folder)

    monkeypatch.setattr(atomic, "write_bytes", full)
    with pytest.raises(DatasetError, match="no space left"):
        import_dataset(Folder(road), out)
    assert (out / NAME).is_file() and not (out / "dataset.json").exists()
    with pytest.raises(DatasetError, match="its build has not finished"):
        Dataset.open(out)
    monkeypatch.undo()
    made = import_dataset(Folder(road), out)
    assert made.pairs == 6 and contents(out) == contents(whole)


@pytest.mark.slow
def test_a_killed_import_goes_on(tmp_path: Path) -> None:
    road = tmp_path / "road"
    layouts.folder_of_pairs(road, 120)
    import_dataset(Folder(road), tmp_path / "whole")
    out = tmp_path / "out"
    command = [sys.executable, "-m", "lcdata", "import", "folder", str(road), "-o", str(out)]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
    while not ((out / NAME).is_file() and (out / NAME).read_bytes().count(b"\n") > 5):
        assert process.poll() is None
        time.sleep(0.001)
    process.send_signal(signal.SIGKILL)
    process.communicate()
    assert not (out / "dataset.json").exists()
    kept = {
        out / json.loads(line)["cloud"] for line in (out / NAME).read_bytes().split(b"\n")[1:-1]
    }
    before = {path: path.stat().st_mtime_ns for path in kept}
    assert subprocess.run(command, capture_output=True, check=False).returncode == 0
    assert {path: path.stat().st_mtime_ns for path in kept} == before
    assert contents(out) == contents(tmp_path / "whole")
    assert validate(out) == []
