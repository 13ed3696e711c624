from __future__ import annotations

import numpy as np
import pytest
from handeye_data import NOISE, X, Z, arm_poses, link_errors, noisy

from lcdata.errors import GeometryError, GroundTruthError
from lcdata.geometry import se3
from lcdata.handeye import Prior, solve
from lcdata.rig import Rig

NOT_RIGID = {
    "reflection": np.diag([1.0, 1.0, -1.0, 1.0]),
    "not a rotation": np.diag([1.0, 1.1, 1.0, 1.0]),
    "last row": np.ones((4, 4)),
}


def prior(std_m=0.01, std_deg=1.0, twist=(0.0,) * 6) -> Prior:
    covariance = np.diag(np.repeat([std_m, np.deg2rad(std_deg)], 3) ** 2)
    return Prior(se3.exp(twist) @ X, se3.exp(twist) @ Z, covariance, covariance)


def one_axis(n: int) -> np.ndarray:
    about_base_z = np.array([se3.exp([0, 0, 0, 0, 0, a]) for a in np.linspace(-1, 1, n)])
    return se3.inverse(about_base_z @ arm_poses(np.random.default_rng(3), 1)[0])


@pytest.mark.parametrize(
    "weights", [None, np.full(20, 2.0), np.tile(np.diag(NOISE**2), (20, 1, 1))]
)
@pytest.mark.parametrize("seed", range(3))
def test_exact_estimates_give_exact_links(seed, weights):
    A = arm_poses(np.random.default_rng(seed), 20)
    found = solve(A, X @ A @ Z, weights=weights)
    np.testing.assert_allclose(found.T_camera_effector, X, atol=1e-9)
    np.testing.assert_allclose(found.T_base_lidar, Z, atol=1e-9)
    np.testing.assert_allclose(found.extrinsic(A), X @ A @ Z, atol=1e-9)
    assert found.observable and found.unobservable == () and found.outliers == ()
    assert np.max(found.residuals.mm) < 1e-6 and np.max(found.left_out.deg) < 1e-6


@pytest.mark.parametrize("wrong", [3, 7])
def test_wrong_estimates_among_twenty_cost_next_to_nothing(wrong):
    ratios = []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        A = arm_poses(rng, 20)
        T = noisy(rng, X @ A @ Z)
        T[:wrong] = noisy(rng, (X @ A @ Z)[:wrong], 10 * NOISE)
        found, without = solve(A, T), solve(A[wrong:], T[wrong:])
        assert len(set(found.outliers) - set(range(wrong))) <= 1
        ratios.append(np.abs(link_errors(found)).sum() / np.abs(link_errors(without)).sum())
    assert max(ratios) < 1.5
    assert np.median(ratios) < 1.05


def test_no_good_pose_of_a_hundred_recordings_is_called_wrong():
    rng = np.random.default_rng(0)
    for _ in range(100):
        A = arm_poses(rng, 20)
        assert solve(A, noisy(rng, X @ A @ Z)).outliers == ()


@pytest.mark.parametrize("kind", ["no weights", "covariances", "prior"])
def test_the_covariance_is_that_of_the_errors(kind):
    squares = []
    for seed in range(60):
        rng = np.random.default_rng(seed)
        A, given = arm_poses(rng, 15), None
        std = NOISE * rng.uniform(0.3, 2, (15, 1)) if kind != "no weights" else NOISE
        T = noisy(rng, X @ A @ Z, std)
        weights = None if kind == "no weights" else np.array([np.diag(s**2) for s in std])
        if kind == "prior":
            covariance = np.diag(np.repeat([0.005, np.deg2rad(0.3)], 3) ** 2)
            errors = rng.multivariate_normal(np.zeros(6), covariance, 2)
            measured = (se3.exp(-e) @ link for e, link in zip(errors, (X, Z), strict=True))
            given = Prior(*measured, covariance, covariance)
        found = solve(A, T, weights=weights, prior=given)
        errors = link_errors(found)
        squares.append(errors @ np.linalg.solve(found.covariance, errors) / 12)
    assert 0.8 < np.mean(squares) < 1.25


def test_extrinsics_are_known_better_than_the_links():
    rng = np.random.default_rng(4)
    A = arm_poses(rng, 12)
    squares = []
    for _ in range(60):
        found = solve(A, noisy(rng, X @ A @ Z))
        covariances = found.extrinsic_covariance(A)
        for a, C in zip(A, covariances, strict=True):
            squares.append(se3.sigma_distance(X @ a @ Z, found.extrinsic(a), C) ** 2 / 6)
    assert 0.8 < np.mean(squares) < 1.25
    assert np.trace(covariances[0][:3, :3]) < np.trace(found.covariance[:3, :3])


def test_the_error_of_a_pose_left_out_is_that_of_solving_without_it():
    rng = np.random.default_rng(5)
    A = arm_poses(rng, 12)
    T = noisy(rng, X @ A @ Z)
    weights = np.tile(np.diag((3 * NOISE) ** 2), (12, 1, 1))  # so that the scale stays 1
    found = solve(A, T, weights=weights)
    for i in range(3):
        others = np.arange(12) != i
        again = solve(A[others], T[others], weights=weights[others]).extrinsic(A[i])
        assert found.left_out.mm[i] == pytest.approx(1e3 * se3.translation_error(again, T[i]), 0.01)
        assert found.left_out.deg[i] == pytest.approx(
            np.rad2deg(se3.rotation_error(again, T[i])), rel=0.01
        )
    assert np.median(found.left_out.mm) > np.median(found.residuals.mm)


def test_covariances_that_promise_too_much_are_scaled_up():
    rng = np.random.default_rng(6)
    A = arm_poses(rng, 20)
    found = solve(A, noisy(rng, X @ A @ Z), weights=np.tile(np.diag((NOISE / 4) ** 2), (20, 1, 1)))
    assert found.scale == pytest.approx(4, rel=0.2)


def test_good_covariances_beat_none():
    better = 0
    for seed in range(15):
        rng = np.random.default_rng(seed)
        A = arm_poses(rng, 15)
        std = NOISE * np.where(np.arange(15) % 3 == 0, 0.1, 2.0)[:, None]
        T = noisy(rng, X @ A @ Z, std)
        found = solve(A, T, weights=np.array([np.diag(s**2) for s in std]))
        better += np.abs(link_errors(found)).sum() < np.abs(link_errors(solve(A, T))).sum()
    assert better >= 13


def test_a_weight_of_zero_and_a_failed_estimate_are_left_out():
    rng = np.random.default_rng(7)
    A = arm_poses(rng, 10)
    T = noisy(rng, X @ A @ Z)
    kept = solve(A[2:], T[2:])
    T[0] = np.nan
    found = solve(A, T, weights=np.array([1, 0, *[1] * 8]))
    np.testing.assert_allclose(found.T_base_lidar, kept.T_base_lidar, atol=1e-9)
    assert found.failed == (0, 1)
    assert np.isnan(found.residuals.mm[:2]).all() and np.isfinite(found.left_out.deg[2:]).all()


def test_two_poses_refine_the_hand_measurement_and_need_one():
    A = arm_poses(np.random.default_rng(8), 2)
    measured = prior(twist=[0.01, 0, -0.01, 0.01, 0.01, 0])
    weights = np.tile(np.diag((NOISE / 100) ** 2), (2, 1, 1))
    found = solve(A, X @ A @ Z, weights=weights, prior=measured)
    np.testing.assert_allclose(found.extrinsic(A), X @ A @ Z, atol=1e-3)
    before, after = se3.log(X @ se3.inverse(measured.T_camera_effector)), link_errors(found)[:6]
    assert np.linalg.norm(after) < np.linalg.norm(before)
    with pytest.raises(GroundTruthError, match=r"2 of 2 poses.*3 are needed.*prior"):
        solve(A, X @ A @ Z)
    with pytest.raises(GroundTruthError, match="1 of 1 poses"):
        solve(A[:1], (X @ A @ Z)[:1], prior=measured)


def test_rotation_about_one_axis_is_named():
    A = one_axis(10)
    with pytest.raises(
        GroundTruthError, match=r"one axis only, \(0\.00, 0\.00, 1\.00\) of the base"
    ):
        solve(A, X @ A @ Z)
    found = solve(A, X @ A @ Z, prior=prior(0.01, 1.0))
    assert not found.observable and found.singular_value_ratio < 1e-6
    assert len(found.unobservable) == 1
    assert "rotation about and translation along (" in found.unobservable[0]
    # Along that axis the links are no better known than by hand; their product is.
    assert found.covariance[11, 11] > 0.2 * np.deg2rad(1.0) ** 2
    assert found.covariance[9, 9] < 1e-3 * found.covariance[11, 11]


def test_too_little_rotation_is_a_warning_by_name():
    rng = np.random.default_rng(9)
    A = arm_poses(rng, 20, degrees=2)
    found = solve(A, noisy(rng, X @ A @ Z))
    assert not found.observable and len(found.unobservable) == 3
    assert "deg only" in found.unobservable[0]
    A = arm_poses(rng, 20, degrees=30)
    assert solve(A, X @ A @ Z).observable


def test_poses_all_alike():
    A = np.repeat(arm_poses(np.random.default_rng(1), 1), 8, axis=0)
    with pytest.raises(GroundTruthError, match=r"hardly turned: .* 30 deg or more"):
        solve(A, X @ A @ Z)
    found = solve(A, X @ A @ Z, prior=prior())
    np.testing.assert_allclose(found.extrinsic(A), X @ A @ Z, atol=1e-4)
    assert not found.observable and len(found.unobservable) == 3


@pytest.mark.parametrize("kind", NOT_RIGID)
@pytest.mark.parametrize("which", ["T_effector_base", "T_camera_lidar"])
def test_matrices_that_are_no_rigid_transform(kind, which):
    A = arm_poses(np.random.default_rng(2), 6)
    stacks = {"T_effector_base": A, "T_camera_lidar": X @ A @ Z}
    stacks[which] = stacks[which].copy()
    stacks[which][4] = stacks[which][4] @ NOT_RIGID[kind]
    with pytest.raises(GeometryError, match=rf"{which}\[4\]"):
        solve(**stacks)


def test_other_bad_input():
    A = arm_poses(np.random.default_rng(2), 6)
    T = X @ A @ Z
    with pytest.raises(GroundTruthError, match="all 6 estimates failed"):
        solve(A, np.full_like(T, np.nan))
    with pytest.raises(GroundTruthError, match="6 arm poses and 5 estimates"):
        solve(A, T[:5])
    with pytest.raises(GroundTruthError, match="no poses"):
        solve(np.zeros((0, 4, 4)), np.zeros((0, 4, 4)))
    with pytest.raises(GeometryError, match=r"shape \(4, 4\)"):
        solve(A[0], T)
    with pytest.raises(GeometryError, match=r"T_effector_base\[0\].*not finite"):
        solve(np.full_like(A, np.nan), T)
    with pytest.raises(GeometryError, match=r"weights\[1\] is -1"):
        solve(A, T, weights=[1, -1, 1, 1, 1, 1])
    with pytest.raises(GeometryError, match=r"weights have shape \(6, 3\)"):
        solve(A, T, weights=np.ones((6, 3)))
    with pytest.raises(GeometryError, match=r"weights\[0\] is not a covariance"):
        solve(A, T, weights=np.tile(-np.eye(6), (6, 1, 1)))
    bare = Rig.from_dict({"T_camera_effector": X.tolist(), "T_base_lidar": Z.tolist()})
    with pytest.raises(GroundTruthError, match="translation_std_m"):
        solve(A, T, prior=Prior.of_rig(bare))
    with pytest.raises(GroundTruthError, match="T_base_lidar"):
        Prior.of_rig(Rig.from_dict({"ground_truth": "static"}))
