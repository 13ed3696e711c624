"""Arm poses that point the camera into the scene, and smooth motion between them."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lcdata.arm import Arm
from lcdata.errors import SimulationError
from lcdata.geometry import se3
from lcdata.simulation.mesh import rotation

Array = NDArray[np.float64]

FORWARD = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
"""Camera axes (x right, y down, z forward) in a base frame with x forward, z up."""

_SPREAD = 1.0 / np.array([1.22074, 1.22074**2, 1.22074**3])
"""Steps of a low-discrepancy sequence: few poses already cover yaw, pitch and roll evenly."""
_ANGLES_DEG = np.array([[-34.0, 34.0], [-8.0, 12.0], [-36.0, 36.0]])
_PLACES_M = np.array([[0.22, 0.42], [-0.22, 0.22], [0.28, 0.58]])
_LIMIT_MARGIN_RAD = np.deg2rad(8.0)
_CLEARANCE_M = 0.08


def arm_pose(
    arm: Arm, T_effector_camera: Array, index: int, start: ArrayLike, rng: np.random.Generator
) -> Array:
    """Joint positions that hold the camera somewhere in front of the tower, facing the scene.

    Args:
        arm: The arm.
        T_effector_camera: 4x4, where the camera sits.
        index: Number of the pose; neighbours differ widely in yaw, pitch and roll.
        start: (3,) random start of the sequence of angles, one for a recording.
        rng: Source of chance for the place and the arm's posture.

    Returns:
        (n,) joint positions in radians, inside the limits.

    Raises:
        SimulationError: The arm cannot reach any such pose.
    """
    share = (np.asarray(start, float) + (index + 1) * _SPREAD) % 1.0
    low, high = _ANGLES_DEG.T
    yaw, pitch, roll = np.deg2rad(low + share * (high - low))
    for _ in range(60):
        T_base_camera = np.eye(4)
        T_base_camera[:3, :3] = rotation(yaw, pitch, roll) @ FORWARD
        T_base_camera[:3, 3] = rng.uniform(*_PLACES_M.T)
        positions = _inverse_kinematics(arm, T_base_camera @ se3.inverse(T_effector_camera), rng)
        if positions is not None:
            return positions
    raise SimulationError(
        f"{arm.urdf.name} cannot hold the camera in front of the tower with yaw "
        f"{np.rad2deg(yaw):.0f}, pitch {np.rad2deg(pitch):.0f}, roll {np.rad2deg(roll):.0f} deg",
        "give a rig whose T_camera_effector points the camera along the effector's z axis",
    )


def _inverse_kinematics(arm: Arm, target: Array, rng: np.random.Generator) -> Array | None:
    """Damped least squares from a few random postures; the least bent solution, or None."""
    low, high = _limits(arm)
    best: Array | None = None
    for _ in range(6):
        q = rng.uniform(0.5 * low, 0.5 * high)
        for _ in range(60):
            error = se3.log(se3.inverse(arm.forward(q)) @ target)
            if np.linalg.norm(error) < 1e-9:
                break
            J = arm.jacobian(q)
            step = J.T @ np.linalg.solve(J @ J.T + 1e-4 * np.eye(6), error)
            q = q + step * min(1.0, 0.4 / np.linalg.norm(step))
        reached = np.linalg.norm(error) < 1e-6 and (q > low).all() and (q < high).all()
        if reached and _clear(arm, q) and (best is None or np.abs(q).max() < np.abs(best).max()):
            best = q
    return best


def _limits(arm: Arm) -> tuple[Array, Array]:
    """Lowest and highest positions of the arm's joints with a margin, radians."""
    index = [arm.model.joints[arm.model.getJointId(n)].idx_q for n in arm.joint_names]
    low = np.asarray(arm.model.lowerPositionLimit)[index]
    high = np.asarray(arm.model.upperPositionLimit)[index]
    return (
        np.maximum(low, -np.pi) + _LIMIT_MARGIN_RAD,
        np.minimum(high, np.pi) - _LIMIT_MARGIN_RAD,
    )


def _clear(arm: Arm, positions: Array) -> bool:
    """Whether all joints are above the tower's plate."""
    import pinocchio

    data = arm.model.createData()
    pinocchio.forwardKinematics(arm.model, data, arm.configuration(positions))
    heights = [data.oMi[arm.model.getJointId(n)].translation[2] for n in arm.joint_names]
    return bool(min(heights) > _CLEARANCE_M)


def min_jerk(start: Array, end: Array, share: ArrayLike) -> Array:
    """Positions on the way from start to end with continuous acceleration.

    Args:
        start: (n,) positions.
        end: (n,) positions.
        share: (T,) elapsed share of the motion's duration, 0 ... 1.

    Returns:
        (T, n).
    """
    s = np.clip(np.asarray(share, float), 0.0, 1.0)[:, None]
    return np.asarray(start + (end - start) * s**3 * (10 - 15 * s + 6 * s * s))
