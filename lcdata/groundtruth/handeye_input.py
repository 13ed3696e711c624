"""What the hand-eye solver is given, checked, and its closed-form start."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lcdata.errors import GeometryError, GroundTruthError
from lcdata.geometry import se3
from lcdata.groundtruth.handeye_problem import STD_FLOOR, Joints, Prior, Problem
from lcdata.rig_links import LINKS

Array = NDArray[np.float64]

SAME_ARM = 1e-4
"""How far (m and rad) T_effector_base may be from the forward kinematics of the joints."""


@dataclass(frozen=True, eq=False)
class Weights:
    """How much an estimate counts.

    Args:
        covariances: (N, 6, 6), of unit scale if not `absolute`.
        absolute: Whether they are covariances in m^2 and rad^2.
    """

    covariances: Array
    absolute: bool


@dataclass(frozen=True, eq=False)
class Checked:
    """Input that can be worked on: the poses that have an estimate, and which those are."""

    problem: Problem
    weights: Weights
    used: NDArray[np.intp]
    failed: NDArray[np.intp]


def checked(
    T_effector_base: ArrayLike,
    T_camera_lidar: ArrayLike,
    weights: ArrayLike | None,
    prior: Prior | None,
    joints: Joints | None,
) -> Checked:
    """Check what `handeye.solve` is given; see there."""
    A, T = _stack(T_effector_base, "T_effector_base"), _stack(T_camera_lidar, "T_camera_lidar")
    if len(A) != len(T):
        raise GroundTruthError(
            f"{len(A)} arm poses and {len(T)} estimates", "give one estimate for each pose"
        )
    count = len(T)
    W = _weights(weights, count)
    good = np.isfinite(T).all(axis=(1, 2)) & np.isfinite(W.covariances).all(axis=(1, 2))
    used, failed = np.flatnonzero(good), np.flatnonzero(~good)
    if not len(used):
        raise GroundTruthError(
            f"all {count} estimates failed" if count else "no poses",
            "calibrate with another method first",
        )
    needed = 3 if prior is None else 2
    if len(used) < needed:
        raise GroundTruthError(
            f"{len(used)} of {count} poses have an estimate, {needed} are needed "
            f"{'without' if prior is None else 'with'} a prior",
            "give the hand measurements as prior, or more poses"
            if prior is None and len(used) == 2
            else "record more poses",
        )
    A = _rigid(A, "T_effector_base", np.arange(count))
    T = _rigid(T[used], "T_camera_lidar", used)
    if joints is not None:
        _check_joints(joints, A, prior)
    problem = Problem(A, A, _prior(prior), joints).subset(used)
    problem = Problem(problem.A, T, problem.prior, problem.joints)
    return Checked(problem, Weights(W.covariances[used], W.absolute), used, failed)


def closed_form(A: Array, T: Array) -> tuple[Array, Array] | None:
    """X and Z in closed form (Shah 2013), or None where there is no unique solution.

    OpenCV solves A' X' = Z' B' of a hand with a camera that looks at a world; here the LiDAR is
    its world and the effector its gripper: A' = T_camera_lidar, X' = Z^-1 ("base to world"),
    Z' = X ("gripper to camera"), B' = T_effector_base.
    """
    import cv2

    if len(A) < 3:
        return None
    try:
        R_lidar_base, t_lidar_base, R, t = cv2.calibrateRobotWorldHandEye(
            list(T[:, :3, :3]),
            list(T[:, :3, 3]),
            list(A[:, :3, :3]),
            list(A[:, :3, 3]),
            method=cv2.CALIB_ROBOT_WORLD_HAND_EYE_SHAH,
        )
    except cv2.error:  # rotations that leave a direction open
        return None
    X, Z_inverse = np.eye(4), np.eye(4)
    X[:3, :3], X[:3, 3] = R, t.ravel()
    Z_inverse[:3, :3], Z_inverse[:3, 3] = R_lidar_base, t_lidar_base.ravel()
    try:
        return se3.check_transform(X), se3.inverse(se3.check_transform(Z_inverse))
    except GeometryError:
        return None


def _stack(T: ArrayLike, name: str) -> Array:
    try:
        stack = np.array(T, float)
    except (TypeError, ValueError) as error:
        raise GeometryError(f"{name} is not a stack of matrices of numbers") from error
    if stack.ndim != 3 or stack.shape[1:] != (4, 4):
        raise GeometryError(f"{name} has shape {stack.shape}", "give (N, 4, 4)")
    return stack


def _rigid(T: Array, name: str, names: NDArray[np.intp]) -> Array:
    """`se3.check_transform` of a stack, the i-th called name[names[i]]."""
    R = T[:, :3, :3]
    apart = np.abs(np.swapaxes(R, 1, 2) @ R - np.eye(3)).max(axis=(1, 2))
    with np.errstate(invalid="ignore"):  # NaN is not good either
        good = (apart <= se3.ROTATION_TOLERANCE) & (np.linalg.det(R) > 0)
    good &= np.isfinite(T).all(axis=(1, 2)) & (T[:, 3] == [0, 0, 0, 1]).all(axis=1)
    T = T.copy()
    for i in np.flatnonzero(~good):
        T[i] = se3.check_transform(T[i], f"{name}[{names[i]}]")
    U, _, Vt = np.linalg.svd(T[:, :3, :3])
    T[:, :3, :3] = U @ Vt
    return T


def _weights(weights: ArrayLike | None, count: int) -> Weights:
    if weights is None:
        return Weights(np.broadcast_to(np.eye(6), (count, 6, 6)), absolute=False)
    W = np.asarray(weights, float)
    if W.shape == (count,):
        if not (W >= 0).all():
            i = int(np.flatnonzero(~(W >= 0))[0])
            raise GeometryError(f"weights[{i}] is {W[i]}", "give weights of 0 or more")
        with np.errstate(divide="ignore", invalid="ignore"):  # weight 0: as if it had failed
            return Weights(np.where(np.eye(6) > 0, 1 / W[:, None, None], 0.0), absolute=False)
    if W.shape != (count, 6, 6):
        raise GeometryError(
            f"weights have shape {W.shape} for {count} poses", "give (N,) or covariances (N, 6, 6)"
        )
    for pose in np.flatnonzero(np.isfinite(W).all(axis=(1, 2))):
        _check_covariance(W[pose], f"weights[{pose}]")
    return Weights(W, absolute=True)


def _check_covariance(W: Array, name: str) -> None:
    eigenvalues = np.linalg.eigvalsh(W)
    if np.abs(W - W.T).max() > 1e-6 * np.abs(W).max() or eigenvalues[0] <= 0:
        raise GeometryError(
            f"{name} is not a covariance (smallest eigenvalue {eigenvalues[0]:.3g})",
            "it must be symmetric and positive definite",
        )


def _prior(prior: Prior | None) -> Prior | None:
    if prior is None:
        return None
    C = np.asarray(prior.joint, float)
    for name, part in (("T_camera_effector", slice(6)), ("T_base_lidar", slice(6, LINKS))):
        if not np.isfinite(C[part, part]).all():
            raise GroundTruthError(
                f"the prior of {name} has no standard deviations",
                "give translation_std_m and rotation_std_deg in the rig",
            )
    _check_covariance(C + STD_FLOOR**2 * np.eye(len(C)), "covariance of the prior")
    X = se3.check_transform(prior.T_camera_effector, "prior T_camera_effector")
    Z = se3.check_transform(prior.T_base_lidar, "prior T_base_lidar")
    return Prior(X, Z, C[:6, :6], C[6:LINKS, 6:LINKS], C)


def _check_joints(joints: Joints, A: Array, prior: Prior | None) -> None:
    q = joints.arm.with_offsets(joints.positions)
    if len(q) != len(A):
        raise GroundTruthError(
            f"{len(q)} joint positions for {len(A)} poses", "give one row for each pose"
        )
    if joints.velocities is not None and np.shape(joints.velocities) != q.shape:
        raise GroundTruthError(
            f"joint velocities of shape {np.shape(joints.velocities)} for {q.shape} positions",
            "give one for each position",
        )
    for pose, (a, b) in enumerate(zip(A, se3.inverse(joints.arm.chain().forward(q)), strict=True)):
        metres, radians = se3.translation_error(a, b), se3.rotation_error(a, b)
        if max(metres, radians) > SAME_ARM:
            raise GroundTruthError(
                f"T_effector_base[{pose}] is {1e3 * metres:.3g} mm and "
                f"{np.rad2deg(radians):.3g} deg off the forward kinematics of its joint positions",
                "give the arm, frames and joint offsets that it was computed with",
            )
    n, known = joints.n_offsets, LINKS if prior is None else len(prior.joint)
    if known not in {LINKS, LINKS + n} and n:
        raise GroundTruthError(
            f"the prior is of {known - LINKS} joint offsets, the arm has {n} joints",
            "give the covariance of this arm",
        )
    if joints.offset_covariance is not None:
        C = np.asarray(joints.offset_covariance, float)
        if C.shape != (n, n) or not np.isfinite(C).all():
            raise GroundTruthError(
                f"the joint offsets' covariance has shape {C.shape}", f"give ({n}, {n}) in rad^2"
            )
        _check_covariance(C + STD_FLOOR**2 * np.eye(n), "covariance of the joint offsets")
