"""Straight outlines among edge rays: RANSAC of planes through the scanner, compiled."""
# ruff: noqa: PLR0912, PLR0915 - a compiled loop is written out, on plain arrays

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lcdata.features.compiled import compiled

Floats = NDArray[np.float32]
Labels = NDArray[np.int32]

TRIALS = 60
FEWEST_POINTS = 8
EPSILON_BEAMS = 0.15
"""Roughness of real edges, in beams, on top of the half beam."""
SHORTEST_BEAMS, LONGEST_BEAMS = 4.0, 60.0
"""How far apart the two points of a trial are."""


@compiled
def outlines(
    labels: Labels, rays: Floats, halves: Floats, ring_step: float
) -> tuple[Labels, Floats]:
    """RANSAC of planes through the scanner, region by region.

    Args:
        labels: (K,) sorted.
        rays: (3, K) unit edge rays.
        halves: (3, K) half a beam across the edge.
        ring_step: Radians.

    Returns:
        (K,) line of each edge point, -1 for none, and (M, 3) normals of the lines' planes.
    """
    lines = np.full(len(labels), -1, np.int32)
    normals = np.zeros((len(labels) // FEWEST_POINTS + 1, 3), np.float32)
    # Points not yet on a line move to the front of their region: tight loops over few columns.
    u, h, place = rays.copy(), halves.copy(), np.arange(len(labels))
    eps = np.float32(EPSILON_BEAMS * ring_step)
    shortest, longest = (SHORTEST_BEAMS * ring_step) ** 2, (LONGEST_BEAMS * ring_step) ** 2
    found, first = 0, 0
    state = np.uint32(1)
    while first < len(labels):
        last = first
        while last < len(labels) and labels[last] == labels[first]:
            last += 1
        begin, first = first, last
        while last - begin >= FEWEST_POINTS:
            most, b0, b1, b2 = 0, np.float32(0), np.float32(0), np.float32(0)
            u0, u1, u2 = u[0, begin:last], u[1, begin:last], u[2, begin:last]
            h0, h1, h2 = h[0, begin:last], h[1, begin:last], h[2, begin:last]
            for _ in range(TRIALS):
                square, one, two = 0.0, 0, 0
                for attempt in range(8):
                    # A linear congruential generator: the same lines on every run.
                    state = np.uint32(state * np.uint32(1664525) + np.uint32(1013904223))
                    drawn = begin + int(state >> np.uint32(8)) % (last - begin)
                    if attempt == 0:
                        one = drawn
                        continue
                    two, square = drawn, 0.0
                    for m in range(3):
                        square += (u[m, one] - u[m, two]) ** 2
                    if shortest < square < longest:
                        break
                if square <= shortest:
                    continue
                n0 = u[1, one] * u[2, two] - u[2, one] * u[1, two]
                n1 = u[2, one] * u[0, two] - u[0, one] * u[2, two]
                n2 = u[0, one] * u[1, two] - u[1, one] * u[0, two]
                norm = np.float32(np.sqrt(n0 * n0 + n1 * n1 + n2 * n2))
                n0, n1, n2 = n0 / norm, n1 / norm, n2 / norm
                votes = np.int32(0)
                for k in range(len(u0)):
                    off = abs(u0[k] * n0 + u1[k] * n1 + u2[k] * n2)
                    bound = abs(h0[k] * n0 + h1[k] * n1 + h2[k] * n2) + eps
                    votes += np.int32(off < bound)
                if votes > most:
                    most, b0, b1, b2 = int(votes), n0, n1, n2
            if most < FEWEST_POINTS:
                break
            b0, b1, b2 = refit(u, h, begin, last, b0, b1, b2, eps)
            rest = begin
            for k in range(begin, last):
                off = abs(u[0, k] * b0 + u[1, k] * b1 + u[2, k] * b2)
                bound = abs(h[0, k] * b0 + h[1, k] * b1 + h[2, k] * b2)
                if off < bound + eps:
                    lines[place[k]] = found
                    continue
                for m in range(3):
                    u[m, rest], h[m, rest] = u[m, k], h[m, k]
                place[rest] = place[k]
                rest += 1
            if rest == last:
                break
            last = rest
            normals[found, 0], normals[found, 1], normals[found, 2] = b0, b1, b2
            found += 1
    return lines, normals[:found].copy()


@compiled
def refit(
    u: Floats,
    h: Floats,
    begin: int,
    last: int,
    n0: np.float32,
    n1: np.float32,
    n2: np.float32,
    eps: np.float32,
) -> tuple[np.float32, np.float32, np.float32]:
    """Least squares over all edge points on a line that only two of them defined."""
    c0, c1, c2 = 0.0, 0.0, 0.0
    for k in range(begin, last):
        off = abs(u[0, k] * n0 + u[1, k] * n1 + u[2, k] * n2)
        if off < abs(h[0, k] * n0 + h[1, k] * n1 + h[2, k] * n2) + eps:
            c0, c1, c2 = c0 + u[0, k], c1 + u[1, k], c2 + u[2, k]
    norm = np.sqrt(c0 * c0 + c1 * c1 + c2 * c2)
    c0, c1, c2 = c0 / norm, c1 / norm, c2 / norm
    d0, d1, d2 = n1 * c2 - n2 * c1, n2 * c0 - n0 * c2, n0 * c1 - n1 * c0
    ff, fs, ss, yf, ys = 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(begin, last):
        y = u[0, k] * n0 + u[1, k] * n1 + u[2, k] * n2
        if abs(y) < abs(h[0, k] * n0 + h[1, k] * n1 + h[2, k] * n2) + eps:
            f = u[0, k] * c0 + u[1, k] * c1 + u[2, k] * c2
            s = u[0, k] * d0 + u[1, k] * d1 + u[2, k] * d2
            ff, fs, ss, yf, ys = ff + f * f, fs + f * s, ss + s * s, yf + y * f, ys + y * s
    determinant = ff * ss - fs * fs
    if determinant <= 0.0:
        return n0, n1, n2
    alpha, beta = (yf * ss - ys * fs) / determinant, (ff * ys - fs * yf) / determinant
    m0, m1 = n0 - alpha * c0 - beta * d0, n1 - alpha * c1 - beta * d1
    m2 = n2 - alpha * c2 - beta * d2
    norm = np.sqrt(m0 * m0 + m1 * m1 + m2 * m2)
    return np.float32(m0 / norm), np.float32(m1 / norm), np.float32(m2 / norm)
