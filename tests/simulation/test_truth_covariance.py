"""Is the ground truth's covariance what simulated rigs show? Their true mounts are off by the
rig's deviations, their joints by zero-point errors."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lcdata.geometry import se3
from lcdata.groundtruth.chain import arm_truth
from lcdata.rig import Rig
from lcdata.simulation.mounts import default_rig, joint_offsets, true_mounts

RIGS = 200


def normalised_squares(rig: Rig, arm, offsets_of) -> np.ndarray:
    """(RIGS,) squared errors of the ground truth in its own covariance, over six."""
    result = []
    for seed in range(RIGS):
        rng = np.random.default_rng([seed, 3])
        mounts, offsets = true_mounts(rig, seed), offsets_of(seed)
        q = np.array([0.2, -0.4, 1.0, 0.3, -0.8, 0.5]) + rng.uniform(-0.6, 0.6, 6)
        standing = rng.normal(0, np.deg2rad(rig.arm.encoder_std_deg), 6)
        truth = arm_truth(rig, arm, q - offsets + standing)
        known = sum(arm.with_offsets(np.zeros((1, 6))))
        A = se3.inverse(replace(arm, joint_offsets={}).forward(q + known))
        error = se3.log(
            mounts.T_camera_effector @ A @ mounts.T_base_lidar @ se3.inverse(truth.T_camera_lidar)
        )
        result.append(error @ np.linalg.solve(truth.covariance, error) / 6)
    return np.array(result)


@pytest.mark.parametrize("std_deg", [0.0, 0.3, 0.75])
def test_the_covariance_is_that_of_simulated_rigs(std_deg):
    content = default_rig().to_dict()
    content["arm"]["joint_offset_std_deg"] = std_deg
    rig = Rig.from_dict(content)
    arm = rig.load_arm()
    squares = normalised_squares(rig, arm, lambda seed: joint_offsets(arm, seed, std_deg))
    print(f"\njoint offsets {std_deg} deg: mean normalised squared error {squares.mean():.3f}")
    assert 0.8 < squares.mean() < 1.25


def test_the_covariance_is_that_of_offsets_with_errors_of_their_own():
    """Calibrated offsets whose errors are correlated, as those of neighbouring joints are."""
    rig = default_rig()
    root = np.deg2rad(0.15) * (np.eye(6) + np.diag(np.full(5, -0.8), 1))
    known = dict(
        zip(rig.load_arm().joint_names, np.deg2rad([0, 1.3, 0.5, 0.9, 0.4, 0]), strict=True)
    )
    arm = replace(rig.load_arm(), joint_offsets=known, offset_covariance=root @ root.T)
    squares = normalised_squares(
        rig, arm, lambda seed: root @ np.random.default_rng([seed, 9]).normal(size=6)
    )
    print(f"\ncalibrated offsets: mean normalised squared error {squares.mean():.3f}")
    assert 0.8 < squares.mean() < 1.25


def test_leaving_out_joint_offsets_is_seen():
    rig = default_rig()
    arm = rig.load_arm()
    squares = normalised_squares(rig, arm, lambda seed: joint_offsets(arm, seed, 0.75))
    assert squares.mean() > 3
