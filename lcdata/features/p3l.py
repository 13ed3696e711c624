"""Pose from three lines, two of them parallel (Ma et al. 2021, *CRLF*, section III-C).

Two parallel lanes and a pole leave an equation of order 2 in place of the general problem's 8. The
planes through the camera that hold the image lines have normals n1, n2 (lanes) and n3 (pole). The
lanes' direction v turns into +-(n1 x n2) (eq. 11, whose R' and angles this spells out), the pole's
direction w into the plane of n3; then n_i . (R p_i + t) = 0 is linear in t (eq. 12). numba kernels:
import this module only where it is used.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]


def p3l(normals: Array, directions: Array, points: Array) -> list[Array]:
    """The poses of two parallel lines and a third.

    Args:
        normals: (3, 3) unit normals, in the camera frame, of the planes through the camera's
            centre and the image lines: of the two parallel lines, then of the third.
        directions: (2, 3) unit vectors, of the parallel lines and of the third, in the LiDAR
            frame.
        points: (3, 3) a point of each line in the LiDAR frame, metres.

    Returns:
        Up to four 4x4 `T_camera_lidar`; none where the lines determine no pose.
    """
    n, p = np.ascontiguousarray(normals, float), np.ascontiguousarray(points, float)
    v, w = (np.ascontiguousarray(direction, float) for direction in directions)
    rotations, count = turns(n[0], n[1], n[2], v, w)
    poses = []
    for R in rotations[:count]:
        if abs(np.linalg.det(n)) < 1e-9:
            continue
        T = np.eye(4)
        T[:3, :3] = R
        T[:3, 3] = np.linalg.solve(n, -np.einsum("ij,ij->i", n, p @ R.T))
        poses.append(T)
    return poses


@njit(cache=True, nogil=True)
def turns(n1, n2, n3, v, w):  # type: ignore[no-untyped-def]
    """Rotations that turn v into +-(n1 x n2) and w into the plane with normal n3.

    Returns:
        (4, 3, 3) of which the first so many count, and how many.
    """
    result = np.empty((4, 3, 3))
    count = 0
    d = np.cross(n1, n2)
    length = np.sqrt(d @ d)
    c = v @ w
    s = np.sqrt(max(1.0 - c * c, 0.0))
    if length < 1e-6 or s < 0.1:
        return result, 0
    d = d / length
    u = (w - c * v) / s
    lidar = np.empty((3, 3))
    lidar[0], lidar[1], lidar[2] = v, u, np.cross(v, u)
    e = np.zeros(3)
    e[np.argmin(np.abs(d))] = 1.0
    e1 = np.cross(d, e)
    e1 = e1 / np.sqrt(e1 @ e1)
    camera = np.empty((3, 3))
    for sign in (1.0, -1.0):
        x = sign * d
        e2 = np.cross(x, e1)
        # n3 . (c x + s (cos a e1 + sin a e2)) = 0
        a1, a2 = n3 @ e1, n3 @ e2
        reach = np.sqrt(a1 * a1 + a2 * a2)
        if reach < 1e-6:
            continue
        q = -c / s * (n3 @ x) / reach
        if abs(q) > 1.0:
            continue
        for other in (1.0, -1.0):
            a = np.arctan2(a2, a1) + other * np.arccos(q)
            camera[0] = x
            camera[1] = np.cos(a) * e1 + np.sin(a) * e2
            camera[2] = np.cross(camera[0], camera[1])
            result[count] = camera.T @ lidar
            count += 1
    return result, count
