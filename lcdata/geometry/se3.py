"""Rigid transforms as 4x4 arrays, with Pinocchio's exponential and logarithm.

`T_a_b` maps coordinates in frame b to frame a. Twists and 6x6 covariances have the order
translation, rotation (Pinocchio's). A covariance of `T_a_b` belongs to a *left* perturbation:
`T_true = exp(xi) @ T_a_b` with `xi ~ N(0, covariance)`, so it is expressed in frame a.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lcdata.errors import GeometryError

Array = NDArray[np.float64]

ROTATION_TOLERANCE = 1e-4
"""How far R^T R may be from the identity, for matrices typed by people with few digits."""


def exp(twist: ArrayLike) -> Array:
    """Exponential of a twist.

    Args:
        twist: (6,) translation part in metres, then rotation part in radians.

    Returns:
        4x4 transform.
    """
    import pinocchio

    return np.asarray(pinocchio.exp6(np.asarray(twist, float)).homogeneous)


def log(T: ArrayLike) -> Array:
    """Logarithm of a transform.

    Args:
        T: 4x4 transform.

    Returns:
        (6,) twist: metres, then radians.
    """
    import pinocchio

    return np.asarray(pinocchio.log6(np.ascontiguousarray(T, float)).vector)


def inverse(T: ArrayLike) -> Array:
    """Inverse of a rigid transform or a stack of them, (..., 4, 4)."""
    T = np.asarray(T, float)
    result = np.zeros_like(T)
    R_t = np.swapaxes(T[..., :3, :3], -1, -2)
    result[..., :3, :3] = R_t
    result[..., :3, 3] = -np.einsum("...ij,...j->...i", R_t, T[..., :3, 3])
    result[..., 3, 3] = 1.0
    return result


def adjoint(T: ArrayLike) -> Array:
    """6x6 matrix with `T @ exp(xi) @ inverse(T) == exp(adjoint(T) @ xi)`."""
    T = np.asarray(T, float)
    R, p = T[:3, :3], T[:3, 3]
    result = np.zeros((6, 6))
    result[:3, :3] = result[3:, 3:] = R
    result[:3, 3:] = skew(p) @ R
    return result


def skew(v: ArrayLike) -> Array:
    """Cross-product matrix of a vector or of a stack, (..., 3) to (..., 3, 3)."""
    v = np.asarray(v, float)
    result = np.zeros((*v.shape, 3))
    result[..., 0, 1], result[..., 0, 2] = -v[..., 2], v[..., 1]
    result[..., 1, 0], result[..., 1, 2] = v[..., 2], -v[..., 0]
    result[..., 2, 0], result[..., 2, 1] = -v[..., 1], v[..., 0]
    return result


def apply(T: ArrayLike, points: ArrayLike) -> Array:
    """Map points: `T_a_b` and (N, 3) points in frame b to (N, 3) points in frame a."""
    T = np.asarray(T, float)
    return np.asarray(np.asarray(points, float) @ T[:3, :3].T + T[:3, 3])


def from_xyz_xyzw(values: ArrayLike) -> Array:
    """4x4 transform of (7,) x y z (m) and unit quaternion x y z w; (N, 4, 4) of (N, 7).

    Raises:
        GeometryError: The quaternion's norm is more than 1 % off 1, or a value is not finite.
    """
    from scipy.spatial.transform import Rotation

    values = np.asarray(values, float)
    rows = values if values.ndim == 2 else values.reshape(1, -1)
    if rows.shape[1] != 7 or not np.isfinite(rows).all():
        raise GeometryError(f"a transform needs x y z qx qy qz qw, got {values.tolist()}")
    norms = np.linalg.norm(rows[:, 3:], axis=1)
    for row, norm in zip(rows, norms, strict=True):
        if abs(norm - 1.0) > 0.01:
            raise GeometryError(
                f"quaternion {row[3:].tolist()} has norm {norm:.4g}",
                "give a unit quaternion x y z w",
            )
    T = np.tile(np.eye(4), (len(rows), 1, 1))
    if len(rows):
        T[:, :3, :3] = Rotation.from_quat(rows[:, 3:]).as_matrix()
    T[:, :3, 3] = rows[:, :3]
    return T if values.ndim == 2 else np.asarray(T[0])


def to_xyz_xyzw(T: ArrayLike) -> Array:
    """(7,) x y z (m) and unit quaternion x y z w (w >= 0) of 4x4; (N, 7) of (N, 4, 4)."""
    from scipy.spatial.transform import Rotation

    T = np.asarray(T, float)
    if not len(T):
        return np.empty((0, 7))
    quaternion = Rotation.from_matrix(T[..., :3, :3]).as_quat(canonical=True)
    return np.concatenate([T[..., :3, 3], quaternion], axis=-1)


def check_transform(T: Any, name: str = "transform") -> Array:
    """A 4x4 rigid transform, its rotation made exactly orthonormal.

    Args:
        T: Array-like of shape (4, 4).
        name: What to call it in an error.

    Returns:
        (4, 4) float array.

    Raises:
        GeometryError: Wrong shape, not finite, a reflection, or no rotation.
    """
    try:
        T = np.array(T, float)
    except (TypeError, ValueError) as error:
        raise GeometryError(f"{name} is not a matrix of numbers") from error
    if T.shape != (4, 4):
        raise GeometryError(f"{name} has shape {T.shape}", "give a 4x4 matrix")
    if not np.isfinite(T).all():
        raise GeometryError(f"{name} has values that are not finite")
    if np.abs(T[3] - [0, 0, 0, 1]).max() > 1e-9:
        raise GeometryError(f"{name} has last row {T[3].tolist()}", "it must be 0 0 0 1")
    R = T[:3, :3]
    determinant = float(np.linalg.det(R))
    if determinant < 0:
        raise GeometryError(
            f"{name} is a reflection (determinant {determinant:.4g})", "check the axes' signs"
        )
    deviation = float(np.abs(R.T @ R - np.eye(3)).max())
    if deviation > ROTATION_TOLERANCE:
        raise GeometryError(
            f"{name} is not a rotation (|R^T R - 1| = {deviation:.3g}, "
            f"at most {ROTATION_TOLERANCE:g})",
            "give more digits, or a quaternion",
        )
    U, _, Vt = np.linalg.svd(R)
    T[:3, :3] = U @ Vt
    return np.asarray(T)


def rotation_error(T_estimate: ArrayLike, T_reference: ArrayLike) -> float:
    """Geodesic angle between two rotations in radians."""
    R = np.asarray(T_estimate, float)[:3, :3] @ np.asarray(T_reference, float)[:3, :3].T
    sine = np.linalg.norm([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]]) / 2
    return float(np.arctan2(sine, (np.trace(R) - 1) / 2))


def translation_error(T_estimate: ArrayLike, T_reference: ArrayLike) -> float:
    """Euclidean distance between two translations in metres."""
    return float(
        np.linalg.norm(np.asarray(T_estimate, float)[:3, 3] - np.asarray(T_reference, float)[:3, 3])
    )


def sigma_distance(T_estimate: ArrayLike, T_reference: ArrayLike, covariance: ArrayLike) -> float:
    """How many standard deviations of the reference an estimate is away from it.

    The Mahalanobis distance of `log(T_estimate @ inverse(T_reference))`. An estimate that is
    exactly right has, over many references, a mean square of 6 (chi-squared, 6 degrees of
    freedom), so values up to about 3.5 say nothing against an estimate.

    Args:
        T_estimate: 4x4 `T_a_b`.
        T_reference: 4x4 `T_a_b` whose covariance is given.
        covariance: 6x6, translation then rotation, in frame a.

    Returns:
        The distance; NaN where the covariance is not finite (a reference without one).
    """
    covariance = np.asarray(covariance, float)
    T_estimate = np.asarray(T_estimate, float)
    if not (np.isfinite(covariance).all() and np.isfinite(T_estimate).all()):
        return float("nan")
    twist = log(T_estimate @ inverse(T_reference))
    squared = float(twist @ np.linalg.pinv(covariance, hermitian=True) @ twist)
    return float(np.sqrt(max(0.0, squared)))
