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
SAME_SIGMA, SAME_M = 2.0, 0.02
"""Lines closer than this are one."""


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
    return _without_repeats(_worth_having(lines))


def _chosen(lines: CloudLines, index: NDArray[Any]) -> CloudLines:
    return CloudLines(
        lines.segments[index], lines.kind[index], lines.support[index], lines.std[index]
    )


def _worth_having(lines: CloudLines) -> CloudLines:
    """Lines that are long enough and well enough known, the largest in the scanner's view first."""
    start, end = lines.segments[:, 0], lines.segments[:, 1]
    across = np.linalg.norm(np.cross(start, end), axis=1)
    angle = np.arctan2(across, (start * end).sum(axis=1))
    good = (lines.lengths > SHORTEST_M) & (angle > SHORTEST_ANGLE) & (lines.std < LARGEST_STD_M)
    return _chosen(lines, np.flatnonzero(good)[np.argsort(-angle[good], kind="stable")])


def _without_repeats(lines: CloudLines) -> CloudLines:
    """Drop an outline along a crease, and shorter copies of a line.

    Compared as seen from the scanner, where a copy covers the line: both its ends lie within
    its standard deviations of the longer line and most of it beside it.
    """
    start, end = lines.segments[:, 0], lines.segments[:, 1]
    length = np.maximum(lines.lengths, 1e-9)
    along = (end - start) / length[:, None]
    # t, off: (i, j) where along line i, and how far from it, the ends of line j are.
    tolerance = SAME_SIGMA * np.hypot(lines.std[:, None], lines.std) + SAME_M
    near = np.ones((len(lines), len(lines)), bool)
    t = []
    for point in (start, end):
        offset = point[None] - start[:, None]
        place = np.einsum("ijk,ik->ij", offset, along)
        near &= np.linalg.norm(offset - place[..., None] * along[:, None], axis=2) < tolerance
        t.append(np.clip(place, 0, length[:, None]))
    shared = np.abs(t[1] - t[0]) > 0.5 * length
    better = (length[:, None] > length) | (lines.kind[:, None] < lines.kind)
    better &= lines.kind[:, None] <= lines.kind
    return _chosen(lines, np.flatnonzero(~(near & shared & better).any(axis=0)))
