"""Local plane fits on a scan grid, compiled.

A plane is written as the vector a with a . p = 1 for its points p (metres), so a = normal /
distance from the scanner. Along a unit ray u the plane is met at range 1 / (a . u): the inverse
range is linear in a, the directions are free of noise, and so least squares on inverse ranges
is unbiased and needs no eigenvectors. Sums over any window come from one summed-area table.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from lcdata.features.compiled import compiled

Array = NDArray[np.float64]
Floats = NDArray[np.float32]

MOST_COLUMNS_ASIDE, MOST_RINGS_ASIDE = 32, 12
"""Largest half size of a window."""
FLAT_SIGMA = 1.6
"""Largest residual of a window that counts as flat, in standard deviations."""
ROUGHNESS_SQUARE = 0.005**2
"""How far real surfaces are from planes (m^2), added to the range noise."""


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
    widest = pad if turn else MOST_COLUMNS_ASIDE
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
            for shrink in (1.0, 2.0):
                half = window / (r * shrink)
                aside = min(max(int(half / column_step + 0.5), 2), widest)
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
    return math.sqrt(offset * offset / (square * (noise * noise * cosine + ROUGHNESS_SQUARE)))
