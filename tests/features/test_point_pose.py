from __future__ import annotations

import numpy as np
import pytest

from lcdata.errors import CalibrationError
from lcdata.features.point_pose import point_pose
from lcdata.geometry import se3
from lcdata.geometry.camera import Camera

PINHOLE = Camera(
    "pinhole", 1280, 720, (530.0, 529.0, 648.0, 366.0), (-0.042, 0.011, -0.0003, 0.0005, -0.005)
)
FISHEYE = Camera("fisheye", 1200, 1200, (340.0, 340.0, 600.0, 600.0), (0.02, -0.01, 0.0, 0.0))
OMNI = Camera("omni", 1200, 1200, (1.2, 640.0, 640.0, 600.0, 600.0), (-0.1, 0.02, 0.0, 0.0))
AROUND = Camera("equirectangular", 2048, 1024)
CAMERAS = {"pinhole": PINHOLE, "fisheye": FISHEYE, "omni": OMNI, "equirectangular": AROUND}

CAMERA_AXES = np.array([[0, -1, 0, 0], [0, 0, -1, 0], [1, 0, 0, 0], [0, 0, 0, 1.0]])
"""x forward, z up to x right, y down."""


def pose(seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return se3.exp([*rng.normal(0, 0.4, 3), *rng.normal(0, 0.5, 3)]) @ CAMERA_AXES


def scene(camera: Camera, count: int, seed: int, noise: float = 0.0) -> tuple:
    """Points of a room that the camera sees, their pixels, and the truth."""
    rng = np.random.default_rng([seed, count])
    T = pose(seed)
    points = np.empty((0, 3))
    while len(points) < count:
        more = rng.uniform(-1, 1, (400, 3)) * [8, 8, 2.5]
        more = more[np.linalg.norm(more, axis=1) > 1.5]
        inside = camera.project(se3.apply(T, more))[1]
        points = np.concatenate([points, more[inside]])[:count]
    pixels = camera.project(se3.apply(T, points))[0] + rng.normal(0, noise, (count, 2))
    if noise:
        pixels = np.clip(pixels, 0, [camera.width - 1, camera.height - 1])
    return points, pixels, T


@pytest.mark.parametrize("name", CAMERAS)
@pytest.mark.parametrize("count", [4, 6, 40])
def test_exact_matches_give_the_exact_pose(name, count):
    camera = CAMERAS[name]
    for seed in range(3):
        points, pixels, T = scene(camera, count, seed)
        found = point_pose(points, pixels, camera)
        poses = [found.T_camera_lidar, *found.others]
        nearest = min(poses, key=lambda other: se3.translation_error(T, other))
        assert se3.rotation_error(T, nearest) < 1e-6
        assert se3.translation_error(T, nearest) < 1e-5
        if count > 4:
            assert not found.others and found.inliers.all() and found.rms_px < 1e-3


def test_noise_is_predicted_by_the_covariance():
    distances = []
    for seed in range(20):
        points, pixels, T = scene(PINHOLE, 12, seed, noise=2.0)
        found = point_pose(points, pixels, PINHOLE)
        distances.append(se3.sigma_distance(found.T_camera_lidar, T, found.covariance))
    # Chi-squared with 6 degrees of freedom; the kernel costs a little.
    assert 3.5 < np.mean(np.square(distances)) < 12.0


def test_a_third_of_wrong_matches_is_told_apart():
    for seed in range(5):
        points, pixels, T = scene(PINHOLE, 15, seed, noise=0.5)
        wrong = np.random.default_rng(seed).choice(15, 5, replace=False)
        pixels[wrong] = np.random.default_rng(seed).uniform([50, 50], [1200, 650], (5, 2))
        found = point_pose(points, pixels, PINHOLE)
        assert se3.rotation_error(found.T_camera_lidar, T) < np.deg2rad(0.5)
        assert se3.translation_error(found.T_camera_lidar, T) < 0.05
        far = np.setdiff1d(np.flatnonzero(~found.inliers), wrong)
        assert not len(far)
        assert any("px off: remove it or pick it again" in line for line in found.warnings)


def test_three_matches_are_said_to_be_ambiguous_and_a_hint_chooses():
    several = 0
    for seed in range(10):
        points, pixels, T = scene(PINHOLE, 3, seed)
        found = point_pose(points, pixels, PINHOLE, initial=T)
        assert se3.rotation_error(found.T_camera_lidar, T) < 1e-5
        assert "pick one more" in found.warnings[0]
        several += bool(found.others)
    assert several


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        (lambda p, u: (p[:2], u[:2]), "2 matches: give 3 or more"),
        (lambda p, u: (p, u[:-1]), "8 points and 7 pixels"),
        (lambda p, u: (p, np.r_[u[:-1], [[np.nan, 1]]]), "match 8 is not finite"),
        (lambda p, u: (p, np.r_[u[:-1], [[1280, 1]]]), r"match 8: pixel \(1280.0, 1.0\)"),
        (lambda p, u: (p, np.r_[u[:-1], u[:1]]), "matches 1 and 8 have the same pixel"),
        (lambda p, u: (np.r_[p[:-1], p[:1]], u), "matches 1 and 8 have the same point"),
        (
            lambda p, u: (np.outer(np.arange(1, 9), [1, 2, 0.5]), u),
            "all 8 points are on one line",
        ),
        (lambda p, u: (p * [1, -1, 1], u), "fit a mirrored scene: left and right are swapped"),
    ],
)
def test_matches_that_give_no_pose_are_refused(change, expected):
    points, pixels, _ = scene(PINHOLE, 8, 1)
    with pytest.raises(CalibrationError, match=expected):
        point_pose(*change(points, pixels), PINHOLE)


def test_picks_close_together_are_said_to_leave_the_pose_open():
    points, _, T = scene(PINHOLE, 8, 3)
    near = points[0] + (points - points.mean(0)) * 0.08
    pixels = PINHOLE.project(se3.apply(T, near))[0]
    found = point_pose(near, pixels, PINHOLE)
    assert any("open: pick farther apart" in line for line in found.warnings)
