"""Points on cloud edges through any camera model, and how uncertain they are there, compiled."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from lcdata.features.image_edges import ORIENTATIONS
from lcdata.geometry.camera_kernels import FAST, project_point_jacobian

Array = NDArray[np.float64]


@njit(cache=True, nogil=True, error_model="numpy")
def project_edges(model, parameters, pose, points, tangents, pixels, along, jacobians):  # type: ignore[no-untyped-def]
    """Pixels of edge points, the directions of their edges there, and their derivatives.

    Args:
        model: Number of the camera model.
        parameters: Its parameters.
        pose: (12,) R row by row, then t, of `T_camera_lidar`.
        points: (N, 3) in the LiDAR frame, metres.
        tangents: (N, 3) unit directions of the edges.
        pixels: (N, 2) takes the pixels; NaN where the camera does not see.
        along: (N, 2) takes unit directions in the image; 0 where an edge is seen end on.
        jacobians: (N, 2, 3) takes the derivatives by the point in the camera frame.
    """
    for i in range(points.shape[0]):
        x, y, z = points[i]
        u, v, ux, uy, uz, vx, vy, vz, ok = project_point_jacobian(
            model,
            parameters,
            pose[0] * x + pose[1] * y + pose[2] * z + pose[9],
            pose[3] * x + pose[4] * y + pose[5] * z + pose[10],
            pose[6] * x + pose[7] * y + pose[8] * z + pose[11],
        )
        pixels[i, 0], pixels[i, 1] = u, v
        jacobians[i, 0, 0], jacobians[i, 0, 1], jacobians[i, 0, 2] = ux, uy, uz
        jacobians[i, 1, 0], jacobians[i, 1, 1], jacobians[i, 1, 2] = vx, vy, vz
        x, y, z = tangents[i]
        tx = pose[0] * x + pose[1] * y + pose[2] * z
        ty = pose[3] * x + pose[4] * y + pose[5] * z
        tz = pose[6] * x + pose[7] * y + pose[8] * z
        du, dv = ux * tx + uy * ty + uz * tz, vx * tx + vy * ty + vz * tz
        norm = np.sqrt(du * du + dv * dv)
        along[i, 0], along[i, 1] = 0.0, 0.0
        if ok and norm > 1e-9:
            along[i, 0], along[i, 1] = du / norm, dv / norm


@njit(cache=True, nogil=True, fastmath=FAST, error_model="numpy")
def directional_costs(  # type: ignore[no-untyped-def]
    model, parameters, poses, points, tangents, weights, field, stride, costs
):
    """Add the sums of a field by direction at the projected points to the costs of many poses.

    Args:
        model: Number of the camera model.
        parameters: Its parameters.
        poses: (P, 12) R row by row, then t, of `T_camera_lidar`.
        points: (N, 3) in the LiDAR frame, metres.
        tangents: (N, 3) directions of the edges.
        weights: (N,).
        field: (ORIENTATIONS, h, w) float32.
        stride: Pixels a cell.
        costs: (P,) added to; outside the image a point costs nothing and gains nothing.
    """
    height, width = field.shape[1:]
    inverse = 1.0 / stride
    for k in range(poses.shape[0]):
        r00, r01, r02, r10, r11, r12, r20, r21, r22, px, py, pz = poses[k]
        total = 0.0
        for i in range(points.shape[0]):
            x, y, z = points[i, 0], points[i, 1], points[i, 2]
            u, v, ux, uy, uz, vx, vy, vz, ok = project_point_jacobian(
                model,
                parameters,
                r00 * x + r01 * y + r02 * z + px,
                r10 * x + r11 * y + r12 * z + py,
                r20 * x + r21 * y + r22 * z + pz,
            )
            if not (ok and u >= -0.5 and v >= -0.5):
                continue
            column, row = int((u + 0.5) * inverse), int((v + 0.5) * inverse)
            if column >= width or row >= height:
                continue
            x, y, z = tangents[i, 0], tangents[i, 1], tangents[i, 2]
            tx = r00 * x + r01 * y + r02 * z
            ty = r10 * x + r11 * y + r12 * z
            tz = r20 * x + r21 * y + r22 * z
            du, dv = ux * tx + uy * ty + uz * tz, vx * tx + vy * ty + vz * tz
            angle = np.arctan2(dv, du)
            if angle < 0.0:
                angle += np.pi
            b = min(int(angle * (ORIENTATIONS / np.pi)), ORIENTATIONS - 1)
            total += weights[i] * field[b, row, column]
        costs[k] += total
