"""A fixed sample of a cloud for all poses of a search: the nearest point in each direction.

Seen from the camera's centre of a first estimate, so that a dense near surface does not outweigh
all that is behind it, and what is hidden from there is left out. Points a little outside the
image belong to the sample: they may come into view.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lcdata.geometry.camera import Camera

Array = NDArray[np.float64]
Floats = NDArray[np.float32]

CELL = np.deg2rad([0.25, 0.4])
"""Edges of a cell of directions, across and down, radians: about a spinning LiDAR's own."""

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
        rest = np.flatnonzero(~inside)
        # Far from the middle of the view needs no comparison with the whole border.
        middle = border.mean(axis=0)
        middle /= max(float(np.linalg.norm(middle)), 1e-9)
        widest = np.arccos(np.clip((border @ middle).min(), -1.0, 1.0)) + margin
        if widest < np.pi:
            rest = rest[bearings[rest] @ middle.astype(np.float32) > np.cos(widest)]
        near = (bearings[rest] @ border.T.astype(np.float32)).max(axis=1, initial=-1.0)
        inside[rest[near > np.cos(margin)]] = True
    return np.asarray(inside)


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

    local = points @ T[:3, :3].T.astype(np.float32) + T[:3, 3].astype(np.float32)
    x, y, z = local.T
    distance = np.sqrt(x * x + y * y + z * z)
    column = ((np.arctan2(x, z) + np.pi) / CELL[0]).astype(np.int32)
    row = ((np.arctan2(y, np.hypot(x, z)) + np.pi / 2) / CELL[1]).astype(np.int32)
    columns, rows = int(2 * np.pi / CELL[0]) + 2, int(np.pi / CELL[1]) + 2
    valid = np.flatnonzero(distance > NEAREST_M)
    place = row[valid] * columns + column[valid]
    # The nearest is written last.
    order = np.argsort(-distance[valid], kind="stable")
    first = np.full(rows * columns, -1, np.int64)
    first[place[order]] = valid[order]
    taken = np.flatnonzero(first >= 0)
    index = first[taken]
    range_image = np.zeros((rows, columns), np.float32)
    range_image.reshape(-1)[taken] = distance[index]
    known = (range_image > 0).astype(np.float32)
    number, total, square = (
        cv2.boxFilter(a, -1, NEIGHBOURHOOD, normalize=False, borderType=cv2.BORDER_CONSTANT)
        for a in (known, range_image, range_image * range_image)
    )
    mean = total / np.maximum(number, 1.0)
    variance = square / np.maximum(number, 1.0) - mean * mean
    rough = np.sqrt(np.maximum(variance, 0.0)) / np.maximum(mean, 1e-6)
    inside = seen(camera, local[index], margin)
    return Sample(index[inside], np.ascontiguousarray(rough.reshape(-1)[taken[inside]]))
