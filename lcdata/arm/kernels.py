"""Compiled forward kinematics and covariance of many joint positions.

One pass over the chain of `arm.chain`: turning about z mixes two columns of the rotation, so a
joint costs one 3x3 product. Imported where it is used: compiling takes a second once a machine.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]


@njit(cache=True, nogil=True, error_model="numpy")  # type: ignore[untyped-decorator]
def _walk(
    links: Array, slides: NDArray[np.bool_], q: Array, R: Array, p: Array, axes: Array
) -> None:
    """Effector pose of one sample in R (3, 3), p (3,); each joint's axis and origin in `axes`."""
    for i in range(3):
        p[i] = links[0, i, 3]
        for j in range(3):
            R[i, j] = links[0, i, j]
    for k in range(slides.shape[0]):
        c, s, shift = 1.0, 0.0, 0.0
        if slides[k]:
            shift = q[k]
        else:
            c, s = math.cos(q[k]), math.sin(q[k])
        for i in range(3):  # row by row, in place
            x, y, z = R[i, 0], R[i, 1], R[i, 2]
            axes[k, i], axes[k, 3 + i] = z, p[i]
            x, y = c * x + s * y, c * y - s * x
            for j in range(3):
                R[i, j] = x * links[k + 1, 0, j] + y * links[k + 1, 1, j] + z * links[k + 1, 2, j]
            p[i] += (
                x * links[k + 1, 0, 3] + y * links[k + 1, 1, 3] + z * (links[k + 1, 2, 3] + shift)
            )


@njit(cache=True, nogil=True, error_model="numpy")  # type: ignore[untyped-decorator]
def forward(links: Array, slides: NDArray[np.bool_], positions: Array) -> Array:
    """(N, 4, 4) `T_base_effector` of (N, n) joint positions, offsets included."""
    count, n = positions.shape
    result = np.zeros((count, 4, 4))
    R, p, axes = np.empty((3, 3)), np.empty(3), np.empty((n, 6))
    for row in range(count):
        _walk(links, slides, positions[row], R, p, axes)
        result[row, :3, :3] = R
        result[row, :3, 3] = p
        result[row, 3, 3] = 1.0
    return result


@njit(cache=True, nogil=True, error_model="numpy")  # type: ignore[untyped-decorator]
def forward_covariance(
    links: Array, slides: NDArray[np.bool_], positions: Array, variance: Array
) -> tuple[Array, Array]:
    """Poses as `forward` gives them, and J diag(variance) J^T in the effector's own axes.

    Args:
        links: (n + 1, 4, 4) of the chain.
        slides: (n,) of the chain.
        positions: (N, n), offsets included.
        variance: (N, n) or (1, n) of each joint, rad^2 or m^2.

    Returns:
        (N, 4, 4), and (N, 6, 6) translation then rotation.
    """
    count, n = positions.shape
    poses, covariances = np.zeros((count, 4, 4)), np.zeros((count, 6, 6))
    R, p, axes = np.empty((3, 3)), np.empty(3), np.empty((n, 6))
    column = np.empty(6)
    for row in range(count):
        _walk(links, slides, positions[row], R, p, axes)
        poses[row, :3, :3] = R
        poses[row, :3, 3] = p
        poses[row, 3, 3] = 1.0
        C = covariances[row]
        spread = variance[row if variance.shape[0] > 1 else 0]
        for k in range(n):
            x, y, z = axes[k, 0], axes[k, 1], axes[k, 2]
            if slides[k]:
                u, v, w = x, y, z
                x, y, z = 0.0, 0.0, 0.0
            else:
                dx, dy, dz = p[0] - axes[k, 3], p[1] - axes[k, 4], p[2] - axes[k, 5]
                u, v, w = y * dz - z * dy, z * dx - x * dz, x * dy - y * dx
            for i in range(3):
                column[i] = R[0, i] * u + R[1, i] * v + R[2, i] * w
                column[3 + i] = R[0, i] * x + R[1, i] * y + R[2, i] * z
            for i in range(6):
                scaled = spread[k] * column[i]
                for j in range(i + 1):
                    C[i, j] += scaled * column[j]
        for i in range(6):
            for j in range(i):
                C[j, i] = C[i, j]
    return poses, covariances
