"""Pluecker lines: a 3D line as (n, v), its image, and the residuals of PLK-Calib.

Equation numbers are those of PLK-Calib (Zhang, Xu, Ren), with its misprints put right. A line
through p1 and p2 is n = p1 x p2, v = p2 - p1. Derivatives belong to the left perturbation of
`lcdata.geometry.se3`, T <- exp(rho, theta) T, in which they are shorter than in print: with
R <- Exp(d) R and p <- p + dp, rho = dp + [p]x d, and -[Rn]x - [p]x[Rv]x of (6) becomes -[n_C]x.

Shapes may have any leading dimensions, the same for poses and lines: (B, 4, 4) with (B, N, 3).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


def from_points(segments: ArrayLike) -> tuple[Array, Array]:
    """Pluecker coordinates, eq. (1).

    Args:
        segments: (N, 2, 3) two points of each line, metres.

    Returns:
        n: (N, 3) normal of the plane of line and origin, m^2, and v: (N, 3) direction, m.
    """
    segments = np.asarray(segments, float)
    return (
        np.cross(segments[..., 0, :], segments[..., 1, :]),
        segments[..., 1, :] - segments[..., 0, :],
    )


def transform(T_camera_lidar: ArrayLike, n: Array, v: Array) -> tuple[Array, Array]:
    """Lines in another frame, eq. (2): n_C = R n + p x R v, v_C = R v.

    Args:
        T_camera_lidar: 4x4.
        n: (N, 3) in the LiDAR frame.
        v: (N, 3) in the LiDAR frame.

    Returns:
        n_C, v_C: (N, 3) each, in the camera frame.
    """
    T = np.asarray(T_camera_lidar, float)
    R_transposed = np.swapaxes(T[..., :3, :3], -1, -2)
    v_camera = v @ R_transposed
    return n @ R_transposed + np.cross(T[..., None, :3, 3], v_camera), v_camera


def line_matrix(K: ArrayLike) -> Array:
    """3x3 matrix that projects n_C to the image line l = K_l n_C, eq. (3).

    Args:
        K: 3x3 intrinsic matrix without skew, pixels.
    """
    (fu, _, cu), (_, fv, cv), _ = np.asarray(K, float)
    return np.array([[fv, 0, 0], [0, fu, 0], [-fv * cu, -fu * cv, fu * fv]])


def back_project(K: ArrayLike, image_segments: ArrayLike) -> Array:
    """Unit normals of the planes through the camera centre and image lines, eq. (7).

    Args:
        K: 3x3 intrinsic matrix, pixels.
        image_segments: (N, 2, 2) end points, pixels.

    Returns:
        (N, 3) unit n' in the camera frame.
    """
    segments = np.asarray(image_segments, float)
    homogeneous = np.concatenate([segments, np.ones((*segments.shape[:-1], 1))], -1)
    bearings = homogeneous @ np.linalg.inv(np.asarray(K, float)).T
    normals = np.cross(bearings[..., 0, :], bearings[..., 1, :])
    length = np.linalg.norm(normals, axis=-1, keepdims=True)
    return np.asarray(normals / np.maximum(length, 1e-300))


def projection_residuals(
    T_camera_lidar: ArrayLike, n: Array, v: Array, K: ArrayLike, image_segments: Array
) -> tuple[Array, Array]:
    """Method I: signed distances of image end points to projected 3D lines, eq. (4) and (6).

    Args:
        T_camera_lidar: 4x4.
        n: (N, 3) line normals in the LiDAR frame.
        v: (N, 3) line directions in the LiDAR frame.
        K: 3x3 intrinsic matrix, pixels.
        image_segments: (N, 2, 2) matched image segments, pixels.

    Returns:
        r: (N, 2) pixels, and J: (N, 2, 6) its derivative by (rho, theta) of a left perturbation.
    """
    n_camera, v_camera = transform(T_camera_lidar, n, v)
    K_l = line_matrix(K)
    line = n_camera @ K_l.T
    length = np.maximum(np.hypot(line[..., 0], line[..., 1]), 1e-300)[..., None]
    line /= length
    residuals = np.einsum("...kc,...c->...k", image_segments, line[..., :2]) + line[..., 2:]
    # dr/dl = (x - r [l1 l2 0]/s) / s, with l already divided by s.
    by_line = np.ones((*residuals.shape, 3))
    by_line[..., :2] = image_segments - residuals[..., None] * line[..., None, :2]
    by_normal = (by_line / length[..., None]) @ K_l
    jacobian = np.concatenate(
        [
            np.cross(v_camera[..., None, :], by_normal),
            np.cross(n_camera[..., None, :], by_normal),
        ],
        -1,
    )
    return residuals, jacobian


def co_perpendicular_residuals(R: ArrayLike, v: Array, n_image: Array) -> tuple[Array, Array]:
    """Method II: r' = n'^T R v, eq. (11), and its derivative (13).

    Args:
        R: 3x3 rotation from LiDAR to camera.
        v: (N, 3) line directions in the LiDAR frame; their length is their weight.
        n_image: (N, 3) unit normals of the back-projected image lines, camera frame.

    Returns:
        r': (N,), and J: (N, 3) its derivative by theta of R <- Exp(theta) R.
    """
    v_camera = v @ np.swapaxes(np.asarray(R, float), -1, -2)
    return np.einsum("...c,...c->...", n_image, v_camera), np.cross(v_camera, n_image)
