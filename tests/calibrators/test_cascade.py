from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from line_scene import errors, perturbed
from nid_scene import textured_pair

from lcdata.calibrators import available, calibrate, create
from lcdata.calibrators.base import Calibration
from lcdata.calibrators.evidence import Finding
from lcdata.errors import CalibrationError
from lcdata.geometry import se3
from lcdata.geometry.camera import Camera
from lcdata.pair import Pair
from lcdata.simulation import render_pair

KITTI = Path(__file__).parents[3] / "shared" / "data" / "kitti_road"


@pytest.fixture(scope="module")
def yard():
    return render_pair("yard", seed=31, columns=1024, width=960, height=540)


@pytest.fixture(scope="module")
def joint(yard):
    """The cascade in the yard from far off: method, start, what it kept, and its result."""
    method = create("cascade")
    prepared = [method.prepare(yard)]
    assert prepared[0].features == {}
    start = perturbed(yard.T_camera_lidar, np.random.default_rng(0), 5.0, 0.5)
    return method, start, prepared, method.calibrate([yard], start, prepared)


def test_is_registered():
    assert "cascade" in available()
    with pytest.raises(CalibrationError, match="search_rotation_deg is 0"):
        create("cascade", search_rotation_deg=0)


def test_lines_are_confirmed_and_refined_by_intensities(yard, joint):
    _, start, prepared, found = joint
    lines = create("projection").calibrate([yard], start, [prepared[0].features["projection"]])
    assert found.converged, found.message
    assert "projection converged; averaged with intensities and edges" in found.message
    rotation, translation = errors(found.T_camera_lidar, yard.T_camera_lidar)
    assert rotation < 0.15
    assert translation < 0.03
    sigma = [np.sqrt(np.trace(r.covariance[:3, :3])) for r in (found, lines)]
    assert sigma[0] < sigma[1]
    assert se3.sigma_distance(found.T_camera_lidar, yard.T_camera_lidar, found.covariance) < 5.0
    assert len(found.matches.pair_index) == len(lines.matches.pair_index)


def test_features_are_made_once_and_only_what_is_asked_for(yard, joint):
    method, start, prepared, _ = joint
    assert set(prepared[0].features) == {"projection", "nid_edge"}
    kept = dict(prepared[0].features)
    method.calibrate([yard], start, prepared)
    assert all(prepared[0].features[name] is features for name, features in kept.items())


def finding(name, converged):
    nothing = np.full((6, 6), np.nan)
    return Finding(name, Calibration(np.eye(4), converged, False, nothing, 0.0, 2.0, 1.0))


def test_only_what_halves_have_tested_may_be_twice_as_uncertain():
    method = create("cascade", max_rotation_sigma_deg=0.2, max_translation_sigma_m=0.04)
    assert method._limits(finding("wide", True)) == (0.08, 0.4)
    assert method._limits(finding("wide", False)) == (0.04, 0.2)
    assert method._limits(finding("projection", True)) == (0.04, 0.2)


def test_without_intensities_there_is_no_second_witness(yard):
    start = perturbed(yard.T_camera_lidar, np.random.default_rng(0), 5.0, 0.5)
    found = calibrate(replace(yard, intensity=None), start, method="cascade")
    assert not found.converged
    assert "nothing else to confirm it" in found.message
    assert errors(found.T_camera_lidar, yard.T_camera_lidar)[1] < 0.1


def test_another_pairs_image_is_a_failure_that_says_its_steps(yard):
    other = render_pair("gym", seed=31, lidar="os1_64", columns=512, width=960, height=540)
    mixed = replace(yard, image=other.image)
    near = {"search_rotation_deg": 3.0, "search_translation_m": 0.3}
    found = calibrate(mixed, yard.T_camera_lidar, method="cascade", **near)
    assert not found.converged
    assert "projection did not converge" in found.message
    assert "wide did not converge" in found.message
    assert np.isfinite(found.T_camera_lidar).all()


def test_nothing_in_view_ends_at_the_initial_guess():
    pair = textured_pair(3)
    away = se3.exp([0, 0, 0, 0, np.pi, 0]) @ pair.T_camera_lidar
    found = calibrate(pair, away, method="cascade")
    assert not found.converged
    assert found.message
    assert np.isfinite(found.T_camera_lidar).all()


@pytest.mark.slow
def test_real_roads_are_right_or_not_called_converged():
    if not KITTI.is_dir():
        pytest.skip("no ../shared/data/kitti_road beside the checkout")
    import cv2
    from pypcd4 import PointCloud

    reference = json.loads((KITTI / "reference.json").read_text())
    T = se3.check_transform(reference["T_camera_lidar"])
    pairs = []
    for path in sorted(KITTI.glob("*.pcd"))[:5]:
        image = cv2.imread(str(path.with_suffix(".png")))[:, :, ::-1].copy()
        cloud = PointCloud.from_path(path)
        camera = Camera("pinhole", image.shape[1], image.shape[0], tuple(reference["K"]))
        points = cloud.numpy(("x", "y", "z")).astype(np.float32)
        pairs.append(Pair(image, points, cloud.numpy(("intensity",))[:, 0], camera))
    start = perturbed(T, np.random.default_rng(4), 5.0, 0.5)
    found = calibrate(pairs, start, method="cascade")
    rotation, translation = errors(found.T_camera_lidar, T)
    assert rotation < 0.5
    assert translation < 0.1
    assert "projection did not converge" in found.message
    alone = calibrate(pairs[:1], start, method="cascade")
    assert not alone.converged
