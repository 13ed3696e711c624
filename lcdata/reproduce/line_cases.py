"""Line configurations of PLK-Calib's Fig. 2, and one that it misses."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

CASES = {
    "normal": "(a) neither parallel nor coplanar",
    "coplanar": "(b) coplanar",
    "parallel": "(c) parallel",
    "coplanar-parallel": "(d) coplanar and parallel",
    "concurrent": "(e) through one point",
}

NEAR, FAR = 4.0, 10.0
"""Metres: depth of the lines' middles."""

ASIDE = 2.0
"""Metres from the camera to a plane of lines, at least: it must not look along it."""

APART = np.deg2rad(20.0)
"""Least angle between two lines that are not parallel, for the first three."""


def lines(case: str, rng: np.random.Generator, count: int) -> Array:
    """End points of lines in front of a camera.

    Args:
        case: A key of `CASES`.
        rng: Random numbers.
        count: Number of lines, three or more.

    Returns:
        (count, 2, 3) in the camera frame, metres.
    """
    while True:
        middle = _in_view(rng, count)
        direction = _directions(rng, 1 if case.endswith("parallel") else count)
        if case == "concurrent":
            middle = middle[0] + direction * rng.uniform(-1.0, 1.0, (count, 1))
        if case.startswith("coplanar"):
            normal = _directions(rng, 1)[0]
            depth = normal @ middle[0]
            middle = middle * (depth / (middle @ normal))[:, None]
            direction = direction - (direction @ normal)[:, None] * normal
            direction /= np.linalg.norm(direction, axis=1, keepdims=True)
            if abs(depth) < ASIDE:
                continue
        half = rng.uniform(0.5, 1.5, (count, 1)) * direction
        segments = np.stack([middle - half, middle + half], axis=1)
        in_front = segments[..., 2].min() > 2.0 and segments[..., 2].max() < 2 * FAR
        if in_front and (len(direction) == 1 or _spread(direction)):
            return segments


def _in_view(rng: np.random.Generator, count: int) -> Array:
    """(count, 3) points in the middle of the image of a camera of 100 by 68 degrees."""
    depth = rng.uniform(NEAR, FAR, (count, 1))
    return np.hstack([depth * rng.uniform([-0.8, -0.45], [0.8, 0.45], (count, 2)), depth])


def _directions(rng: np.random.Generator, count: int) -> Array:
    """(count, 3) random unit vectors, the first three of them well apart."""
    while True:
        v = rng.normal(size=(count, 3))
        v /= np.linalg.norm(v, axis=1, keepdims=True)
        if _spread(v):
            return v


def _spread(v: Array) -> bool:
    cosine = np.abs(v[:3] @ v[:3].T)[np.triu_indices(min(3, len(v)), 1)]
    return bool((cosine < np.cos(APART)).all())
