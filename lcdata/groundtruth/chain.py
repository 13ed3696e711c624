"""The extrinsic of an arm pose and its covariance.

    T_camera_lidar = T_camera_effector @ T_effector_base @ T_base_lidar

PLK-Calib, section V-B (printed there as T_L^C = T_E^C T_B^E T_L^B). The first and last link are
measured by hand, the middle one is the inverse of the arm's forward kinematics.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lcdata.arm import Arm
from lcdata.errors import RigError
from lcdata.geometry import se3
from lcdata.groundtruth.budget import drift
from lcdata.groundtruth.twists import adjoint_many
from lcdata.rig import Rig
from lcdata.rig_links import LINKS

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class PoseTruth:
    """Ground truth of one arm pose.

    Args:
        T_camera_lidar: 4x4, maps LiDAR points to camera points.
        covariance: 6x6, translation (m) then rotation (rad), left perturbation in the camera
            frame; NaN where it is unknown.
        T_camera_effector: 4x4 hand-measured link; None without an arm.
        T_effector_base: 4x4, inverse of the forward kinematics; None without an arm.
        T_base_lidar: 4x4 hand-measured link; None without an arm.
        budget: 6x6 covariance from each source, see `budget.SOURCES`; their sum is `covariance`.
            Empty where nothing is known.
    """

    T_camera_lidar: Array
    covariance: Array
    T_camera_effector: Array | None = None
    T_effector_base: Array | None = None
    T_base_lidar: Array | None = None
    budget: dict[str, Array] = field(default_factory=dict)


def arm_truth(
    rig: Rig,
    arm: Arm,
    positions: ArrayLike,
    scatter: ArrayLike | None = None,
    samples: int = 1,
    duration_s: float = 0.0,
) -> PoseTruth:
    """Ground truth of a dwell of the arm; see `arm_truths`.

    Args:
        rig: Hand-measured links with standard deviations, encoder standard deviation.
        arm: Arm model.
        positions: (n,) mean joint positions over the dwell in radians, in the arm's order.
        scatter: (n,) standard deviation within the dwell in radians.
        samples: Number of joint states in the dwell.
        duration_s: How long the dwell lasted.

    Raises:
        RigError: The rig has no arm's links.
        ArmError: A joint outside its limits, or not as many positions as joints.
    """
    positions = np.asarray(positions, float)
    arm.check_limits(positions)
    spread = np.zeros_like(positions) if scatter is None else np.asarray(scatter, float)
    return arm_truths(rig, arm, positions[None], spread[None], [samples], [duration_s])[0]


def arm_truths(
    rig: Rig,
    arm: Arm,
    positions: ArrayLike,
    scatter: ArrayLike,
    samples: ArrayLike,
    duration_s: ArrayLike,
) -> list[PoseTruth]:
    """Ground truth of many dwells of the arm, whose joint limits are not checked here.

    The covariance of `T_true = exp(xi) @ T_camera_lidar` sums independent parts. With
    X = T_camera_effector, A = T_effector_base, J the effector's Jacobian in its own axes, and
    left perturbations of the two hand-measured links:

        xi = xi_X - Ad(X) J (dq_encoders + dq_offsets + v dt) + Ad(X A) xi_Z

    What the encoders get wrong at a pose (gear, backlash) is the same in every sample of a
    dwell, so the rig's encoder standard deviation does not shrink with the number of samples;
    only the scatter within the dwell does. Joint offsets are the same at every pose of an arm:
    their part is right for each pose, yet does not average out over poses. Nor do those of the
    two links. v is at most the drift within the dwell, which stands still but for that.

    Links that were refined together have errors xi_X and xi_Z (and dq_offsets, where those were
    refined as well) that belong together: the rig's `links_covariance`, one part of the budget.

    Args:
        rig: Hand-measured links with standard deviations, encoder standard deviation.
        arm: Arm model; the covariance of its joint offsets, where known, replaces the rig's
            standard deviation, and the rig's `links_covariance`, where it has joint offsets, both.
        positions: (N, n) mean joint positions in radians, in the arm's order.
        scatter: (N, n) standard deviations within the dwells in radians.
        samples: (N,) joint states in each dwell.
        duration_s: (N,) how long each lasted.

    Raises:
        RigError: The rig has no arm's links, or their covariance is of another arm's joints.
        ArmError: Not as many positions as joints.
    """
    if rig.T_camera_effector is None or rig.T_base_lidar is None:
        raise RigError("the rig has no T_camera_effector and T_base_lidar", "add both")
    X, Z = rig.T_camera_effector.T, rig.T_base_lidar.T
    spread = np.asarray(scatter, float)
    T_base_effector, J = arm.chain().jacobians(arm.with_offsets(positions))
    A = se3.inverse(T_base_effector)
    by_joints = se3.adjoint(X) @ J
    by_lidar_link = adjoint_many(X @ A)
    encoders = np.deg2rad(rig.arm.encoder_std_deg) ** 2 + (
        spread**2 / np.maximum(np.asarray(samples), 1)[:, None]
    )
    clock = (drift(spread, duration_s) * rig.clock_offset_std_s) ** 2
    parts = {
        "encoders": _through(by_joints, encoders[:, :, None] * np.eye(spread.shape[1])),
        "clock_offset": _through(by_joints, clock[:, :, None] * np.eye(spread.shape[1])),
    } | _constant_parts(rig, arm, by_lidar_link, by_joints)
    total = np.sum(list(parts.values()), axis=0)
    return [
        PoseTruth(T, total[i], X, A[i], Z, {name: part[i] for name, part in parts.items()})
        for i, T in enumerate(X @ A @ Z)
    ]


def _constant_parts(rig: Rig, arm: Arm, by_lidar_link: Array, by_joints: Array) -> dict[str, Array]:
    """(N, 6, 6) of what is the same at every pose: links and joint offsets, by source."""
    links, n = rig.covariance_of_links(), len(arm.joint_names)
    if len(links) not in {LINKS, LINKS + n}:
        raise RigError(
            f"the rig's links_covariance has {len(links)} rows, the arm has {n} joints",
            f"give {LINKS} rows, or {LINKS + n} with the joint offsets",
        )
    by_camera_link = np.broadcast_to(np.eye(6), by_lidar_link.shape)
    by_links = np.concatenate([by_camera_link, by_lidar_link], axis=2)
    if len(links) > LINKS:
        by_all = np.concatenate([by_links, -by_joints], axis=2)
        return {"links_and_joint_offsets": _through(by_all, links)}
    offsets = {"joint_offsets": _through(by_joints, offset_covariance(rig, arm))}
    if rig.links_covariance is not None:
        return offsets | {"links": _through(by_links, links)}
    return offsets | {
        "T_camera_effector": _through(by_camera_link, links[:6, :6]),
        "T_base_lidar": _through(by_lidar_link, links[6:, 6:]),
    }


def _through(J: Array, covariance: Array) -> Array:
    """(N, 6, 6) J C J^T, exactly symmetric, of (N, 6, n) and one or (N,) covariances (n, n)."""
    result = J @ covariance @ J.transpose(0, 2, 1)
    return np.asarray((result + result.transpose(0, 2, 1)) / 2)


def offset_covariance(rig: Rig, arm: Arm) -> Array:
    """(n, n) covariance of the joints' zero points in rad^2.

    That of the arm's offsets file, where it has one; the rig's standard deviation elsewhere.
    """
    n = len(arm.joint_names)
    result = np.full((n, n), np.nan) if arm.offset_covariance is None else arm.offset_covariance
    by_rig = np.eye(n) * np.deg2rad(rig.arm.joint_offset_std_deg) ** 2
    return np.where(np.isnan(result), by_rig, result)


def static_truth(rig: Rig, T_camera_lidar: ArrayLike | None = None) -> PoseTruth:
    """Ground truth of a recording without an arm.

    Args:
        rig: May give `T_camera_lidar`, which wins, with or without standard deviations.
        T_camera_lidar: 4x4 of the recording's /tf_static.

    Raises:
        RigError: Neither gives an extrinsic.
    """
    if rig.T_camera_lidar is not None:
        covariance = rig.T_camera_lidar.covariance
        known = np.isfinite(covariance).all()
        budget = {"T_camera_lidar": covariance} if known else {}
        return PoseTruth(rig.T_camera_lidar.T, covariance, budget=budget)
    if T_camera_lidar is None:
        raise RigError(
            "ground_truth: static, and no extrinsic in /tf_static",
            "give T_camera_lidar (maps LiDAR points to camera points) in the rig",
        )
    T = se3.check_transform(T_camera_lidar, "T_camera_lidar of /tf_static")
    return PoseTruth(T, np.full((6, 6), np.nan))
