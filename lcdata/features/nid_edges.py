"""Edges of the cloud on edges of the image: what sharpens NID on sparse scans.

Cloud edges are steps of range, and of reflectance, from point to point along a ring. Image edges
are Canny's, horizontal ones left out: rings cannot see them. The distance to the next edge, cut
off, has its mean over the neighbourhood taken away: without that it rewards clutter, and zero
becomes the natural cost of a point outside the image.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from lcdata.features.nid_kernels import move, place_pixels
from lcdata.features.nid_views import NidImage
from lcdata.features.scan_grid import ring_from_elevation, ring_from_scan_order
from lcdata.geometry.camera_kernels import (
    BLOCK,
    BLOCK_ROWS,
    FAST,
    project_block,
    project_block_jacobian,
)

Array = NDArray[np.float64]
Floats = NDArray[np.float32]

TRUNCATIONS = (0.06, 0.025, 0.012, 0.006)
"""Distances beyond which nothing is gained, radians, coarse to fine."""

CLUTTER = 0.2
"""Edge of the box over which the distances' mean is taken away, radians."""

STEP_M, STEP_SHARE = 0.4, 0.03
"""How much farther the next point of a ring must be, metres and share of the range."""

FARTHEST_M = 60.0
PAINT_SHARE = 0.04
"""Share of the points that are at the strongest reflectance steps."""
PAINT_WEIGHT = 0.5
"""What a step of reflectance counts beside one of range."""

COARSE_CELL, FINEST_CELL = 0.03, 0.002
"""Cells that tell the field of view of a cloud without rings, and its range image's, radians."""

LARGEST_GAP = 3.0
"""Points of a ring farther apart than so many typical gaps are not neighbours."""


def edge_points(
    points: Floats,
    intensity: Floats,
    organised: tuple[int, int] | None = None,
    ring: NDArray[np.integer[Any]] | None = None,
) -> tuple[Floats, Floats]:
    """Points at steps of range and of reflectance along rings.

    Args:
        points: (N, 3) in the LiDAR frame, metres; NaN or zeros where nothing came back.
        intensity: (N,).
        organised: (rings, columns) if the points are a row-major image of the scan.
        ring: (N,) ring numbers; otherwise from the points' order or elevation. A cloud that has
            no rings is cut into rings of its own density.

    Returns:
        (M, 3) points in the LiDAR frame, metres, and their (M,) weights.
    """
    with np.errstate(invalid="ignore"):
        distance = np.linalg.norm(points, axis=1)
        good = np.flatnonzero((distance > 0.5) & (distance < 1e4) & np.isfinite(intensity))
    if len(good) < 100:
        return np.zeros((0, 3), np.float32), np.zeros(0, np.float32)
    cloud = points[good]
    if organised is not None:
        rank = good // organised[1]
    elif ring is not None:
        rank = np.unique(np.asarray(ring)[good], return_inverse=True)[1]
    else:
        found = ring_from_scan_order(cloud)
        if found is None:
            found = ring_from_elevation(cloud)
        if found is None:
            chosen, found = _own_rings(cloud, distance[good])
            good, cloud = good[chosen], cloud[chosen]
        rank = np.asarray(found)
    azimuth = np.arctan2(cloud[:, 1], cloud[:, 0])
    order = np.lexsort((azimuth, rank))
    cloud, rank, azimuth = cloud[order], rank[order], azimuth[order]
    light, far = intensity[good][order], distance[good][order]
    gap = np.diff(azimuth)
    same = (np.diff(rank) == 0) & (gap > 0)
    if not same.any():
        return np.zeros((0, 3), np.float32), np.zeros(0, np.float32)
    same &= gap < LARGEST_GAP * max(float(np.median(gap[same])), 1e-3)
    step = np.diff(far)
    needed = np.maximum(STEP_M, STEP_SHARE * np.minimum(far[1:], far[:-1]))
    before = np.flatnonzero(same & (step > needed) & (far[:-1] < FARTHEST_M))
    after = np.flatnonzero(same & (step < -needed) & (far[1:] < FARTHEST_M))
    ray = cloud / far[:, None]
    middle = ray[1:] + ray[:-1]
    middle /= np.linalg.norm(middle, axis=1, keepdims=True)
    depth = np.concatenate(
        [middle[before] * far[before, None], middle[after] * far[after + 1, None]]
    )
    paint = _paint(light, far, same, middle)
    found_points = np.concatenate([depth, paint]).astype(np.float32)
    weights = np.repeat([1.0, PAINT_WEIGHT], [len(depth), len(paint)]).astype(np.float32)
    return np.ascontiguousarray(found_points), weights


def _paint(light: Floats, far: Floats, same: NDArray[np.bool_], middle: Floats) -> Floats:
    """Points at the strongest steps of reflectance on unbroken surfaces."""
    scale = max(float(np.median(light[light > 0])) if (light > 0).any() else 0.0, 1e-9)
    level = np.log(light + 0.3 * scale)
    smooth = same & (np.abs(np.diff(far)) < 0.02 * far[1:]) & (far[1:] < FARTHEST_M)
    strength = np.where(smooth, np.abs(np.diff(level)), 0.0)
    peak = strength.copy()
    peak[1:] = np.where(strength[1:] < strength[:-1], 0.0, peak[1:])
    peak[:-1] = np.where(strength[:-1] <= strength[1:], 0.0, peak[:-1])
    count = int(PAINT_SHARE * len(light))
    best = np.argsort(-peak, kind="stable")[:count]
    best = best[peak[best] > 0.2]
    return np.asarray(middle[best] * (0.5 * (far[best] + far[best + 1]))[:, None])


def _own_rings(cloud: Floats, distance: Floats) -> tuple[NDArray[np.intp], NDArray[np.int64]]:
    """A cloud without rings seen as a range image, about as fine as its density bears.

    Returns:
        (K,) the nearest point of each cell, and its (K,) row.
    """
    elevation = np.arctan2(cloud[:, 2], np.hypot(cloud[:, 0], cloud[:, 1]))
    azimuth = np.arctan2(cloud[:, 1], cloud[:, 0])
    seen = len(np.unique(np.floor(np.stack([azimuth, elevation], 1) / COARSE_CELL), axis=0))
    # Two points a cell on average: few cells stay empty.
    cell = max(COARSE_CELL * float(np.sqrt(2.0 * seen / len(cloud))), FINEST_CELL)
    row = np.floor((elevation + np.pi) / cell).astype(np.int64)
    place = row * (1 << 20) + np.floor((azimuth + np.pi) / cell).astype(np.int64)
    order = np.lexsort((distance, place))
    first = np.r_[True, np.diff(place[order]) != 0]
    chosen = order[first]
    return chosen, row[chosen]


@dataclass(frozen=True, eq=False)
class EdgeFields:
    """Distances to the image's edges, their local mean taken away, at each truncation.

    Args:
        fields: (len(TRUNCATIONS), h, w) float32, below 0 near an edge that stands alone.
    """

    fields: Floats


def edge_fields(image: NidImage) -> EdgeFields:
    """Distance fields of one image at the resolution of the registration."""
    distance = edge_distance(image.grey, image.focal)
    fields = [without_clutter(distance, t * image.focal, image.focal) for t in TRUNCATIONS]
    return EdgeFields(np.ascontiguousarray(fields, np.float32))


def edge_distance(grey: NDArray[np.uint8], focal: float) -> Floats:
    """(H, W) pixels to the next edge that is not horizontal.

    Args:
        grey: (H, W).
        focal: Pixels a radian.
    """
    import cv2

    smooth = cv2.GaussianBlur(grey, (0, 0), max(0.0012 * focal, 0.5))
    gx, gy = (cv2.Sobel(smooth, cv2.CV_16S, dx, 1 - dx) for dx in (1, 0))
    high = float(np.percentile(np.abs(gx) + np.abs(gy), 92))
    edges = cv2.Canny(gx, gy, 0.4 * high, max(high, 20.0))
    edges[np.abs(gx) < 0.4 * np.abs(gy)] = 0
    return np.asarray(cv2.distanceTransform(255 - edges, cv2.DIST_L2, 5))


def without_clutter(distance: Floats, truncation: float, focal: float) -> Floats:
    """Distances as shares of a truncation, cut off there, less their mean over a box around.

    Args:
        distance: (H, W) pixels.
        truncation: Pixels.
        focal: Pixels a radian.
    """
    import cv2

    box = max(3, round(CLUTTER * focal))
    cut = np.minimum(distance, np.float32(truncation)) / np.float32(truncation)
    return np.asarray(cut - cv2.blur(cut, (box, box), borderType=cv2.BORDER_REFLECT))


@njit(cache=True, nogil=True, fastmath=FAST, error_model="numpy")
def edge_costs(model, parameters, poses, points, weights, fields, levels, costs):  # type: ignore[no-untyped-def]
    """Add the weighted sums of fields at the projected points to the costs of many poses.

    Args:
        model: Number of the camera model.
        parameters: Its parameters, for this image's size.
        poses: (P, 12) R row by row, then t, of `T_camera_lidar`.
        points: (N, 3) float32 in the LiDAR frame, metres.
        weights: (N,) float32.
        fields: (F, h, w) float32.
        levels: (L,) which of the fields count.
        costs: (P,) added to.
    """
    height, width = fields.shape[1:]
    block, place = np.zeros(BLOCK_ROWS * BLOCK), np.empty(BLOCK, np.int32)
    for k in range(poses.shape[0]):
        total = 0.0
        for start in range(0, points.shape[0], BLOCK):
            size = min(BLOCK, points.shape[0] - start)
            move(poses[k], points[start : start + size], block)
            project_block(model, parameters, block)
            place_pixels(block, width, height, place)
            for level in levels:
                field = fields[level].reshape(-1)
                for j in range(size):
                    if place[j] >= 0:
                        total += weights[start + j] * field[np.uint32(place[j])]
        costs[k] += total


@njit(cache=True, nogil=True, fastmath=FAST, error_model="numpy")
def edge_gradient(  # type: ignore[no-untyped-def]
    model, parameters, pose, points, weights, fields, levels, groups, gradients
):
    """Weighted sum of fields, interpolated, at one pose, and its gradient.

    Args:
        model: Number of the camera model.
        parameters: Its parameters, for this image's size.
        pose: (12,) R row by row, then t, of `T_camera_lidar`.
        points: (N, 3) float32 in the LiDAR frame, metres.
        weights: (N,) float32.
        fields: (F, h, w) float32.
        levels: (L,) which of the fields count.
        groups: (N,) uint8 row of `gradients` that a point's share goes to.
        gradients: (G, 6) by a left perturbation of the pose, translation then rotation; added to.

    Returns:
        The sum.
    """
    height, width = fields.shape[1:]
    block = np.zeros(BLOCK_ROWS * BLOCK)
    total = 0.0
    for start in range(0, points.shape[0], BLOCK):
        size = min(BLOCK, points.shape[0] - start)
        move(pose, points[start : start + size], block)
        project_block_jacobian(model, parameters, block)
        for j in range(size):
            u, v = block[3 * BLOCK + j], block[4 * BLOCK + j]
            if not (u > 0.0 and v > 0.0 and u < width - 1.0 and v < height - 1.0):
                continue
            column, row = np.int32(u), np.int32(v)
            fu, fv = u - column, v - row
            value, du, dv = 0.0, 0.0, 0.0
            for level in levels:
                field = fields[level]
                i00, i01 = np.float64(field[row, column]), np.float64(field[row, column + 1])
                i10, i11 = (
                    np.float64(field[row + 1, column]),
                    np.float64(field[row + 1, column + 1]),
                )
                top, low = i00 + fu * (i01 - i00), i10 + fu * (i11 - i10)
                value += top + fv * (low - top)
                du += (i01 - i00) + fv * ((i11 - i10) - (i01 - i00))
                dv += low - top
            weight = np.float64(weights[start + j])
            total += weight * value
            du, dv = weight * du, weight * dv
            gx = du * block[5 * BLOCK + j] + dv * block[8 * BLOCK + j]
            gy = du * block[6 * BLOCK + j] + dv * block[9 * BLOCK + j]
            gz = du * block[7 * BLOCK + j] + dv * block[10 * BLOCK + j]
            px, py, pz = block[j], block[BLOCK + j], block[2 * BLOCK + j]
            g = groups[start + j]
            gradients[g, 0] += gx
            gradients[g, 1] += gy
            gradients[g, 2] += gz
            gradients[g, 3] += py * gz - pz * gy
            gradients[g, 4] += pz * gx - px * gz
            gradients[g, 5] += px * gy - py * gx
    return total
