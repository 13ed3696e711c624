from __future__ import annotations

import dataclasses
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from box_room import make
from rrd import Rrd

from lcdata.dataset import cloud_file
from lcdata.errors import ReportError
from lcdata.review import Wanted, open_viewer, save_review, serve


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
        save_review(dataset, tmp_path / "r.rrd", wanted=Wanted(run="x"))


@pytest.mark.parametrize("damage", ["cut", "missing", "no return", "no fields"])
def test_a_damaged_cloud_is_named_and_the_rest_is_shown(dataset, tmp_path, damage):
    cloud = dataset.path / dataset.pairs[1].cloud
    records, height, width = cloud_file.read(cloud)
    records = records.copy()
    if damage == "missing":
        cloud.unlink()
    elif damage == "cut":
        cloud.write_bytes(cloud.read_bytes()[:-1000])
    elif damage == "no return":
        records["x"] = np.nan
        cloud.write_bytes(b"".join(cloud_file.encode(records, height, width)))
    else:
        records.dtype.names = ("a", "b", "c", "d")
        cloud.write_bytes(b"".join(cloud_file.encode(records, height, width)))
    done = save_review(dataset, tmp_path / "r.rrd")
    (failure,) = done.failures
    assert failure.startswith(f"{dataset.pairs[1].pair_id}: ")
    assert "000.pcd" in failure
    rrd = Rrd(done.path)
    clouds = rrd.rows("/lidar/cloud", "Points3D:positions")
    assert [len(clouds[n]) > 0 for n in (0, 1)] == [True, False]
    assert rrd.rows("/overlays/ground_truth/cloud", "Points2D:positions")[1] == []
    images = rrd.rows("/camera/image/lab/png", "EncodedImage:blob")
    assert sorted(images) == [1]
    assert failure in rrd.static("/summary", "TextDocument:text")[0]


@pytest.mark.parametrize("content", [None, b"", b"not an image", b"\x89PNG\r\n\x1a\n cut"])
def test_a_damaged_image_is_named_and_the_cloud_is_shown(dataset, tmp_path, content):
    image = dataset.path / dataset.pairs[1].image
    image.unlink()
    if content is not None:
        image.write_bytes(content)
    done = save_review(dataset, tmp_path / "r.rrd")
    (failure,) = done.failures
    assert "000.png" in failure
    rrd = Rrd(done.path)
    assert len(rrd.rows("/lidar/cloud", "Points3D:positions")[1]) > 100
    assert not any("/lab/" in entity for entity in rrd.entities)
    before = rrd.rows("/camera/image/den/jpeg", "EncodedImage:blob")
    assert before[1] == []  # the image of the pair before does not stay


def test_what_cannot_be_written_leaves_the_review_that_was_there(dataset, tmp_path):
    path = tmp_path / "out" / "r.rrd"
    save_review(dataset, path)
    before = path.read_bytes()
    results = dataset.path / "results"
    results.mkdir()
    (results / "cut.parquet").write_bytes(b"PAR1 and no more")
    with pytest.raises(ReportError, match=r"cut\.parquet is not a results file"):
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
