from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lcdata.errors import ArmError, RigError
from lcdata.geometry import se3
from lcdata.groundtruth.budget import SOURCES, drift, shares, variances
from lcdata.groundtruth.chain import arm_truth, static_truth
from lcdata.rig import Rig

Q = np.array([0.4, -0.5, 1.1, 0.3, -0.9, 0.7])


def link(twist, std_m, std_deg):
    return {
        "matrix": se3.exp(twist).tolist(),
        "translation_std_m": std_m,
        "rotation_std_deg": std_deg,
    }


@pytest.fixture(scope="module")
def rig() -> Rig:
    return Rig.from_dict(
        {
            "arm": {"encoder_std_deg": 0.1, "joint_offset_std_deg": 0.3},
            "clock_offset_std_s": 0.1,
            "T_camera_effector": link(
                [0.02, -0.04, 0.06, 1.2, -1.1, 0.9], [0.002, 0.004, 0.003], [0.3, 0.1, 0.2]
            ),
            "T_base_lidar": link(
                [0.1, -0.2, 0.5, 0.1, 0.05, 1.5], [0.005, 0.001, 0.003], [0.2, 0.4, 0.1]
            ),
        }
    )


def test_the_chain_maps_a_point_link_by_link(rig):
    truth = arm_truth(rig, rig.load_arm(), Q)
    point = np.array([[3.0, -1.0, 0.5]])
    by_links = se3.apply(
        rig.T_camera_effector.T,
        se3.apply(se3.inverse(rig.load_arm().forward(Q)), se3.apply(rig.T_base_lidar.T, point)),
    )
    np.testing.assert_allclose(se3.apply(truth.T_camera_lidar, point), by_links, atol=1e-12)
    np.testing.assert_allclose(
        truth.T_camera_effector @ truth.T_effector_base @ truth.T_base_lidar,
        truth.T_camera_lidar,
        atol=1e-12,
    )


def test_the_covariance_is_that_of_monte_carlo_samples(rig):
    """20,000 rigs with errors drawn from the standard deviations, through the whole chain."""
    arm, scatter, samples = rig.load_arm(), np.full(6, np.deg2rad(0.2)), 4
    truth = arm_truth(rig, arm, Q, scatter, samples, duration_s=0.5)
    rng = np.random.default_rng(5)
    n = 20_000
    encoder = np.hypot(np.deg2rad(rig.arm.encoder_std_deg), scatter[0] / np.sqrt(samples))
    at_effector = rng.multivariate_normal(np.zeros(6), rig.T_camera_effector.covariance, n)
    at_base = rng.multivariate_normal(np.zeros(6), rig.T_base_lidar.covariance, n)
    drift = scatter[0] * np.sqrt(12) / 0.5 * rng.normal(0, rig.clock_offset_std_s, (n, 6))
    offsets = rng.normal(0, np.deg2rad(rig.arm.joint_offset_std_deg), (n, 6))
    readings = Q + rng.normal(0, encoder, (n, 6)) + offsets + drift
    inverse = se3.inverse(truth.T_camera_lidar)
    errors = np.array(
        [
            se3.log(
                se3.exp(x)
                @ rig.T_camera_effector.T
                @ se3.inverse(arm.forward(q))
                @ se3.exp(z)
                @ rig.T_base_lidar.T
                @ inverse
            )
            for x, q, z in zip(at_effector, readings, at_base, strict=True)
        ]
    )
    sampled = errors.T @ errors / n
    scale = np.sqrt(np.outer(np.diag(sampled), np.diag(sampled)))
    assert np.abs((truth.covariance - sampled) / scale).max() < 0.04
    squares = np.einsum("ni,ij,nj->n", errors, np.linalg.inv(truth.covariance), errors)
    assert squares.mean() == pytest.approx(6, abs=0.15)


def test_the_parts_of_the_budget_add_up(rig):
    truth = arm_truth(rig, rig.load_arm(), Q, np.full(6, 1e-4), 10, duration_s=2.0)
    assert set(truth.budget) <= set(SOURCES)
    np.testing.assert_allclose(sum(truth.budget.values()), truth.covariance, rtol=1e-12)
    part = shares(truth.T_camera_lidar, truth.budget)
    assert sum(p.translation for p in part.values()) == pytest.approx(1)
    assert sum(p.rotation for p in part.values()) == pytest.approx(1)
    assert part["T_base_lidar"].translation > part["T_camera_effector"].translation > 0
    assert 0 < part["clock_offset"].rotation < 1e-3  # the arm stands still


def test_a_share_is_that_of_the_error_norms_of_samples(rig):
    """Only one source at a time is at work; its mean squares are its part of the budget."""
    arm = rig.load_arm()
    truth = arm_truth(rig, arm, Q)
    rng = np.random.default_rng(2)
    for name in ("joint_offsets", "T_base_lidar"):
        xi = rng.multivariate_normal(np.zeros(6), truth.budget[name], 20_000)
        moved = [se3.exp(x) @ truth.T_camera_lidar for x in xi]
        squares = [se3.translation_error(T, truth.T_camera_lidar) ** 2 for T in moved]
        predicted = variances(truth.T_camera_lidar, truth.budget[name])
        assert np.mean(squares) == pytest.approx(predicted.translation, rel=0.05)
        squares = [se3.rotation_error(T, truth.T_camera_lidar) ** 2 for T in moved]
        assert np.mean(squares) == pytest.approx(predicted.rotation, rel=0.05)


def test_offsets_with_a_covariance_of_their_own_replace_the_rigs_deviation(rig):
    arm = rig.load_arm()
    by_file = np.diag([1e-6] * 5 + [np.nan])
    better = arm_truth(rig, replace(arm, offset_covariance=by_file), Q)
    J = se3.adjoint(rig.T_camera_effector.T) @ arm.jacobian(Q)
    variance = np.array([1e-6] * 5 + [np.deg2rad(0.3) ** 2])
    np.testing.assert_allclose(better.budget["joint_offsets"], (J * variance) @ J.T, atol=1e-15)


def test_drift_is_that_of_even_motion():
    t = np.linspace(0, 2, 2001)
    assert drift([np.std(0.01 * t)], 2.0) == pytest.approx(0.01, rel=1e-3)
    assert drift([0.1], 0.0) == [0.0]


def test_links_without_standard_deviations_leave_the_covariance_unknown(rig):
    content = rig.to_dict()
    content["T_base_lidar"] = {"matrix": content["T_base_lidar"]["matrix"]}
    bare = Rig.from_dict(content)
    truth = arm_truth(bare, bare.load_arm(), Q)
    assert np.isnan(truth.covariance).all()


def test_bad_joints_are_refused(rig):
    with pytest.raises(ArmError, match="joint_2"):
        arm_truth(rig, rig.load_arm(), Q + np.array([0, 5, 0, 0, 0, 0]))


def test_static_truth_comes_from_the_rig_first_then_from_tf():
    T = se3.exp([1, 2, 3, 0.1, 0.2, 0.3])
    given = Rig.from_dict({"ground_truth": "static", "T_camera_lidar": link([0] * 6, 0.01, 0.1)})
    bare = Rig.from_dict({"ground_truth": "static"})
    np.testing.assert_allclose(static_truth(given, T).T_camera_lidar, np.eye(4))
    assert static_truth(given).covariance[0, 0] == pytest.approx(1e-4)
    np.testing.assert_allclose(static_truth(bare, T).T_camera_lidar, T, atol=1e-12)
    assert np.isnan(static_truth(bare, T).covariance).all()
    with pytest.raises(RigError, match="T_camera_lidar"):
        static_truth(bare)
    with pytest.raises(RigError, match="T_base_lidar"):
        arm_truth(bare, Rig.from_dict({"ground_truth": "static"}).load_arm(), Q)
