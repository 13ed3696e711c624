"""Lines where a plane ends in front of something farther away, or of nothing.

The last beam on a plane and the first one past it leave the edge anywhere between them, so an
edge point is put half way: half a beam outwards. Edge points are rays; the rays of a straight
edge lie in one plane through the scanner, which RANSAC finds with a tolerance of half a beam,
the same at all ranges. Where it cuts the surface's plane is the line.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lcdata.features.edge_points import edge_points
from lcdata.features.outlines import EPSILON_BEAMS, FEWEST_POINTS, outlines
from lcdata.features.planes import Labels, Planes
from lcdata.features.scan_grid import ScanGrid

Array = NDArray[np.float64]
Floats = NDArray[np.float32]
Indices = NDArray[np.intp]

STEP_M, STEP_SIGMA = 0.1, 5.0
"""How much farther the outside must be, in metres and in standard deviations of range."""
LARGEST_RING_GAP = 2.0
"""Rings farther apart than this, in typical gaps, are not neighbours."""
LARGEST_GAP_BEAMS = 5.0
SMALLEST_DENSITY = 0.6
"""Fewest edge points of a line for each beam along it."""


def find_silhouettes(grid: ScanGrid, planes: Planes) -> tuple[Array, Array, NDArray[np.int64]]:
    """Segments of the outlines of planes, foreground side only.

    Returns:
        (M, 2, 3) segments in metres, (M,) standard deviations of their position across
        themselves in metres, (M,) number of edge points on each.
    """
    points, columns = grid.points, grid.points.shape[1]
    seen = points[..., 0] != 0
    labels, rays, halves = edge_points(
        points,
        planes.labels,
        planes.inverse,
        seen.sum(axis=1) > 0.01 * columns,
        seen.any(axis=0),
        np.abs(np.diff(grid.elevation)) > LARGEST_RING_GAP * grid.ring_step,
        grid.elevation,
        grid.column_step,
        grid.full_turn,
        max(STEP_M, STEP_SIGMA * planes.noise_m),
    )
    order = np.argsort(labels, kind="stable")
    labels, rays, halves = labels[order], rays[order], halves[order]
    lines, first_guess = outlines(
        labels,
        np.ascontiguousarray(rays.T, np.float32),
        np.ascontiguousarray(halves.T, np.float32),
        grid.ring_step,
    )
    order, first, last = _runs(lines, rays, first_guess, grid.ring_step)
    if not len(first):
        return np.zeros((0, 2, 3)), np.zeros(0), np.zeros(0, np.int64)
    owners = labels[order[first]]
    ends = rays[order[np.stack([first, last], axis=1)]]
    normals, variance = _fit_runs(
        rays[order], halves[order], first_guess[lines[order]], first, grid.ring_step
    )
    # Beams of one column (ring) share their error: only a new column (ring) averages it.
    azimuth, height = np.arctan2(ends[..., 1], ends[..., 0]), np.arcsin(ends[..., 2])
    turn = np.abs((np.diff(azimuth)[:, 0] + np.pi) % (2 * np.pi) - np.pi) / abs(grid.column_step)
    steps = 1 + np.minimum(turn, np.abs(np.diff(height)[:, 0]) / grid.ring_step)

    # The end rays are put on the line's own plane, then on the surface.
    inverse = planes.inverse[owners]
    ends = ends - (ends @ normals[..., None]) * normals[:, None]
    segments = ends / np.einsum("mei,mi->me", ends, inverse)[..., None]
    beam = variance / steps * (segments**2).sum(axis=2).max(axis=1)
    surface = np.einsum("mei,mij,mej->me", segments, planes.covariance[owners], segments)
    surface = surface.max(axis=1) / (inverse**2).sum(axis=1)
    return segments, np.sqrt(beam + surface), last - first + 1


def _runs(
    lines: Labels, rays: Array, normals: Floats, ring_step: float
) -> tuple[Indices, Indices, Indices]:
    """Cut lines at gaps and drop pieces with too few edge points for their length.

    Returns:
        (J,) edge points in order along their runs, and the places in it of (M,) first and (M,)
        last points of runs.
    """
    order = np.flatnonzero(lines >= 0)
    line, ray = lines[order], rays[order]
    middle = np.stack([np.bincount(line, ray[:, k], len(normals)) for k in range(3)], axis=1)
    along = np.cross(normals, middle)
    middle = np.cross(along, normals)
    x = np.arctan2((ray * along[line]).sum(axis=1), (ray * middle[line]).sum(axis=1))
    by_line = np.lexsort((x, line))
    order, line, x = order[by_line], line[by_line], x[by_line]
    cut = (np.diff(line) != 0) | (np.diff(x) > LARGEST_GAP_BEAMS * ring_step)
    first = np.concatenate([[0], np.flatnonzero(cut) + 1])[: len(order)]
    last = np.concatenate([first[1:], [len(order)]])[: len(first)] - 1
    fewest = np.maximum(FEWEST_POINTS, SMALLEST_DENSITY * (x[last] - x[first]) / ring_step)
    kept = np.flatnonzero(last - first + 1 >= fewest)
    first, last = first[kept], last[kept]
    length = last - first + 1
    place = np.cumsum(length) - length
    member = np.repeat(first - place, length) + np.arange(length.sum())
    return order[member], place, place + length - 1


def _fit_runs(
    rays: Array, halves: Array, normals: Floats, first: Indices, ring_step: float
) -> tuple[Array, Array]:
    """Least squares of a plane through the scanner to each run of edge points.

    An edge point's error is even over half a beam either way, so its weight depends on how
    the line runs against the beams.

    Args:
        rays: (J, 3) of the runs, one after the other.
        halves: (J, 3) half a beam across the edge.
        normals: (J, 3) of each ray's first guess.
        first: (M,) where runs start.
        ring_step: Radians.

    Returns:
        (M, 3) unit normals, (M,) variance of an edge point across the line, radians^2.
    """
    count = np.diff(first, append=len(rays))
    middle = np.repeat(rays[first + count // 2], count, axis=0)
    along = np.cross(normals, middle)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    middle = np.cross(along, normals)
    u, v, y, h = (
        np.einsum("ki,ki->k", a, b)
        for a, b in ((rays, middle), (rays, along), (rays, normals), (halves, normals))
    )
    weight = 1 / (h * h / 3 + (EPSILON_BEAMS * ring_step) ** 2)
    uu, uv, vv, yu, yv, w = np.add.reduceat(
        weight * np.stack([u * u, u * v, v * v, y * u, y * v, np.ones_like(u)]), first, axis=1
    )
    determinant = uu * vv - uv * uv
    fitted = (
        normals[first]
        - ((yu * vv - yv * uv) / determinant)[:, None] * middle[first]
        - ((yv * uu - yu * uv) / determinant)[:, None] * along[first]
    )
    return fitted / np.linalg.norm(fitted, axis=1, keepdims=True), count / w
