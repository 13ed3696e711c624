"""Lines where a plane ends in front of something farther away, or of nothing.

The last beam on a plane and the first one past it leave the edge anywhere between them, so an
edge point is put half way: half a beam outwards. Edge points are rays; the rays of a straight
edge lie in one plane through the scanner, which RANSAC finds with a tolerance of half a beam,
the same at all ranges. Where it cuts the surface's plane is the line.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from lcdata.features.planes import Floats, Labels, Planes
from lcdata.features.scan_grid import ScanGrid

Array = NDArray[np.float64]

STEP_M, STEP_SIGMA = 0.1, 5.0
"""How much farther the outside must be, in metres and in standard deviations of range."""
LOOK_PIXELS = 3
"""Missing returns in a row that are sky and not dropouts."""
GRAZING_COSINE = 0.15
"""Where nothing came back beyond a surface seen flatter than this, its edge is the reach."""
TRIALS = 60
EPSILON_BEAMS = 0.15
"""Roughness of real edges, in beams, on top of the half beam."""
FEWEST_POINTS = 8
LARGEST_GAP_BEAMS = 5.0
SMALLEST_DENSITY = 0.6


def find_silhouettes(grid: ScanGrid, planes: Planes) -> tuple[Array, Array, NDArray[np.int64]]:
    """Segments of the outlines of planes, foreground side only.

    Returns:
        (M, 2, 3) segments in metres, (M,) standard deviations of their position across
        themselves in metres, (M,) number of edge points on each.
    """
    points, rings, columns = grid.points, *grid.points.shape[:2]
    seen = (points[..., 0] != 0) | (points[..., 1] != 0)
    labels, rays, halves = edge_points(
        points,
        planes.labels,
        planes.inverse,
        seen.sum(axis=1) > 0.01 * columns,
        seen.any(axis=0),
        grid.elevation,
        grid.column_step,
        grid.full_turn,
        max(STEP_M, STEP_SIGMA * planes.noise_m),
    )
    order = np.argsort(labels, kind="stable")
    labels, rays, halves = labels[order], rays[order], halves[order]
    normals, ends, owners, counts, spreads = outline_lines(
        labels, rays, halves, grid.ring_step, abs(grid.column_step)
    )
    inverse = planes.inverse[owners]
    # End rays are put on the line's plane, then on the surface.
    ends = ends - (ends @ normals[..., None]) * normals[:, None]
    segments = ends / np.einsum("mei,mi->me", ends, inverse)[..., None]
    across = spreads * np.linalg.norm(segments, axis=2).max(axis=1)
    variance = np.einsum("mei,mij,mej->me", segments, planes.covariance[owners], segments)
    surface = variance.max(axis=1) / (inverse**2).sum(axis=1)
    return segments, np.sqrt(across**2 + surface), counts


@njit(cache=True)
def edge_points(
    points: Floats,
    labels: Labels,
    inverse: Array,
    live_rings: NDArray[np.bool_],
    live_columns: NDArray[np.bool_],
    elevation: Array,
    column_step: float,
    turn: bool,
    farther: float,
) -> tuple[Labels, Array, Array]:
    """Rays half a beam outside each plane's last pixels, where the outside is farther.

    Returns:
        (K,) labels, (K, 3) unit rays, (K, 3) half the way from the inner beam to the outer one.
    """
    rings, columns = labels.shape
    owners = np.empty(rings * columns, np.int32)
    rays = np.empty((rings * columns, 3))
    halves = np.empty((rings * columns, 3))
    count = 0
    for i in range(rings):
        for j in range(columns):
            label = labels[i, j]
            if label < 0:
                continue
            for direction in range(4):
                di, dj = 0, 0
                if direction < 2:
                    dj = 1 - 2 * direction
                else:
                    di = 5 - 2 * direction
                # The nearest return in this direction, or none in all of LOOK_PIXELS.
                found, out, first_i, first_j = 0, False, 0, 0
                ni, nj = i, j
                for step in range(1, LOOK_PIXELS + 1):
                    ni, nj = ni + di, nj + dj
                    if turn:
                        nj = nj % columns
                    if ni < 0 or ni >= rings or nj < 0 or nj >= columns:
                        out = True
                        break
                    if not (live_rings[ni] and live_columns[nj]):
                        out = True
                        break
                    if step == 1:
                        first_i, first_j = ni, nj
                    q = points[ni, nj]
                    if q[0] != 0.0 or q[1] != 0.0 or q[2] != 0.0:
                        found = step
                        break
                # Beyond a dropout the edge could be anywhere in between: not used.
                if (out and found == 0) or found > 1 or count == len(owners):
                    continue
                if found == 1 and labels[ni, nj] == label:
                    continue
                a, p = inverse[label], points[i, j]
                rp = np.sqrt(np.float64(p[0]) * p[0] + p[1] * p[1] + p[2] * p[2])
                u0, u1, u2 = p[0] / rp, p[1] / rp, p[2] / rp
                if found == 1:
                    q = points[ni, nj]
                    rq = np.sqrt(np.float64(q[0]) * q[0] + q[1] * q[1] + q[2] * q[2])
                    w0, w1, w2 = q[0] / rq, q[1] / rq, q[2] / rq
                    facing = a[0] * w0 + a[1] * w1 + a[2] * w2
                    if facing <= 0.0 or rq < 1.0 / facing + farther:
                        continue
                else:
                    norm = np.sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2])
                    if (a[0] * u0 + a[1] * u1 + a[2] * u2) / norm < GRAZING_COSINE:
                        continue
                    azimuth = np.arctan2(u1, u0) + dj * column_step
                    height = np.arctan2(u2, np.sqrt(u0 * u0 + u1 * u1))
                    height += elevation[first_i] - elevation[i]
                    w0, w1 = np.cos(height) * np.cos(azimuth), np.cos(height) * np.sin(azimuth)
                    w2 = np.sin(height)
                m0, m1, m2 = 0.5 * (u0 + w0), 0.5 * (u1 + w1), 0.5 * (u2 + w2)
                norm = np.sqrt(m0 * m0 + m1 * m1 + m2 * m2)
                owners[count] = label
                rays[count, 0], rays[count, 1], rays[count, 2] = m0 / norm, m1 / norm, m2 / norm
                halves[count, 0] = 0.5 * (w0 - u0)
                halves[count, 1] = 0.5 * (w1 - u1)
                halves[count, 2] = 0.5 * (w2 - u2)
                count += 1
    return owners[:count].copy(), rays[:count].copy(), halves[:count].copy()


@njit(cache=True)
def refine(
    rays: Array, halves: Array, chosen: NDArray[np.bool_], normal: Array, eps: float
) -> None:
    """Least squares of a plane through the scanner to the chosen rays, in place.

    An edge point's error is even over half a beam either way, so its weight depends on how
    the line runs against the beam grid: in the plane's frame, across = alpha + beta * along.
    """
    centre = np.zeros(3)
    for k in range(len(rays)):
        if chosen[k]:
            centre += rays[k]
    centre -= np.dot(centre, normal) * normal
    centre /= np.sqrt(np.dot(centre, centre))
    along = np.cross(normal, centre)
    s0, s1, s2, y0, y1 = 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(len(rays)):
        if chosen[k]:
            x, y, d = np.dot(rays[k], along), np.dot(rays[k], normal), np.dot(rays[k], centre)
            bound = np.dot(halves[k], normal)
            w = 1.0 / (bound * bound / 3.0 + eps * eps)
            s0 += w * d * d
            s1 += w * d * x
            s2 += w * x * x
            y0 += w * d * y
            y1 += w * x * y
    determinant = s0 * s2 - s1 * s1
    if determinant <= 1e-12 * s0 * s2:
        return
    alpha, beta = (y0 * s2 - y1 * s1) / determinant, (s0 * y1 - s1 * y0) / determinant
    normal -= alpha * centre + beta * along
    normal /= np.sqrt(np.dot(normal, normal))


@njit(cache=True)
def add_runs(
    rays: Array,
    halves: Array,
    line: Array,
    ring_step: float,
    column_step: float,
    lines: int,
    normals: Array,
    ends: Array,
    counts: NDArray[np.int64],
    spreads: Array,
) -> int:
    """Cut a line's edge points at gaps and store each run that is dense enough.

    Returns:
        The number of lines stored so far.
    """
    along = np.cross(line, rays[0])
    x = np.arctan2(rays @ along, rays @ np.cross(along, line))
    order = np.argsort(x)
    eps = EPSILON_BEAMS * ring_step
    first = 0
    for k in range(1, len(order) + 1):
        if k < len(order) and x[order[k]] - x[order[k - 1]] < LARGEST_GAP_BEAMS * ring_step:
            continue
        run = order[first:k]
        first = k
        angle = x[run[-1]] - x[run[0]]
        if len(run) < max(FEWEST_POINTS, SMALLEST_DENSITY * angle / ring_step):
            continue
        u, h = rays[run], halves[run]
        normal = line.copy()
        refine(u, h, np.ones(len(u), np.bool_), normal, eps)
        rise = abs(u[-1, 2] - u[0, 2]) / ring_step
        turn = abs(u[-1, 0] * u[0, 1] - u[-1, 1] * u[0, 0]) / column_step
        # Beams of one column (ring) share their error: only a new column (ring) averages it.
        steps = 1.0 + min(rise, turn)
        spreads[lines] = np.sqrt(np.mean((h @ normal) ** 2) / (3.0 * steps))
        normals[lines] = normal
        ends[lines, 0], ends[lines, 1] = u[0], u[-1]
        counts[lines] = len(run)
        lines += 1
    return lines


@njit(cache=True)
def outline_lines(
    labels: Labels, rays: Array, halves: Array, ring_step: float, column_step: float
) -> tuple[Array, Array, Labels, NDArray[np.int64], Array]:
    """RANSAC of planes through the scanner, region by region, split at gaps.

    Args:
        labels: (K,) sorted.
        rays: (K, 3) unit edge rays.
        halves: (K, 3) half a beam across the edge.
        ring_step: Radians.
        column_step: Radians.

    Returns:
        (M, 3) normals, (M, 2, 3) end rays, (M,) labels, (M,) point counts, (M,) angular
        standard deviations across the line.
    """
    capacity = len(labels) // FEWEST_POINTS + 1
    normals, ends = np.zeros((capacity, 3)), np.zeros((capacity, 2, 3))
    owners, counts = np.zeros(capacity, np.int32), np.zeros(capacity, np.int64)
    spreads = np.zeros(capacity)
    lines = 0
    eps = EPSILON_BEAMS * ring_step
    np.random.seed(0)
    normal, best = np.zeros(3), np.zeros(3)
    start = 0
    while start < len(labels):
        stop = start
        while stop < len(labels) and labels[stop] == labels[start]:
            stop += 1
        u, h = rays[start:stop].copy(), halves[start:stop].copy()
        misses = 0
        while len(u) >= FEWEST_POINTS and misses < 3:
            most = 0
            for _ in range(TRIALS):
                one = np.random.randint(len(u))
                for _ in range(8):
                    two = np.random.randint(len(u))
                    chord = u[one] - u[two]
                    distance = np.sqrt(np.dot(chord, chord))
                    if 4.0 * ring_step < distance < 60.0 * ring_step:
                        break
                if distance <= 4.0 * ring_step:
                    continue
                normal[:] = np.cross(u[one], u[two])
                normal /= np.sqrt(np.dot(normal, normal))
                votes = 0
                for k in range(len(u)):
                    off = abs(u[k, 0] * normal[0] + u[k, 1] * normal[1] + u[k, 2] * normal[2])
                    bound = abs(h[k, 0] * normal[0] + h[k, 1] * normal[1] + h[k, 2] * normal[2])
                    if off < bound + eps:
                        votes += 1
                if votes > most:
                    most = votes
                    best[:] = normal
            if most < FEWEST_POINTS:
                break
            near = np.abs(u @ best) < np.abs(h @ best) + eps
            for _ in range(2):
                refine(u, h, near, best, eps)
                near = np.abs(u @ best) < np.abs(h @ best) + eps
            chosen = np.flatnonzero(near)
            if len(chosen) < FEWEST_POINTS:
                misses += 1
                continue
            found = add_runs(
                u[chosen],
                h[chosen],
                best,
                ring_step,
                column_step,
                lines,
                normals,
                ends,
                counts,
                spreads,
            )
            misses = 0 if found > lines else misses + 1
            owners[lines:found] = labels[start]
            lines = found
            u, h = u[~near], h[~near]
        start = stop
    return normals[:lines], ends[:lines], owners[:lines], counts[:lines], spreads[:lines]
