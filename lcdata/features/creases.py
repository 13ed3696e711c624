"""Lines where two planes of a scan meet."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lcdata.features.compiled import compiled
from lcdata.features.planes import Floats, Labels, Planes
from lcdata.features.scan_grid import ScanGrid

Array = NDArray[np.float64]

LOOK_PIXELS = 3
"""How many pixels without a plane may lie between two planes that meet."""
SMALLEST_SINE = np.sin(np.radians(15.0))
"""Planes closer to parallel than this have no line worth having."""
LARGEST_GAP_BEAMS = 4.0
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
    off = abs(other[0] * p[0] + other[1] * p[1] + other[2] * p[2] - 1.0)
    return off / (sine * np.sqrt(other[0] ** 2 + other[1] ** 2 + other[2] ** 2))


@compiled
def spacing(p: Floats, r: float, a: Array, step: float) -> float:
    """Distance on a plane between beams that are an angle apart, metres."""
    return step * r * r * np.sqrt(a[0] ** 2 + a[1] ** 2 + a[2] ** 2)


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
    count = 0
    for i in range(rings):
        for j in range(columns):
            label = labels[i, j]
            if label < 0:
                continue
            for direction in range(2):
                other = -1
                ni, nj = i, j
                for _ in range(LOOK_PIXELS):
                    if direction == 0:
                        nj += 1
                        if nj == columns:
                            if not turn:
                                break
                            nj = 0
                    else:
                        ni += 1
                        if ni == rings:
                            break
                    other = labels[ni, nj]
                    if other >= 0:
                        break
                if other < 0 or other == label or count == len(pairs):
                    continue
                one, two = min(label, other), max(label, other)
                a, b = inverse[one], inverse[two]
                c0 = a[1] * b[2] - a[2] * b[1]
                c1 = a[2] * b[0] - a[0] * b[2]
                c2 = a[0] * b[1] - a[1] * b[0]
                aa = a[0] * a[0] + a[1] * a[1] + a[2] * a[2]
                bb = b[0] * b[0] + b[1] * b[1] + b[2] * b[2]
                sine = np.sqrt((c0 * c0 + c1 * c1 + c2 * c2) / (aa * bb))
                if sine < SMALLEST_SINE:
                    continue
                p, q = points[i, j], points[ni, nj]
                rp = np.sqrt(p[0] * p[0] + p[1] * p[1] + p[2] * p[2])
                rq = np.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2])
                u0 = 0.5 * (p[0] / rp + q[0] / rq)
                u1 = 0.5 * (p[1] / rp + q[1] / rq)
                u2 = 0.5 * (p[2] / rp + q[2] / rq)
                # a - b is the normal of the plane through the scanner and the line.
                d0, d1, d2 = a[0] - b[0], a[1] - b[1], a[2] - b[2]
                off = (d0 * u0 + d1 * u1 + d2 * u2) / np.sqrt(d0 * d0 + d1 * d1 + d2 * d2)
                # Pixels within 3 sigma of both planes went to whichever came first.
                contested = 4.0 * noise / sine
                if abs(off) > 1.5 * ring_step + contested / min(rp, rq):
                    continue
                # Planes that only seem to meet, one far behind the other, do not count.
                if label != one:
                    p, q, rp, rq = q, p, rq, rp
                near = off_line(p, b, sine) < contested + spacing(p, rp, a, 2.0 * ring_step)
                if not near or (
                    off_line(q, a, sine) > contested + spacing(q, rq, b, 2.0 * ring_step)
                ):
                    continue
                pairs[count, 0], pairs[count, 1] = one, two
                norm = np.sqrt(u0 * u0 + u1 * u1 + u2 * u2)
                rays[count, 0], rays[count, 1], rays[count, 2] = u0 / norm, u1 / norm, u2 / norm
                count += 1
    return pairs[:count].copy(), rays[:count].copy()
