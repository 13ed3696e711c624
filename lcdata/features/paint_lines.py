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

MARGIN = 4
"""Beams on either side of a step that must lie on the same smooth surface, within twice what is
allowed at the step. Poles and limbs are darker at their sides, which is no paint, and look flat to
the few beams on them."""

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
    count, member = _chains(middle, half, sign, step_rank, azimuth, ring_start)
    if count == 0:
        return nothing
    chosen = np.argsort(member, kind="stable")[np.count_nonzero(member < 0) :]
    groups = np.split(chosen, np.cumsum(np.bincount(member[chosen]))[:-1])
    fits = [_fit(middle[group], half[group]) for group in groups]
    segments, std = np.array([f[0] for f in fits]), np.array([f[1] for f in fits])
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
        for j in range(max(i - MARGIN, 1), min(i + MARGIN + 2, n - 1)):
            if rank[j - 1] == rank[i] and rank[j + 1] == rank[i]:
                share = 1.0 if i <= j <= i + 1 else 0.5
                for k in range(3):
                    turn = cloud[j + 1, k] - 2.0 * cloud[j, k] + cloud[j - 1, k]
                    bend = max(bend, share * abs(turn))
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
def _distance(points, i, j):  # type: ignore[no-untyped-def]
    x, y, z = points[i, 0] - points[j, 0], points[i, 1] - points[j, 1], points[i, 2] - points[j, 2]
    return (x * x + y * y + z * z) ** 0.5


@njit(cache=True)
def _lonely(middle, sign, rank):  # type: ignore[no-untyped-def]
    """Which steps are not one of several of the same sign: texture, bricks, stripes."""
    n = len(middle)
    lonely = np.ones(n, np.bool_)
    for i in range(n):
        for direction in (-1, 1):
            for k in range(1, 7):
                j = i + direction * k
                if j < 0 or j >= n or rank[j] != rank[i] or _distance(middle, i, j) > LONELY_M:
                    break
                if sign[j] == sign[i]:
                    lonely[i] = False
    return lonely


@njit(cache=True)
def _chains(middle, half, sign, rank, azimuth, ring_start):  # type: ignore[no-untyped-def]
    """Straight chains of steps from ring to ring.

    Returns:
        Number of chains, and for each step its chain or -1.
    """
    n = len(middle)
    rings = len(ring_start) - 1
    member = np.full(n, -1, np.int64)
    count = 0
    chain = np.empty(rings, np.int64)
    best = np.empty(rings, np.int64)
    for seed in range(n):
        if member[seed] >= 0:
            continue
        best_size = 0
        for r in range(rank[seed] + 1, min(rank[seed] + 3, rings)):
            i = _first(middle, seed, azimuth, ring_start, r)
            while i < ring_start[r + 1] and azimuth[i] < azimuth[seed] + _reach(middle, seed):
                if member[i] < 0 and sign[i] == sign[seed]:
                    length = _distance(middle, i, seed)
                    if 1e-3 < length < LARGEST_GAP_M:
                        size = _follow(
                            middle, half, sign, rank, azimuth, ring_start, member, seed, i, chain
                        )
                        if size > best_size:
                            best_size = size
                            best[:size] = chain[:size]
                i += 1
        if best_size >= FEWEST_RINGS:
            for i in range(best_size):
                member[best[i]] = count
            count += 1
    return count, member


@njit(cache=True)
def _reach(middle, i):  # type: ignore[no-untyped-def]
    """Azimuth within which a point can lie at the largest gap from step i."""
    return 1.1 * LARGEST_GAP_M / (middle[i, 0] ** 2 + middle[i, 1] ** 2) ** 0.5


@njit(cache=True)
def _first(middle, step, azimuth, ring_start, r):  # type: ignore[no-untyped-def]
    """First step of ring r that can lie within the largest gap of a step, by bisection."""
    least = azimuth[step] - _reach(middle, step)
    low, high = ring_start[r], ring_start[r + 1]
    while low < high:
        middle_i = (low + high) // 2
        if azimuth[middle_i] < least:
            low = middle_i + 1
        else:
            high = middle_i
    return low


@njit(cache=True)
def _follow(  # type: ignore[no-untyped-def]
    middle, half, sign, rank, azimuth, ring_start, member, seed, other, chain
):
    """Extend the line through two steps ring by ring.

    Returns:
        Number of steps on the line, their indices in `chain`; 0 in a regular pattern, where the
        next ring's step could as well be that of a neighbour.
    """
    chain[0], chain[1] = seed, other
    size, missed, doubtful = 2, 0, 0
    last = other
    x0, y0, z0 = middle[seed, 0], middle[seed, 1], middle[seed, 2]
    for r in range(rank[other] + 1, len(ring_start) - 1):
        reach = _distance(middle, last, seed)
        ux = (middle[last, 0] - x0) / reach
        uy = (middle[last, 1] - y0) / reach
        uz = (middle[last, 2] - z0) / reach
        nearest, least, rivals = -1, 1e9, 0
        i = _first(middle, last, azimuth, ring_start, r)
        while i < ring_start[r + 1] and azimuth[i] < azimuth[last] + _reach(middle, last):
            if member[i] < 0 and sign[i] == sign[seed]:
                x, y, z = middle[i, 0] - x0, middle[i, 1] - y0, middle[i, 2] - z0
                along = x * ux + y * uy + z * uz
                if reach < along < reach + LARGEST_GAP_M * (1 + missed):
                    off = max(x * x + y * y + z * z - along * along, 0.0) ** 0.5
                    if off < LONELY_M:
                        rivals += 1
                    # The direction from few points extrapolates badly.
                    limit = (half[i] + 0.01) * min(1.0 + along / reach, 3.0)
                    if off < limit and off < least:
                        nearest, least = i, off
            i += 1
        if nearest < 0:
            missed += 1
            if missed > 1:
                break
        else:
            missed = 0
            if rivals > 1:
                doubtful += 1
            chain[size] = nearest
            size += 1
            last = nearest
    return size if 4 * doubtful < size else 0


def _fit(points: Array, half: Array) -> tuple[Array, float]:
    """Segment through points that are uncertain by `half` a step, and its deviation, metres."""
    centre = points.mean(0)
    values, vectors = np.linalg.eigh((points - centre).T @ (points - centre))
    along = (points - centre) @ vectors[:, 2]
    segment = centre + np.outer([along.min(), along.max()], vectors[:, 2])
    # Within its step a point is uniformly distributed; steps of neighbouring rings agree.
    variance = max(float((half**2).mean()) / 3.0, (values[0] + values[1]) / (len(points) - 2))
    return segment, max(1.5 * float(np.sqrt(variance / len(points))), 0.003)
