"""Guesses from nothing: success on simulated pairs, honesty elsewhere, bad input named."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from lcdata import Camera, Pair, calibrate
from lcdata.calibrators.initial_guess import guess
from lcdata.errors import CalibrationError
from lcdata.geometry import se3

CAMERA = Camera("pinhole", 320, 240, (200.0, 200.0, 159.5, 119.5))


def errors(T: np.ndarray, truth: np.ndarray) -> tuple[float, float]:
    return np.rad2deg(se3.rotation_error(T, truth)), se3.translation_error(T, truth)


def blank() -> Pair:
    points = np.random.default_rng(0).normal(size=(500, 3)) * 5
    return Pair(np.full((240, 320), 90, np.uint8), points, None, CAMERA)


def test_bad_input_is_named() -> None:
    with pytest.raises(CalibrationError, match="no pairs to guess from"):
        guess([])
    with pytest.raises(CalibrationError, match=r"no option 'rout'.*route"):
        guess(blank(), rout="edges")
    with pytest.raises(CalibrationError, match=r"unknown route 'magic'.*auto, edges, matching"):
        guess(blank(), route="magic")
    with pytest.raises(CalibrationError, match=r"rotate_lidar is 45.*0, 90, 180 or 270"):
        guess(blank(), rotate_lidar=45)
    with pytest.raises(CalibrationError, match=r"0 lines in the image.*pick matches by hand"):
        guess(blank(), route="edges")
    with pytest.raises(CalibrationError, match="no initial guess 'automatic'"):
        calibrate(blank(), "automatic", method="plk")


def test_nothing_to_match_is_named() -> None:
    with pytest.raises(CalibrationError, match=r"matched points agree on a rotation.*lcdata pick"):
        guess(blank(), route="matching")


@pytest.mark.slow
@pytest.mark.parametrize("lidar", ["os1_128", "avia"])
def test_a_simulated_pair_is_solved_from_nothing(lidar: str) -> None:
    from lcdata.simulation import render_pair

    pair = render_pair("yard", seed=11, lidar=lidar)
    found = guess(pair)
    rotation, translation = errors(found.T_camera_lidar, pair.T_camera_lidar)
    assert found.converged, found.message
    assert rotation < 1.0
    assert translation < 0.5


@pytest.mark.slow
def test_one_frame_of_a_real_road_is_not_called_solved_when_it_is_not() -> None:
    shared = Path(__file__).parents[2].parent / "shared" / "data" / "kitti_road"
    if not shared.is_dir():
        pytest.skip("no shared data beside the repository")
    import cv2
    from pypcd4 import PointCloud

    reference = json.loads((shared / "reference.json").read_text())
    for path in sorted(shared.glob("*.pcd"))[:2]:
        cloud = PointCloud.from_path(path)
        image = cv2.imread(str(path.with_suffix(".png")))[:, :, ::-1].copy()
        camera = Camera("pinhole", image.shape[1], image.shape[0], tuple(reference["K"]))
        points = cloud.numpy(("x", "y", "z")).astype(np.float32)
        found = guess(Pair(image, points, cloud.numpy(("intensity",))[:, 0], camera))
        rotation, translation = errors(found.T_camera_lidar, np.array(reference["T_camera_lidar"]))
        assert not found.converged or (rotation < 1.0 and translation < 0.5)
        assert found.converged or found.message
