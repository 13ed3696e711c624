"""Poles in a cloud: tall cells of a grid that hold a steep line of points and little else.

Ma et al. 2021, *CRLF*, eq. (5) and (6), with RANSAC lines. numba kernels: import this module only
where it is used.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

NEAR_M = 0.2
"""Distance of a pole's points from its axis: half a thick pole and the beam's spread."""

STEEPEST = float(np.tan(np.deg2rad(8.0)))
"""Largest tilt of a pole."""

LENGTH_M, POINTS, POLES = 1.2, 5, 40
"""A pole's least length and points; poles at most."""

MOST = 40
"""Points of a pole that are kept: near ones, which hundreds hit, do not count more."""

AROUND_M = 1.0
"""Radius of the surroundings of a pole that must be nearly empty, and how far above it."""

CLUTTER = 0.6
"""Points around a pole, as a share of its own, from which on it is a tree or a wall."""

LOOK = 0.8
"""Share of the steepest look at which a cell counts as tall where H1 is out of view."""

ROW = 1_000_000
"""Cells of one row of the grid have consecutive numbers."""


def find_poles(
    flat: Array, index: Indices, cell_m: float, tallest_m: float
) -> tuple[Indices, Indices, Array]:
    """Find poles.

    Args:
        flat: (N, 3) points in a frame with z up and the LiDAR at its origin, metres.
        index: (M,) points that count: above the ground, and above H0.
        cell_m: Edge of a cell.
        tallest_m: H1, height that a cell must reach; where the scanner does not look so high, it
            must reach up to `LOOK` of what is seen.

    Returns:
        (K,) indices of pole points, (K,) pole of each, and (P, 2, 3) axes from below up.
    """
    if not len(index):
        return np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros((0, 2, 3))
    points = flat[index]
    far = np.hypot(points[:, 0], points[:, 1])
    slope = points[:, 2] / np.maximum(far, 1.0)
    high = np.partition(slope, -max(1, len(slope) // 1000))[-max(1, len(slope) // 1000)]
    needed = np.minimum(tallest_m, LOOK * max(float(high), 0.0) * far)
    number = np.floor(points[:, :2] / cell_m).astype(np.int64) @ np.array([ROW, 1])
    order = np.argsort(number, kind="stable")
    cells, start = np.unique(number[order], return_index=True)
    tall = np.zeros(len(cells), bool)
    tall[np.searchsorted(cells, np.unique(number[points[:, 2] > needed]))] = True
    start = np.append(start, len(order)).astype(np.int64)
    count = np.diff(start)
    chosen = np.flatnonzero(tall & (count >= 2))
    chosen = chosen[np.argsort(-count[chosen], kind="stable")]
    member, ends = _grow(np.ascontiguousarray(points[order]), cells, start, chosen)
    found = np.flatnonzero(member >= 0)
    found = found[_evenly(member[found], points[order[found], 2])]
    return index[order[found]], member[found], ends


def _evenly(member: Indices, height: Array) -> Indices:
    """Indices of at most `MOST` points of each pole, evenly over their heights."""
    order = np.lexsort((height, member))
    count = np.bincount(member)
    first = np.concatenate([[0], np.cumsum(count)[:-1]])
    place = np.arange(len(order)) - first[member[order]]
    size = count[member[order]]
    step = np.maximum(size / MOST, 1.0)
    kept = np.floor(place / step) != np.floor((place - 1) / step)
    return np.asarray(order[kept])


@njit(cache=True, nogil=True)
def _grow(points, cells, start, chosen):  # type: ignore[no-untyped-def]  # noqa: PLR0912, PLR0915
    """Pole of each point, -1 for none, and (P, 2, 3) axes; points are sorted by cell."""
    member = np.full(len(points), -1, np.int64)
    ends = np.empty((POLES, 2, 3))
    count = 0
    around = np.empty(len(points), np.int64)
    state = 12345
    for c in chosen:
        size = 0
        for row in range(-2, 3):
            k = np.searchsorted(cells, cells[c] + row * ROW - 2)
            while k < len(cells) and cells[k] <= cells[c] + row * ROW + 2:
                for i in range(start[k], start[k + 1]):
                    if member[i] < 0:
                        around[size] = i
                        size += 1
                k += 1
        if size < POINTS:
            continue
        best, ax, ay, bx, by = 0, 0.0, 0.0, 0.0, 0.0
        for _ in range(60):
            state = (1103515245 * state + 12345) % 2147483648
            i = start[c] + (state >> 8) % (start[c + 1] - start[c])
            state = (1103515245 * state + 12345) % 2147483648
            j = around[(state >> 8) % size]
            dz = points[j, 2] - points[i, 2]
            if member[i] >= 0 or abs(dz) < 0.5 * LENGTH_M:
                continue
            sx, sy = (points[j, 0] - points[i, 0]) / dz, (points[j, 1] - points[i, 1]) / dz
            if sx * sx + sy * sy > STEEPEST * STEEPEST:
                continue
            on = 0
            for n in range(size):
                m = around[n]
                dz = points[m, 2] - points[i, 2]
                x = points[m, 0] - points[i, 0] - sx * dz
                y = points[m, 1] - points[i, 1] - sy * dz
                if x * x + y * y < NEAR_M * NEAR_M:
                    on += 1
            if on > best:
                best = on
                bx, by = sx, sy
                ax, ay = points[i, 0] - sx * points[i, 2], points[i, 1] - sy * points[i, 2]
        if best < POINTS:
            continue
        for _ in range(3):
            ax, ay, bx, by, low, high, on = _fit_axis(points, around[:size], ax, ay, bx, by)
            if on < POINTS:
                break
        steep = bx * bx + by * by <= STEEPEST * STEEPEST
        if on < POINTS or high - low < LENGTH_M or not steep:
            continue
        beside = 0
        for n in range(size):
            m = around[n]
            x = points[m, 0] - ax - bx * points[m, 2]
            y = points[m, 1] - ay - by * points[m, 2]
            far = (x * x + y * y) ** 0.5
            if 1.5 * NEAR_M < far < AROUND_M and low < points[m, 2] < high + AROUND_M:
                beside += 1
        if beside > CLUTTER * on:
            continue
        for n in range(size):
            m = around[n]
            x = points[m, 0] - ax - bx * points[m, 2]
            y = points[m, 1] - ay - by * points[m, 2]
            if x * x + y * y < NEAR_M * NEAR_M:
                member[m] = count
        for k in range(2):
            z = low if k == 0 else high
            ends[count, k] = ax + bx * z, ay + by * z, z
        count += 1
        if count == POLES:
            break
    return member, ends[:count].copy()


@njit(cache=True, nogil=True)
def _fit_axis(points, around, ax, ay, bx, by):  # type: ignore[no-untyped-def]
    """Least-squares x = ax + bx z, y = ay + by z of the points near an axis, and their extent."""
    n = 0
    sx, sy, sz, szz, sxz, syz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    low, high = np.inf, -np.inf
    for m in around:
        z = points[m, 2]
        x, y = points[m, 0] - ax - bx * z, points[m, 1] - ay - by * z
        if x * x + y * y < NEAR_M * NEAR_M:
            n += 1
            sx += x
            sy += y
            sz += z
            szz += z * z
            sxz += x * z
            syz += y * z
            low, high = min(low, z), max(high, z)
    spread = n * szz - sz * sz
    if n >= POINTS and spread > 1e-9:
        cx, cy = (n * sxz - sx * sz) / spread, (n * syz - sy * sz) / spread
        ax, ay = ax + (sx - cx * sz) / n, ay + (sy - cy * sz) / n
        bx, by = bx + cx, by + cy
    return ax, ay, bx, by, low, high, n
