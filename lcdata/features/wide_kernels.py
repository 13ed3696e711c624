"""Look-ups of many poses in label maps and edge fields, compiled.

Each kernel takes one frame and many poses: project all points, then look up, pose after pose.
Points are projected eight at a time in single precision.
Maps have a border of one cell that stands for everything outside, so that no look-up asks whether
a point is inside. numba kernels: import this module only where it is used.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from lcdata.features.wide_projection import NEAREST, pixels
from lcdata.geometry.camera_formulas import PINHOLE
from lcdata.geometry.camera_kernels import FAST


@njit(cache=True, nogil=True, fastmath=FAST, error_model="numpy")
def locate(model, parameters, pose, points, scale, height, width, cells):  # type: ignore[no-untyped-def]
    """Cell of each point in a map with a border; 0 (a corner of the border) behind the camera.

    Args:
        model: Number of the camera model.
        parameters: (COUNT,) float64 of the camera model.
        pose: (12,) float32 R row by row, then t, of `T_camera_lidar`.
        points: (3, N) float32 in the LiDAR frame, metres.
        scale: Cells a pixel, float32.
        height: Rows of the map, border included.
        width: Columns of the map, border included.
        cells: (N,) int32, written: row * width + column.
    """
    r00, r01, r02, r10, r11, r12, r20, r21, r22, tx, ty, tz = pose
    half, one, zero = np.float32(0.5), np.float32(1.0), np.float32(0.0)
    right, bottom = np.float32(width - 1), np.float32(height - 1)
    n = points.shape[1]
    xs, ys, zs = points[0], points[1], points[2]
    if model == PINHOLE:
        fx, fy = np.float32(parameters[0]) * scale, np.float32(parameters[1]) * scale
        cx = (np.float32(parameters[2]) + half) * scale + one
        cy = (np.float32(parameters[3]) + half) * scale + one
        for i in range(n):
            x, y, z = xs[i], ys[i], zs[i]
            depth = r20 * x + r21 * y + r22 * z + tz
            front = depth > NEAREST
            inverse = one / (depth if front else one)
            u = fx * (r00 * x + r01 * y + r02 * z + tx) * inverse + cx
            v = fy * (r10 * x + r11 * y + r12 * z + ty) * inverse + cy
            u = u if u > zero else zero
            v = v if v > zero else zero
            u = u if u < right else right
            v = v if v < bottom else bottom
            cell = np.int32(v) * np.int32(width) + np.int32(u)
            cells[i] = cell if front else np.int32(0)
    else:
        us, vs = np.empty(n, np.float32), np.empty(n, np.float32)
        pixels(model, parameters, pose, points, us, vs)
        shift = half * scale + one
        for i in range(n):
            u, v = us[i] * scale + shift, vs[i] * scale + shift
            u = u if u > zero else zero
            v = v if v > zero else zero
            u = u if u < right else right
            v = v if v < bottom else bottom
            cells[i] = np.int32(v) * np.int32(width) + np.int32(u)


@njit(cache=True, nogil=True, fastmath=FAST, error_model="numpy")
def count(model, parameters, poses, points, classes, labels, scale, counts):  # type: ignore[no-untyped-def]
    """Add one frame's joint histograms of point classes and pixel labels.

    Args:
        model: Number of the camera model.
        parameters: (COUNT,) float64 of the camera model.
        poses: (P, 12) float32.
        points: (3, N) float32 in the LiDAR frame, metres.
        classes: (N,) uint8.
        labels: (h, w) uint8 with the border; the border's label is the largest.
        scale: Cells of the map a pixel, float32.
        counts: (P, A, B) int32, classes by labels, the last column outside; added to.
    """
    height, width = labels.shape
    flat = labels.reshape(-1)
    n, columns = points.shape[1], counts.shape[2]
    cells = np.empty(n, np.int32)
    rows = np.empty(n, np.uint32)
    # Two tables in turn: neighbours often share a cell, and would wait for each other.
    size = counts.shape[1] * columns
    table = np.zeros(2 * size, np.int32)
    for i in range(n):
        rows[i] = (i & 1) * size + classes[i] * columns
    for k in range(poses.shape[0]):
        locate(model, parameters, poses[k], points, scale, height, width, cells)
        table[:] = 0
        for i in range(n):
            table[rows[i] + np.uint32(flat[np.uint32(cells[i])])] += 1
        line = counts[k].reshape(-1)
        for j in range(size):
            line[j] += table[j] + table[size + j]


@njit(cache=True, nogil=True, fastmath=FAST, error_model="numpy")
def field_sums(model, parameters, poses, points, weights, field, scale, sums):  # type: ignore[no-untyped-def]
    """Add the weighted sums of a field at one frame's points.

    Args:
        model: Number of the camera model.
        parameters: (COUNT,) float64 of the camera model.
        poses: (P, 12) float32.
        points: (3, N) float32 in the LiDAR frame, metres.
        weights: (N,) float32.
        field: (h, w) float32 with a border of zeros.
        scale: Cells of the field a pixel, float32.
        sums: (P,) float64, added to.
    """
    height, width = field.shape
    flat = field.reshape(-1)
    n = points.shape[1]
    cells = np.empty(n, np.int32)
    for k in range(poses.shape[0]):
        locate(model, parameters, poses[k], points, scale, height, width, cells)
        total = np.float32(0.0)
        for i in range(n):
            total += weights[i] * flat[np.uint32(cells[i])]
        sums[k] += total


@njit(cache=True, nogil=True, error_model="numpy")
def information(counts, logs, shared, joint, inside):  # type: ignore[no-untyped-def]
    """Mutual information and joint entropy of histograms, over the points inside.

    Args:
        counts: (P, A, B) int32; the last column is outside.
        logs: (N + 1,) float64: n log n of every count that can occur.
        shared: (P,) float64, written: I(A; B), nats.
        joint: (P,) float64, written: H(A, B), nats.
        inside: (P,) float64, written: share of the points inside.
    """
    poses, rows, columns = counts.shape
    across = np.empty(columns, np.int64)
    for k in range(poses):
        across[:] = 0
        both, down, total = 0.0, 0.0, 0
        for a in range(rows):
            row = 0
            for b in range(columns - 1):
                c = counts[k, a, b]
                if c:
                    row += c
                    across[b] += c
                    both += logs[c]
            down += logs[row]
            total += row
        outside = 0
        for a in range(rows):
            outside += counts[k, a, columns - 1]
        inside[k] = total / max(total + outside, 1)
        shared[k], joint[k] = 0.0, 0.0
        if total == 0:
            continue
        side = 0.0
        for b in range(columns - 1):
            side += logs[across[b]]
        joint[k] = (logs[total] - both) / total
        shared[k] = (logs[total] + both - down - side) / total
