"""Planes in the voxels of a dense cloud, by RANSAC, compiled.

Yuan et al. 2021, section III-A: cut the cloud into voxels, take planes from each, one after the
other.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lcdata.features.compiled import compiled

Array = NDArray[np.float64]
Labels = NDArray[np.int8]

MOST_PLANES = 6
"""Planes that are looked for in a voxel; one with so many is no built structure."""

HYPOTHESES = 40
"""Random triples of points a plane."""

GHOST_COSINE, GHOST_DISTANCES = np.cos(np.deg2rad(20.0)), 3.0
"""A plane so nearly parallel and so near to an earlier one is the tail of its noise."""

JUDGES = 200
"""Points that judge a hypothesis, at most."""


@dataclass(frozen=True, eq=False)
class VoxelPlanes:
    """Planes of the voxels of one cloud.

    Args:
        points: (N, 3) metres, voxel by voxel.
        starts: (V + 1,) where each voxel's points begin.
        labels: (N,) which plane of its voxel a point belongs to, -1 for none.
        planes: (V, MOST_PLANES, 4) unit normals n and offsets d with n . p = d.
        counts: (V, MOST_PLANES) points of each; 0 where there is no such plane.
        spread: (V, MOST_PLANES) root mean square of the distances, metres.
        corners: (V, 3) lowest corner of each voxel, metres.
        size: Edge of a voxel, metres.
    """

    points: Array
    starts: NDArray[np.int64]
    labels: Labels
    planes: Array
    counts: NDArray[np.int64]
    spread: Array
    corners: Array
    size: float


def grouped(points: Array, size: float, shift: float = 0.0) -> tuple[NDArray[np.int64], Array]:
    """Which points share a voxel.

    Args:
        points: (N, 3) metres, at most a million voxels from the origin.
        size: Edge of a voxel, metres.
        shift: Of the grid along each axis, metres.

    Returns:
        (N,) order that puts voxels one after the other, and (N, 3) lowest corner of the voxel of
        each point in that order, metres.
    """
    cell = np.floor((points - shift) / size).astype(np.int64)
    key = ((cell[:, 0] + (1 << 20)) << 42) + ((cell[:, 1] + (1 << 20)) << 21) + cell[:, 2]
    order = np.argsort(key, kind="stable")
    return order.astype(np.int64), np.asarray(cell[order] * size + shift, float)


def thinned(points: Array, size: float) -> Array:
    """The mean of the points of each cell of `size` metres: (M, 3)."""
    if not len(points):
        return points
    order, corners = grouped(points, size)
    first = np.flatnonzero(np.r_[True, (np.diff(corners, axis=0) != 0.0).any(axis=1)])
    count = np.diff(np.r_[first, len(order)])
    return np.asarray(np.add.reduceat(points[order], first, axis=0) / count[:, None])


def voxel_planes(
    points: Array, size: float, distance: float, fewest: int, shift: float = 0.0
) -> VoxelPlanes:
    """Find the planes of a cloud, voxel by voxel.

    Args:
        points: (N, 3) metres, finite.
        size: Edge of a voxel, metres.
        distance: Points closer to a plane belong to it, metres.
        fewest: Points that a plane needs.
        shift: Of the grid along each axis, metres.
    """
    order, corners = grouped(points, size, shift)
    ordered = np.ascontiguousarray(points[order])
    fresh = np.ones(len(ordered), bool)
    fresh[1:] = (np.diff(corners, axis=0) != 0.0).any(axis=1)
    starts = np.r_[np.flatnonzero(fresh), len(ordered)].astype(np.int64)
    count = len(starts) - 1
    labels = np.full(len(ordered), -1, np.int8)
    planes = np.zeros((count, MOST_PLANES, 4))
    counts = np.zeros((count, MOST_PLANES), np.int64)
    spread = np.zeros((count, MOST_PLANES))
    _find_planes(ordered, starts, distance, fewest, labels, planes, counts, spread)
    return VoxelPlanes(
        ordered, starts, labels, planes, counts, spread, corners[starts[:-1]].reshape(-1, 3), size
    )


@compiled
def _find_planes(  # noqa: PLR0912, PLR0915 - RANSAC as one loop
    points: Array,
    starts: NDArray[np.int64],
    distance: float,
    fewest: int,
    labels: Labels,
    planes: Array,
    counts: NDArray[np.int64],
    spread: Array,
) -> None:
    """One plane after the other in each voxel, each of what earlier ones left."""
    longest = 0
    for v in range(len(starts) - 1):
        longest = max(longest, starts[v + 1] - starts[v])
    free = np.empty(longest, np.int64)
    matrix, mean = np.empty((3, 3)), np.empty(3)
    normal, best = np.empty(3), np.empty(3)
    for v in range(len(starts) - 1):
        count = starts[v + 1] - starts[v]
        if count < fewest:
            continue
        for i in range(count):
            free[i] = starts[v] + i
        left, state = count, np.uint64(v + 1)
        number = 0
        for _ in range(2 * MOST_PLANES):
            if left < fewest or number == MOST_PLANES:
                break
            stride = max(1, left // JUDGES)
            most, offset = 0, 0.0
            for _ in range(HYPOTHESES):
                a, b, c = 0, 0, 0
                for k in range(3):
                    state = state * np.uint64(6364136223846793005) + np.uint64(1442695040888963407)
                    pick = free[np.int64((state >> np.uint64(33)) % np.uint64(left))]
                    if k == 0:
                        a = pick
                    elif k == 1:
                        b = pick
                    else:
                        c = pick
                for k in range(3):
                    i, j = (k + 1) % 3, (k + 2) % 3
                    normal[k] = (points[b, i] - points[a, i]) * (points[c, j] - points[a, j]) - (
                        points[b, j] - points[a, j]
                    ) * (points[c, i] - points[a, i])
                norm = np.sqrt(normal[0] ** 2 + normal[1] ** 2 + normal[2] ** 2)
                if norm < 1e-6:
                    continue
                d = 0.0
                for k in range(3):
                    normal[k] /= norm
                    d += normal[k] * points[a, k]
                inside = 0
                for m in range(0, left, stride):
                    p = points[free[m]]
                    off = normal[0] * p[0] + normal[1] * p[1] + normal[2] * p[2] - d
                    if abs(off) < distance:
                        inside += 1
                if inside > most:
                    most, offset = inside, d
                    best[:] = normal
                if most * stride > 0.9 * left:
                    break
            if most * stride < 0.7 * fewest:
                break
            total, square = 0, 0.0
            for turn in range(4):
                total, square = 0, 0.0
                matrix[:], mean[:] = 0.0, 0.0
                for m in range(left):
                    p = points[free[m]]
                    off = best[0] * p[0] + best[1] * p[1] + best[2] * p[2] - offset
                    if abs(off) < distance:
                        total += 1
                        square += off * off
                        for i in range(3):
                            x = p[i] - points[starts[v], i]
                            mean[i] += x
                            for j in range(i, 3):
                                matrix[i, j] += x * (p[j] - points[starts[v], j])
                if total < fewest or turn == 3:
                    break
                mean /= total
                for i in range(3):
                    for j in range(i, 3):
                        matrix[i, j] = matrix[i, j] / total - mean[i] * mean[j]
                        matrix[j, i] = matrix[i, j]
                best[:] = np.linalg.eigh(matrix)[1][:, 0]
                offset = 0.0
                for k in range(3):
                    offset += best[k] * (mean[k] + points[starts[v], k])
            if total < fewest:
                break
            # The tail of an earlier plane's noise is no plane of its own.
            owner = number
            for k in range(number):
                n = planes[v, k]
                cosine = abs(n[0] * best[0] + n[1] * best[1] + n[2] * best[2])
                off = -n[3]
                for i in range(3):
                    off += n[i] * (mean[i] / total + points[starts[v], i])
                if cosine > GHOST_COSINE and abs(off) < GHOST_DISTANCES * distance:
                    owner = k
                    break
            counts[v, owner] += total
            if owner == number:
                planes[v, number, :3], planes[v, number, 3] = best, offset
                spread[v, number] = np.sqrt(square / total)
                number += 1
            kept = 0
            for m in range(left):
                p = points[free[m]]
                off = best[0] * p[0] + best[1] * p[1] + best[2] * p[2] - offset
                if abs(off) < distance:
                    labels[free[m]] = owner
                else:
                    free[kept] = free[m]
                    kept += 1
            left = kept
