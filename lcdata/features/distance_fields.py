"""Directional distance fields of image lines, and the chamfer cost of poses on them.

One field an orientation bin says how far a pixel is from the next image line of about that
orientation. A pose costs the mean over samples on the projected 3D segments. numba kernels:
import this module only where it is used.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from lcdata.geometry.camera import Camera

Array = NDArray[np.float64]

ORIENTATIONS = 18
"""Bins of 10 degrees."""

FIELDS = {60.0: 15.0, 20.0: 10.0, 8.0: 5.0, 4.0: 3.0}
"""Truncation distances in pixels at a focal length of 1000, coarse to fine, and the angles in
degrees that a line reaches beyond its own bin."""

OUTSIDE_COST = 0.7
"""Cost of a sample outside the image or behind the camera; 1 is that of one far from any line."""

FULL_LENGTH = 200.0
"""Projected length from which a line counts in full, pixels at a focal length of 1000.

A camera that backs off sees all lines, small and crowded, each near some image line or other: what
a line can prove is as much as the pixels that it covers."""

NEAR = 0.1
"""Points closer to the camera's plane than this are behind it, metres."""


@dataclass(frozen=True, eq=False)
class DistanceFields:
    """Truncated distances to the image lines.

    Args:
        table: (ORIENTATIONS, h, w) uint8; 255 stands for the truncation distance or more.
        stride: Pixels a cell.
        intrinsics: (4,) fx fy cx cy of the undistorted image, pixels.
    """

    table: NDArray[np.uint8]
    stride: float
    intrinsics: Array


def distance_fields(
    lines: Array, camera: Camera, truncation: float, angle_reach_deg: float
) -> DistanceFields:
    """Fields of one image at one resolution, a sixth of the truncation distance a cell.

    Args:
        lines: (M, 4) image lines, undistorted pixels.
        camera: Camera of the image; its distortion is ignored.
        truncation: Distance in pixels beyond which nothing is gained.
        angle_reach_deg: A line counts in bins up to so far beside its own; on the way its
            distance grows linearly to the truncation.
    """
    stride = max(1.0, float(round(truncation / 6.0)))
    shape = (int(np.ceil(camera.height / stride)), int(np.ceil(camera.width / stride)))
    table = np.full((ORIENTATIONS, *shape), 255, np.uint8)
    _splat(
        np.ascontiguousarray(lines, float), stride, truncation, np.deg2rad(angle_reach_deg), table
    )
    return DistanceFields(table, stride, np.array(camera.intrinsics))


@njit(cache=True)
def _splat(lines, stride, truncation, angle_reach, table):  # type: ignore[no-untyped-def]
    """Exact distances, written only around each line: cheaper than 18 distance transforms."""
    bins, height, width = table.shape
    for i in range(lines.shape[0]):
        x1, y1, x2, y2 = lines[i]
        dx, dy = x2 - x1, y2 - y1
        length = np.sqrt(dx * dx + dy * dy)
        if length < 1e-6:
            continue
        dx, dy = dx / length, dy / length
        angle = np.arctan2(dy, dx) % np.pi
        for b in range(bins):
            away = abs(angle - (b + 0.5) * np.pi / bins)
            away = max(min(away, np.pi - away) - 0.5 * np.pi / bins, 0.0)
            base = truncation * away / angle_reach
            reach = truncation - base
            if reach <= 0.0:
                continue
            low = max(0, int(np.floor((min(y1, y2) - reach + 0.5) / stride - 0.5)))
            high = min(height - 1, int(np.ceil((max(y1, y2) + reach + 0.5) / stride - 0.5)))
            for row in range(low, high + 1):
                y = (row + 0.5) * stride - 0.5 - y1
                left, right = min(x1, x2) - reach, max(x1, x2) + reach
                if abs(dy) > 1e-9:
                    # |dx y - dy x| <= reach bounds x in this row.
                    a, c = (dx * y - reach) / dy, (dx * y + reach) / dy
                    left, right = max(left, x1 + min(a, c)), min(right, x1 + max(a, c))
                first = max(0, int(np.floor((left + 0.5) / stride - 0.5)))
                last = min(width - 1, int(np.ceil((right + 0.5) / stride - 0.5)))
                for column in range(first, last + 1):
                    x = (column + 0.5) * stride - 0.5 - x1
                    along = min(max(x * dx + y * dy, 0.0), length)
                    ex, ey = x - along * dx, y - along * dy
                    value = 255.0 * (base + np.sqrt(ex * ex + ey * ey)) / truncation
                    if value < table[b, row, column]:
                        table[b, row, column] = np.uint8(value)


@njit(cache=True, fastmath={"contract", "arcp", "reassoc"}, error_model="numpy")
def chamfer(  # type: ignore[no-untyped-def]
    poses, segments, weights, samples, table, stride, intrinsics, costs
):
    """Add the chamfer costs of many poses on one image to `costs`.

    Args:
        poses: (P, 12) R row by row, then p, of `T_camera_lidar`.
        segments: (M, 2, 3) in the LiDAR frame, metres.
        weights: (M,) what a segment counts; of all images together they sum to 1.
        samples: Points looked up on each segment.
        table: See `DistanceFields`.
        stride: See `DistanceFields`.
        intrinsics: (4,) fx fy cx cy, pixels.
        costs: (P,) in 0..1, added to.
    """
    bins, height, width = table.shape
    flat = table.reshape(-1)
    # From here on the unit of the image is a cell.
    fx, fy = intrinsics[0] / stride, intrinsics[1] / stride
    cx, cy = (intrinsics[2] + 0.5) / stride, (intrinsics[3] + 0.5) / stride
    right, bottom = width - cx, height - cy
    full = FULL_LENGTH * np.sqrt(fx * fy) / 1000.0
    for k in range(poses.shape[0]):
        r00, r01, r02, r10, r11, r12, r20, r21, r22, px, py, pz = poses[k]
        cost = 0.0
        for m in range(segments.shape[0]):
            x, y, z = segments[m, 0]
            ax = fx * (r00 * x + r01 * y + r02 * z + px)
            ay = fy * (r10 * x + r11 * y + r12 * z + py)
            az = r20 * x + r21 * y + r22 * z + pz
            x, y, z = segments[m, 1]
            bx = fx * (r00 * x + r01 * y + r02 * z + px)
            by = fy * (r10 * x + r11 * y + r12 * z + py)
            bz = r20 * x + r21 * y + r22 * z + pz
            if (
                (az < NEAR and bz < NEAR)
                or (ax < -cx * az and bx < -cx * bz)
                or (ay < -cy * az and by < -cy * bz)
                or (ax > right * az and bx > right * bz)
                or (ay > bottom * az and by > bottom * bz)
            ):
                cost += OUTSIDE_COST * weights[m]
                continue
            vx, vy, vz = bx - ax, by - ay, bz - az
            counts = 1.0
            if az > NEAR and bz > NEAR:
                du, dv = bx / bz - ax / az, by / bz - ay / az
                counts = min(1.0, np.sqrt(du * du + dv * dv) / full)
            # Direction of the projected line l = K_l (a x v): (-l2, l1).
            angle = np.arctan2(ay * vz - az * vy, ax * vz - az * vx)
            offset = int(angle * (bins / np.pi) + bins) % bins * height * width
            total = 0
            outside = 0
            for i in range(samples):
                t = (i + 0.5) / samples
                z = az + t * vz
                inverse = 1.0 / z
                u = (ax + t * vx) * inverse + cx
                v = (ay + t * vy) * inverse + cy
                if z >= NEAR and u >= 0.0 and v >= 0.0 and u < width and v < height:
                    total += flat[np.uint64(offset + int(v) * width + int(u))]
                else:
                    outside += 1
            inside = (total * (1.0 / 255.0) + OUTSIDE_COST * outside) / samples
            cost += weights[m] * (counts * inside + (1.0 - counts) * OUTSIDE_COST)
        costs[k] += cost
