"""A fixed sample of a cloud for all poses of a search: the nearest point in each direction.

Seen from the camera's centre of a first estimate, so that a dense near surface does not outweigh
all that is behind it, and what is hidden from there is left out. Points a little outside the
image belong to the sample: they may come into view.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from lcdata.geometry.camera import Camera

Array = NDArray[np.float64]
Floats = NDArray[np.float32]

ACROSS, DOWN = float(np.deg2rad(0.25)), float(np.deg2rad(0.4))
"""Edges of a cell of directions, radians: about a spinning LiDAR's own."""

NEIGHBOURHOOD = (7, 5)
"""Cells, across and down, over which the roughness of the range is taken."""

BORDER_STEPS = 48
"""Points on each side of the image that stand for its border."""

NEAREST_M = 0.5
"""Closer returns are of the rig itself."""


@dataclass(frozen=True, eq=False)
class Sample:
    """Points of one frame.

    Args:
        index: (N,) which of the cloud's points.
        roughness: (N,) float32 spread of the range around a point over its mean.
    """

    index: NDArray[np.int64]
    roughness: Floats


def seen(camera: Camera, points: Floats, margin: float) -> NDArray[np.bool_]:
    """Which points lie in the camera's view or near it.

    Args:
        camera: Any model.
        points: (N, 3) in the camera frame, metres.
        margin: How far beside the image, radians.
    """
    bearings = points / np.maximum(np.linalg.norm(points, axis=1, keepdims=True), 1e-9)
    _, inside = camera.project(bearings)
    border = _border(camera)
    if len(border):
        middle, widest = _cone(border, margin)
        rest = np.flatnonzero(~inside & (bearings @ middle > widest))
        near = (bearings[rest] @ border.T.astype(np.float32)).max(axis=1, initial=-1.0)
        inside[rest[near > np.cos(margin)]] = True
    return np.asarray(inside)


def _cone(border: Array, margin: float) -> tuple[Floats, float]:
    """Axis of a cone around the view and its margin, and the cosine of its half-angle."""
    middle = border.mean(axis=0) if len(border) else np.zeros(3)
    length = float(np.linalg.norm(middle))
    if length < 0.1:  # a view all around
        return np.zeros(3, np.float32), -2.0
    middle /= length
    widest = float(np.arccos(np.clip((border @ middle).min(), -1.0, 1.0))) + margin
    cosine = np.cos(widest) - 1e-6 if widest < np.pi else -2.0
    return middle.astype(np.float32), float(cosine)


def _border(camera: Camera) -> Array:
    """Unit vectors to the border of the image, where the lens shows something."""
    t = np.linspace(-0.5, 0.5, BORDER_STEPS)
    u, v = (t + 0.5) * (camera.width - 1), (t + 0.5) * (camera.height - 1)
    zero = np.zeros(BORDER_STEPS)
    pixels = np.concatenate(
        [
            np.stack([u, zero], 1),
            np.stack([u, zero + camera.height - 1], 1),
            np.stack([zero, v], 1),
            np.stack([zero + camera.width - 1, v], 1),
        ]
    )
    bearings = camera.unproject(pixels)
    return np.asarray(bearings[np.isfinite(bearings).all(axis=1)])


def sample(camera: Camera, points: Floats, T: Array, margin: float) -> Sample:
    """The nearest point in each cell of directions in view.

    Args:
        camera: Any model.
        points: (N, 3) float32 in the LiDAR frame, metres, finite.
        T: 4x4 `T_camera_lidar` of the estimate.
        margin: How far beside the image, radians.

    Returns:
        Points from top to bottom and left to right.
    """
    import cv2

    border = _border(camera)
    # A lens that shows nothing at its corners may see more than its border tells.
    complete = len(border) == 4 * BORDER_STEPS
    middle, widest = _cone(border, margin) if complete else (np.zeros(3, np.float32), -2.0)
    first, ranges = _nearest(points, T, middle, widest)
    taken = np.flatnonzero(first.reshape(-1) >= 0)
    if not len(taken):
        return Sample(np.zeros(0, np.int64), np.zeros(0, np.float32))
    rows, columns = np.divmod(taken, first.shape[1])
    part = slice(rows.min(), rows.max() + 1), slice(columns.min(), columns.max() + 1)
    distance = np.ascontiguousarray(ranges[part])
    number, total, square = (
        cv2.boxFilter(a, -1, NEIGHBOURHOOD, normalize=False, borderType=cv2.BORDER_CONSTANT)
        for a in ((distance > 0).astype(np.float32), distance, distance * distance)
    )
    mean = total / np.maximum(number, 1.0)
    variance = square / np.maximum(number, 1.0) - mean * mean
    rough = np.sqrt(np.maximum(variance, 0.0)) / np.maximum(mean, 1e-6)
    index = first.reshape(-1)[taken]
    local = points[index] @ T[:3, :3].T.astype(np.float32) + T[:3, 3].astype(np.float32)
    inside = seen(camera, local, margin)
    place = rows[inside] - rows.min(), columns[inside] - columns.min()
    return Sample(index[inside], np.ascontiguousarray(rough[place]))


@njit(cache=True, nogil=True, fastmath={"contract", "arcp", "reassoc", "nsz"})
def _nearest(points, T, middle, widest):  # type: ignore[no-untyped-def]
    """Index of the nearest point (-1 for none) and its range (0) in each cell of directions.

    Args:
        points: (N, 3) float32 in the LiDAR frame, metres.
        T: 4x4 `T_camera_lidar`.
        middle: (3,) axis of a cone.
        widest: Cosine of its half-angle; points outside are left out.
    """
    rows, columns = int(np.pi / DOWN) + 2, int(2.0 * np.pi / ACROSS) + 2
    first = np.full((rows, columns), -1, np.int64)
    ranges = np.zeros((rows, columns), np.float32)
    for i in range(len(points)):
        a, b, c = np.float64(points[i, 0]), np.float64(points[i, 1]), np.float64(points[i, 2])
        x = T[0, 0] * a + T[0, 1] * b + T[0, 2] * c + T[0, 3]
        y = T[1, 0] * a + T[1, 1] * b + T[1, 2] * c + T[1, 3]
        z = T[2, 0] * a + T[2, 1] * b + T[2, 2] * c + T[2, 3]
        distance = np.sqrt(x * x + y * y + z * z)
        if (
            distance < NEAREST_M
            or middle[0] * x + middle[1] * y + middle[2] * z < widest * distance
        ):
            continue
        row = int((np.arcsin(y / distance) + 0.5 * np.pi) / DOWN)
        column = int((np.arctan2(x, z) + np.pi) / ACROSS)
        if first[row, column] < 0 or distance < ranges[row, column]:
            first[row, column] = i
            ranges[row, column] = distance
    return first, ranges
