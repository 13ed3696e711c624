"""Planes of a scan grid: local fits, region growing, merging, a label for every pixel.

A plane is written as the vector a with a . p = 1 for its points p (metres), so a = normal /
distance from the scanner. Along a unit ray u the plane is met at range 1 / (a . u): the inverse
range is linear in a, the directions are free of noise, and so least squares on inverse ranges
is unbiased and needs no eigenvectors. Sums over any window come from one summed-area table.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lcdata.features.compiled import compiled
from lcdata.features.scan_grid import ScanGrid

Array = NDArray[np.float64]
Floats = NDArray[np.float32]
Labels = NDArray[np.int32]

WINDOW_M = 0.15
"""Half size of the window of a local fit."""
MOST_COLUMNS_ASIDE, MOST_RINGS_ASIDE = 32, 12
ROUGHNESS_SQUARE = 0.005**2
"""How far real surfaces are from planes (m^2), added to the range noise."""
NO_SEED = np.float32(1e9)
GROW_ANGLE, GROW_SIGMA = np.radians(15.0), 3.0
MERGE_ANGLE, MERGE_SIGMA = np.radians(4.0), 2.0
FLAT_SIGMA = 1.6
"""Largest residual of a window that counts as flat, in standard deviations."""
MERGE_GAP = 3
"""How many nodes apart two regions may be to be neighbours."""
NEIGHBOURS = 6
EXPLAINED = 1.5
"""A region goes if its neighbours' planes fit its points up to this much worse than its own."""
FEWEST_NODES, FEWEST_ROWS = 15, 4
"""Smallest region. Each beam has a bias of its own: few rings leave the tilt to their biases."""
NOISE_LIMITS_M = 0.004, 0.05


@dataclass(frozen=True, eq=False)
class Planes:
    """The planes of one scan.

    Args:
        labels: (rings, columns) int32 plane of each pixel, -1 for none.
        inverse: (P, 3) vectors a with a . p = 1, 1/m.
        covariance: (P, 3, 3) of `inverse`.
        noise_m: Standard deviation of a range, estimated from this scan.
    """

    labels: Labels
    inverse: Array
    covariance: Array
    noise_m: float


def find_planes(grid: ScanGrid) -> Planes:
    """Segment a scan into planes."""
    points, turn = grid.points, grid.full_turn
    ring_step, column_step = grid.ring_step, abs(grid.column_step)
    table = window_table(points, MOST_COLUMNS_ASIDE if turn else 0)

    ring_steps = np.maximum(np.abs(np.gradient(grid.elevation)), 0.3 * ring_step)
    coarse = local_fits(points, table, turn, ring_steps, column_step, 8, 0.0, np.inf)[1]
    measured = coarse[np.isfinite(coarse)]
    noise = float(np.clip(np.quantile(measured, 0.4), *NOISE_LIMITS_M)) if len(measured) else 0.02
    # Nodes are about as far apart in azimuth as in elevation; 2 columns where they are dense.
    stride = 2 if ring_step > 1.5 * column_step and points.shape[1] % 2 == 0 else 1
    fits, residuals = local_fits(
        points, table, turn, ring_steps, column_step, stride, WINDOW_M, noise
    )
    nodes = np.ascontiguousarray(points[:, ::stride])
    node_labels, sums, vectors = grow(
        nodes, fits, residuals, turn, ring_step, stride * column_step, noise
    )
    parents = merge(nodes, node_labels, sums, vectors, turn, noise)
    roots = np.flatnonzero(parents == np.arange(len(parents)))
    new = np.full(len(parents) + 1, -1, np.int32)
    new[roots] = np.arange(len(roots))
    new[:-1] = new[parents]
    node_labels = new[node_labels]
    inverse = vectors[roots]
    kept = ~explained(nodes, node_labels, inverse, turn, noise)
    roots, inverse = roots[kept], inverse[kept]
    node_labels = np.append(np.where(kept, np.cumsum(kept) - 1, -1), -1).astype(np.int32)[
        node_labels
    ]
    labels = spread(points, node_labels, inverse, stride, turn, noise)
    matrices = sums[roots][:, [[0, 1, 2], [1, 3, 4], [2, 4, 5]]]
    return Planes(labels, inverse, np.linalg.inv(matrices), noise)


@compiled
def window_table(points: Floats, pad: int) -> Array:
    """Summed-area table of u u^T (6), u/r (3), 1/r^2 for each pixel.

    Args:
        points: (R, C, 3) metres, zeros where nothing came back.
        pad: Columns repeated beyond either end, for windows across the seam.

    Returns:
        (R + 1, C + 2 pad + 1, 10); the trace of u u^T counts the points.
    """
    rings, columns = points.shape[:2]
    table = np.zeros((rings + 1, columns + 2 * pad + 1, 10))
    row = np.zeros(10)
    for i in range(rings):
        for m in range(10):
            row[m] = 0.0
        for k in range(columns + 2 * pad):
            j = k - pad
            if j < 0:
                j += columns
            elif j >= columns:
                j -= columns
            x, y, z = points[i, j, 0], points[i, j, 1], points[i, j, 2]
            square = np.float64(x) * x + np.float64(y) * y + np.float64(z) * z
            if square > 0.0:
                inverse_square = 1.0 / square
                row[0] += x * x * inverse_square
                row[1] += x * y * inverse_square
                row[2] += x * z * inverse_square
                row[3] += y * y * inverse_square
                row[4] += y * z * inverse_square
                row[5] += z * z * inverse_square
                row[6] += x * inverse_square
                row[7] += y * inverse_square
                row[8] += z * inverse_square
                row[9] += inverse_square
            for m in range(10):
                table[i + 1, k + 1, m] = table[i, k + 1, m] + row[m]
    return table


@compiled
def solve3(s: Array, a: Array) -> bool:
    """Solve a symmetric positive 3x3 system; False if it is singular.

    Args:
        s: (9+,) the matrix as xx xy xz yy yz zz, then the right side.
        a: (3,) takes the solution.
    """
    c0 = s[3] * s[5] - s[4] * s[4]
    c1 = s[2] * s[4] - s[1] * s[5]
    c2 = s[1] * s[4] - s[2] * s[3]
    determinant = s[0] * c0 + s[1] * c1 + s[2] * c2
    scale = s[0] + s[3] + s[5]
    if determinant <= 1e-13 * scale * scale * scale:
        return False
    c3 = s[0] * s[5] - s[2] * s[2]
    c4 = s[1] * s[2] - s[0] * s[4]
    c5 = s[0] * s[3] - s[1] * s[1]
    a[0] = (c0 * s[6] + c1 * s[7] + c2 * s[8]) / determinant
    a[1] = (c1 * s[6] + c3 * s[7] + c4 * s[8]) / determinant
    a[2] = (c2 * s[6] + c4 * s[7] + c5 * s[8]) / determinant
    return True


@compiled
def local_fits(
    points: Floats,
    table: Array,
    turn: bool,
    ring_steps: Array,
    column_step: float,
    stride: int,
    window: float,
    noise: float,
) -> tuple[Floats, Floats]:
    """Fit a plane around every `stride`-th pixel of each ring.

    The window has a half size of `window` metres, at least 1 ring and 2 columns; where that is
    not flat, half of it is tried.

    Returns:
        (R, N, 3) vectors a (0 where not flat) and (R, N) residuals in metres of range (inf).
    """
    rings, columns = points.shape[:2]
    pad = (table.shape[1] - 1 - columns) // 2
    count = (columns + stride - 1) // stride
    fits = np.zeros((rings, count, 3), np.float32)
    residuals = np.full((rings, count), np.inf, np.float32)
    sums, a = np.zeros(10), np.zeros(3)
    for i in range(rings):
        for k in range(count):
            j = k * stride
            x, y, z = points[i, j, 0], points[i, j, 1], points[i, j, 2]
            r = np.sqrt(np.float64(x) * x + np.float64(y) * y + np.float64(z) * z)
            if r == 0.0:
                continue
            for attempt in range(2):
                half = window / (r * (1 + attempt))
                aside = min(max(int(half / column_step + 0.5), 2), MOST_COLUMNS_ASIDE)
                above = min(max(int(half / ring_steps[i] + 0.5), 1), MOST_RINGS_ASIDE)
                left, right = j - aside, j + aside + 1
                if not turn:
                    left, right = max(left, 0), min(right, columns)
                top, bottom = max(i - above, 0), min(i + above + 1, rings)
                for m in range(10):
                    sums[m] = (
                        table[bottom, right + pad, m]
                        - table[top, right + pad, m]
                        - table[bottom, left + pad, m]
                        + table[top, left + pad, m]
                    )
                n = sums[0] + sums[3] + sums[5]
                if n < 0.5 * (right - left) * (bottom - top) or n < 7.5:
                    break
                if not solve3(sums, a):
                    break
                inside = a[0] * x + a[1] * y + a[2] * z
                if inside <= 0.0:
                    continue
                misfit = sums[9] - a[0] * sums[6] - a[1] * sums[7] - a[2] * sums[8]
                residual = r * r * np.sqrt(max(misfit, 0.0) / (n - 3.0))
                square = a[0] * a[0] + a[1] * a[1] + a[2] * a[2]
                # The part of the tolerance across the surface grows along a grazing ray.
                slope = square * r * r / (inside * inside)
                if residual <= FLAT_SIGMA * np.sqrt(noise * noise + ROUGHNESS_SQUARE * slope):
                    fits[i, k, 0], fits[i, k, 1], fits[i, k, 2] = a[0], a[1], a[2]
                    residuals[i, k] = residual
                    break
                if aside == 2 and above == 1:
                    break
    return fits, residuals


@compiled
def off_plane(a0: float, a1: float, a2: float, x: float, y: float, z: float, noise: float) -> float:
    """Distance of a point from a plane in standard deviations of that distance."""
    inside = a0 * x + a1 * y + a2 * z
    if inside <= 0.0:
        return np.inf
    square = a0 * a0 + a1 * a1 + a2 * a2
    offset = inside - 1.0
    cosine = inside * inside / (square * (x * x + y * y + z * z))
    return np.sqrt(offset * offset / (square * (noise * noise * cosine + ROUGHNESS_SQUARE)))


@compiled
def grow(
    points: Floats,
    fits: Floats,
    residuals: Floats,
    turn: bool,
    ring_step: float,
    column_step: float,
    noise: float,
) -> tuple[Labels, Array, Array]:
    """Grow regions over nodes with a local fit: 15 deg to the region's normal, 3 sigma.

    Returns:
        (R, N) labels with -1 for none, (P, 9) sums of each region's weighted least squares,
        (P, 3) its vectors a.
    """
    rings, columns = fits.shape[:2]
    labels = np.full((rings, columns), -1, np.int32)
    queue = np.empty(rings * columns, np.int32)
    capacity = 4096
    sums, vectors = np.zeros((capacity, 9)), np.zeros((capacity, 3))
    a, s = np.zeros(3), np.zeros(9)
    cosine_limit = np.cos(GROW_ANGLE)
    regions = 0
    for attempt in range(2):
        limit = noise if attempt == 0 else NO_SEED
        for seed in range(rings * columns):
            si, sj = seed // columns, seed % columns
            if labels[si, sj] != -1 or residuals[si, sj] >= limit or regions == capacity:
                continue
            a[0], a[1], a[2] = fits[si, sj, 0], fits[si, sj, 1], fits[si, sj, 2]
            for k in range(9):
                s[k] = 0.0
            labels[si, sj] = regions
            queue[0], head, tail = seed, 0, 1
            # Fewer points than the seed's own window had would make its plane worse.
            half = WINDOW_M * np.sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2])
            window = 1.0 + 2.0 * min(half / ring_step, MOST_RINGS_ASIDE)
            window *= 1.0 + 2.0 * min(half / column_step, MOST_COLUMNS_ASIDE)
            refit = int(window)
            norm = np.sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2])
            while head < tail:
                i, j = queue[head] // columns, queue[head] % columns
                head += 1
                x, y, z = (
                    np.float64(points[i, j, 0]),
                    np.float64(points[i, j, 1]),
                    np.float64(points[i, j, 2]),
                )
                square = x * x + y * y + z * z
                inside = (a[0] * x + a[1] * y + a[2] * z) / norm
                cosine = inside * inside / square
                weight = square * cosine / (noise * noise * cosine + ROUGHNESS_SQUARE)
                s[0] += weight * x * x
                s[1] += weight * x * y
                s[2] += weight * x * z
                s[3] += weight * y * y
                s[4] += weight * y * z
                s[5] += weight * z * z
                s[6] += weight * x
                s[7] += weight * y
                s[8] += weight * z
                if head == refit:
                    if solve3(s, a):
                        norm = np.sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2])
                    refit = refit + refit // 2
                for step in range(4):
                    ni, nj = i, j
                    if step == 0:
                        nj = j + 1
                    elif step == 1:
                        nj = j - 1
                    elif step == 2:
                        ni = i + 1
                    else:
                        ni = i - 1
                    if nj < 0 or nj == columns:
                        if not turn:
                            continue
                        nj = nj % columns
                    if ni < 0 or ni == rings or labels[ni, nj] != -1:
                        continue
                    if residuals[ni, nj] == np.inf:
                        continue
                    f0, f1, f2 = fits[ni, nj, 0], fits[ni, nj, 1], fits[ni, nj, 2]
                    dot = f0 * a[0] + f1 * a[1] + f2 * a[2]
                    if dot < cosine_limit * norm * np.sqrt(f0 * f0 + f1 * f1 + f2 * f2):
                        continue
                    x, y, z = points[ni, nj, 0], points[ni, nj, 1], points[ni, nj, 2]
                    if off_plane(a[0], a[1], a[2], x, y, z, noise) > GROW_SIGMA:
                        continue
                    labels[ni, nj] = regions
                    queue[tail] = ni * columns + nj
                    tail += 1
            highest, lowest = 0, rings
            for n in range(tail):
                highest = max(highest, queue[n] // columns)
                lowest = min(lowest, queue[n] // columns)
            large = tail >= max(FEWEST_NODES, 0.1 * window) and highest - lowest + 1 >= FEWEST_ROWS
            if large and solve3(s, a):
                for k in range(3):
                    vectors[regions, k] = a[k]
                for k in range(9):
                    sums[regions, k] = s[k]
                regions += 1
            else:
                # Too small: left for regions that come later, but no seed again.
                for n in range(tail):
                    labels[queue[n] // columns, queue[n] % columns] = -1
                    residuals[queue[n] // columns, queue[n] % columns] = NO_SEED
    return labels, sums[:regions].copy(), vectors[:regions].copy()


@compiled
def find(parents: Labels, label: int) -> int:
    """Root of a label in a union-find forest."""
    while parents[label] != label:
        parents[label] = parents[parents[label]]
        label = parents[label]
    return label


@compiled
def merge(
    points: Floats, labels: Labels, sums: Array, vectors: Array, turn: bool, noise: float
) -> Labels:
    """Join neighbouring regions that are one plane: 4 deg between normals, 2 sigma apart.

    Sums and vectors of a root are updated in place.

    Returns:
        (P,) root of each region.
    """
    rings, columns = labels.shape
    parents = np.empty(len(vectors), np.int32)
    for k in range(len(vectors)):
        parents[k] = k
    cosine_limit = np.cos(MERGE_ANGLE)
    a, s = np.zeros(3), np.zeros(9)
    for i in range(rings):
        for j in range(columns):
            if labels[i, j] < 0:
                continue
            for step in range(2 * MERGE_GAP):
                ni, nj = i, j
                if step < MERGE_GAP:
                    nj += step + 1
                else:
                    ni += step - MERGE_GAP + 1
                if ni >= rings or (nj >= columns and not turn):
                    continue
                nj = nj % columns
                if labels[ni, nj] < 0:
                    continue
                one, other = find(parents, labels[i, j]), find(parents, labels[ni, nj])
                if one == other:
                    continue
                v, w = vectors[one], vectors[other]
                dot = v[0] * w[0] + v[1] * w[1] + v[2] * w[2]
                squares = (v[0] ** 2 + v[1] ** 2 + v[2] ** 2) * (w[0] ** 2 + w[1] ** 2 + w[2] ** 2)
                if dot < cosine_limit * np.sqrt(squares):
                    continue
                x, y, z = points[i, j, 0], points[i, j, 1], points[i, j, 2]
                reach = 1.0 / (v[0] * x + v[1] * y + v[2] * z)
                x, y, z = x * reach, y * reach, z * reach
                if off_plane(w[0], w[1], w[2], x, y, z, noise) > MERGE_SIGMA:
                    continue
                x, y, z = points[ni, nj, 0], points[ni, nj, 1], points[ni, nj, 2]
                reach = 1.0 / (w[0] * x + w[1] * y + w[2] * z)
                x, y, z = x * reach, y * reach, z * reach
                if off_plane(v[0], v[1], v[2], x, y, z, noise) > MERGE_SIGMA:
                    continue
                for k in range(9):
                    s[k] = sums[one, k] + sums[other, k]
                if solve3(s, a):
                    parents[other] = one
                    for k in range(9):
                        sums[one, k] = s[k]
                    for k in range(3):
                        vectors[one, k] = a[k]
    return parents


@compiled
def explained(
    points: Floats, labels: Labels, vectors: Array, turn: bool, noise: float
) -> NDArray[np.bool_]:
    """Find regions whose points belong to larger planes beside them.

    Windows across a rounded-off or a grazing crease can be flat enough to start a plane of
    their own. Its points fit its larger neighbours as well as itself.

    Returns:
        (P,) True for such regions.
    """
    rings, columns = labels.shape
    sizes = np.zeros(len(vectors), np.int64)
    beside = np.full((len(vectors), NEIGHBOURS), -1, np.int32)
    for i in range(rings):
        for j in range(columns):
            if labels[i, j] >= 0:
                sizes[labels[i, j]] += 1
    for i in range(rings):
        for j in range(columns):
            one = labels[i, j]
            if one < 0:
                continue
            for step in range(2 * MERGE_GAP):
                ni, nj = i, j
                if step < MERGE_GAP:
                    nj += step + 1
                else:
                    ni += step - MERGE_GAP + 1
                if ni >= rings or (nj >= columns and not turn):
                    continue
                other = labels[ni, nj % columns]
                if other < 0 or other == one:
                    continue
                small, large = one, other
                if sizes[small] > sizes[large]:
                    small, large = other, one
                for k in range(NEIGHBOURS):
                    if beside[small, k] == large:
                        break
                    if beside[small, k] < 0:
                        beside[small, k] = large
                        break
    own, theirs = np.zeros(len(vectors)), np.zeros(len(vectors))
    for i in range(rings):
        for j in range(columns):
            label = labels[i, j]
            if label < 0 or beside[label, 0] < 0:
                continue
            x, y, z = points[i, j, 0], points[i, j, 1], points[i, j, 2]
            best = np.inf
            for k in range(NEIGHBOURS):
                if beside[label, k] >= 0:
                    v = vectors[beside[label, k]]
                    best = min(best, off_plane(v[0], v[1], v[2], x, y, z, noise))
            v = vectors[label]
            own[label] += min(off_plane(v[0], v[1], v[2], x, y, z, noise), 9.0) ** 2
            theirs[label] += min(best, 9.0) ** 2
    return (theirs < EXPLAINED * own) & (own > 0.0)


@compiled
def spread(
    points: Floats, node_labels: Labels, vectors: Array, stride: int, turn: bool, noise: float
) -> Labels:
    """Give every pixel within 3 sigma the plane that reaches it first, starting at the nodes."""
    rings, columns = points.shape[:2]
    labels = np.full((rings, columns), -1, np.int32)
    queue = np.empty(rings * columns, np.int32)
    tail = 0
    for i in range(rings):
        for j in range(columns):
            label = node_labels[i, j // stride]
            if label < 0 or points[i, j, 0] == points[i, j, 1] == points[i, j, 2] == 0.0:
                continue
            v = vectors[label]
            x, y, z = points[i, j, 0], points[i, j, 1], points[i, j, 2]
            if off_plane(v[0], v[1], v[2], x, y, z, noise) <= GROW_SIGMA:
                labels[i, j] = label
                queue[tail] = i * columns + j
                tail += 1
    head = 0
    while head < tail:
        i, j = queue[head] // columns, queue[head] % columns
        head += 1
        label = labels[i, j]
        v = vectors[label]
        for step in range(4):
            ni, nj = i, j
            if step == 0:
                nj = j + 1
            elif step == 1:
                nj = j - 1
            elif step == 2:
                ni = i + 1
            else:
                ni = i - 1
            if nj < 0 or nj == columns:
                if not turn:
                    continue
                nj = nj % columns
            if ni < 0 or ni == rings or labels[ni, nj] != -1:
                continue
            x, y, z = points[ni, nj, 0], points[ni, nj, 1], points[ni, nj, 2]
            if x == y == z == 0.0:
                continue
            if off_plane(v[0], v[1], v[2], x, y, z, noise) <= GROW_SIGMA:
                labels[ni, nj] = label
                queue[tail] = ni * columns + nj
                tail += 1
    return labels
