"""Histograms of LiDAR and image intensities at a pose, hard and soft, compiled.

Everything is one pass over the points: transform, project by any camera model, look up, count.
The soft histogram's second pass turns the slopes of a cost with respect to the counts into its
gradient with respect to the pose. numba kernels: import this module only where it is used.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from lcdata.geometry.camera_kernels import (
    BLOCK,
    BLOCK_ROWS,
    FAST,
    project_block,
    project_block_jacobian,
)

BINS = 16


@njit(cache=True, nogil=True, fastmath=FAST, error_model="numpy")
def move(pose, points, block):  # type: ignore[no-untyped-def]
    """Fill the first rows of a block with points in the camera frame."""
    r00, r01, r02, r10, r11, r12, r20, r21, r22, tx, ty, tz = pose
    for j in range(points.shape[0]):
        x, y, z = np.float64(points[j, 0]), np.float64(points[j, 1]), np.float64(points[j, 2])
        block[j] = r00 * x + r01 * y + r02 * z + tx
        block[BLOCK + j] = r10 * x + r11 * y + r12 * z + ty
        block[2 * BLOCK + j] = r20 * x + r21 * y + r22 * z + tz


@njit(cache=True, nogil=True, fastmath=FAST, error_model="numpy")
def place_pixels(block, width, height, place):  # type: ignore[no-untyped-def]
    """Where in a flat image the nearest pixels of a projected block are; -1 outside."""
    right, bottom = width - 0.5, height - 0.5
    for j in range(BLOCK):
        u, v = block[3 * BLOCK + j], block[4 * BLOCK + j]
        ok = (u >= -0.5) & (v >= -0.5) & (u < right) & (v < bottom)
        pixel = np.int32((v if ok else 0.0) + 0.5) * np.int32(width)
        pixel += np.int32((u if ok else 0.0) + 0.5)
        place[j] = pixel if ok else np.int32(-1)


@njit(cache=True, nogil=True, fastmath=FAST, error_model="numpy")
def count_hard(model, parameters, poses, points, bins, image, counts):  # type: ignore[no-untyped-def]
    """Add to the joint histograms of many poses on one image.

    Args:
        model: Number of the camera model.
        parameters: Its parameters, for this image's size.
        poses: (P, 12) R row by row, then t, of `T_camera_lidar`.
        points: (N, 3) float32 in the LiDAR frame, metres.
        bins: (N,) uint8 bin of each point's intensity, below `BINS`.
        image: (h, w) uint8 bin of each pixel, below `BINS`.
        counts: (P, BINS, BINS) int32, LiDAR by image; added to.
    """
    height, width = image.shape
    pixels = image.reshape(-1)
    count = points.shape[0]
    across, down = points[:, 0].astype(np.float64), points[:, 1].astype(np.float64)
    ahead = points[:, 2].astype(np.float64)
    block, place = np.zeros(BLOCK_ROWS * BLOCK), np.empty(BLOCK, np.int32)
    # Two tables in turn: neighbouring points often share a cell, and would wait for each other.
    table = np.zeros(2 * BINS * BINS, np.int32)
    for k in range(poses.shape[0]):
        r00, r01, r02, r10, r11, r12, r20, r21, r22, tx, ty, tz = poses[k]
        table[:] = 0
        for start in range(0, count, BLOCK):
            size = min(BLOCK, count - start)
            for j in range(size):
                x, y, z = across[start + j], down[start + j], ahead[start + j]
                block[j] = r00 * x + r01 * y + r02 * z + tx
                block[BLOCK + j] = r10 * x + r11 * y + r12 * z + ty
                block[2 * BLOCK + j] = r20 * x + r21 * y + r22 * z + tz
            project_block(model, parameters, block)
            place_pixels(block, width, height, place)
            for j in range(size):
                if place[j] >= 0:
                    row = (j & 1) * BINS + bins[start + j]
                    table[np.uint32(row * BINS + pixels[np.uint32(place[j])])] += 1
        for a in range(BINS):
            for b in range(BINS):
                counts[k, a, b] += table[a * BINS + b] + table[(BINS + a) * BINS + b]


@njit(cache=True, nogil=True, fastmath=FAST, error_model="numpy", forceinline=True)
def _fade(u, v, right, bottom, border):  # type: ignore[no-untyped-def]
    """Weight of a point in the strip along the image's border, and its slopes by the pixel."""
    weight, wu, wv = 1.0, 0.0, 0.0
    gap_u, gap_v = min(u, right - u), min(v, bottom - v)
    if gap_u < border:
        weight = gap_u / border
        wu = (1.0 if u == gap_u else -1.0) / border
    if gap_v < border:
        wu *= gap_v / border
        wv = weight * (1.0 if v == gap_v else -1.0) / border
        weight *= gap_v / border
    return weight, wu, wv


@njit(cache=True, nogil=True, fastmath=FAST, error_model="numpy")
def count_soft(model, parameters, pose, points, bins, image, border, counts, kept):  # type: ignore[no-untyped-def]
    """Add to the soft joint histogram of one pose, and keep what its gradient needs.

    The image's bins are soft: the interpolated intensity is spread over four bins by a cubic
    B-spline. The LiDAR's are hard: a point's own intensity does not depend on the pose. Near the
    image's border a point counts less, so that leaving it is smooth.

    Args:
        model: Number of the camera model.
        parameters: Its parameters, for this image's size.
        pose: (12,) R row by row, then t, of `T_camera_lidar`.
        points: (N, 3) float32 in the LiDAR frame, metres.
        bins: (N,) uint8 bin of each point's intensity, below `BINS`.
        image: (h, w) float32 intensity in units of bins, 0 .. BINS - 3.
        border: Width of the strip in which points fade, pixels.
        counts: (BINS, BINS) float64, LiDAR by image; added to.
        kept: (N, 11) float32: intensity, weight, point in the camera frame (3), slopes of
            the intensity (3) and of the weight (3) by the point; a weight of 0 is out of view.
    """
    height, width = image.shape
    pixels = image.reshape(-1)
    right, bottom = width - 1.0, height - 1.0
    block = np.zeros(BLOCK_ROWS * BLOCK)
    table = np.zeros(2 * BINS * BINS)
    for start in range(0, points.shape[0], BLOCK):
        size = min(BLOCK, points.shape[0] - start)
        move(pose, points[start : start + size], block)
        project_block_jacobian(model, parameters, block)
        for j in range(size):
            i = start + j
            u, v = block[3 * BLOCK + j], block[4 * BLOCK + j]
            kept[i, 1] = 0.0
            if not (u > 0.0 and v > 0.0 and u < right and v < bottom):
                continue
            column, row = np.int32(u), np.int32(v)
            fu, fv = u - column, v - row
            # Unsigned: indices that might be negative would be tested at every access.
            here = np.uint32(row * np.int32(width) + column)
            below = np.uint32(here + np.uint32(width))
            i00, i01 = np.float64(pixels[here]), np.float64(pixels[here + np.uint32(1)])
            i10, i11 = np.float64(pixels[below]), np.float64(pixels[below + np.uint32(1)])
            top, low = i00 + fu * (i01 - i00), i10 + fu * (i11 - i10)
            value, dv = top + fv * (low - top), low - top
            du = (i01 - i00) + fv * ((i11 - i10) - (i01 - i00))
            weight, wu, wv = _fade(u, v, right, bottom, border)
            first: int = min(int(value), BINS - 4)
            t = value - first
            s = 1.0 - t
            cell = np.uint32(((j & 1) * BINS + bins[i]) * BINS + first)
            sixth = weight / 6.0
            t2, s2 = t * t, s * s
            table[cell] += sixth * s2 * s
            table[cell + np.uint32(1)] += sixth * (4.0 + t2 * (3.0 * t - 6.0))
            table[cell + np.uint32(2)] += sixth * (4.0 + s2 * (3.0 * s - 6.0))
            table[cell + np.uint32(3)] += sixth * t2 * t
            kept[i, 0], kept[i, 1] = value, weight
            kept[i, 2], kept[i, 3], kept[i, 4] = block[j], block[BLOCK + j], block[2 * BLOCK + j]
            ux, uy, uz = block[5 * BLOCK + j], block[6 * BLOCK + j], block[7 * BLOCK + j]
            vx, vy, vz = block[8 * BLOCK + j], block[9 * BLOCK + j], block[10 * BLOCK + j]
            kept[i, 5] = du * ux + dv * vx
            kept[i, 6] = du * uy + dv * vy
            kept[i, 7] = du * uz + dv * vz
            if wu != 0.0 or wv != 0.0:
                kept[i, 8] = wu * ux + wv * vx
                kept[i, 9] = wu * uy + wv * vy
                kept[i, 10] = wu * uz + wv * vz
            else:
                kept[i, 8] = kept[i, 9] = kept[i, 10] = 0.0
    for a in range(BINS):
        for b in range(BINS):
            counts[a, b] += table[a * BINS + b] + table[(BINS + a) * BINS + b]


@njit(cache=True, nogil=True, fastmath=FAST, error_model="numpy")
def soft_gradient(bins, kept, slopes, groups, gradients):  # type: ignore[no-untyped-def]
    """Add the points' shares of the gradient of a cost of `count_soft`'s counts.

    Args:
        bins: See `count_soft`.
        kept: See `count_soft`.
        slopes: (BINS, BINS) derivative of the cost by each count.
        groups: (N,) uint8 row of `gradients` that a point's share goes to.
        gradients: (G, 6) by a left perturbation of the pose, translation then rotation; added to.
    """
    steps = slopes.reshape(-1)
    for i in range(bins.shape[0]):
        weight = np.float64(kept[i, 1])
        if weight == 0.0:
            continue
        value = np.float64(kept[i, 0])
        first: int = min(int(value), BINS - 4)
        t = value - first
        s = 1.0 - t
        cell = np.uint32(bins[i] * BINS + first)
        d0, d1 = steps[cell], steps[cell + np.uint32(1)]
        d2, d3 = steps[cell + np.uint32(2)], steps[cell + np.uint32(3)]
        t2, s2 = t * t, s * s
        by_value = (
            0.5 * weight * (d3 * t2 - d0 * s2 + d1 * t * (3.0 * t - 4.0) - d2 * s * (3.0 * s - 4.0))
        )
        gx, gy, gz = by_value * kept[i, 5], by_value * kept[i, 6], by_value * kept[i, 7]
        if weight < 1.0:
            mean = d0 * s2 * s + d1 * (4.0 + t2 * (3.0 * t - 6.0))
            mean = (mean + d2 * (4.0 + s2 * (3.0 * s - 6.0)) + d3 * t2 * t) / 6.0
            gx += mean * kept[i, 8]
            gy += mean * kept[i, 9]
            gz += mean * kept[i, 10]
        px, py, pz = np.float64(kept[i, 2]), np.float64(kept[i, 3]), np.float64(kept[i, 4])
        g = groups[i]
        gradients[g, 0] += gx
        gradients[g, 1] += gy
        gradients[g, 2] += gz
        gradients[g, 3] += py * gz - pz * gy
        gradients[g, 4] += pz * gx - px * gz
        gradients[g, 5] += px * gy - py * gx
