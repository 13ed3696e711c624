from __future__ import annotations

import json
import pickle
from dataclasses import replace

import numpy as np
import pytest
from line_scene import CAMERA, errors, features, perturbed, world

from lcdata.calibrators import available, calibrate, create
from lcdata.errors import CalibrationError
from lcdata.geometry import se3
from lcdata.geometry.camera import Camera
from lcdata.pair import Pair

METHODS = ("projection", "plk")
NOTHING = Pair(np.zeros((720, 1280), np.uint8), np.zeros((0, 3), np.float32), None, CAMERA)


def usable(result):
    """No NaN where a number is promised."""
    assert np.isfinite(result.T_camera_lidar).all()
    np.testing.assert_allclose(
        result.T_camera_lidar[:3, :3] @ result.T_camera_lidar[:3, :3].T, np.eye(3), atol=1e-9
    )
    assert result.seconds > 0
    return result


def test_methods_are_registered_with_frozen_parameters():
    assert set(METHODS) <= set(available())
    method = create("plk", search_rotation_deg=5.0, decoupled=True)
    assert method.search_rotation_deg == 5.0
    with pytest.raises(AttributeError):
        method.seed = 3
    assert pickle.loads(pickle.dumps(method)) == method


@pytest.mark.parametrize("method", METHODS)
def test_calibrates_from_five_degrees_and_half_a_metre(method):
    found = []
    for seed in range(3):
        T, lines = world(seed)
        start = perturbed(T, np.random.default_rng(seed))
        result = usable(create(method).calibrate([NOTHING], start, [lines]))
        found.append(errors(result.T_camera_lidar, T))
        assert result.cost_final < result.cost_initial
        assert result.covariance.shape == (6, 6)
        assert len(result.matches.points_lidar) == len(result.matches.points_image)
    assert np.median(found, axis=0)[0] < 0.2
    assert np.max(found, axis=0)[0] < 1.0


def test_result_is_repeatable():
    T, lines = world(4)
    start = perturbed(T, np.random.default_rng(4))
    first = create("projection").calibrate([NOTHING], start, [lines])
    again = create("projection").calibrate([NOTHING], start, [lines])
    assert np.array_equal(first.T_camera_lidar, again.T_camera_lidar)


def test_matched_lines_lie_on_each_other():
    T, lines = world(4)
    start = perturbed(T, np.random.default_rng(4))
    result = create("projection").calibrate([NOTHING], start, [lines])
    assert result.converged, result.message
    middle = se3.apply(result.T_camera_lidar, result.matches.points_lidar.mean(1))
    pixels, _ = CAMERA.project(middle)
    a, b = result.matches.points_image[:, 0], result.matches.points_image[:, 1]
    along = (b - a) / np.linalg.norm(b - a, axis=1, keepdims=True)
    offset = pixels - a
    distance = np.abs(offset[:, 0] * along[:, 1] - offset[:, 1] * along[:, 0])
    assert np.median(distance) < 2.0
    assert (result.matches.pair_index == 0).all()


@pytest.mark.parametrize("method", METHODS)
def test_lines_of_another_place_are_not_called_converged(method):
    wrong = 0
    for seed in range(5):
        T, lines = world(seed)
        _, other = world(seed + 20)
        mixed = replace(lines, image_lines=other.image_lines, fields=other.fields)
        start = perturbed(T, np.random.default_rng(seed))
        result = usable(create(method).calibrate([NOTHING], start, [mixed]))
        assert result.converged or result.message
        wrong += result.converged
    assert wrong == 0


@pytest.mark.parametrize("method", METHODS)
def test_parallel_lines_are_degenerate(method):
    rng = np.random.default_rng(0)
    place = rng.uniform([4, -5, -1], [15, 5, 1], (25, 3))
    up = np.array([0, 0, 1.0])
    segments = np.stack([place - up, place + up], 1)
    T = np.eye(4)
    T[:3, :3] = [[0, -1, 0], [0, 0, -1], [1, 0, 0]]
    pixels, _ = CAMERA.project(se3.apply(T, segments.reshape(-1, 3)))
    result = create(method).calibrate([NOTHING], T, [features(pixels.reshape(-1, 4), segments)])
    usable(result)
    assert result.degenerate
    assert not result.converged
    assert result.message


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(
    "points",
    [
        np.zeros((0, 3), np.float32),
        np.full((500, 3), np.nan, np.float32),
        np.zeros((500, 3), np.float32),
        np.full((500, 3), np.inf, np.float32),
        np.ones((1, 3), np.float64),
    ],
    ids=["empty", "nan", "zeros", "inf", "one"],
)
def test_clouds_without_lines_give_the_initial_guess_back(method, points):
    rng = np.random.default_rng(0)
    image = rng.integers(0, 255, (720, 1280), dtype=np.uint8)
    pair = Pair(image, points, np.ones(len(points), np.float32), CAMERA)
    initial = se3.exp([0.1, 0.2, 0.3, 0.1, 0.2, 0.3])
    result = usable(calibrate(pair, initial, method=method))
    assert not result.converged
    assert "0 in the cloud" in result.message
    np.testing.assert_allclose(result.T_camera_lidar, initial)


def test_blank_image_and_random_cloud():
    rng = np.random.default_rng(0)
    points = rng.normal(size=(64 * 512, 3)).astype(np.float32) * 10
    image = np.full((720, 1280, 3), 90, np.uint8)
    pair = Pair(image, points, None, CAMERA, organised=(64, 512))
    result = usable(calibrate(pair, np.eye(4), method="projection"))
    assert not result.converged
    assert "0 in the image" in result.message


def test_no_pairs_and_no_initial_guess_are_errors():
    with pytest.raises(CalibrationError, match="0 pairs"):
        create("plk").calibrate([], np.eye(4))
    with pytest.raises(CalibrationError, match="initial guess None"):
        create("plk").calibrate([NOTHING], None)


def test_some_pairs_prepared_and_some_not():
    T, lines = world(4)
    start = perturbed(T, np.random.default_rng(4))
    result = create("projection").calibrate([NOTHING, NOTHING], start, [lines, None])
    assert errors(result.T_camera_lidar, T)[0] < 0.3


@pytest.mark.slow
@pytest.mark.parametrize("scenario", ["gym", "parking_lot", "yard"])
def test_simulated_pairs_from_five_degrees_and_half_a_metre(scenario):
    """A smaller scan than the full one, to keep it short; benchmarks/line_calibration.py is it."""
    from lcdata.simulation import render_pair

    found = []
    for pose in range(2):
        pair = render_pair(scenario, pose_index=pose, pair_index=0, seed=7, columns=1024)
        start = perturbed(pair.T_camera_lidar, np.random.default_rng(pose))
        for method in METHODS:
            calibrator = create(method)
            result = usable(calibrator.calibrate([pair], start))
            rotation, translation = errors(result.T_camera_lidar, pair.T_camera_lidar)
            found.append((rotation, translation))
            assert not result.converged or (rotation < 0.5 and translation < 0.1)
    rotation, translation = np.median(found, axis=0)
    assert rotation < 0.3
    assert translation < 0.05


@pytest.mark.slow
def test_real_road_scans_are_never_confidently_wrong(shared):
    """Road scenes are hard for lines: a result may fail, but must say so."""
    from pypcd4 import PointCloud

    reference = json.loads((shared / "data/kitti_road/reference.json").read_text())
    T = np.array(reference["T_camera_lidar"])
    import cv2

    wrong = []
    for path in sorted((shared / "data/kitti_road").glob("*.pcd"))[:4]:
        cloud = PointCloud.from_path(path)
        image = cv2.imread(str(path.with_suffix(".png")))[:, :, ::-1].copy()
        camera = Camera("pinhole", image.shape[1], image.shape[0], tuple(reference["K"]))
        points = cloud.numpy(("x", "y", "z")).astype(np.float32)
        pair = Pair(image, points, cloud.numpy(("intensity",))[:, 0], camera)
        start = perturbed(T, np.random.default_rng(0))
        result = usable(calibrate(pair, start, method="projection"))
        rotation, translation = errors(result.T_camera_lidar, T)
        if result.converged and (rotation > 0.5 or translation > 0.1):
            wrong.append((path.name, rotation, translation))
    assert not wrong


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(
    ("hold", "offset", "box"),
    [
        ("rotation", [0.0, 4.0, 0.0, 0.0, 0.0, 0.0], {"search_translation_m": 5.0}),
        ("translation", [0.0, 0.0, 0.0, 0.0, 0.0, 0.4], {"search_rotation_deg": 28.0}),
    ],
)
def test_half_of_the_extrinsic_can_be_held(method, hold, offset, box):
    """PLK-Calib's Figure 6: far off in the other half."""
    found = []
    for seed in range(3):
        T, lines = world(seed)
        start = T @ se3.exp(offset)
        result = usable(create(method, hold=hold, **box).calibrate([NOTHING], start, [lines]))
        part = np.s_[:3, :3] if hold == "rotation" else np.s_[:3, 3]
        np.testing.assert_allclose(result.T_camera_lidar[part], T[part], atol=1e-12)
        degrees, metres = errors(result.T_camera_lidar, T)
        found.append(degrees < 0.5 and metres < 0.1)
        assert found[-1] or not result.converged
    assert sum(found) >= 2  # one of the three shows ten lines among clutter


def test_what_cannot_be_held_is_named():
    with pytest.raises(CalibrationError, match="hold is 'everything'"):
        create("projection", hold="everything")
