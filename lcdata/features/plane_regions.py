"""From local plane fits to regions of a scan grid: growing, merging, labels, compiled.

Nodes are the pixels that have a local fit: every pixel of a ring, or every second one where
columns are denser than rings.
"""
# ruff: noqa: PLR0912, PLR0915 - a compiled loop is written out, on plain arrays

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lcdata.features.compiled import compiled
from lcdata.features.plane_fits import (
    MOST_COLUMNS_ASIDE,
    MOST_RINGS_ASIDE,
    ROUGHNESS_SQUARE,
    off_plane,
    solve3,
)

Array = NDArray[np.float64]
Floats = NDArray[np.float32]
Labels = NDArray[np.int32]

GROW_ANGLE, GROW_SIGMA = np.radians(15.0), 3.0
MERGE_ANGLE, MERGE_SIGMA = np.radians(4.0), 2.0
NO_SEED = np.float32(1e9)
FEWEST_NODES, FEWEST_ROWS = 15, 4
"""Smallest region. Each beam has a bias of its own: few rings leave the tilt to their biases."""
SMALLEST_SHARE = 0.1
"""Smallest region, as a part of the window of its seed's fit."""
GAP = 3
"""How many nodes apart two regions may be to be neighbours."""
NEIGHBOURS = 6
EXPLAINED = 1.5
"""A region goes if its neighbours' planes fit its points up to this much worse than its own."""
MOST_REGIONS = 4096


@compiled
def beside(i: int, j: int, direction: int, rings: int, columns: int, turn: bool) -> tuple[int, int]:
    """One of the four neighbours of a pixel; -1, -1 beyond the border."""
    if direction == 0:
        j += 1
    elif direction == 1:
        j -= 1
    elif direction == 2:
        i += 1
    else:
        i -= 1
    if turn and j == columns:
        j = 0
    elif turn and j < 0:
        j = columns - 1
    if i < 0 or i >= rings or j < 0 or j >= columns:
        return -1, -1
    return i, j


@compiled
def ahead(i: int, j: int, step: int, rings: int, columns: int, turn: bool) -> tuple[int, int]:
    """The next GAP pixels of a ring (steps 0 to GAP - 1), then of a column; -1, -1 for none."""
    if step < GAP:
        j += step + 1
        if j >= columns:
            j -= columns
            if not turn:
                return -1, -1
    else:
        i += step - GAP + 1
        if i >= rings:
            return -1, -1
    return i, j


@compiled
def grow(
    points: Floats,
    fits: Floats,
    residuals: Floats,
    turn: bool,
    ring_step: float,
    column_step: float,
    window_m: float,
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
    sums, vectors = np.zeros((MOST_REGIONS, 9)), np.zeros((MOST_REGIONS, 3))
    a, s = np.zeros(3), np.zeros(9)
    cosine_limit = np.cos(GROW_ANGLE)
    regions = 0
    for attempt in range(2):
        limit = noise if attempt == 0 else NO_SEED
        for seed in range(rings * columns):
            si, sj = seed // columns, seed % columns
            if labels[si, sj] != -1 or residuals[si, sj] >= limit or regions == MOST_REGIONS:
                continue
            a[0], a[1], a[2] = fits[si, sj, 0], fits[si, sj, 1], fits[si, sj, 2]
            for k in range(9):
                s[k] = 0.0
            labels[si, sj] = regions
            queue[0], head, tail = seed, 0, 1
            # Fewer points than the seed's own window had would make its plane worse.
            half = window_m * np.sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2])
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
                for direction in range(4):
                    ni, nj = beside(i, j, direction, rings, columns, turn)
                    if ni < 0 or labels[ni, nj] != -1:
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
            large = (
                tail >= max(FEWEST_NODES, SMALLEST_SHARE * window)
                and highest - lowest + 1 >= FEWEST_ROWS
            )
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
            for step in range(2 * GAP):
                ni, nj = ahead(i, j, step, rings, columns, turn)
                if ni < 0 or labels[ni, nj] < 0 or labels[ni, nj] == labels[i, j]:
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
    larger = np.full((len(vectors), NEIGHBOURS), -1, np.int32)
    for i in range(rings):
        for j in range(columns):
            if labels[i, j] >= 0:
                sizes[labels[i, j]] += 1
    for i in range(rings):
        for j in range(columns):
            one = labels[i, j]
            if one < 0:
                continue
            for step in range(2 * GAP):
                ni, nj = ahead(i, j, step, rings, columns, turn)
                other = labels[ni, nj] if ni >= 0 else -1
                if other < 0 or other == one:
                    continue
                small, large = one, other
                if sizes[small] > sizes[large]:
                    small, large = other, one
                for k in range(NEIGHBOURS):
                    if larger[small, k] == large:
                        break
                    if larger[small, k] < 0:
                        larger[small, k] = large
                        break
    own, theirs = np.zeros(len(vectors)), np.zeros(len(vectors))
    for i in range(rings):
        for j in range(columns):
            label = labels[i, j]
            if label < 0 or larger[label, 0] < 0:
                continue
            x, y, z = points[i, j, 0], points[i, j, 1], points[i, j, 2]
            best = np.inf
            for k in range(NEIGHBOURS):
                if larger[label, k] >= 0:
                    v = vectors[larger[label, k]]
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
        for direction in range(4):
            ni, nj = beside(i, j, direction, rings, columns, turn)
            if ni < 0 or labels[ni, nj] != -1:
                continue
            x, y, z = points[ni, nj, 0], points[ni, nj, 1], points[ni, nj, 2]
            if x == y == z == 0.0:
                continue
            if off_plane(v[0], v[1], v[2], x, y, z, noise) <= GROW_SIGMA:
                labels[ni, nj] = label
                queue[tail] = ni * columns + nj
                tail += 1
    return labels
