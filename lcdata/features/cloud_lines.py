"""3D line segments of a LiDAR scan: where planes meet and where they end.

After Lu, Liu, Li: Fast 3D Line Segment Detection From Unorganized Point Cloud (2019), which
finds planes by region growing and lines on the planes, on the scan's own grid instead of a
kd-tree. Two kinds of lines: intersections of neighbouring planes, and outlines of foreground
planes.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lcdata.features.scan_grid import scan_grid

Array = NDArray[np.float64]

PLANE_PLANE, BOUNDARY = 0, 1

SHORTEST_M = 0.25
SHORTEST_ANGLE = np.radians(1.5)
"""A segment is at least this long in metres and, seen from the scanner, in angle."""
LARGEST_STD_M = 0.1
SAME_ANGLE = np.radians(3.0)


@dataclass(frozen=True, eq=False)
class CloudLines:
    """3D line segments of one scan.

    Args:
        segments: (M, 2, 3) end points in the LiDAR frame, metres; longest (as seen from the
            scanner) first.
        kind: (M,) uint8, 0 for two planes that meet, 1 for the outline of a foreground plane.
        support: (M,) int64 points or point pairs that a segment rests on.
        std: (M,) standard deviation of a segment's position across itself, metres.
    """

    segments: Array
    kind: NDArray[np.uint8]
    support: NDArray[np.int64]
    std: Array

    def __len__(self) -> int:
        return len(self.segments)

    @property
    def lengths(self) -> Array:
        """(M,) metres."""
        return np.asarray(np.linalg.norm(self.segments[:, 1] - self.segments[:, 0], axis=1))

    @classmethod
    def empty(cls) -> CloudLines:
        """No lines."""
        return cls(np.zeros((0, 2, 3)), np.zeros(0, np.uint8), np.zeros(0, np.int64), np.zeros(0))


def extract_cloud_lines(
    points: NDArray[np.floating[Any]],
    organised: tuple[int, int] | None = None,
    ring: NDArray[np.integer[Any]] | None = None,
) -> CloudLines:
    """Find the line segments of a scan.

    Args:
        points: (N, 3) in the LiDAR frame, metres, z along the axis of rotation; NaN or zeros
            where nothing came back.
        organised: (rings, columns) if the points are a row-major image of the scan.
        ring: (N,) ring numbers of an unorganised cloud; without them they come from the order
            of the points or from clear clusters of elevation.

    Returns:
        The lines; none where the points form no scan (too few, no rings to be found).
    """
    grid = scan_grid(points, organised, ring)
    if grid is None:
        return CloudLines.empty()
    from lcdata.features.creases import find_creases
    from lcdata.features.planes import find_planes
    from lcdata.features.silhouettes import find_silhouettes

    planes = find_planes(grid)
    creases, crease_std, crease_support = find_creases(grid, planes)
    outlines, outline_std, outline_support = find_silhouettes(grid, planes)
    lines = CloudLines(
        np.concatenate([creases, outlines]),
        np.repeat(np.array([PLANE_PLANE, BOUNDARY], np.uint8), [len(creases), len(outlines)]),
        np.concatenate([crease_support, outline_support]),
        np.concatenate([crease_std, outline_std]),
    )
    return lines
