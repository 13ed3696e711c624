"""A camera as it is drawn in 3D."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lcdata.geometry import se3
from lcdata.geometry.camera import Camera

Array = NDArray[np.float64]


def plane(camera: Camera) -> Array:
    """3x3 of the image plane that stands for a camera in 3D: as sharp in the middle."""
    if camera.model == "pinhole":
        return camera.K
    fx, fy = camera.pixels_per_radian
    return np.array([[fx, 0, camera.width / 2], [0, fy, camera.height / 2], [0, 0, 1.0]])


def frustum(camera: Camera, T_camera_lidar: Array, depth_m: float) -> list[Array]:
    """A camera's field of view as line strips in the LiDAR frame, metres."""
    w, h = camera.width - 0.5, camera.height - 0.5
    corners = np.array([[-0.5, -0.5], [w, -0.5], [w, h], [-0.5, h]])
    fx, fy, cx, cy = camera.intrinsics
    rays = np.column_stack([(corners - [cx, cy]) / [fx, fy], np.ones(4)]) * depth_m
    T_lidar_camera = se3.inverse(T_camera_lidar)
    corners = se3.apply(T_lidar_camera, rays)
    eye = T_lidar_camera[:3, 3]
    return [np.vstack([corners, corners[:1]]), *(np.stack([eye, c]) for c in corners)]
