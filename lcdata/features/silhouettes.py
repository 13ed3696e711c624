"""Lines where a plane ends in front of something farther away, or of nothing.

The last beam on a plane and the first one past it leave the edge anywhere between them, so an
edge point is put half way: half a beam outwards. Edge points are rays; the rays of a straight
edge lie in one plane through the scanner, which RANSAC finds with a tolerance of half a beam,
the same at all ranges. Where it cuts the surface's plane is the line.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lcdata.features.compiled import compiled
from lcdata.features.planes import Floats, Labels, Planes
from lcdata.features.scan_grid import ScanGrid

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

STEP_M, STEP_SIGMA = 0.1, 5.0
"""How much farther the outside must be, in metres and in standard deviations of range."""
FLAT_COSINE = 0.5
"""Flatter than this, it must be that much farther across the surface too."""
LARGEST_RING_GAP = 2.0
"""Rings farther apart than this, in typical gaps, are not neighbours."""
LOOK_PIXELS = 3
"""Missing returns in a row that are sky and not dropouts."""
GRAZING_COSINE = 0.15
"""Where nothing came back beyond a surface seen flatter than this, its edge is the reach."""
LOWEST_SKY = np.radians(-2.0)
"""No return below the horizon is a dark or wet surface, not the open sky."""
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
    lines, normals = outlines(
        labels,
        np.ascontiguousarray(rays.T, np.float32),
        np.ascontiguousarray(halves.T, np.float32),
        grid.ring_step,
    )
    order, first, last = _runs(lines, rays, normals, grid.ring_step)
    if not len(first):
        return np.zeros((0, 2, 3)), np.zeros(0), np.zeros(0, np.int64)
    owners = labels[order[first]]
    ends = rays[order[np.stack([first, last], axis=1)]]
    normals, variance = _fit_runs(
        rays[order], halves[order], normals[lines[order]], first, grid.ring_step
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
    lines: Labels, rays: Array, normals: Array, ring_step: float
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
    rays: Array, halves: Array, normals: Array, first: Indices, ring_step: float
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


@compiled
def edge_points(
    points: Floats,
    labels: Labels,
    inverse: Array,
    live_rings: NDArray[np.bool_],
    live_columns: NDArray[np.bool_],
    wide: NDArray[np.bool_],
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
                di = 0 if direction < 2 else 5 - 2 * direction
                dj = 1 - 2 * direction if direction < 2 else 0
                if 0 <= i + di < rings and 0 <= j + dj < columns and labels[i + di, j + dj] == label:
                    continue
                ni, nj, seen = look(points, live_rings, live_columns, wide, turn, i, j, di, dj)
                if ni < 0 or labels[ni, nj] == label or count == len(owners):
                    continue
                a, p = inverse[label], points[i, j]
                rp = np.sqrt(np.float64(p[0]) * p[0] + p[1] * p[1] + p[2] * p[2])
                u0, u1, u2 = p[0] / rp, p[1] / rp, p[2] / rp
                norm = np.sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2])
                cosine = (a[0] * u0 + a[1] * u1 + a[2] * u2) / norm
                if seen:
                    q = points[ni, nj]
                    rq = np.sqrt(np.float64(q[0]) * q[0] + q[1] * q[1] + q[2] * q[2])
                    w0, w1, w2 = q[0] / rq, q[1] / rq, q[2] / rq
                    facing = a[0] * w0 + a[1] * w1 + a[2] * w2
                    if facing <= 0.0 or rq < max(1.0 / facing, rp) + farther:
                        continue
                    # A surface seen flatly that only bends away is off its plane along the ray
                    # long before it is across.
                    if cosine < FLAT_COSINE and rq * facing - 1.0 < farther * norm:
                        continue
                    # A ring with a bias of its own, not an edge: the plane goes on behind it.
                    if di != 0 and resumes(labels, label, ni, nj, di):
                        continue
                else:
                    if cosine < GRAZING_COSINE or elevation[ni] < LOWEST_SKY:
                        continue
                    azimuth = np.arctan2(u1, u0) + dj * column_step
                    height = np.arctan2(u2, np.sqrt(u0 * u0 + u1 * u1))
                    height += elevation[ni] - elevation[i]
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


@compiled
def resumes(labels: Labels, label: int, i: int, j: int, di: int) -> bool:
    """Whether a label comes back within the next pixels of a column."""
    for _ in range(LOOK_PIXELS):
        i += di
        if i < 0 or i >= len(labels):
            return False
        if labels[i, j] == label:
            return True
    return False


@compiled
def look(
    points: Floats,
    live_rings: NDArray[np.bool_],
    live_columns: NDArray[np.bool_],
    wide: NDArray[np.bool_],
    turn: bool,
    i: int,
    j: int,
    di: int,
    dj: int,
) -> tuple[int, int, bool]:
    """The next pixel in a direction and whether it has a return.

    The border of the scan, a crop or a dead ring, and a dropout (beyond which the edge could
    be anywhere) give -1.
    """
    rings, columns = points.shape[:2]
    ni, nj = i, j
    for step in range(LOOK_PIXELS):
        ni, nj = ni + di, nj + dj
        if di != 0 and 0 <= ni < rings and wide[min(ni, ni - di)]:
            return -1, -1, False
        if turn:
            nj = nj - columns if nj >= columns else (nj + columns if nj < 0 else nj)
        if ni < 0 or ni >= rings or nj < 0 or nj >= columns:
            return -1, -1, False
        if not (live_rings[ni] and live_columns[nj]):
            return -1, -1, False
        if points[ni, nj, 0] != 0.0 or points[ni, nj, 1] != 0.0 or points[ni, nj, 2] != 0.0:
            if step > 0:
                return -1, -1, False
            return ni, nj, True
    return ni - (LOOK_PIXELS - 1) * di, nj, False


@compiled
def outlines(
    labels: Labels, rays: Floats, halves: Floats, ring_step: float
) -> tuple[Labels, Floats]:
    """RANSAC of planes through the scanner, region by region.

    Args:
        labels: (K,) sorted.
        rays: (3, K) unit edge rays.
        halves: (3, K) half a beam across the edge.
        ring_step: Radians.

    Returns:
        (K,) line of each edge point, -1 for none, and (M, 3) normals of the lines' planes.
    """
    lines = np.full(len(labels), -1, np.int32)
    normals = np.zeros((len(labels) // FEWEST_POINTS + 1, 3), np.float32)
    # Points not yet on a line move to the front of their region: tight loops over few columns.
    u, h, place = rays.copy(), halves.copy(), np.arange(len(labels))
    eps = np.float32(EPSILON_BEAMS * ring_step)
    shortest, longest = (4.0 * ring_step) ** 2, (60.0 * ring_step) ** 2
    found, first = 0, 0
    state = np.uint32(1)
    while first < len(labels):
        last = first
        while last < len(labels) and labels[last] == labels[first]:
            last += 1
        begin, first = first, last
        while last - begin >= FEWEST_POINTS:
            most, b0, b1, b2 = 0, np.float32(0), np.float32(0), np.float32(0)
            u0, u1, u2 = u[0, begin:last], u[1, begin:last], u[2, begin:last]
            h0, h1, h2 = h[0, begin:last], h[1, begin:last], h[2, begin:last]
            for _ in range(TRIALS):
                square, one, two = 0.0, 0, 0
                for attempt in range(8):
                    # A linear congruential generator: the same lines on every run.
                    state = np.uint32(state * np.uint32(1664525) + np.uint32(1013904223))
                    drawn = begin + np.int64(state >> np.uint32(8)) % (last - begin)
                    if attempt == 0:
                        one = drawn
                        continue
                    two, square = drawn, 0.0
                    for m in range(3):
                        square += (u[m, one] - u[m, two]) ** 2
                    if shortest < square < longest:
                        break
                if square <= shortest:
                    continue
                n0 = u[1, one] * u[2, two] - u[2, one] * u[1, two]
                n1 = u[2, one] * u[0, two] - u[0, one] * u[2, two]
                n2 = u[0, one] * u[1, two] - u[1, one] * u[0, two]
                norm = np.float32(np.sqrt(n0 * n0 + n1 * n1 + n2 * n2))
                n0, n1, n2 = n0 / norm, n1 / norm, n2 / norm
                votes = np.int32(0)
                for k in range(len(u0)):
                    off = abs(u0[k] * n0 + u1[k] * n1 + u2[k] * n2)
                    bound = abs(h0[k] * n0 + h1[k] * n1 + h2[k] * n2) + eps
                    votes += np.int32(off < bound)
                if votes > most:
                    most, b0, b1, b2 = votes, n0, n1, n2
            if most < FEWEST_POINTS:
                break
            b0, b1, b2 = refit(u, h, begin, last, b0, b1, b2, eps)
            rest = begin
            for k in range(begin, last):
                off = abs(u[0, k] * b0 + u[1, k] * b1 + u[2, k] * b2)
                bound = abs(h[0, k] * b0 + h[1, k] * b1 + h[2, k] * b2)
                if off < bound + eps:
                    lines[place[k]] = found
                    continue
                for m in range(3):
                    u[m, rest], h[m, rest] = u[m, k], h[m, k]
                place[rest] = place[k]
                rest += 1
            if rest == last:
                break
            last = rest
            normals[found, 0], normals[found, 1], normals[found, 2] = b0, b1, b2
            found += 1
    return lines, normals[:found].copy()


@compiled
def refit(
    u: Floats,
    h: Floats,
    begin: int,
    last: int,
    n0: np.float32,
    n1: np.float32,
    n2: np.float32,
    eps: np.float32,
) -> tuple[np.float32, np.float32, np.float32]:
    """Least squares over all edge points on a line that only two of them defined."""
    c0, c1, c2 = 0.0, 0.0, 0.0
    for k in range(begin, last):
        off = abs(u[0, k] * n0 + u[1, k] * n1 + u[2, k] * n2)
        if off < abs(h[0, k] * n0 + h[1, k] * n1 + h[2, k] * n2) + eps:
            c0, c1, c2 = c0 + u[0, k], c1 + u[1, k], c2 + u[2, k]
    norm = np.sqrt(c0 * c0 + c1 * c1 + c2 * c2)
    c0, c1, c2 = c0 / norm, c1 / norm, c2 / norm
    d0, d1, d2 = n1 * c2 - n2 * c1, n2 * c0 - n0 * c2, n0 * c1 - n1 * c0
    ff, fs, ss, yf, ys = 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(begin, last):
        y = u[0, k] * n0 + u[1, k] * n1 + u[2, k] * n2
        if abs(y) < abs(h[0, k] * n0 + h[1, k] * n1 + h[2, k] * n2) + eps:
            f = u[0, k] * c0 + u[1, k] * c1 + u[2, k] * c2
            s = u[0, k] * d0 + u[1, k] * d1 + u[2, k] * d2
            ff, fs, ss, yf, ys = ff + f * f, fs + f * s, ss + s * s, yf + y * f, ys + y * s
    determinant = ff * ss - fs * fs
    if determinant <= 0.0:
        return n0, n1, n2
    alpha, beta = (yf * ss - ys * fs) / determinant, (ff * ys - fs * yf) / determinant
    m0, m1 = n0 - alpha * c0 - beta * d0, n1 - alpha * c1 - beta * d1
    m2 = n2 - alpha * c2 - beta * d2
    norm = np.sqrt(m0 * m0 + m1 * m1 + m2 * m2)
    return np.float32(m0 / norm), np.float32(m1 / norm), np.float32(m2 / norm)
