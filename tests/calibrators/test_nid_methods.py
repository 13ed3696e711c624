from __future__ import annotations

import json
import pickle
from dataclasses import replace

import numpy as np
import pytest
from line_scene import errors, perturbed
from nid_scene import CAMERA, textured_pair

from lcdata.calibrators import available, calibrate, create
from lcdata.errors import CalibrationError
from lcdata.geometry import se3
from lcdata.geometry.camera import Camera
from lcdata.pair import Pair

METHODS = ("nid", "nid_edge")


def usable(result):
    """No NaN where a number is promised."""
    assert np.isfinite(result.T_camera_lidar).all()
    np.testing.assert_allclose(
        result.T_camera_lidar[:3, :3] @ result.T_camera_lidar[:3, :3].T, np.eye(3), atol=1e-9
    )
    assert result.seconds > 0
    assert result.converged != bool(result.message)
    return result


def test_methods_are_registered_with_frozen_parameters():
    assert set(METHODS) <= set(available())
    method = create("nid", solver="bfgs", search_rotation_deg=1.0)
    with pytest.raises(AttributeError):
        method.solver = "global"
    assert pickle.loads(pickle.dumps(method)) == method
    features = method.prepare(textured_pair(0, points=1000))
    assert len(pickle.loads(pickle.dumps(features)).points) == len(features.points)


@pytest.mark.parametrize(
    ("parameters", "error"),
    [
        ({"solver": "newton"}, "solver is 'newton'"),
        ({"search_rotation_deg": 0}, "search_rotation_deg is 0"),
        ({"rounds": 1.5}, "rounds is 1.5"),
        ({"search_samples": True}, "search_samples is True"),
    ],
)
def test_impossible_parameters(parameters, error):
    with pytest.raises(CalibrationError, match=error):
        create("nid", **parameters)


@pytest.mark.parametrize(
    ("solver", "degrees", "metres"),
    [("global", 1.0, 0.1), ("bfgs", 0.3, 0.03), ("nelder_mead", 0.3, 0.03)],
)
def test_recovers_a_known_pose(solver, degrees, metres):
    pair = textured_pair(10)
    start = perturbed(pair.T_camera_lidar, np.random.default_rng(0), degrees, metres)
    result = usable(calibrate(pair, start, method="nid", solver=solver))
    rotation, translation = errors(result.T_camera_lidar, pair.T_camera_lidar)
    assert rotation < 0.15
    assert translation < 0.02
    assert result.cost_final < result.cost_initial
    assert result.converged, result.message
    sigma = np.sqrt(np.diag(result.covariance))
    assert 1e-4 < sigma[:3].max() < 0.05


def test_result_is_repeatable():
    pair = textured_pair(11)
    start = perturbed(pair.T_camera_lidar, np.random.default_rng(0), 1.0, 0.1)
    method = create("nid")
    prepared = [method.prepare(pair)]
    first, again = (method.calibrate([pair], start, prepared) for _ in range(2))
    assert np.array_equal(first.T_camera_lidar, again.T_camera_lidar)
    assert np.array_equal(first.covariance, again.covariance)


@pytest.mark.parametrize(
    "camera",
    [
        Camera("fisheye", 640, 480, (260, 260, 320, 240), (0.02, -0.01, 0.002, 0.0)),
        pytest.param(Camera("equirectangular", 1200, 600, ()), marks=pytest.mark.slow),
    ],
    ids=["fisheye", "equirectangular"],
)
def test_works_on_the_raw_image_of_other_cameras(camera):
    pair = textured_pair(12, camera=camera)
    start = perturbed(pair.T_camera_lidar, np.random.default_rng(0), 0.7, 0.07)
    result = usable(calibrate(pair, start, method="nid"))
    rotation, translation = errors(result.T_camera_lidar, pair.T_camera_lidar)
    assert rotation < 0.1
    assert translation < 0.03


def test_several_pairs_are_better_than_one():
    T = textured_pair(20).T_camera_lidar
    pairs = []
    for seed in range(20, 23):
        pair = textured_pair(seed, points=4000, noise=0.3)
        points = se3.apply(se3.inverse(T) @ pair.T_camera_lidar, pair.points).astype(np.float32)
        pairs.append(replace(pair, points=points, T_camera_lidar=T))
    start = perturbed(T, np.random.default_rng(1), 0.3, 0.03)

    def found(pairs):
        return errors(calibrate(pairs, start, method="nid", solver="bfgs").T_camera_lidar, T)

    single = np.mean([found(pair) for pair in pairs], axis=0)
    assert (np.array(found(pairs)) < single).all()


@pytest.mark.parametrize("method", ["nid", pytest.param("nid_edge", marks=pytest.mark.slow)])
def test_an_image_of_another_place_is_not_called_converged(method):
    for seed in range(1):
        pair, other = textured_pair(30 + seed), textured_pair(40 + seed)
        mixed = replace(pair, image=other.image)
        start = perturbed(pair.T_camera_lidar, np.random.default_rng(seed), 1.0, 0.1)
        assert not usable(calibrate(mixed, start, method=method)).converged


@pytest.mark.slow
def test_a_guess_farther_off_than_the_box_is_not_called_converged_where_it_is_wrong():
    pair = textured_pair(32)
    start = perturbed(pair.T_camera_lidar, np.random.default_rng(0), 6.0, 0.5)
    result = usable(calibrate(pair, start, method="nid"))
    rotation, translation = errors(result.T_camera_lidar, pair.T_camera_lidar)
    assert not result.converged or (rotation < 0.5 and translation < 0.1)


@pytest.mark.parametrize("method", METHODS)
def test_pairs_without_usable_intensities_are_refused(method):
    pair = textured_pair(0, points=1000)
    with pytest.raises(CalibrationError, match="no intensity field"):
        calibrate(replace(pair, intensity=None), np.eye(4), method=method)
    flat = replace(pair, intensity=np.full(1000, 7.0, np.float32))
    with pytest.raises(CalibrationError, match="all intensities are 7"):
        calibrate(flat, np.eye(4), method=method)
    blank = replace(pair, image=np.full_like(pair.image, 90))
    with pytest.raises(CalibrationError, match="all pixels are 90"):
        calibrate(blank, np.eye(4), method=method)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(
    ("turn_deg", "where"), [((0, 180, 0), "% behind the camera"), ((0, 89, 0), "right of it")]
)
def test_no_overlap_says_where_the_points_went(method, turn_deg, where):
    pair = textured_pair(0, points=3000)
    away = se3.exp([0, 0, 0, *np.deg2rad(turn_deg)]) @ pair.T_camera_lidar
    result = usable(calibrate(pair, away, method=method))
    assert not result.converged
    assert result.degenerate
    assert where in result.message
    np.testing.assert_allclose(result.T_camera_lidar, away)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("value", [np.nan, 0.0, np.inf], ids=str)
def test_clouds_without_points_give_the_initial_guess_back(method, value):
    rng = np.random.default_rng(0)
    image = rng.integers(0, 255, (CAMERA.height, CAMERA.width), dtype=np.uint8)
    for count in (0, 500):
        points = np.full((count, 3), value, np.float32)
        pair = Pair(image, points, rng.random(count).astype(np.float32), CAMERA)
        result = usable(calibrate(pair, np.eye(4), method=method))
        assert not result.converged
        assert "the cloud has no points" in result.message


def test_random_intensities_are_not_called_converged():
    pair = textured_pair(33)
    light = np.random.default_rng(0).random(len(pair.points)).astype(np.float32)
    result = usable(calibrate(replace(pair, intensity=light), pair.T_camera_lidar, method="nid"))
    assert not result.converged


def test_no_pairs_and_no_initial_guess_are_errors():
    with pytest.raises(CalibrationError, match="0 pairs"):
        create("nid").calibrate([], np.eye(4))
    with pytest.raises(CalibrationError, match="initial guess None"):
        create("nid").calibrate([textured_pair(0, points=1000)], None)


@pytest.mark.slow
@pytest.mark.parametrize("scenario", ["gym", "parking_lot", "yard"])
def test_simulated_pairs_are_registered_to_a_centimetre(scenario):
    from lcdata.simulation import render_pair

    pair = render_pair(scenario, seed=7, columns=1024)
    start = perturbed(pair.T_camera_lidar, np.random.default_rng(0), 1.0, 0.1)
    for method in METHODS:
        result = usable(calibrate(pair, start, method=method))
        rotation, translation = errors(result.T_camera_lidar, pair.T_camera_lidar)
        assert rotation < 0.25
        assert translation < 0.04
        assert se3.sigma_distance(pair.T_camera_lidar, result.T_camera_lidar, result.covariance) < 8


@pytest.mark.slow
def test_one_real_road_scan_is_never_confidently_wrong(shared):
    """One sparse sweep does not determine the answer: the method has to know."""
    import cv2
    from pypcd4 import PointCloud

    folder = shared / "data" / "kitti_road"
    reference = json.loads((folder / "reference.json").read_text())
    T = np.array(reference["T_camera_lidar"])
    for path in sorted(folder.glob("*.pcd"))[:2]:
        cloud = PointCloud.from_path(path)
        image = cv2.imread(str(path.with_suffix(".png")))[:, :, ::-1].copy()
        camera = Camera("pinhole", image.shape[1], image.shape[0], tuple(reference["K"]))
        points = cloud.numpy(("x", "y", "z")).astype(np.float32)
        pair = Pair(image, points, cloud.numpy(("intensity",))[:, 0], camera)
        start = perturbed(T, np.random.default_rng(0), 1.0, 0.1)
        for method in METHODS:
            result = usable(calibrate(pair, start, method=method))
            rotation, translation = errors(result.T_camera_lidar, T)
            assert not result.converged or (rotation < 0.5 and translation < 0.1)
