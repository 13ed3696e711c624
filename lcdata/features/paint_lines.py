"""3D segments where the reflectance of a surface changes: lane marks, court lines, panels.

Open places have few creases and silhouettes near by, but paint on the ground, which fixes the
translation. Along each ring the reflectance steps at the border of paint; steps of one sign that
follow each other from ring to ring on a straight line make a segment. Lines along a ring are not
found: their position would be no better than the gap between rings. numba kernels: import this
module only where it is used.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from lcdata.features.scan_grid import ring_from_scan_order

Array = NDArray[np.float64]

CONTRAST = 0.15
"""Smallest |b - a| / (a + b) of the reflectances on both sides of a step."""

FEWEST_RINGS = 6
"""Rings that a segment must cross."""

NEAREST_M = 0.3
"""Closer returns, and the zeros of missing ones, are left out."""

LONELY_M = 0.2
"""A second step of the same sign so close is texture: which one continues a line is doubtful."""

SHORTEST_M = 0.4
LARGEST_GAP_M = 1.2
"""Between points of neighbouring rings on one segment."""


def extract_paint_lines(
    points: NDArray[np.floating[Any]],
    intensity: NDArray[np.floating[Any]] | None,
    organised: tuple[int, int] | None = None,
    ring: NDArray[np.integer[Any]] | None = None,
) -> tuple[Array, Array]:
    """Find straight borders of paint.

    Args:
        points: (N, 3) in the LiDAR frame, metres; NaN or zeros where nothing came back.
        intensity: (N,) reflectance in any unit; without it there are no lines.
        organised: (rings, columns) if the points are a row-major image of the scan.
        ring: (N,) ring numbers of an unorganised cloud; otherwise from the order of the points.

    Returns:
        (M, 2, 3) segments in metres, and (M,) standard deviations across them, metres.
    """
    nothing = np.zeros((0, 2, 3)), np.zeros(0)
    good = np.flatnonzero(np.abs(points[:, 0]) + np.abs(points[:, 1]) > NEAREST_M)
    if intensity is None or not len(good):
        return nothing
    if organised is not None:
        rank = good // organised[1]
    else:
        known = ring_from_scan_order(points[good]) if ring is None else np.asarray(ring)[good]
        if known is None:
            return nothing
        good, rank = _in_scan_order(points, good, known)
    cloud, light = np.asarray(points[good], float), np.asarray(intensity, float)[good]
    index, sign = _steps(cloud, light, rank, CONTRAST)
    if len(index) < FEWEST_RINGS:
        return nothing
    first, second = cloud[index], cloud[index + 1]
    middle = 0.5 * (first + second)
    lonely = _lonely(middle, sign, rank[index])
    index, sign, first, second = index[lonely], sign[lonely], first[lonely], second[lonely]
    if len(index) < FEWEST_RINGS:
        return nothing
    middle = 0.5 * (first + second)
    half = 0.5 * np.linalg.norm(second - first, axis=1)
    azimuth = np.arctan2(middle[:, 1], middle[:, 0])
    order = np.lexsort((azimuth, rank[index]))
    middle, half, sign, azimuth = middle[order], half[order], sign[order], azimuth[order]
    step_rank = rank[index][order]
    ring_start = np.searchsorted(step_rank, np.arange(step_rank[-1] + 2))
    segments, std = _chains(middle, half, sign, step_rank, azimuth, ring_start)
    keep = np.linalg.norm(segments[:, 1] - segments[:, 0], axis=1) > SHORTEST_M
    return segments[keep], std[keep]


def _in_scan_order(
    points: NDArray[np.floating[Any]], good: NDArray[np.int64], ring: NDArray[np.integer[Any]]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The good points sorted by the rank of their ring's elevation, then by azimuth."""
    x, y, z = np.asarray(points[good], float).T
    rank = np.unique(ring, return_inverse=True)[1]
    elevation = np.bincount(rank, np.arctan2(z, np.hypot(x, y))) / np.bincount(rank)
    rank = np.argsort(np.argsort(elevation))[rank]
    order = np.lexsort((np.arctan2(y, x), rank))
    return good[order], rank[order]


@njit(cache=True)
def _steps(cloud, light, rank, contrast):  # type: ignore[no-untyped-def]
    """Indices i of steps between points i and i + 1 of a ring on one smooth surface."""
    n = len(cloud)
    found = np.empty(n, np.int64)
    sign = np.empty(n, np.int8)
    strength = np.zeros(n)
    for i in range(1, n - 2):
        if rank[i - 1] != rank[i + 2]:
            continue
        before, after = 0.5 * (light[i - 1] + light[i]), 0.5 * (light[i + 1] + light[i + 2])
        change = after - before
        if abs(change) < contrast * (before + after) or before + after <= 0.0:
            continue
        # Evenly spaced points on a straight line: no edge of an object is near.
        reach = 0.0
        bend = 0.0
        for k in range(3):
            step = cloud[i + 1, k] - cloud[i, k]
            reach += step * step
            bend = max(bend, abs(step - (cloud[i, k] - cloud[i - 1, k])))
            bend = max(bend, abs(step - (cloud[i + 2, k] - cloud[i + 1, k])))
        distance = np.sqrt(cloud[i, 0] ** 2 + cloud[i, 1] ** 2 + cloud[i, 2] ** 2)
        if bend < 0.04 + 0.004 * distance and reach < (0.05 * distance) ** 2:
            strength[i] = change
    count = 0
    for i in range(1, n - 2):
        s = strength[i]
        if s != 0.0 and abs(s) >= abs(strength[i - 1]) and abs(s) > abs(strength[i + 1]):
            found[count] = i
            sign[count] = 1 if s > 0 else -1
            count += 1
    return found[:count].copy(), sign[:count].copy()


@njit(cache=True)
def _lonely(middle, sign, rank):  # type: ignore[no-untyped-def]
    """Which steps are not one of several of the same sign: texture, bricks, stripes."""
    n = len(middle)
    lonely = np.ones(n, np.bool_)
    for i in range(n):
        rivals = 0
        for direction in (-1, 1):
            for k in range(1, 7):
                j = i + direction * k
                if j < 0 or j >= n or rank[j] != rank[i]:
                    break
                d = middle[j] - middle[i]
                if (d * d).sum() > LONELY_M**2:
                    break
                rivals += sign[j] == sign[i]
        lonely[i] = rivals == 0
    return lonely


@njit(cache=True)
def _chains(middle, half, sign, rank, azimuth, ring_start):  # type: ignore[no-untyped-def]
    """Straight chains of steps from ring to ring, longest first come first served by seed."""
    n = len(middle)
    rings = len(ring_start) - 1
    used = np.zeros(n, np.bool_)
    segments = np.empty((n, 2, 3))
    std = np.empty(n)
    count = 0
    chain = np.empty(rings, np.int64)
    best = np.empty(rings, np.int64)
    for seed in range(n):
        if used[seed]:
            continue
        best_size = 0
        for gap in range(1, 3):
            r = rank[seed] + gap
            if r >= rings:
                continue
            low_i, high_i = _window(middle[seed], azimuth, ring_start, r)
            for other in range(low_i, high_i):
                if used[other] or sign[other] != sign[seed]:
                    continue
                first = middle[other] - middle[seed]
                length = np.sqrt((first * first).sum())
                if length > LARGEST_GAP_M or length < 1e-3:
                    continue
                size = _follow(
                    middle, half, sign, rank, azimuth, ring_start, used, seed, other, chain
                )
                if size > best_size:
                    best_size = size
                    best[:size] = chain[:size]
        if best_size < FEWEST_RINGS:
            continue
        for i in range(best_size):
            used[best[i]] = True
        segments[count], std[count] = _fit(middle[best[:best_size]], half[best[:best_size]])
        count += 1
    return segments[:count].copy(), std[:count].copy()


@njit(cache=True)
def _fit(points, half):  # type: ignore[no-untyped-def]
    """Segment through points that are uncertain by `half` a step, and its deviation, metres."""
    n = len(points)
    centre = points.sum(0) / n
    away = points - centre
    values, vectors = np.linalg.eigh(away.T @ away)
    direction = np.ascontiguousarray(vectors[:, 2])
    along = away @ direction
    segment = np.empty((2, 3))
    segment[0] = centre + along.min() * direction
    segment[1] = centre + along.max() * direction
    # Within its step a point is uniformly distributed; steps of neighbouring rings agree.
    variance = max((half * half).sum() / (3.0 * n), (values[0] + values[1]) / (n - 2))
    return segment, max(1.5 * np.sqrt(variance / n), 0.003)


@njit(cache=True)
def _window(point, azimuth, ring_start, r):  # type: ignore[no-untyped-def]
    """Range of the steps of ring r that can lie within the largest gap of a point."""
    reach = 1.1 * LARGEST_GAP_M / np.sqrt(point[0] ** 2 + point[1] ** 2)
    at = np.arctan2(point[1], point[0])
    ring = azimuth[ring_start[r] : ring_start[r + 1]]
    low, high = np.searchsorted(ring, at - reach), np.searchsorted(ring, at + reach)
    return ring_start[r] + low, ring_start[r] + high


@njit(cache=True)
def _follow(middle, half, sign, rank, azimuth, ring_start, used, seed, other, chain):  # type: ignore[no-untyped-def]
    """Extend the line through two steps ring by ring.

    Returns:
        Number of steps on the line, their indices in `chain`; 0 in a regular pattern, where the
        next ring's step could as well be that of a neighbour.
    """
    rings = len(ring_start) - 1
    chain[0], chain[1] = seed, other
    size, missed, doubtful = 2, 0, 0
    start, last = middle[seed], middle[other]
    for r in range(rank[other] + 1, rings):
        direction = last - start
        direction = direction / np.sqrt((direction * direction).sum())
        nearest, least, rivals = -1, 1e9, 0
        low_i, high_i = _window(last, azimuth, ring_start, r)
        for i in range(low_i, high_i):
            if used[i] or sign[i] != sign[seed]:
                continue
            d = middle[i] - last
            along = (d * direction).sum()
            if along <= 0.0 or along > LARGEST_GAP_M * (1 + missed):
                continue
            d = middle[i] - start
            along = (d * direction).sum()
            off = np.sqrt(max((d * d).sum() - along * along, 0.0))
            reach = np.sqrt(((last - start) ** 2).sum())
            # The direction from few points extrapolates badly.
            limit = (half[i] + 0.01) * min(1.0 + along / max(reach, 1e-3), 3.0)
            if off < LONELY_M:
                rivals += 1
            if off < limit and off < least:
                nearest, least = i, off
        if nearest < 0:
            missed += 1
            if missed > 1:
                break
            continue
        missed = 0
        doubtful += rivals > 1
        chain[size] = nearest
        size += 1
        last = middle[nearest]
    return size if 4 * doubtful < size else 0
