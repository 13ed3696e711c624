"""Data sets of wide lenses: what is stored, drawn and shown of them."""

from __future__ import annotations

import numpy as np
import pytest
from box_room import GOOD, add_results, make
from rrd import Rrd

from lcdata.dataset import Dataset
from lcdata.dataset.validate import validate
from lcdata.geometry import se3
from lcdata.geometry.camera import Camera
from lcdata.report.overlay import depth_range, draw_overlay
from lcdata.review import save_review

CAMERAS = {
    "fisheye": Camera("fisheye", 320, 240, (80, 81, 159.2, 121), (0.02, -0.01, 0.003, -0.0004)),
    "omni": Camera("omni", 300, 300, (2.2, 290, 291, 149, 152), (0.01, 0.3, 0.0004, 0.0004)),
    "panorama": Camera("equirectangular", 480, 240),
    "atan": Camera("atan", 320, 240, (150, 151, 159.2, 121), (0.93,)),
}


@pytest.fixture(scope="module")
def rooms(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    made = make(tmp_path_factory.mktemp("lenses") / "rooms", pairs=1, cameras=CAMERAS)
    add_results(made)
    return Dataset.open(made.path)


def test_cameras_are_read_back_and_found_sound(rooms):
    for record in rooms.pairs:
        assert rooms.load(record.pair_id).camera == CAMERAS[record.scenario]
    assert [finding for finding in validate(rooms.path) if "image" in finding] == []


def test_the_review_shows_them_as_they_were_recorded(rooms, tmp_path):
    rrd = Rrd(save_review(rooms, tmp_path / "review.rrd", thin=1).path)
    resolutions = rrd.rows("/camera", "Pinhole:resolution")
    for number, record in enumerate(rooms.pairs):
        camera = CAMERAS[record.scenario]
        shown = resolutions[max(time for time in resolutions if time <= number)][0]
        assert shown == [camera.width, camera.height]
        blob = rrd.rows(f"/camera/image/{record.scenario}/jpeg", "EncodedImage:blob")[number][0]
        assert bytes(blob) == (rooms.path / record.image).read_bytes()
        overlay = rrd.rows("/overlays/ground_truth/cloud", "Points2D:positions")[number]
        assert len(overlay) > 20
        assert (np.max(overlay, axis=0) < [camera.width, camera.height]).all()
    assert f"/overlays/{GOOD}/cloud" in rrd.entities


@pytest.mark.parametrize("name", CAMERAS)
def test_points_are_drawn_on_the_raw_image(rooms, name):
    """Walls' colours in the picture and in the cloud agree, to the sides and behind, too."""
    record = next(record for record in rooms.pairs if record.scenario == name)
    pair = rooms.load(record.pair_id)
    points = pair.points[np.isfinite(pair.points).all(axis=1)]
    reach = np.sort(np.abs(points), axis=1)
    points = points[reach[:, 2] - reach[:, 1] > 0.2]  # colours blur where walls meet
    axis = np.argmax(np.abs(points), axis=1)
    wall = 2 * axis + (points[np.arange(len(points)), axis] > 0)
    in_camera = se3.apply(pair.T_camera_lidar, points)
    pixels, inside = pair.camera.project(in_camera)
    assert (in_camera[inside, 2] < 0).any() == (name in ("omni", "panorama", "fisheye"))
    columns, rows = np.round(pixels[inside]).astype(int).T
    colours = pair.image[rows, columns].astype(int)
    seen = wall[inside]
    typical = {number: np.median(colours[seen == number], axis=0) for number in np.unique(seen)}
    apart = np.abs(colours - np.array([typical[number] for number in seen])).max(axis=1)
    assert np.mean(apart < 25) > 0.95
    near, far = depth_range(pair, pair.T_camera_lidar)
    assert 0 < near < far < 6
    picture = draw_overlay(pair, pair.T_camera_lidar)
    assert picture.shape == pair.image.shape
