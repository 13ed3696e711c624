from __future__ import annotations

import numpy as np
import pytest
from handeye_data import NOISE, X, Z, arm_poses, joint_positions, link_errors, noisy

from lcdata.arm import Arm
from lcdata.errors import GroundTruthError
from lcdata.geometry import se3
from lcdata.groundtruth.handeye_problem import Joints, Prior, Problem
from lcdata.handeye import solve

OFFSETS = np.deg2rad([0.0, 0.8, -0.5, 0.6, 0.4, 0.0])
CLOCK_S = 0.02


@pytest.fixture(scope="module")
def arm() -> Arm:
    return Arm.load("gen3_lite")


def measured() -> Prior:
    covariance = np.diag(np.repeat([0.01, np.deg2rad(1.0)], 3) ** 2)
    return Prior(X, Z, covariance, covariance)


@pytest.mark.parametrize("which", ["links", "offsets", "clock", "both"])
def test_the_jacobian_equals_finite_differences(arm, which):
    rng = np.random.default_rng(0)
    q, v = joint_positions(rng, arm, 4), rng.normal(0, 0.3, (4, 6))
    joints = None
    if which != "links":
        offset_std = 0.0 if which == "clock" else 0.5
        joints = Joints(arm, q, offset_std, None if which == "offsets" else v)
    A = se3.inverse(arm.chain().forward(q))
    problem = Problem(A, noisy(rng, X @ A @ Z, 5 * NOISE), measured(), joints)
    size = len(problem.extra_std)
    assert size == {"links": 0, "offsets": 6, "clock": 1, "both": 7}[which]
    state = problem.start(X, Z).moved(rng.normal(0, 0.02, 12 + size))
    _, J = problem.linearise(state)
    _, prior_J = problem.prior_rows(state)
    for k, step in enumerate(np.eye(12 + size) * 1e-6):
        ahead, behind = state.moved(step), state.moved(-step)
        numeric = (problem.residuals(ahead) - problem.residuals(behind)) / 2e-6
        np.testing.assert_allclose(J[:, :, k], numeric, atol=1e-7)
        numeric = (problem.prior_rows(ahead)[0] - problem.prior_rows(behind)[0]) / 2e-6
        np.testing.assert_allclose(prior_J[:, k], numeric, atol=1e-5)


def test_joint_offsets_are_found_with_the_links(arm):
    rng = np.random.default_rng(1)
    q = joint_positions(rng, arm, 30)
    A = se3.inverse(arm.chain().forward(q))
    truth = X @ se3.inverse(arm.chain().forward(q + OFFSETS)) @ Z
    T = noisy(rng, truth, NOISE / 10)
    without = solve(A, T)
    found = solve(A, T, joints=Joints(arm, q, offset_std_deg=1.0))
    assert np.median(found.residuals.deg) < 0.3 * np.median(without.residuals.deg)
    errors = found.joint_offsets - OFFSETS
    # The first and the last joint's offsets cannot be told from the links: only the prior speaks.
    assert (np.abs(errors[1:5]) < 3.5 * found.joint_offsets_std[1:5]).all()
    assert found.joint_offsets_std[1:5].max() < np.deg2rad(0.4)
    assert found.joint_offsets_std[[0, 5]] == pytest.approx(np.deg2rad(1.0), rel=0.05)
    assert ["joint_1" in found.unobservable[0], "joint_6" in found.unobservable[1]] == [True] * 2
    assert len(found.unobservable) == 2
    assert np.abs(link_errors(without)).sum() > 2 * np.abs(link_errors(found)).sum()


def test_the_clock_offset_is_found_where_the_arm_moves(arm):
    rng = np.random.default_rng(2)
    q, v = joint_positions(rng, arm, 30), rng.normal(0, 0.5, (30, 6))
    A = se3.inverse(arm.chain().forward(q))
    T = noisy(rng, X @ se3.inverse(arm.chain().forward(q + CLOCK_S * v)) @ Z, NOISE / 10)
    found = solve(A, T, joints=Joints(arm, q, 0.0, v))
    assert found.clock_offset_s == pytest.approx(CLOCK_S, abs=4 * found.clock_offset_std_s)
    assert found.clock_offset_std_s < 0.002
    assert found.joint_offsets.shape == (0,)
    still = solve(A, T, joints=Joints(arm, q, 0.0, np.zeros_like(v)))
    assert still.unobservable == ("clock offset: the estimates say next to nothing about it",)
    assert np.isnan(solve(A, T).clock_offset_s)


def test_joints_of_another_arm_or_of_other_offsets_are_refused(arm):
    rng = np.random.default_rng(3)
    q = joint_positions(rng, arm, 5)
    A = se3.inverse(arm.chain().forward(q))
    T = X @ A @ Z
    other = Arm(arm.urdf, joint_offsets={"joint_2": 0.01})
    with pytest.raises(GroundTruthError, match=r"T_effector_base\[0\] is .* mm and 0\.573 deg off"):
        solve(A, T, joints=Joints(other, q))
    with pytest.raises(GroundTruthError, match="4 joint positions for 5 poses"):
        solve(A, T, joints=Joints(arm, q[:4]))
    with pytest.raises(GroundTruthError, match="velocities"):
        solve(A, T, joints=Joints(arm, q, velocities=np.zeros((5, 2))))
    with pytest.raises(GroundTruthError, match="off the forward kinematics"):
        solve(A2 := arm_poses(rng, 5), X @ A2 @ Z, joints=Joints(arm, q))
