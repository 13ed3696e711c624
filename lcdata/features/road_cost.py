r"""How well lane and pole points fall onto their masks (Ma et al. 2021, *CRLF*, eq. 8 and 9).

Eq. (8) is put right: as printed, heights of mask pixels fall from the border inwards, and points
would gather along borders. Here

    H(q) = 1 - g0^d(q, R^2 \ Q) / 2    in the mask Q,
    H(q) = g1^d(q, Q) / 2               elsewhere,

with the paper's city-block distances d: it rises from 0 far away to 1/2 at the border and to 1
deep in the mask. Eq. (9) is printed without its sums' end: J is the sum over lanes and poles of
the mean height of their points; one that is not in the image has height 0. numba kernels: import
this module only where it is used.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]
Floats = NDArray[np.float32]
Mask = NDArray[np.bool_]

GAMMA0, GAMMA1 = 0.7, 0.97
"""Factors a pixel at 1000 pixels a radian, inside and outside: the paper does not say its own."""

NEAR = 0.1
"""Points closer to the camera's plane are behind it, metres."""


def height_map(mask: Mask, gamma0: float = GAMMA0, gamma1: float = GAMMA1) -> Floats:
    """Eq. (8).

    Args:
        mask: (h, w), some of it true and some false.
        gamma0: Factor a pixel inside.
        gamma1: Factor a pixel outside.

    Returns:
        (h, w) heights, 0..1.
    """
    import cv2

    inside, outside = mask.astype(np.uint8), (~mask).astype(np.uint8)
    deep = cv2.distanceTransform(inside, cv2.DIST_L1, 3)
    far = cv2.distanceTransform(outside, cv2.DIST_L1, 3)
    # City-block distances are whole numbers.
    steps = np.arange(sum(mask.shape) + 2)
    table = np.concatenate([0.5 * gamma1 ** steps[:0:-1], 1.0 - 0.5 * gamma0**steps])
    result = np.empty(mask.shape, np.float32)
    tabulate(deep, far, table.astype(np.float32), 1.0, 0.0, result)
    return result


@njit(cache=True, nogil=True)
def tabulate(deep, far, table, steps, shift, result):  # type: ignore[no-untyped-def]
    """A table's values by the signed distance of each pixel to a mask's border.

    Args:
        deep: (h, w) distances to the outside, 0 there, pixels.
        far: (h, w) distances to the inside, 0 there.
        table: (2 n + 1,) float32 values, the border's in the middle; its ends go on.
        steps: Entries a pixel.
        shift: Pixels by which the border is nearer from either side.
        result: (h, w) float32, where the values go.
    """
    middle = len(table) // 2
    for row in range(deep.shape[0]):
        for column in range(deep.shape[1]):
            inside = deep[row, column]
            depth = inside - shift if inside > 0.0 else shift - far[row, column]
            index = int(depth * steps + middle)
            result[row, column] = table[max(0, min(index, len(table) - 1))]


def flat_poses(T: Array) -> Array:
    """(P, 12) rotation row by row, then translation, of (P, 4, 4) or of one 4x4."""
    T = np.asarray(T, float).reshape(-1, 4, 4)
    return np.concatenate([T[:, :3, :3].reshape(-1, 9), T[:, :3, 3]], 1)


@njit(cache=True, nogil=True, inline="always")
def height_at(pose, x, y, z, table, intrinsics):  # type: ignore[no-untyped-def]
    """Height under one point; 0 outside the image."""
    cz = pose[6] * x + pose[7] * y + pose[8] * z + pose[11]
    if cz < NEAR:
        return 0.0
    cx = pose[0] * x + pose[1] * y + pose[2] * z + pose[9]
    cy = pose[3] * x + pose[4] * y + pose[5] * z + pose[10]
    u = intrinsics[0] * cx / cz + intrinsics[2] + 0.5
    v = intrinsics[1] * cy / cz + intrinsics[3] + 0.5
    if u < 0.0 or v < 0.0 or u >= table.shape[1] or v >= table.shape[0]:
        return 0.0
    return table[int(v), int(u)]


@njit(cache=True, nogil=True)
def mean_height(pose, points, table, intrinsics, least):  # type: ignore[no-untyped-def]
    """Mean height of (N, 3) points for one (12,) pose; -1 as soon as it cannot exceed `least`."""
    total, count = 0.0, len(points)
    for i in range(count):
        # No height is above 1.
        if total + (count - i) <= least * count:
            return -1.0
        total += height_at(pose, points[i, 0], points[i, 1], points[i, 2], table, intrinsics)
    return total / max(count, 1)


@njit(cache=True, nogil=True)
def heights(poses, points, table, intrinsics):  # type: ignore[no-untyped-def]
    """Mean heights of (N, 3) points for (P, 12) poses: (P,)."""
    result = np.empty(len(poses))
    for k in range(len(poses)):
        result[k] = mean_height(poses[k], points, table, intrinsics, -1.0)
    return result


@njit(cache=True, nogil=True, fastmath=True, error_model="numpy")
def class_means(poses, points, start, maps, place, shape, intrinsics, road, step):  # type: ignore[no-untyped-def]
    """Mean of the maps under the lanes, the road and the poles of every pair, between pixels.

    Args:
        poses: (P, 12).
        points: See `road_view.Stack`, as the rest.
        start: (V, 4).
        maps: (M,) one kind.
        place: (V, 2).
        shape: (V, 2).
        intrinsics: (V, 4).
        road: Whether the road's points are looked at.
        step: Every so many points count.

    Returns:
        (P, V, 3); 0 of no points.
    """
    result = np.zeros((len(poses), len(start), 3))
    for k in range(len(poses)):
        r00, r01, r02, r10, r11, r12, r20, r21, r22, tx, ty, tz = poses[k]
        for v in range(len(start)):
            fx, fy, cx, cy = intrinsics[v]
            width = shape[v, 1]
            right, bottom = float(width - 1), float(shape[v, 0] - 1)
            for kind in range(3):
                if kind == 1 and not road:
                    continue
                first = place[v, 1 if kind == 2 else 0]
                begin, end = start[v, kind], start[v, kind + 1]
                total = 0.0
                for i in range(begin, end, step):
                    x, y, z = points[i, 0], points[i, 1], points[i, 2]
                    c = r20 * x + r21 * y + r22 * z + tz
                    if c < NEAR:
                        continue
                    c = 1.0 / c
                    a = fx * (r00 * x + r01 * y + r02 * z + tx) * c + cx
                    b = fy * (r10 * x + r11 * y + r12 * z + ty) * c + cy
                    if a < 0.0 or b < 0.0 or a >= right or b >= bottom:
                        continue
                    column, row = int(a), int(b)
                    a -= column
                    b -= row
                    j = np.uint64(first + row * width + column)
                    m = np.uint64(first + (row + 1) * width + column)
                    one = np.uint64(1)
                    low = maps[j] + a * (maps[j + one] - maps[j])
                    total += low + b * (maps[m] + a * (maps[m + one] - maps[m]) - low)
                if end > begin:
                    result[k, v, kind] = total / ((end - begin + step - 1) // step)
    return result


@njit(cache=True, nogil=True, error_model="numpy")
def group_slopes(  # type: ignore[no-untyped-def]
    pose, points, start, maps, place, shape, intrinsics, shares, group, gradients
):
    """Add the derivatives of a weighted sum of map values to those of the points' groups.

    Args:
        pose: (12,).
        points: See `class_means`, as the rest.
        start: (V, 4).
        maps: (M,) one kind.
        place: (V, 2).
        shape: (V, 2).
        intrinsics: (V, 4).
        shares: (V, 3) what the mean over lanes, road and poles of each pair counts.
        group: (N,) group of each point.
        gradients: (G, 6) by a left perturbation of the pose: metres, then radians; added to.
    """
    r00, r01, r02, r10, r11, r12, r20, r21, r22, tx, ty, tz = pose
    for v in range(len(start)):
        fx, fy, cx, cy = intrinsics[v]
        width = shape[v, 1]
        right, bottom = float(width - 1), float(shape[v, 0] - 1)
        for kind in range(3):
            first = place[v, 1 if kind == 2 else 0]
            begin, end = start[v, kind], start[v, kind + 1]
            if end == begin or shares[v, kind] == 0.0:
                continue
            share = shares[v, kind] / (end - begin)
            for i in range(begin, end):
                px, py, pz = points[i, 0], points[i, 1], points[i, 2]
                z = r20 * px + r21 * py + r22 * pz + tz
                if z < NEAR:
                    continue
                x = r00 * px + r01 * py + r02 * pz + tx
                y = r10 * px + r11 * py + r12 * pz + ty
                u, w = fx * x / z + cx, fy * y / z + cy
                if u < 0.0 or w < 0.0 or u >= right or w >= bottom:
                    continue
                column, row = int(u), int(w)
                a, b = u - column, w - row
                j = first + row * width + column
                m = j + width
                su = (1.0 - b) * (maps[j + 1] - maps[j]) + b * (maps[m + 1] - maps[m])
                sw = (1.0 - a) * (maps[m] - maps[j]) + a * (maps[m + 1] - maps[j + 1])
                gx, gy = share * su * fx / z, share * sw * fy / z
                gz = -(gx * x + gy * y) / z
                g = gradients[group[i]]
                g[0] += gx
                g[1] += gy
                g[2] += gz
                g[3] += y * gz - z * gy
                g[4] += z * gx - x * gz
                g[5] += x * gy - y * gx


@njit(cache=True, nogil=True)
def map_values(pose, points, start, maps, place, shape, intrinsics):  # type: ignore[no-untyped-def]
    """(N,) value of the nearest pixel of a map under each point of all pairs."""
    values = np.zeros(len(points))
    for v in range(len(start)):
        for i in range(start[v, 0], start[v, 3]):
            x, y, z = points[i]
            c = pose[6] * x + pose[7] * y + pose[8] * z + pose[11]
            if c < NEAR:
                continue
            a = intrinsics[v, 0] * (pose[0] * x + pose[1] * y + pose[2] * z + pose[9]) / c
            b = intrinsics[v, 1] * (pose[3] * x + pose[4] * y + pose[5] * z + pose[10]) / c
            a += intrinsics[v, 2] + 0.5
            b += intrinsics[v, 3] + 0.5
            if 0.0 <= a < shape[v, 1] and 0.0 <= b < shape[v, 0]:
                first = place[v, 1 if i >= start[v, 2] else 0]
                values[i] = maps[first + int(b) * shape[v, 1] + int(a)]
    return values


@njit(cache=True, nogil=True)
def random_search(  # type: ignore[no-untyped-def]
    pose, points, start, maps, place, shape, intrinsics, metres, radians, settings, seed
):
    """Algorithm 1: random steps around the best pose so far, ever shorter.

    Args:
        pose: (12,) where to start.
        points: See `class_means`, as the rest.
        start: (V, 4).
        maps: (M,) heights.
        place: (V, 2).
        shape: (V, 2).
        intrinsics: (V, 4).
        metres: t0, half width of the step along each axis.
        radians: theta0, largest angle of the step about a random axis.
        settings: Initial step size, its lower bound, search count, decay factor.
        seed: Of the steps.

    Returns:
        (12,) the pose with the largest J.
    """
    np.random.seed(seed)  # noqa: NPY002 - numba has no other
    best = pose.copy()
    trial = np.empty((1, 12))
    trial[0] = best
    step, least, count, decay = settings
    most = _total(class_means(trial, points, start, maps, place, shape, intrinsics, False, 1))
    axis = np.empty(3)
    while step >= least * (1.0 - 1e-9):
        for _ in range(int(count)):
            angle = step * np.random.uniform(-radians, radians)  # noqa: NPY002
            for k in range(3):
                axis[k] = np.random.normal()  # noqa: NPY002
            axis /= np.sqrt(axis @ axis)
            s, c = np.sin(angle), 1.0 - np.cos(angle)
            x, y, z = axis
            turn = np.array(
                [
                    [1.0 - c * (y * y + z * z), c * x * y - s * z, c * x * z + s * y],
                    [c * x * y + s * z, 1.0 - c * (x * x + z * z), c * y * z - s * x],
                    [c * x * z - s * y, c * y * z + s * x, 1.0 - c * (x * x + y * y)],
                ]
            )
            for i in range(3):
                for j in range(3):
                    trial[0, 3 * i + j] = (
                        turn[i, 0] * best[j] + turn[i, 1] * best[3 + j] + turn[i, 2] * best[6 + j]
                    )
                move = step * np.random.uniform(-metres, metres)  # noqa: NPY002
                trial[0, 9 + i] = best[9 + i] + move
            value = _total(
                class_means(trial, points, start, maps, place, shape, intrinsics, False, 1)
            )
            if value > most:
                most = value
                best[:] = trial[0]
        step *= decay
    return best


@njit(cache=True, nogil=True)
def _total(means):  # type: ignore[no-untyped-def]
    """J of eq. (9), the mean over pairs."""
    total = 0.0
    for v in range(means.shape[1]):
        total += means[0, v, 0] + means[0, v, 2]
    return total / means.shape[1]
