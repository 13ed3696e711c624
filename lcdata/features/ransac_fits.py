"""Planes and lines by RANSAC (Fischler and Bolles 1981), compiled.

numba kernels: import this module only where it is used.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]

VOTERS = 700
"""Points that vote on a sampled line."""


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
        direction = left[second] - left[first]
        centre = left[first]
        for _ in range(3):
            direction = direction / np.linalg.norm(direction)
            across = _across(left, centre, direction)
            on = left[across < near_m]
            if len(on) < 2:
                break
            centre = on.mean(0)
            direction = np.linalg.eigh((on - centre).T @ (on - centre))[1][:, 1]
        across = _across(left, centre, direction)
        along = (left[across < near_m] - centre) @ direction
        if len(along) >= fewest and np.ptp(along) >= shortest_m:
            ends = np.array([along.min(), along.max()])
            segments.append(centre + ends[:, None] * direction)
            counts.append(len(along))
        gone = across < clear_m
        gone[[first, second]] = True
        left = np.ascontiguousarray(left[~gone])
    return np.array(segments).reshape(-1, 2, 2), np.array(counts, np.int64)


def _across(points: Array, centre: Array, direction: Array) -> Array:
    offset = points - centre
    return np.asarray(np.abs(offset[:, 0] * direction[1] - offset[:, 1] * direction[0]))


@njit(cache=True, nogil=True)
def _best_line(points, pairs, near, apart, step):  # type: ignore[no-untyped-def]
    first, second, most = 0, 0, 0
    for k in range(len(pairs)):
        i, j = pairs[k]
        dx, dy = points[j, 0] - points[i, 0], points[j, 1] - points[i, 1]
        length = np.sqrt(dx * dx + dy * dy)
        if length < apart or length == 0.0:
            continue
        dx, dy = dx / length, dy / length
        count, left, right = 0, 0, 0
        for m in range(0, len(points), step):
            off = (points[m, 0] - points[i, 0]) * dy - (points[m, 1] - points[i, 1]) * dx
            if abs(off) < near:
                count += 1
            elif -3.0 * near < off < 0.0:
                left += 1
            elif 0.0 < off < 3.0 * near:
                right += 1
        if count - max(left, right) > most:
            first, second, most = i, j, count - max(left, right)
    return first, second, most
