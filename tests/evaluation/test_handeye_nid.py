from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from nid_scene import R_CAMERA_LIDAR, textured_pair

from lcdata.errors import CalibrationError, GroundTruthError
from lcdata.evaluation.handeye_nid import solve_nid
from lcdata.geometry import se3


@pytest.fixture(scope="module")
def tower():
    """Five poses of an arm, each with a made-up scene of its own before the camera."""
    rng = np.random.default_rng(0)
    X = se3.exp([0.05, -0.02, 0.08, 0.1, -0.2, 0.05])
    Z = se3.exp([0.1, 0.0, -0.3, 0.02, 0.01, 0.0])
    A, pairs = [], []
    forward = np.eye(4)
    forward[:3, :3] = R_CAMERA_LIDAR
    for seed in range(5):
        turn = se3.exp([*rng.normal(size=3) * 0.2, *rng.uniform(-0.6, 0.6, 3)])
        T = turn @ forward
        A.append(se3.inverse(X) @ T @ se3.inverse(Z))
        pair = textured_pair(seed, points=5000)
        points = se3.apply(se3.inverse(T) @ pair.T_camera_lidar, pair.points).astype(np.float32)
        pairs.append([replace(pair, points=points, T_camera_lidar=T)])
    return X, Z, np.array(A), pairs


def test_links_from_the_intensities_of_all_poses(tower):
    X, Z, A, pairs = tower
    start_X = se3.exp([0.02, -0.015, 0.01, 0.003, -0.004, 0.003]) @ X
    start_Z = se3.exp([-0.01, 0.02, 0.01, -0.003, 0.002, 0.003]) @ Z
    found = solve_nid(pairs, A, start_X, start_Z, rounds=3)
    assert found.cost_final < found.cost_initial
    assert found.observable
    assert found.used.all()
    truth = X @ A @ Z
    for T, T_true in zip(found.extrinsics, truth, strict=True):
        assert np.rad2deg(se3.rotation_error(T, T_true)) < 0.06
        assert se3.translation_error(T, T_true) < 0.01
    assert se3.translation_error(found.T_camera_effector, X) < 0.02


def test_poses_that_see_nothing_are_left_out_or_refused(tower):
    X, Z, A, pairs = tower
    away = A.copy()
    away[0] = se3.inverse(X) @ se3.exp([0, 0, 0, 0, np.pi, 0]) @ X @ A[0]
    assert list(solve_nid(pairs, away, X, Z, rounds=1).used) == [False, True, True, True, True]
    with pytest.raises(GroundTruthError, match="1 of 2 poses have points in view"):
        solve_nid(pairs[:2], away[:2], X, Z)
    with pytest.raises(CalibrationError, match="5 poses of pairs, 2 of the arm"):
        solve_nid(pairs, A[:2], X, Z)


@pytest.mark.slow
def test_a_data_set_refined_from_its_intensities(sample_recordings, tmp_path):
    """Simulated recordings, whose true mounts are known."""
    import json

    from lcdata.dataset import Dataset
    from lcdata.dataset.build import build
    from lcdata.evaluation.handeye import refine

    build(sample_recordings / "yard", tmp_path / "set", sample_recordings / "rig.yaml")
    dataset = Dataset.open(tmp_path / "set")
    truth = json.loads((sample_recordings / "truth.json").read_text())
    found = refine(dataset, direct=True, features="nid").found
    for link in ("T_camera_effector", "T_base_lidar"):
        true, measured = np.array(truth[link]), getattr(dataset.rig, link).T
        before, after = (se3.rotation_error(T, true) for T in (measured, getattr(found, link)))
        assert after < max(before, np.deg2rad(0.1))
    with pytest.raises(GroundTruthError, match="no hand-eye from 'edges'"):
        refine(dataset, direct=True, features="edges")
