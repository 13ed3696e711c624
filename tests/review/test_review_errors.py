from __future__ import annotations

import dataclasses
import subprocess
import sys
from pathlib import Path

import pytest
from box_room import make

from lcdata.errors import DatasetError, ReportError
from lcdata.review import open_viewer, save_review, serve


@pytest.fixture
def dataset(tmp_path):
    return make(tmp_path / "set", arm=False, pairs=1)


def test_no_pairs(dataset, tmp_path):
    empty = dataclasses.replace(dataset, pairs=())
    with pytest.raises(ReportError, match="no pairs"):
        save_review(empty, tmp_path / "r.rrd")


def test_no_thinning_below_one(dataset, tmp_path):
    with pytest.raises(ReportError, match="every 0th point"):
        save_review(dataset, tmp_path / "r.rrd", thin=0)


def test_an_unknown_run_names_those_that_are_there(dataset, tmp_path):
    with pytest.raises(ReportError, match="no run 'x': stored are none"):
        save_review(dataset, tmp_path / "r.rrd", run="x")


def test_a_damaged_pair_leaves_the_review_that_was_there(dataset, tmp_path):
    path = tmp_path / "out" / "r.rrd"
    save_review(dataset, path)
    before = path.read_bytes()
    (dataset.path / dataset.pairs[1].cloud).write_bytes(b"not a cloud")
    with pytest.raises(DatasetError, match=r"000\.pcd"):
        save_review(dataset, path)
    assert path.read_bytes() == before
    assert [file.name for file in path.parent.iterdir()] == ["r.rrd"]


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no limit of file sizes")
def test_a_full_disk_is_told_and_leaves_nothing(dataset, tmp_path):
    """A limit of the file's size stops Rerun's writer thread as a full disk does."""
    script = (
        "import resource, sys; from pathlib import Path\n"
        "from lcdata.dataset import Dataset\n"
        "from lcdata.errors import LcdataError\n"
        "from lcdata.review import save_review\n"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, resource.RLIM_INFINITY))\n"
        "try:\n    save_review(Dataset.open(sys.argv[1]), Path(sys.argv[2]))\n"
        "except LcdataError as error:\n    print(f'told: {error}')\n"
    )
    out = tmp_path / "out"
    arguments = [sys.executable, "-c", script, str(dataset.path), str(out / "r.rrd")]
    done = subprocess.run(arguments, check=False, capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    assert "told: " in done.stdout
    assert "could not write the review" in done.stdout
    assert list(out.iterdir()) == []


def test_a_review_that_is_not_there(tmp_path):
    with pytest.raises(ReportError, match="no file"):
        serve(tmp_path / "none.rrd")


@pytest.mark.skipif(sys.platform != "linux", reason="other systems always have a display")
def test_without_a_display_the_browser_is_named(monkeypatch):
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    with pytest.raises(ReportError, match="--serve"):
        open_viewer(Path("r.rrd"))
