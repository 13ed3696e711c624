from __future__ import annotations

import json
import pickle
from dataclasses import replace

import numpy as np
import pytest
from line_scene import errors
from nid_scene import textured_pair

from lcdata.calibrators import available, calibrate, create
from lcdata.calibrators.wide_verdict import doubts
from lcdata.errors import CalibrationError
from lcdata.evaluation.protocol import perturb
from lcdata.features.wide_search import FINE, MIDDLE, passes
from lcdata.geometry import se3
from lcdata.geometry.camera import Camera
from lcdata.pair import Pair


def usable(result):
    """No NaN where a number is promised, and a reason where there is doubt."""
    assert np.isfinite(result.T_camera_lidar).all()
    np.testing.assert_allclose(
        result.T_camera_lidar[:3, :3] @ result.T_camera_lidar[:3, :3].T, np.eye(3), atol=1e-9
    )
    assert result.converged != bool(result.message)
    return result


def test_is_registered_with_frozen_parameters():
    assert "wide" in available()
    method = create("wide", search_rotation_deg=3.0)
    with pytest.raises(AttributeError):
        method.seed = 1
    features = method.prepare(textured_pair(0, points=2000))
    again = pickle.loads(pickle.dumps(features))
    assert np.array_equal(again.distance, features.distance)


@pytest.mark.parametrize(
    ("parameters", "error"),
    [
        ({"search_rotation_deg": 0}, "search_rotation_deg is 0"),
        ({"search_translation_m": float("nan")}, "search_translation_m is nan"),
        ({"min_pairs": 2.5}, "min_pairs is 2.5"),
        ({"seed": -1}, "seed is -1"),
    ],
)
def test_impossible_parameters(parameters, error):
    with pytest.raises(CalibrationError, match=error):
        create("wide", **parameters)


def test_a_near_guess_needs_no_wide_pass():
    assert passes(1.4, 0.14) == (MIDDLE, FINE)
    wide = passes(7.0, 0.7)
    assert wide[1:] == (MIDDLE, FINE)
    np.testing.assert_allclose(wide[0].box, np.repeat([np.deg2rad(7.0), 0.7], 3))


def test_one_pair_is_of_low_confidence_and_repeatable():
    pair = textured_pair(10, points=8000)
    start = perturb(pair.T_camera_lidar, 1.0, 0.1, np.random.default_rng(0))
    method = create("wide", search_rotation_deg=1.5, search_translation_m=0.15)
    prepared = [method.prepare(pair)]
    first, again = (usable(method.calibrate([pair], start, prepared)) for _ in range(2))
    assert np.array_equal(first.T_camera_lidar, again.T_camera_lidar)
    assert not first.converged
    assert "low confidence: 1 different scenes" in first.message
    assert first.cost_final < first.cost_initial
    rotation, translation = errors(first.T_camera_lidar, pair.T_camera_lidar)
    assert rotation < 0.3
    assert translation < 0.05


def test_copies_of_a_pair_are_no_evidence():
    pair = textured_pair(11, points=1500)
    start = perturb(pair.T_camera_lidar, 0.5, 0.05, np.random.default_rng(0))
    result = usable(
        calibrate(
            [pair] * 2,
            start,
            method="wide",
            search_rotation_deg=1.0,
            search_translation_m=0.1,
            min_pairs=2,
        )
    )
    assert not result.converged
    assert "1 different scenes in 2 pairs" in result.message


@pytest.mark.parametrize("what", ["grey", "no intensity", "dark", "nan", "fisheye", "far off"])
def test_unusual_input(what):
    pair = textured_pair(12, points=12000 if what == "nan" else 4000)
    T = pair.T_camera_lidar
    if what == "no intensity":
        pair = replace(pair, intensity=None)
    elif what == "dark":
        pair = replace(pair, intensity=np.zeros(len(pair.points), np.float32))
    elif what == "nan":
        pair.points[::3] = np.nan
        pair.intensity[1::3] = np.nan
    elif what == "grey":
        pair = replace(pair, image=np.repeat(pair.image[..., None], 3, axis=2))
    elif what == "fisheye":
        camera = Camera("fisheye", 640, 400, (250, 250, 320, 200), (0.01, 0.0, 0.0, 0.0))
        pair = replace(pair, camera=camera)
    else:
        T = se3.exp([0, 0, 0, 0, np.pi, 0]) @ T  # looks away: nothing in view
    result = usable(
        calibrate(pair, T, method="wide", search_rotation_deg=1.0, search_translation_m=0.1)
    )
    assert not result.converged
    if what in ("grey", "nan"):
        assert errors(result.T_camera_lidar, pair.T_camera_lidar)[0] < 0.5


def test_unusable_input():
    pair = textured_pair(13, points=1000)
    with pytest.raises(CalibrationError, match="0 of 0 points"):
        empty = Pair(pair.image, np.zeros((0, 3), np.float32), None, pair.camera)
        calibrate(empty, np.eye(4), method="wide")
    with pytest.raises(CalibrationError, match="all pixels are 7"):
        blank = replace(pair, image=np.full_like(pair.image, 7))
        calibrate(blank, np.eye(4), method="wide")
    with pytest.raises(CalibrationError, match="needs an initial guess"):
        calibrate(pair, None, method="wide")


def road(shared, frames):
    """Real pairs and their reference."""
    import cv2
    from pypcd4 import PointCloud

    folder = shared / "data" / "kitti_road"
    reference = json.loads((folder / "reference.json").read_text())
    T = se3.check_transform(reference["T_camera_lidar"])
    pairs = []
    for path in sorted(folder.glob("*.pcd"))[frames]:
        cloud = PointCloud.from_path(path)
        image = cv2.imread(str(path.with_suffix(".png")))[:, :, ::-1].copy()
        camera = Camera("pinhole", image.shape[1], image.shape[0], tuple(reference["K"]))
        points = cloud.numpy(("x", "y", "z")).astype(np.float32)
        pairs.append(Pair(image, points, cloud.numpy(("intensity",))[:, 0], camera))
    return pairs, np.asarray(T)


@pytest.mark.slow
def test_five_real_frames_from_far_off(shared):
    pairs, T = road(shared, slice(0, 5))
    start = perturb(T, 5.0, 0.5, np.random.default_rng(77))
    result = usable(calibrate(pairs, start, method="wide"))
    rotation, translation = errors(result.T_camera_lidar, T)
    assert rotation < 0.5
    assert translation < 0.1
    assert 0.3 < se3.sigma_distance(result.T_camera_lidar, T, result.covariance) < 8.0


@pytest.mark.slow
def test_halves_that_disagree_are_doubted(shared):
    """A joint pose that neither half finds, and one reference that all find."""
    from lcdata.features.wide_objective import images

    pairs, T = road(shared, slice(0, 4))
    features = [create("wide").prepare(pair) for pair in pairs]
    rng = np.random.default_rng(0)
    pictures = images(features, rng)
    wrong = perturb(T, 1.0, 0.2, rng)
    found = doubts(features, pictures, T, wrong, passes(1.0, 0.1), (0.1, 0.5, 4), rng)
    assert len(found) == 1
    assert "alone ends" in found[0]
