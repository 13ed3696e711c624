"""How well lane and pole points fall onto their masks (Ma et al. 2021, *CRLF*, eq. 8 and 9).

Eq. (8) is put right: as printed, heights of mask pixels fall from the border inwards, and points
would gather along borders. Here

    H(q) = 1 - g0^d(q, R^2 \\ Q) / 2    in the mask Q,
    H(q) = g1^d(q, Q) / 2               elsewhere,

with the paper's city-block distances d: it rises from 0 far away to 1/2 at the border and to 1
deep in the mask. Eq. (9) is printed without its sums' end: J is the sum over lanes and poles of
the mean height of their points; one that is not in the image has height 0. numba kernels: import
this module only where it is used.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]
Floats = NDArray[np.float32]
Mask = NDArray[np.bool_]

GAMMA0, GAMMA1 = 0.7, 0.97
"""Factors a pixel at 1000 pixels a radian, inside and outside: the paper does not say its own."""

NEAR = 0.1
"""Points closer to the camera's plane are behind it, metres."""


def height_map(mask: Mask, gamma0: float = GAMMA0, gamma1: float = GAMMA1) -> Floats:
    """Eq. (8).

    Args:
        mask: (h, w), some of it true and some false.
        gamma0: Factor a pixel inside.
        gamma1: Factor a pixel outside.

    Returns:
        (h, w) heights, 0..1.
    """
    import cv2

    inside, outside = mask.astype(np.uint8), (~mask).astype(np.uint8)
    deep = cv2.distanceTransform(inside, cv2.DIST_L1, 3)
    far = cv2.distanceTransform(outside, cv2.DIST_L1, 3)
    decay = np.exp(np.where(mask, np.log(gamma0) * deep, np.log(gamma1) * far))
    return np.asarray(np.where(mask, 1.0 - 0.5 * decay, 0.5 * decay), np.float32)


def flat_poses(T: Array) -> Array:
    """(P, 12) rotation row by row, then translation, of (P, 4, 4) or of one 4x4."""
    T = np.asarray(T, float).reshape(-1, 4, 4)
    return np.concatenate([T[:, :3, :3].reshape(-1, 9), T[:, :3, 3]], 1)


@njit(cache=True, nogil=True, inline="always")
def height_at(pose, x, y, z, table, intrinsics):  # type: ignore[no-untyped-def]
    """Height under one point; 0 outside the image."""
    cz = pose[6] * x + pose[7] * y + pose[8] * z + pose[11]
    if cz < NEAR:
        return 0.0
    cx = pose[0] * x + pose[1] * y + pose[2] * z + pose[9]
    cy = pose[3] * x + pose[4] * y + pose[5] * z + pose[10]
    u = intrinsics[0] * cx / cz + intrinsics[2] + 0.5
    v = intrinsics[1] * cy / cz + intrinsics[3] + 0.5
    if u < 0.0 or v < 0.0 or u >= table.shape[1] or v >= table.shape[0]:
        return 0.0
    return table[int(v), int(u)]


@njit(cache=True, nogil=True)
def mean_height(pose, points, table, intrinsics):  # type: ignore[no-untyped-def]
    """Mean height of (N, 3) points for one (12,) pose; 0 of no points."""
    total = 0.0
    for i in range(len(points)):
        total += height_at(pose, points[i, 0], points[i, 1], points[i, 2], table, intrinsics)
    return total / max(len(points), 1)


@njit(cache=True, nogil=True)
def heights(poses, points, table, intrinsics):  # type: ignore[no-untyped-def]
    """Mean heights of (N, 3) points for (P, 12) poses: (P,)."""
    result = np.empty(len(poses))
    for k in range(len(poses)):
        result[k] = mean_height(poses[k], points, table, intrinsics)
    return result
