"""How many points are kept, and which."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from box_room import CLEAN, make
from rrd import Rrd

from lcdata.dataset.reader import read_image
from lcdata.recording import images
from lcdata.review import save_review, thinning
from lcdata.review.thinning import OVERLAY, POINTS, Thinning, plan, spread


@pytest.fixture(scope="module")
def room(tmp_path_factory):
    made = make(tmp_path_factory.mktemp("thin") / "set", arm=False, pairs=1, cameras={"lab": CLEAN})
    return made


def many(dataset, count, points=262_144):
    """The same pair many times, as the index has it."""
    record = replace(dataset.pairs[0], points=points)
    return replace(dataset, pairs=(record,) * count)


def test_one_point_of_each_stretch_is_kept_the_same_each_time():
    kept = spread(262_144, 20_000, seed=3)
    bounds = np.arange(20_001) * 262_144 // 20_000
    assert ((kept >= bounds[:-1]) & (kept < bounds[1:])).all()
    np.testing.assert_array_equal(kept, spread(262_144, 20_000, seed=3))
    assert (kept != spread(262_144, 20_000, seed=4)).mean() > 0.8
    columns = np.bincount(kept % 8, minlength=8)
    assert columns.std() < 0.05 * columns.mean()  # no stripes


def test_few_points_are_all_kept():
    np.testing.assert_array_equal(spread(7, 20, seed=0), np.arange(7))
    assert len(spread(0, 20, seed=0)) == 0


def test_every_nth_if_asked_for():
    np.testing.assert_array_equal(Thinning(None, 3).keep(8, "x"), [0, 3, 6])


@pytest.mark.parametrize(("pairs", "methods"), [(600, 2), (600, 5), (2000, 2), (300, 1)])
def test_the_budget_holds(room, pairs, methods):
    dataset = many(room, pairs)
    found = plan(dataset, methods + 2)
    size = (dataset.path / dataset.pairs[0].image).stat().st_size
    each = size + found.points * 16 + (methods + 2) * found.overlay * 12
    assert each * pairs < 400e6
    assert POINTS[0] <= found.points <= POINTS[1]
    assert OVERLAY[0] <= found.overlay <= OVERLAY[1]
    assert found.points == POINTS[1] or f"thinned to {found.points:,} each" in found.note


def test_a_budget_that_images_alone_exceed_is_told(room, monkeypatch):
    monkeypatch.setattr(thinning, "BUDGET_BYTES", 1000.0)
    found = plan(many(room, 600), 4)
    assert (found.points, found.overlay) == (POINTS[0], OVERLAY[0])
    assert "the images of 600 pairs alone take" in found.note


def test_a_small_data_set_is_not_thinned(room):
    found = plan(room, 4)
    assert found.points == POINTS[1]
    assert found.note == ""


def test_what_is_asked_for_is_kept(room):
    assert plan(many(room, 600), 4, points=123).points == 123
    assert "thinned to 123 each" in plan(many(room, 600), 4, points=123).note


def test_large_png_images_are_shown_as_jpeg_and_that_is_told(room, tmp_path, monkeypatch):
    monkeypatch.setattr(thinning, "PNG_BYTES", 100)
    done = save_review(room, tmp_path / "r.rrd")
    assert "PNG images of lab are shown as JPEG" in done.notes[-1]
    rrd = Rrd(done.path)
    blob = bytes(rrd.rows("/camera/image/lab/jpeg", "EncodedImage:blob")[0][0])
    assert images.suffix(blob, "") == ".jpg"
    recorded = read_image(room.path / room.pairs[0].image)
    assert cv2.PSNR(images.decode_file(blob), recorded) > 30


def test_deep_png_images_are_shown_as_jpeg(tmp_path):
    made = make(tmp_path / "set", arm=False, pairs=1, cameras={"lab": CLEAN})
    file = made.path / made.pairs[0].image
    deep = read_image(file)[..., 0].astype(np.uint16) << 8
    file.write_bytes(cv2.imencode(".png", deep)[1].tobytes())
    rrd = Rrd(save_review(made, tmp_path / "r.rrd").path)
    blob = bytes(rrd.rows("/camera/image/lab/jpeg", "EncodedImage:blob")[0][0])
    assert images.decode_file(blob).dtype == np.uint8
