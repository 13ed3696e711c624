"""Many small line problems at once: PLK-Calib's two methods without robust weights.

As in the paper's section IV: matches are given, noise is on the end points of image lines only,
and every line counts alike. All runs of a case are solved together, a batch axis first.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lcdata.geometry import pluecker

Array = NDArray[np.float64]

ITERATIONS = 40
PARALLEL = 1e-15
"""Singular values below so small a part of the largest count as zero in a linear step."""


@dataclass(frozen=True, eq=False)
class Problems:
    """B problems of N matched lines.

    Args:
        segments: (B, N, 2, 3) in the LiDAR frame, metres.
        image: (B, N, 2, 2) end points of the matched image lines, pixels.
        K: 3x3 intrinsic matrix, pixels.
        T_initial: (B, 4, 4) initial guesses of T_camera_lidar.
    """

    segments: Array
    image: Array
    K: Array
    T_initial: Array


def projection(problems: Problems) -> Array:
    """Method I, eq. (5): Levenberg-Marquardt on the residuals of eq. (4).

    Returns:
        (B, 4, 4) T_camera_lidar.
    """
    n, v = pluecker.from_points(problems.segments)

    def linearise(T: Array) -> tuple[Array, Array]:
        r, J = pluecker.projection_residuals(T, n, v, problems.K, problems.image)
        return r.reshape(len(T), -1), J.reshape(len(T), -1, 6)

    T = problems.T_initial.copy()
    damping = np.full(len(T), 1e-3)
    r, J = linearise(T)
    cost = np.square(r).sum(1)
    for _ in range(ITERATIONS):
        H = np.swapaxes(J, 1, 2) @ J
        diagonal = np.einsum("bii->bi", H)
        damped = H + np.einsum("bi,ij->bij", damping[:, None] * diagonal + 1e-12, np.eye(6))
        step = -np.linalg.solve(damped, np.einsum("bki,bk->bi", J, r)[..., None])[..., 0]
        tried = _moved(T, step)
        r_tried, J_tried = linearise(tried)
        cost_tried = np.square(r_tried).sum(1)
        better = cost_tried < cost
        T, r, J = (
            np.where(better[(...,) + (None,) * (new.ndim - 1)], new, old)
            for new, old in ((tried, T), (r_tried, r), (J_tried, J))
        )
        if (cost - cost_tried <= 1e-12 * cost).all() and (damping < 1e-6).any():
            break
        cost = np.where(better, cost_tried, cost)
        damping = np.clip(np.where(better, 0.1 * damping, 10 * damping), 1e-9, 1e9)
    return T


def decoupled(problems: Problems) -> Array:
    """Method II, eq. (12) then (14): rotation alone, then translation by linear least squares.

    A line's direction is weighted by 1 / sqrt(|p1|^2 + |p2|^2); the linear step uses
    n'^T (R p_mid + p) = 0 over |p_mid|, which a rotation that is not exact does not bias.

    Returns:
        (B, 4, 4) T_camera_lidar.
    """
    n_image = pluecker.back_project(problems.K, problems.image)
    size = np.sqrt(np.square(problems.segments).sum((2, 3)))[..., None]
    v = (problems.segments[:, :, 1] - problems.segments[:, :, 0]) / size
    T = problems.T_initial.copy()
    for _ in range(ITERATIONS):
        r, J = pluecker.co_perpendicular_residuals(T[:, :3, :3], v, n_image)
        step = np.zeros((len(T), 6))
        step[:, 3:] = -_least_squares(J, r)
        # Parallel lines leave a direction open: no step may turn the world over.
        step *= np.minimum(1.0, 0.5 / np.maximum(np.abs(step).max(1), 1e-12))[:, None]
        T = _moved(T, step)
        if np.abs(step).max() < 1e-12:
            break
    middle = problems.segments.mean(2)
    distance = np.linalg.norm(middle, axis=2, keepdims=True)
    turned = middle @ np.swapaxes(T[:, :3, :3], 1, 2)
    rows = n_image / distance
    T[:, :3, 3] = -_least_squares(rows, (rows * turned).sum(2))
    return T


def _least_squares(A: Array, b: Array) -> Array:
    """(B, k) x of least squares A x = b for (B, N, k) and (B, N)."""
    return np.asarray((np.linalg.pinv(A, rcond=PARALLEL) @ b[..., None])[..., 0])


def _moved(T: Array, step: Array) -> Array:
    """exp(step) T to first order: the derivative is that of a left perturbation."""
    from scipy.spatial.transform import Rotation

    turn = Rotation.from_rotvec(step[:, 3:]).as_matrix()
    moved = T.copy()
    moved[:, :3, :3] = turn @ T[:, :3, :3]
    moved[:, :3, 3] = np.einsum("bij,bj->bi", turn, T[:, :3, 3]) + step[:, :3]
    return moved
