from __future__ import annotations

import numpy as np
import pytest

from lcdata.errors import ArmError, RigError
from lcdata.geometry import se3
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
            "arm": {"encoder_std_deg": 0.1},
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
    truth = arm_truth(rig, arm, Q, scatter, samples)
    rng = np.random.default_rng(5)
    n = 20_000
    encoder = np.hypot(np.deg2rad(rig.arm.encoder_std_deg), scatter[0] / np.sqrt(samples))
    at_effector = rng.multivariate_normal(np.zeros(6), rig.T_camera_effector.covariance, n)
    at_base = rng.multivariate_normal(np.zeros(6), rig.T_base_lidar.covariance, n)
    readings = Q + rng.normal(0, encoder, (n, 6))
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
