"""Planes and lines by RANSAC (Fischler and Bolles 1981), compiled.

numba kernels: import this module only where it is used.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]

VOTERS, FITTED = 700, 10_000
"""Points that vote on a sampled line, and those that a plane is fitted to, or few more."""


def ransac_plane(
    points: Array, half_m: float, upright_rad: float, rng: np.random.Generator
) -> tuple[Array, float] | None:
    """The plane that most points lie on and few lie below.

    Args:
        points: (N, 3) metres.
        half_m: Half of the plane's thickness.
        upright_rad: Largest angle of its normal to the z axis, up or down.
        rng: Of the samples.

    Returns:
        Unit normal, pointing to the side where most of the other points are, and distance d with
        n . p = d, metres; None where no three points span one.
    """
    if len(points) < 3:
        return None
    some = points[rng.integers(0, len(points), min(len(points), 1500))]
    triples = points[rng.integers(0, len(points), (300, 3))]
    votes = _plane_votes(
        np.ascontiguousarray(some, float),
        np.ascontiguousarray(triples, float),
        half_m,
        float(np.cos(upright_rad)),
    )
    best = int(np.argmax(votes))
    if votes[best] <= 0:
        return None
    corner = triples[best]
    normal = np.cross(corner[1] - corner[0], corner[2] - corner[0])
    normal /= np.linalg.norm(normal)
    d = float(normal @ corner[0])
    # So many determine a plane to a millimetre.
    points = points[:: max(1, len(points) // FITTED)]
    for _ in range(5):
        on = points[np.abs(points @ normal - d) < half_m]
        if len(on) < 3:
            return None
        centre = on.mean(0)
        normal = np.linalg.eigh((on - centre).T @ (on - centre))[1][:, 0]
        d = float(normal @ centre)
    side = points @ normal - d
    if np.count_nonzero(side > half_m) < np.count_nonzero(side < -half_m):
        normal, d = -normal, -d
    return normal, d


@njit(cache=True, nogil=True)
def _plane_votes(points, triples, half, upright):  # type: ignore[no-untyped-def]
    """Points on each plane, minus three times those on the emptier side beyond a tenth of all."""
    votes = np.zeros(len(triples))
    for k in range(len(triples)):
        a, b, c = triples[k, 0], triples[k, 1], triples[k, 2]
        ux, uy, uz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
        vx, vy, vz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
        nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        length = np.sqrt(nx * nx + ny * ny + nz * nz)
        if length < 1e-3 or abs(nz) < upright * length:
            continue
        nx, ny, nz = nx / length, ny / length, nz / length
        d = nx * a[0] + ny * a[1] + nz * a[2]
        on, below, above = 0, 0, 0
        for i in range(len(points)):
            s = nx * points[i, 0] + ny * points[i, 1] + nz * points[i, 2] - d
            if abs(s) < half:
                on += 1
            elif s < 0.0:
                below += 1
            else:
                above += 1
        votes[k] = on - 3.0 * max(0.0, min(below, above) - 0.1 * len(points))
    return votes


def ransac_lines(
    points: Array,
    near_m: float,
    clear_m: float,
    fewest: int,
    shortest_m: float,
    most: int,
    rng: np.random.Generator,
    trials: int = 300,
) -> tuple[Array, NDArray[np.int64]]:
    """Straight lines through points of a plane, one after the other, the clearest first.

    Points beside a line count against it: fields full of points hold lines in any direction.

    Args:
        points: (N, 2) metres.
        near_m: Points at this distance or less belong to a line.
        clear_m: Points at this distance or less are not used for the next lines.
        fewest: Points a line needs, more than a band of the same width beside it has.
        shortest_m: From its first point to its last.
        most: Lines at most.
        rng: Of the samples.
        trials: Pairs of points tried for each line.

    Returns:
        (M, 2, 2) segments and (M,) their numbers of points.
    """
    left = np.ascontiguousarray(points, float)
    segments: list[Array] = []
    counts: list[int] = []
    while len(left) >= fewest and len(segments) < most:
        pairs = rng.integers(0, len(left), (trials, 2))
        step = max(1, len(left) // VOTERS)
        first, second, count = _best_line(left, pairs, near_m, 0.5 * shortest_m, step)
        if count * step < fewest:
            break
        segment, count, across = _fitted(left, first, second, near_m)
        if count >= fewest and np.linalg.norm(segment[1] - segment[0]) >= shortest_m:
            segments.append(segment)
            counts.append(count)
        gone = across < clear_m
        gone[first] = gone[second] = True
        left = left[~gone]
    return np.array(segments).reshape(-1, 2, 2), np.array(counts, np.int64)


@njit(cache=True, nogil=True)
def _fitted(points, first, second, near):  # type: ignore[no-untyped-def]
    """The line through two points, fitted three times to the points near it.

    Returns:
        (2, 2) from its first point to its last, their number, and (N,) distances of all.
    """
    cx, cy = points[first, 0], points[first, 1]
    dx, dy = points[second, 0] - cx, points[second, 1] - cy
    length = np.sqrt(dx * dx + dy * dy)
    dx, dy = dx / length, dy / length
    for _ in range(3):
        n, sx, sy, sxx, sxy, syy = 0, 0.0, 0.0, 0.0, 0.0, 0.0
        for m in range(len(points)):
            x, y = points[m, 0] - cx, points[m, 1] - cy
            if abs(x * dy - y * dx) < near:
                n += 1
                sx += x
                sy += y
                sxx += x * x
                sxy += x * y
                syy += y * y
        if n < 2:
            break
        sx, sy = sx / n, sy / n
        sxx, sxy, syy = sxx / n - sx * sx, sxy / n - sx * sy, syy / n - sy * sy
        angle = 0.5 * np.arctan2(2.0 * sxy, sxx - syy)
        cx, cy, dx, dy = cx + sx, cy + sy, np.cos(angle), np.sin(angle)
    across = np.empty(len(points))
    low, high, count = np.inf, -np.inf, 0
    for m in range(len(points)):
        x, y = points[m, 0] - cx, points[m, 1] - cy
        across[m] = abs(x * dy - y * dx)
        if across[m] < near:
            along = x * dx + y * dy
            low, high, count = min(low, along), max(high, along), count + 1
    ends = np.array([[cx + low * dx, cy + low * dy], [cx + high * dx, cy + high * dy]])
    return ends, count, across


@njit(cache=True, nogil=True)
def _best_line(points, pairs, near, apart, step):  # type: ignore[no-untyped-def]
    """The pair of points whose line has most points near it, more than beside it."""
    count = (len(points) + step - 1) // step
    # Coordinates by themselves and sums without branches: the compiler takes several at once.
    x, y = np.empty(count, np.float32), np.empty(count, np.float32)
    for m in range(count):
        x[m], y[m] = points[m * step, 0] - points[0, 0], points[m * step, 1] - points[0, 1]
    first, second, most = 0, 0, 0
    for k in range(len(pairs)):
        i, j = pairs[k]
        dx, dy = points[j, 0] - points[i, 0], points[j, 1] - points[i, 1]
        length = np.sqrt(dx * dx + dy * dy)
        if length < apart or length == 0.0:
            continue
        dx, dy = dx / length, dy / length
        away = (points[i, 0] - points[0, 0]) * dy - (points[i, 1] - points[0, 1]) * dx
        votes = _votes(x, y, np.float32(dx), np.float32(dy), np.float32(away), np.float32(near))
        if votes > most:
            first, second, most = i, j, votes
    return first, second, most


@njit(cache=True, nogil=True)
def _votes(x, y, dx, dy, away, near):  # type: ignore[no-untyped-def]
    """Points near a line, less those of the fuller band of the same width beside it."""
    on, left, right = np.int32(0), np.int32(0), np.int32(0)
    wide = np.float32(3.0) * near
    for m in range(len(x)):
        off = x[m] * dy - y[m] * dx - away
        on += np.int32(abs(off) < near)
        left += np.int32((off > -wide) & (off <= -near))
        right += np.int32((off < wide) & (off >= near))
    return on - max(left, right)
