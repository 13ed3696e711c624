"""Lines where two planes of a scan meet."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from lcdata.features.compiled import compiled
from lcdata.features.planes import Labels, Planes
from lcdata.features.scan_grid import ScanGrid

Array = NDArray[np.float64]
Floats = NDArray[np.float32]

LOOK_PIXELS = 3
"""How many pixels without a plane may lie between two planes that meet."""
SMALLEST_SINE = np.sin(np.radians(15.0))
"""Planes closer to parallel than this have no line worth having."""
LARGEST_GAP_BEAMS = 4.0
CONTESTED_SIGMA = 4.0
LARGEST_OFF_BEAMS, LARGEST_APART_BEAMS = 1.5, 2.0
"""How far a pixel pair may be from the line: as seen, and on the planes."""
FEWEST_CROSSINGS = 4
SMALLEST_DENSITY = 0.5


def find_creases(grid: ScanGrid, planes: Planes) -> tuple[Array, Array, NDArray[np.int64]]:
    """Segments of the intersections of neighbouring planes, as far as the planes really meet.

    Returns:
        (M, 2, 3) segments in metres, (M,) standard deviations of their position across
        themselves in metres, (M,) number of pixel pairs on either side of each.
    """
    pairs, rays = crossings(
        grid.points, planes.labels, planes.inverse, grid.full_turn, grid.ring_step, planes.noise_m
    )
    if not len(pairs):
        return np.zeros((0, 2, 3)), np.zeros(0), np.zeros(0, np.int64)
    a, b = planes.inverse[pairs[:, 0]], planes.inverse[pairs[:, 1]]
    along = np.cross(a, b)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    # Rays are put on the plane through the scanner and the line, then on the line.
    across = (a - b) / np.linalg.norm(a - b, axis=1, keepdims=True)
    rays = rays - (across * rays).sum(axis=1, keepdims=True) * across
    t = (along * rays).sum(axis=1) / (a * rays).sum(axis=1)

    order = np.lexsort((t, pairs[:, 1], pairs[:, 0]))
    pairs, rays, t = pairs[order], rays[order], t[order]
    step = np.linalg.norm(np.diff(rays, axis=0), axis=1)
    split = (np.diff(pairs, axis=0) != 0).any(axis=1) | (step > LARGEST_GAP_BEAMS * grid.ring_step)
    first = np.concatenate([[0], np.flatnonzero(split) + 1])
    last = np.concatenate([first[1:], [len(t)]]) - 1
    count = last - first + 1
    angle = np.linalg.norm(rays[last] - rays[first], axis=1)
    kept = (count >= FEWEST_CROSSINGS) & (count >= SMALLEST_DENSITY * angle / grid.ring_step)
    first, last, count = first[kept], last[kept], count[kept]

    one, other = pairs[first].T
    a, b = planes.inverse[one], planes.inverse[other]
    along = np.cross(a, b)
    square = (along**2).sum(axis=1, keepdims=True)
    # The point of the line nearest to the scanner: a . p = b . p = 1.
    foot = (np.cross(b, along) + np.cross(along, a)) / square
    along /= np.sqrt(square)
    segments = foot[:, None] + np.stack([t[first], t[last]], axis=1)[..., None] * along[:, None]
    sine2 = square[:, 0] / ((a**2).sum(axis=1) * (b**2).sum(axis=1))
    variance = sum(
        np.einsum("mei,mij,mej->me", segments, planes.covariance[i], segments).max(axis=1)
        / (planes.inverse[i] ** 2).sum(axis=1)
        for i in (one, other)
    )
    return segments, np.sqrt(variance / sine2), count


@compiled
def off_line(p: Floats, other: Array, sine: float) -> float:
    """Distance of a point of one plane from the line in which it meets another, metres."""
    off: float = abs(other[0] * p[0] + other[1] * p[1] + other[2] * p[2] - 1.0)
    return off / (sine * length(other))


@compiled
def spacing(r: float, a: Array, step: float) -> float:
    """Distance on a plane between beams that are an angle apart, metres."""
    return step * r * r * length(a)


@compiled
def length(v: Array | Floats) -> float:
    """Norm of a vector of three."""
    return math.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])


@compiled
def next_label(labels: Labels, i: int, j: int, down: bool, turn: bool) -> tuple[int, int]:
    """The next pixel of a ring, or of a column, that has a label; -1, -1 for none near."""
    for _ in range(LOOK_PIXELS):
        if down:
            i += 1
        else:
            j += 1
        if turn and j == labels.shape[1]:
            j = 0
        if i == labels.shape[0] or j == labels.shape[1]:
            return -1, -1
        if labels[i, j] >= 0:
            return i, j
    return -1, -1


@compiled
def crossings(
    points: Floats, labels: Labels, inverse: Array, turn: bool, ring_step: float, noise: float
) -> tuple[Labels, Array]:
    """Pixel pairs of two planes near the line in which the planes meet.

    Returns:
        (K, 2) labels, the smaller one first, and (K, 3) unit rays between the two pixels.
    """
    rings, columns = labels.shape
    pairs = np.empty((rings * columns, 2), np.int32)
    rays = np.empty((rings * columns, 3))
    cross, apart, ray = np.empty(3), np.empty(3), np.empty(3)
    count = 0
    for i in range(rings):
        for j in range(columns):
            label = labels[i, j]
            if label < 0:
                continue
            for down in (False, True):
                ni, nj = next_label(labels, i, j, down, turn)
                if ni < 0 or labels[ni, nj] == label or count == len(pairs):
                    continue
                a, b = inverse[label], inverse[labels[ni, nj]]
                p, q = points[i, j], points[ni, nj]
                rp, rq = length(p), length(q)
                for k in range(3):
                    cross[k] = a[k - 2] * b[k - 1] - a[k - 1] * b[k - 2]
                    # The normal of the plane through the scanner and the line.
                    apart[k] = a[k] - b[k]
                    ray[k] = p[k] / rp + q[k] / rq
                sine = length(cross) / (length(a) * length(b))
                if sine < SMALLEST_SINE:
                    continue
                off = abs(apart[0] * ray[0] + apart[1] * ray[1] + apart[2] * ray[2])
                off /= length(apart) * length(ray)
                # Pixels within 3 sigma of both planes went to whichever came first.
                contested = CONTESTED_SIGMA * noise / sine
                if off > LARGEST_OFF_BEAMS * ring_step + contested / min(rp, rq):
                    continue
                # Planes that only seem to meet, one far behind the other, do not count.
                step = LARGEST_APART_BEAMS * ring_step
                if off_line(p, b, sine) > contested + spacing(rp, a, step):
                    continue
                if off_line(q, a, sine) > contested + spacing(rq, b, step):
                    continue
                pairs[count, 0] = min(label, labels[ni, nj])
                pairs[count, 1] = max(label, labels[ni, nj])
                for k in range(3):
                    rays[count, k] = ray[k] / length(ray)
                count += 1
    return pairs[:count].copy(), rays[:count].copy()
