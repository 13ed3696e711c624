"""Errors of extrinsics as CRLF counts them: per axis."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from lcdata.geometry import se3

Array = NDArray[np.float64]
Six = tuple[float, float, float, float, float, float]

AXES = ("Δtx (m)", "Δty (m)", "Δtz (m)", "Δroll (°)", "Δpitch (°)", "Δyaw (°)")


def per_axis(T: Array, truth: Array) -> Six:
    """Error of a 4x4 T_camera_lidar.

    Returns:
        Difference of the translations along the camera's x, y, z in metres, and the angles of
        `R R_true^T` about its x, y, z (roll, pitch, yaw of Rz Ry Rx) in degrees.
    """
    R = T[:3, :3] @ truth[:3, :3].T
    roll = np.arctan2(R[2, 1], R[2, 2])
    pitch = np.arcsin(np.clip(-R[2, 0], -1.0, 1.0))
    yaw = np.arctan2(R[1, 0], R[0, 0])
    t = T[:3, 3] - truth[:3, 3]
    angles = np.rad2deg([roll, pitch, yaw])
    return (
        float(t[0]),
        float(t[1]),
        float(t[2]),
        float(angles[0]),
        float(angles[1]),
        float(angles[2]),
    )


def displaced(truth: Array, share: float, rng: np.random.Generator) -> Array:
    """An extrinsic off by up to `share` of 1 m and 6 deg on each axis, evenly drawn (section IV-B).

    Args:
        truth: 4x4.
        share: 0 ... 1; one component of the translation and one of the rotation reach it.
        rng: Source of chance.
    """
    shift, turn = rng.uniform(-1.0, 1.0, (2, 3))
    shift, turn = shift / np.abs(shift).max(), turn / np.abs(turn).max()
    rotation = se3.exp(np.concatenate([np.zeros(3), np.deg2rad(6.0) * share * turn]))
    T = truth.copy()
    T[:3, :3] = rotation[:3, :3] @ T[:3, :3]
    T[:3, 3] += share * shift
    return T


def sizes(errors: Sequence[Six]) -> tuple[Array, Array]:
    """(N,) length of the translation errors in metres, and about that of the rotations in deg."""
    table = np.array(errors, float).reshape(-1, 6)
    return np.linalg.norm(table[:, :3], axis=1), np.linalg.norm(table[:, 3:], axis=1)
