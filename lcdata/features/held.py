"""Half of an extrinsic held as it is given, while the other half is estimated."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lcdata.geometry.se3 import exp, skew

Array = NDArray[np.float64]

NOTHING, ROTATION, TRANSLATION = "nothing", "rotation", "translation"

HOLDS = (NOTHING, ROTATION, TRANSLATION)
"""What can be held. The translation is that of `T_camera_lidar`: where the camera sees the LiDAR's
origin, about which the LiDAR then turns."""


def free_directions(T_camera_lidar: Array, hold: str) -> Array:
    """Left perturbations (translation, rotation) that leave what is held where it is.

    Args:
        T_camera_lidar: 4x4 pose that is perturbed; only its translation matters, and that only
            where it is held.
        hold: One of `HOLDS`.

    Returns:
        (6, 6) or (6, 3), a direction a column.
    """
    if hold == ROTATION:
        return np.eye(6)[:, :3]
    if hold == TRANSLATION:  # p + theta x p + rho = p
        return np.concatenate([skew(T_camera_lidar[:3, 3]), np.eye(3)])
    return np.eye(6)


def stepped(T_camera_lidar: Array, step: Array, hold: str) -> Array:
    """exp(step) T, with what is held exactly where it was.

    Args:
        T_camera_lidar: 4x4.
        step: (6,) along `free_directions`, translation then rotation.
        hold: One of `HOLDS`.
    """
    T = exp(step) @ T_camera_lidar
    if hold == TRANSLATION:
        T[:3, 3] = T_camera_lidar[:3, 3]
    return T


def released(box: Array, hold: str) -> Array:
    """A search's (6,) half-widths of rotation, then translation, without those of what is held."""
    box = box.copy()
    if hold == ROTATION:
        box[:3] = 0.0
    if hold == TRANSLATION:
        box[3:] = 0.0
    return box
