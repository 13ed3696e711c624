"""Which frames show the same scene: several scans of a LiDAR that stands still are one."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float32]

CELL = np.deg2rad(2.0)
"""Edge of a cell of directions."""

SAME_RANGE = 0.02
"""Share by which the nearest ranges in a cell of two scans of one scene differ at most."""

SAME_SHARE = 0.6
"""Share of cells of equal range in two scans of one scene. Measured: 0.91 and more where people and
leaves moved, at most 0.26 of two places on a road, which share its surface."""


def signature(points: Floats) -> NDArray[np.float16]:
    """Logarithm of the nearest range in each direction; infinite where nothing came back.

    Args:
        points: (N, 3) in the LiDAR frame, metres, finite and not 0.

    Returns:
        (rows * columns,).
    """
    x, y, z = points.T
    distance = np.sqrt(x * x + y * y + z * z)
    columns, rows = int(2 * np.pi / CELL) + 1, int(np.pi / CELL) + 1
    column = ((np.arctan2(y, x) + np.pi) / CELL).astype(np.int32)
    row = ((np.arctan2(z, np.hypot(x, y)) + np.pi / 2) / CELL).astype(np.int32)
    nearest = np.full(rows * columns, np.inf, np.float32)
    np.minimum.at(nearest, np.minimum(row, rows - 1) * columns + column % columns, distance)
    return np.log(nearest).astype(np.float16)


def scenes(signatures: Sequence[NDArray[np.float16]]) -> list[list[int]]:
    """Numbers of the frames by scene.

    Args:
        signatures: See `signature`, of each frame.

    Returns:
        One list a scene, in the order of their first frames.
    """
    result: list[list[int]] = []
    for i, mine in enumerate(signatures):
        for scene in result:
            if _alike(mine, signatures[scene[0]]):
                scene.append(i)
                break
        else:
            result.append([i])
    return result


def _alike(one: NDArray[np.float16], other: NDArray[np.float16]) -> bool:
    both = np.isfinite(one) & np.isfinite(other)
    if not both.any():
        return False
    gap = np.abs(one[both].astype(np.float32) - other[both].astype(np.float32))
    return bool((gap < SAME_RANGE).mean() > SAME_SHARE)
