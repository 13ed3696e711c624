"""Depth-continuous edges of a dense cloud: lines in which planes of a voxel meet.

Yuan et al. 2021, section III-A: edges where depth jumps come out too far or too near, because a
beam's spot is wide and mixes foreground and background; where two planes meet, both sides are
measured well.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from lcdata.features.compiled import compiled
from lcdata.features.voxel_planes import MOST_PLANES, VoxelPlanes, thinned, voxel_planes

Array = NDArray[np.float64]

THIN_M = 0.02
"""Points closer than this are averaged before anything else (the paper's)."""

NEAREST_M, FARTHEST_M = 0.5, 60.0

SIZES = (2.0, 1.0, 0.5)
"""Edges of voxels, metres: those that a few planes do not explain are cut again."""

EXPLAINED = 0.8
"""Share of a voxel's points that lie on its planes if they explain it."""

FEWEST_POINTS = 60
"""Points of a plane (the paper's)."""

DISTANCE_LIMITS_M = 0.015, 0.06
"""RANSAC's distance follows the noise of the cloud between the paper's and this."""

NOISE_FACTOR = 3.0

LARGEST_COSINE = np.cos(np.deg2rad(30.0))
"""Planes at 30 to 150 degrees have a line (the paper's)."""

CLOSE_M, FAR_M = 0.03, 0.06
"""How near to the line points of one plane and of the other must be (the paper's), or so many
typical spacings of points:"""
CLOSE_SPACINGS, FAR_SPACINGS = 1.5, 3.0

BIN_M = 0.02
"""Steps along a line."""

SHORTEST_M = 0.2
"""Of a line within its voxel (the paper's)."""

ONE_SIDE = 0.85
"""Share of a plane's points on one side of a line at which it ends there. One of the two must:
planes that only cross, as those of a bush do, are no edge."""

SAMPLE = 0.004
"""Spacing of edge points, as seen from the scanner, radians."""

BESIDE_COSINE, BESIDE_M = np.cos(np.deg2rad(10.0)), 0.06
"""A plane so parallel and so near to a face of its voxel is left to the other grid."""

LARGEST_SIGMA_M = 0.04
"""Lines that their planes hold worse than this are left out."""

CORRELATION = 4.0
"""Points of a plane that count as one: surfaces are not as flat as their noise is white."""


def voxel_edges(points: NDArray[np.floating[Any]]) -> tuple[Array, Array, Array]:
    """Points on the depth-continuous edges of a cloud.

    Args:
        points: (N, 3) in the LiDAR frame, metres; NaN or zeros where nothing came back.

    Returns:
        (M, 3) points on edges, metres, (M, 3) unit directions of the edges, and (M,) standard
        deviations of the points across them, metres.
    """
    with np.errstate(invalid="ignore", over="ignore"):
        square = (np.asarray(points, float) ** 2).sum(axis=1)
        good = (square > NEAREST_M**2) & (square < FARTHEST_M**2)
    cloud = thinned(np.asarray(points, float)[good], THIN_M)
    if len(cloud) < 2 * FEWEST_POINTS:
        return np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0)
    distance = _distance(cloud)
    found = []
    for shift in (0.0, 0.5):
        rest = cloud
        for k, size in enumerate(SIZES):
            planes = voxel_planes(rest, size, distance, FEWEST_POINTS, shift * size)
            whole = _explained(planes) | (k + 1 == len(SIZES))
            found.append(_edges(planes, whole))
            belongs = np.repeat(whole, np.diff(planes.starts))
            rest = planes.points[~belongs]
            if len(rest) < 2 * FEWEST_POINTS:
                break
    where, tangents, sigma = (np.concatenate(part) for part in zip(*found, strict=True))
    return where, tangents, sigma[:, 0]


def _distance(cloud: Array) -> float:
    """RANSAC's distance from the noise of a sample of voxels, metres."""
    planes = voxel_planes(cloud, SIZES[-1], DISTANCE_LIMITS_M[1], FEWEST_POINTS)
    first = planes.spread[planes.counts[:, 0] > 0, 0]
    noise = float(np.median(first)) if len(first) else 0.0
    return float(np.clip(NOISE_FACTOR * noise, *DISTANCE_LIMITS_M))


def _explained(planes: VoxelPlanes) -> NDArray[np.bool_]:
    """(V,) whether a voxel's planes are fewer than most and hold most of its points."""
    total = np.diff(planes.starts)
    share = planes.counts.sum(axis=1) / np.maximum(total, 1)
    return np.asarray((share >= EXPLAINED) & (planes.counts[:, MOST_PLANES - 1] == 0))


def _edges(planes: VoxelPlanes, chosen: NDArray[np.bool_]) -> tuple[Array, Array, Array]:
    """Points, directions and (M, 1) standard deviations of the lines in the chosen voxels."""
    bins = int(np.ceil(2.0 * planes.size / BIN_M)) + 2
    return _meet(
        planes.points,
        planes.starts,
        planes.labels,
        planes.planes,
        planes.counts,
        planes.spread,
        planes.corners,
        planes.size,
        np.flatnonzero(chosen & (planes.counts[:, 1] > 0)),
        bins,
    )


@compiled
def cut(plane: Array, corner: Array, size: float) -> bool:
    """Whether a plane runs along a face of the voxel, which cuts off one half of its noise."""
    for k in range(3):
        if abs(plane[k]) < BESIDE_COSINE:
            continue
        # Where the axis through the voxel's middle meets the plane.
        i, j = (k + 1) % 3, (k + 2) % 3
        place = plane[3] - plane[i] * (corner[i] + 0.5 * size) - plane[j] * (corner[j] + 0.5 * size)
        place = place / plane[k] - corner[k]
        if min(abs(place), abs(place - size)) < BESIDE_M:
            return True
    return False


@compiled
def doubled(rows: Array) -> Array:
    """The same rows with room for as many more."""
    more = np.empty((2 * len(rows), rows.shape[1]))
    more[: len(rows)] = rows
    return more


@compiled
def offset_variance(moments: Array, count: int, spread: float, t: float) -> float:
    """Variance of a fitted plane's distance at a place of a line on it, squared metres.

    Args:
        moments: Sums of t, w, tt, tw, ww of the plane's points, along the line and across it.
        count: Number of them.
        spread: Root mean square of their distances from the plane, metres.
        t: The place, metres; w is 0 there.
    """
    mt, mw = moments[0] / count, moments[1] / count
    tt = moments[2] / count - mt * mt + 1e-9
    tw = moments[3] / count - mt * mw
    ww = moments[4] / count - mw * mw + 1e-9
    determinant = max(tt * ww - tw * tw, 1e-12)
    dt, dw = t - mt, -mw
    quadratic = (ww * dt * dt - 2.0 * tw * dt * dw + tt * dw * dw) / determinant
    return float(CORRELATION * spread * spread / count * (1.0 + quadratic))


@compiled
def _meet(  # noqa: PLR0912, PLR0915 - one pass over pairs of planes
    points: Array,
    starts: NDArray[np.int64],
    labels: NDArray[np.int8],
    planes: Array,
    counts: NDArray[np.int64],
    spread: Array,
    corners: Array,
    size: float,
    voxels: NDArray[np.int64],
    bins: int,
) -> tuple[Array, Array, Array]:
    """Points on the lines of all pairs of planes that meet in a voxel.

    Returns:
        (M, 3) points, (M, 3) directions, (M, 1) standard deviations across, metres.
    """
    where = np.empty((1024, 3))
    tangents = np.empty((1024, 3))
    sigmas = np.empty((1024, 1))
    count = 0
    gaps = np.empty((2, bins))
    near = np.empty((2, bins))
    along, foot = np.empty(3), np.empty(3)
    middle = np.empty(3)
    for v in voxels:
        for a in range(MOST_PLANES - 1):
            if counts[v, a] == 0:
                break
            for b in range(a + 1, MOST_PLANES):
                if counts[v, b] == 0:
                    break
                na, nb = planes[v, a, :4], planes[v, b, :4]
                cosine = na[0] * nb[0] + na[1] * nb[1] + na[2] * nb[2]
                if abs(cosine) > LARGEST_COSINE:
                    continue
                norm = np.sqrt(1.0 - cosine * cosine)
                for k in range(3):
                    i, j = (k + 1) % 3, (k + 2) % 3
                    along[k] = (na[i] * nb[j] - na[j] * nb[i]) / norm
                    middle[k] = corners[v, k] + 0.5 * size
                # The point of the line that is nearest to the voxel's middle.
                ra, rb = na[3], nb[3]
                for k in range(3):
                    ra -= na[k] * middle[k]
                    rb -= nb[k] * middle[k]
                ca = (ra - cosine * rb) / (norm * norm)
                cb = (rb - cosine * ra) / (norm * norm)
                if cut(na, corners[v], size) or cut(nb, corners[v], size):
                    continue
                outside = 0.0
                for k in range(3):
                    foot[k] = middle[k] + ca * na[k] + cb * nb[k]
                    outside = max(outside, abs(foot[k] - middle[k]))
                if outside > size:
                    continue
                gaps[:] = np.inf
                sides = np.zeros((2, 2))
                moments = np.zeros((2, 5))
                # Half a voxel's face with so many points: their typical spacing.
                spacing = size * np.sqrt(0.5 / min(counts[v, a], counts[v, b]))
                reach = max(FAR_M, FAR_SPACINGS * spacing)
                for i in range(starts[v], starts[v + 1]):
                    if labels[i] != a and labels[i] != b:
                        continue
                    one = 0 if labels[i] == a else 1
                    n = na if one == 0 else nb
                    x, y, z = points[i, 0] - foot[0], points[i, 1] - foot[1], points[i, 2] - foot[2]
                    t = x * along[0] + y * along[1] + z * along[2]
                    # Across the line, on the plane.
                    w = (
                        x * (n[1] * along[2] - n[2] * along[1])
                        + y * (n[2] * along[0] - n[0] * along[2])
                        + z * (n[0] * along[1] - n[1] * along[0])
                    )
                    sides[one, 0 if w > 0.0 else 1] += 1.0
                    moments[one, 0] += t
                    moments[one, 1] += w
                    moments[one, 2] += t * t
                    moments[one, 3] += t * w
                    moments[one, 4] += w * w
                    place = int(np.floor(t / BIN_M)) + bins // 2
                    if abs(w) < reach and 0 <= place < bins:
                        gaps[one, place] = min(gaps[one, place], abs(w))
                ends = False
                for one in range(2):
                    most = max(sides[one, 0], sides[one, 1])
                    ends |= most >= ONE_SIDE * (sides[one, 0] + sides[one, 1])
                if not ends:
                    continue
                aside = int(reach / BIN_M) + 1
                for one in range(2):
                    for i in range(bins):
                        near[one, i] = np.inf
                        for j in range(max(i - aside, 0), min(i + aside + 1, bins)):
                            if gaps[one, j] < np.inf:
                                step = (i - j) * BIN_M
                                gap = np.sqrt(gaps[one, j] ** 2 + step * step)
                                near[one, i] = min(near[one, i], gap)
                close = max(CLOSE_M, CLOSE_SPACINGS * spacing)
                first = count
                length = 0
                for i in range(bins):
                    low, high = min(near[0, i], near[1, i]), max(near[0, i], near[1, i])
                    if low > close or high > reach:
                        continue
                    t = (i - bins // 2 + 0.5) * BIN_M
                    square = 0.0
                    inside = True
                    for k in range(3):
                        p = foot[k] + t * along[k]
                        inside &= corners[v, k] <= p <= corners[v, k] + size
                        square += p * p
                    if not inside:
                        continue
                    variance = 0.0
                    for one in range(2):
                        plane = a if one == 0 else b
                        variance += offset_variance(
                            moments[one], counts[v, plane], spread[v, plane], t
                        )
                    sigma = np.sqrt(variance) / norm
                    if sigma > LARGEST_SIGMA_M:
                        continue
                    length += 1
                    every = max(1, int(SAMPLE * np.sqrt(square) / BIN_M))
                    if i % every:
                        continue
                    if count == len(where):
                        where, tangents = doubled(where), doubled(tangents)
                        sigmas = doubled(sigmas)
                    sigmas[count, 0] = sigma
                    for k in range(3):
                        where[count, k] = foot[k] + t * along[k]
                        tangents[count, k] = along[k]
                    count += 1
                if length * BIN_M < SHORTEST_M:
                    count = first
    return where[:count].copy(), tangents[:count].copy(), sigmas[:count].copy()
