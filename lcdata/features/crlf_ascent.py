"""The top of CRLF's agreement near a pose, by BFGS in one compiled piece.

The verdict of a pose climbs a dozen times from other places and with other points; with a general
minimiser four fifths of the time are calls. numba kernels: import this module only where it is
used.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from lcdata.features.nid_search import UNIT
from lcdata.features.road_cost import NEAR

LEAST_VARIANCE = 1e-4
"""Floor of the variance of a map over the ground, where the correlation would have none."""

METRES, RADIANS = float(UNIT[0]), float(UNIT[3])
"""What matters alike: the ascent works in these units."""

GAIN, FLAT = 1e-7, 1e-7
"""Relative gain in a step, and gradient a unit, that are not worth another step."""

ARMIJO = 1e-4
"""Share of the gain that the gradient promises with which a step is taken."""


@njit(cache=True, nogil=True, error_model="numpy")
def agreement_slope(pose, data, gradient):  # type: ignore[no-untyped-def]
    """The agreement of one pose; see `crlf_refine`.

    Args:
        pose: (12,).
        data: Points, start, one kind of maps, place, shape and intrinsics, see `road_view.Stack`,
            and (V,) share of the ground's points that are lane points.
        gradient: (6,) of the agreement by a left perturbation, metres then radians; written to.

    Returns:
        The agreement.
    """
    points, start, maps, place, shape, intrinsics, share = data
    mean, slope = np.empty(3), np.empty((3, 6))
    value = 0.0
    gradient[:] = 0.0
    for v in range(len(start)):
        for kind in range(3):
            mean[kind] = class_slope(
                pose,
                points[start[v, kind] : start[v, kind + 1]],
                maps[place[v, 1 if kind == 2 else 0] :],
                shape[v],
                intrinsics[v],
                slope[kind],
            )
        s = share[v]
        both = s * mean[0] + (1.0 - s) * mean[1]
        variance = max(both - both * both, LEAST_VARIANCE)
        factor = np.sqrt(s * (1.0 - s) / variance)
        bend = 0.0
        if both - both * both > LEAST_VARIANCE:
            bend = -0.5 * (mean[0] - mean[1]) / variance * (1.0 - 2.0 * both)
        value += factor * (mean[0] - mean[1]) + mean[2]
        lane, road = factor * (1.0 + bend * s), factor * (bend * (1.0 - s) - 1.0)
        for k in range(6):
            gradient[k] += lane * slope[0, k] + road * slope[1, k] + slope[2, k]
    for k in range(6):
        gradient[k] /= len(start)
    return value / len(start)


@njit(cache=True, nogil=True, fastmath=True, error_model="numpy")
def class_slope(pose, points, table, shape, intrinsics, slope):  # type: ignore[no-untyped-def]
    """Mean of a map under (N, 3) points, and its (6,) gradient; both 0 of no points.

    Args:
        pose: (12,).
        points: (N, 3).
        table: The map, row by row, with others behind it.
        shape: Its rows and columns.
        intrinsics: fx fy cx cy.
        slope: (6,) by a left perturbation, metres then radians; written to.
    """
    r00, r01, r02, r10, r11, r12, r20, r21, r22, tx, ty, tz = pose
    fx, fy, cx, cy = intrinsics
    width = shape[1]
    right, bottom = float(width - 1), float(shape[0] - 1)
    total, g0, g1, g2, g3, g4, g5 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(len(points)):
        px, py, pz = points[i, 0], points[i, 1], points[i, 2]
        z = r20 * px + r21 * py + r22 * pz + tz
        if z < NEAR:
            continue
        x = r00 * px + r01 * py + r02 * pz + tx
        y = r10 * px + r11 * py + r12 * pz + ty
        inverse = 1.0 / z
        u, w = fx * x * inverse + cx, fy * y * inverse + cy
        if u < 0.0 or w < 0.0 or u >= right or w >= bottom:
            continue
        column, row = int(u), int(w)
        a, b = u - column, w - row
        j = np.uint64(row * width + column)
        m = np.uint64((row + 1) * width + column)
        one = np.uint64(1)
        h00, h01, h10, h11 = table[j], table[j + one], table[m], table[m + one]
        low, high = h00 + a * (h01 - h00), h10 + a * (h11 - h10)
        total += low + b * (high - low)
        gx = fx * inverse * ((h01 - h00) + b * ((h11 - h10) - (h01 - h00)))
        gy = fy * inverse * (high - low)
        gz = -(gx * x + gy * y) * inverse
        g0 += gx
        g1 += gy
        g2 += gz
        g3 += y * gz - z * gy
        g4 += z * gx - x * gz
        g5 += x * gy - y * gx
    n = max(len(points), 1)
    slope[0], slope[1], slope[2] = g0 / n, g1 / n, g2 / n
    slope[3], slope[4], slope[5] = g3 / n, g4 / n, g5 / n
    return total / n


@njit(cache=True, nogil=True)
def displace(pose, twist, result):  # type: ignore[no-untyped-def]
    """exp(twist) pose, (12,) each; the twist in metres, then radians, by Rodrigues' formula."""
    wx, wy, wz = twist[3], twist[4], twist[5]
    square = wx * wx + wy * wy + wz * wz
    angle = np.sqrt(square)
    if angle < 1e-4:  # the series' next terms are below rounding
        a, b, c = 1.0 - square / 6.0, 0.5 - square / 24.0, 1.0 / 6.0 - square / 120.0
    else:
        a = np.sin(angle) / angle
        b = (1.0 - np.cos(angle)) / square
        c = (1.0 - a) / square
    W = np.array([[0.0, -wz, wy], [wz, 0.0, -wx], [-wy, wx, 0.0]])
    W2 = W @ W
    for i in range(3):
        for j in range(4):
            at = 9 + i if j == 3 else 3 * i + j
            value = pose[at]
            for k in range(3):
                part = pose[9 + k] if j == 3 else pose[3 * k + j]
                value += (a * W[i, k] + b * W2[i, k]) * part
            result[at] = value
        for k in range(3):
            move = b * W[i, k] + c * W2[i, k] + (1.0 if i == k else 0.0)
            result[9 + i] += move * twist[k]


@njit(cache=True, nogil=True)
def climb(pose, data, reach, iterations):  # type: ignore[no-untyped-def]
    """Climb from a pose by BFGS.

    Args:
        pose: (12,) where to start.
        data: See `agreement_slope`.
        reach: (6,) how far to go from the start at most, metres then radians.
        iterations: Steps at most.

    Returns:
        (12,) the top, or where the reach ended.
    """
    unit = np.array([METRES, METRES, METRES, RADIANS, RADIANS, RADIANS])
    bound = reach / unit
    best, trial = pose.copy(), pose.copy()
    gradient, ahead = np.empty(6), np.empty(6)
    value = agreement_slope(best, data, gradient)
    gradient *= unit
    x = np.zeros(6)
    H = np.eye(6)  # of the negative agreement, inverse
    fresh = True
    for _ in range(iterations):
        slope = np.where((np.abs(x) >= bound) & (x * gradient > 0.0), 0.0, gradient)
        if np.abs(slope).max() < FLAT:
            break
        direction = np.where(slope == 0.0, 0.0, H @ slope)
        if fresh or direction @ slope <= 0.0:
            direction, fresh = slope / np.sqrt(slope @ slope), True
        step, higher = _step(best, data, x, direction, slope, bound, value, trial, ahead)
        if higher < value:
            if fresh:
                break
            fresh = True
            continue
        ahead *= unit
        fresh = not _curve(H, step, gradient - ahead, fresh) and fresh
        small = higher - value < GAIN * max(abs(value), abs(higher), 1.0)
        x += step
        best[:] = trial
        value = higher
        gradient[:] = ahead
        if small:
            break
    return best


@njit(cache=True, nogil=True)
def _step(pose, data, x, direction, slope, bound, value, trial, ahead):  # type: ignore[no-untyped-def]
    """Go along a direction as far as it gains.

    Args:
        pose: (12,) where to start.
        data: See `agreement_slope`.
        x: (6,) how far from the very start that is, in units, as all that follows.
        direction: (6,).
        slope: (6,) of the agreement.
        bound: (6,) how far from the very start to go at most.
        value: The agreement.
        trial: (12,) the pose that is reached; written to.
        ahead: (6,) gradient there, in metres and radians; written to.

    Returns:
        (6,) the step, and the agreement there; less than `value` if there is none that gains.
    """
    unit = np.array([METRES, METRES, METRES, RADIANS, RADIANS, RADIANS])
    promised, length = direction @ slope, 1.0
    step = np.zeros(6)
    for _ in range(12):
        step = np.maximum(-bound, np.minimum(bound, x + length * direction)) - x
        displace(pose, step * unit, trial)
        higher = agreement_slope(trial, data, ahead)
        if higher >= value + ARMIJO * (step @ slope):
            return step, higher
        # Where the parabola through both values and the slope has its top.
        bent = 2.0 * (length * promised - (higher - value))
        length *= max(0.1, min(0.5, length * promised / max(bent, 1e-300)))
    return step, -np.inf


@njit(cache=True, nogil=True)
def _curve(H, step, change, fresh):  # type: ignore[no-untyped-def]
    """Learn from a step and the change of the slope: the update of BFGS, if they make sense."""
    along = step @ change
    if along <= 1e-12 * np.sqrt((step @ step) * (change @ change)):
        return False
    if fresh:
        H[:] = np.eye(6) * (along / (change @ change))
    y = H @ change
    scale = (along + change @ y) / (along * along)
    H += scale * np.outer(step, step) - (np.outer(y, step) + np.outer(step, y)) / along
    return True
