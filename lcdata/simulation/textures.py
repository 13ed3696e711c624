"""Procedural textures, evaluated at hit points and filtered to the footprint of a pixel.

Joints between bricks, tiles and planks are pulse trains whose box filter has a closed form, so
lines of paint and mortar lie where they should to a fraction of a pixel; mottling is value noise
whose octaves fade as they become finer than the footprint.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numba import njit
from numpy.typing import NDArray

from lcdata.simulation.mesh import BRICK, CHECKER, PLANK, RIB, Material, linear

Float32 = NDArray[np.float32]

_COLOR, _JOINT, _PATTERN, _SIZE, _GAP, _NOISE, _GRAIN = 0, 3, 6, 7, 9, 10, 11
_VARIATION = 0.16
"""By how much bricks, tiles and planks differ in brightness."""


def table(materials: Sequence[Material]) -> Float32:
    """(M, 12) rows of numbers that `albedo` reads."""
    rows = [
        [*linear(m.color), *linear(m.joint), m.pattern, *m.size, m.gap, m.noise, m.grain]
        for m in materials
    ]
    return np.array(rows, np.float32)


@njit(cache=True)  # type: ignore[untyped-decorator]
def _hash(i: int, j: int, seed: int) -> float:
    """A number in [0, 1) that depends on two integers and a seed only."""
    h = np.uint32(i) * np.uint32(374761393) + np.uint32(j) * np.uint32(668265263)
    h = np.uint32(h + np.uint32(seed) * np.uint32(2246822519))
    h = np.uint32((h ^ (h >> np.uint32(13))) * np.uint32(1274126177))
    return float((h ^ (h >> np.uint32(16))) & np.uint32(0xFFFFFF)) / 16777216.0


@njit(cache=True)  # type: ignore[untyped-decorator]
def _value_noise(x: float, y: float, seed: int) -> float:
    """Smooth noise in [-1, 1] with a period of one unit."""
    fx, fy = np.floor(x), np.floor(y)
    i, j = int(fx), int(fy)
    tx, ty = x - fx, y - fy
    tx, ty = tx * tx * (3 - 2 * tx), ty * ty * (3 - 2 * ty)
    a = _hash(i, j, seed) * (1 - tx) + _hash(i + 1, j, seed) * tx
    b = _hash(i, j + 1, seed) * (1 - tx) + _hash(i + 1, j + 1, seed) * tx
    return float(2 * (a * (1 - ty) + b * ty) - 1)


@njit(cache=True)  # type: ignore[untyped-decorator]
def _pulse(x: float, period: float, gap: float, footprint: float) -> float:
    """Share of [x - footprint/2, x + footprint/2] inside gaps centred on multiples of period."""
    duty = gap / period
    a, b = (x - footprint / 2) / period + duty / 2, (x + footprint / 2) / period + duty / 2
    fa, fb = np.floor(a), np.floor(b)
    inside = (fb - fa) * duty + min(b - fb, duty) - min(a - fa, duty)
    return float(inside * period / footprint)


@njit(cache=True)  # type: ignore[untyped-decorator]
def albedo(
    points: Float32,
    triangle: NDArray[np.uint32],
    footprint: Float32,
    frames: Float32,
    material: NDArray[np.int32],
    materials: Float32,
) -> Float32:
    """Linear RGB albedo of hit points.

    Args:
        points: (N, 3) hit points, metres.
        triangle: (N,) the triangle that each lies on.
        footprint: (N,) width of the pixel or beam on the surface, metres.
        frames: (T, 3, 3) texture origin, u axis, v axis of each triangle.
        material: (T,) material of each triangle.
        materials: (M, 12) from `table`.

    Returns:
        (N, 3) in 0 ... 1.
    """
    out = np.empty((len(points), 3), np.float32)
    for n in range(len(points)):
        t = triangle[n]
        m = material[t]
        row = materials[m]
        frame = frames[t]
        u, v = np.float32(0), np.float32(0)
        for k in range(3):
            d = points[n, k] - frame[0, k]
            u += d * frame[1, k]
            v += d * frame[2, k]
        w = max(footprint[n], np.float32(1e-4))
        pattern = int(row[_PATTERN])
        su, sv, gap = row[_SIZE], row[_SIZE + 1], row[_GAP]
        joint, cell = np.float32(0), np.float32(0)
        if BRICK <= pattern <= PLANK:
            i, j = 0, int(np.floor(v / sv))
            shifted = u
            if pattern == BRICK:
                shifted = u + 0.5 * su * (j % 2)
            elif pattern == PLANK:
                shifted = u + su * _hash(j, 7, m)
            i = int(np.floor(shifted / su))
            joint_u = _pulse(shifted, su, gap, w)
            joint_v = _pulse(v, sv, gap, w)
            joint = joint_u + joint_v - joint_u * joint_v
            cell = _VARIATION * (2 * _hash(i, j, m + 11) - 1) * max(0.0, 1 - w / min(su, sv))
        elif pattern == CHECKER:
            a, b = _pulse(u, su, su / 2, w), _pulse(v, sv, sv / 2, w)
            joint = a + b - 2 * a * b
        elif pattern == RIB:
            joint = 0.5 * max(0.0, 1 - 2 * w / su) * (1 + np.sin(2 * np.pi * u / su))
        mottle = np.float32(0)
        amplitude, scale = row[_NOISE], row[_GRAIN]
        for octave in range(4):
            fade = min(1.0, max(0.0, 2 - 4 * w / scale))
            if fade <= 0 or amplitude <= 0:
                break
            mottle += amplitude * fade * _value_noise(u / scale, v / scale, m * 5 + octave)
            amplitude, scale = amplitude * 0.6, scale * 0.4
        for k in range(3):
            value = row[_COLOR + k] * (1 - joint) + row[_JOINT + k] * joint
            out[n, k] = min(1.0, max(0.003, value * (1 + cell * (1 - joint) + mottle)))
    return out
