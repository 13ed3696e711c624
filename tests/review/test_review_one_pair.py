"""The review of one pair: what is in the recording, whatever the pair lacks."""

from __future__ import annotations

import io
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from box_room import BAD, CLEAN, GOOD, LIDAR, make
from PIL import Image
from rrd import Rrd
from test_review_cameras import CAMERAS

from lcdata.dataset import Dataset, schema
from lcdata.errors import CalibrationError, DatasetError, ReportError
from lcdata.review.blending import WIDEST_PX, Blending, reduced
from lcdata.review.one_pair import default_path, save_pair_review

NO_INTENSITY = np.dtype([(name, LIDAR[name]) for name in "xyz"])


def picture(rrd: Rrd, entity: str) -> np.ndarray:
    """An encoded image of a recording."""
    return np.asarray(Image.open(io.BytesIO(bytes(rrd.static(entity, "EncodedImage:blob")[0]))))


@pytest.fixture(scope="module")
def one(dataset: Dataset, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    path = tmp_path_factory.mktemp("one") / "one.rrd"
    written, figure = save_pair_review(dataset, dataset.pairs[0].pair_id, path)
    assert written == path
    assert figure is not None
    return path, figure


def test_it_shows_the_pair_at_the_estimate_the_guess_and_the_truth(dataset, one):
    rrd = Rrd(one[0])
    for source in (GOOD, "initial", "ground_truth"):
        for entity in (f"coloured/{source}/points", f"blended/{source}/lidar"):
            assert f"/{entity}" in rrd.entities
    assert not [entity for entity in rrd.entities if BAD in entity]
    text = rrd.static("/pair", "TextDocument:text")[0]
    assert dataset.pairs[0].pair_id in text
    assert "## NID landscape" in text
    assert "| initial guess | 0." in text


def test_the_blend_goes_from_image_to_lidar(dataset, one):
    rrd = Rrd(one[0])
    assert rrd.timelines == {"blend"}
    opacity = rrd.rows("/blended/ground_truth/lidar", "EncodedImage:opacity", "blend")
    assert len(opacity) == 101
    assert (opacity[0][0], opacity[50][0], opacity[100][0]) == (0.0, 0.5, 1.0)
    camera = dataset.camera(dataset.pairs[0].scenario)
    below, above = picture(rrd, "/image"), picture(rrd, "/blended/ground_truth/lidar")
    assert below.shape[:2] == above.shape[:2] == (camera.height, camera.width)
    assert 100 < np.count_nonzero(above[..., 3]) < above[..., 3].size


def test_the_landscape_is_a_picture_beside_the_recording(one):
    path, figure = one
    assert figure == path.with_suffix(".png")
    shown = picture(Rrd(path), "/landscape")
    np.testing.assert_array_equal(shown, np.asarray(Image.open(figure)))
    green = np.abs(shown[..., :3].astype(int) - [64, 214, 120]).max(axis=2) < 30
    assert green.sum() > 500  # the ground truth's lines


@pytest.fixture(scope="module")
def lenses(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    made = make(tmp_path_factory.mktemp("lenses") / "rooms", pairs=1, cameras=CAMERAS)
    return Dataset.open(made.path)


@pytest.mark.parametrize("name", CAMERAS)
def test_walls_take_their_colours_through_every_lens(lenses, name):
    record = next(record for record in lenses.pairs if record.scenario == name)
    pair = lenses.load(record.pair_id)
    blending = Blending(pair)
    T = pair.T_camera_lidar
    seen, pixels = blending.seen(T)
    assert len(seen) > 0.05 * len(blending.points)
    assert CAMERAS[name].contains(pixels).all()
    points = blending.points[seen]
    reach = np.sort(np.abs(points), axis=1)
    clear = reach[:, 2] - reach[:, 1] > 0.2  # colours blur where walls meet
    axis = np.argmax(np.abs(points), axis=1)
    wall = 2 * axis + (points[np.arange(len(points)), axis] > 0)
    colours = blending.colours(T)[seen].astype(int)
    typical = {number: np.median(colours[wall == number], axis=0) for number in np.unique(wall)}
    apart = np.abs(colours - np.array([typical[number] for number in wall])).max(axis=1)
    assert np.mean(apart[clear] < 25) > 0.95
    lidar = blending.picture(T)
    assert lidar.shape == (CAMERAS[name].height, CAMERAS[name].width, 4)
    columns, rows = np.rint(pixels).astype(int).T
    assert (lidar[rows, columns, 3] == 255).all()


def test_a_wide_lens_has_a_review_without_results(lenses):
    record = next(record for record in lenses.pairs if record.scenario == "panorama")
    path, figure = save_pair_review(lenses, record.pair_id)
    assert path == lenses.path / schema.REPORT / "pair-panorama-pose_000-000.rrd"
    assert path == default_path(lenses, record.pair_id)
    assert figure is not None
    assert {e.split("/")[2] for e in Rrd(path).entities if e.startswith("/blended")} == {
        "ground_truth"
    }


def test_a_pair_without_intensities_says_so_and_shows_the_rest(tmp_path):
    made = make(tmp_path / "dark", arm=False, pairs=1, cameras={"lab": CLEAN}, fields=NO_INTENSITY)
    pair_id = made.pairs[0].pair_id
    stale = default_path(made, pair_id).with_suffix(".png")
    stale.parent.mkdir()
    stale.touch()
    path, figure = save_pair_review(made, pair_id)
    assert figure is None
    assert not stale.exists()
    rrd = Rrd(path)
    text = rrd.static("/pair", "TextDocument:text")[0]
    assert f"**No NID landscape**: pair {pair_id}: the cloud has no intensity field" in text
    assert "ranges" in text
    assert "/landscape" not in rrd.entities
    assert np.ptp(picture(rrd, "/blended/ground_truth/lidar")[..., 0]) > 100


def test_without_an_estimate_the_guess_and_the_truth_are_shown(dataset, tmp_path):
    path, figure = save_pair_review(
        dataset, dataset.pairs[1].pair_id, tmp_path / "one.rrd", method=BAD, thin=4
    )
    assert figure is not None
    rrd = Rrd(path)
    assert {e.split("/")[2] for e in rrd.entities if e.startswith("/coloured")} == {
        "initial",
        "ground_truth",
    }
    assert "no lines in the image" in rrd.static("/pair", "TextDocument:text")[0]


def test_what_is_not_there_is_named(dataset, tmp_path):
    last = dataset.pairs[3].pair_id
    with pytest.raises(ReportError, match=f"no result of '{BAD}' on {last}: .* of {GOOD}$"):
        save_pair_review(dataset, last, tmp_path / "x.rrd", method=BAD)
    with pytest.raises(DatasetError, match="den/pose_9"):
        save_pair_review(dataset, "den/pose_9", tmp_path / "x.rrd")
    with pytest.raises(CalibrationError, match="cannot reach 9 m"):
        save_pair_review(dataset, last, tmp_path / "x.rrd", reach_m=9.0)
    assert not list(tmp_path.iterdir())


def test_large_images_are_reduced(dataset):
    camera = CLEAN.resized(4000, 3000)
    assert (reduced(camera).width, reduced(camera).height) == (WIDEST_PX, 1200)
    assert reduced(CLEAN) == CLEAN
    pair = dataset.load(next(p.pair_id for p in dataset.pairs if p.scenario == "lab"))
    large = np.kron(pair.image, np.ones((10, 10, 1), np.uint8))
    blending = Blending(replace(pair, image=large, camera=CLEAN.resized(2400, 1800)))
    assert blending.image.shape == (1200, WIDEST_PX, 3)
    seen, _ = blending.seen(pair.T_camera_lidar)
    assert set(seen) == set(Blending(pair).seen(pair.T_camera_lidar)[0])


def test_a_grey_image_gives_grey_points(dataset):
    pair = dataset.load(dataset.pairs[0].pair_id)
    grey = Blending(replace(pair, image=np.ascontiguousarray(pair.image[..., 0])))
    seen, _ = grey.seen(pair.T_camera_lidar)
    assert np.ptp(grey.colours(pair.T_camera_lidar)[seen], axis=1).max() == 0


def test_a_pose_that_sees_nothing_and_an_empty_cloud_leave_the_image(dataset):
    pair = dataset.load(dataset.pairs[0].pair_id)
    T = pair.T_camera_lidar
    empty = replace(pair, points=pair.points[:0], intensity=pair.intensity[:0], organised=None)
    empty = replace(empty, ring=None)
    away = np.eye(4)
    away[:3, 3] = 50, 0, -9
    for blending, pose in ((Blending(pair), away @ T), (Blending(empty), T)):
        assert not blending.picture(pose).any()
        assert len(np.unique(blending.colours(pose), axis=0)) <= 1
