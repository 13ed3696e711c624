"""Poses from three points each: what a robust search over matches draws from."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations, islice

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

SAMPLES = 120
"""Triples to try; all there are of up to nine matches, drawn ones of more."""


def triples(count: int, seed: int) -> Iterator[tuple[int, ...]]:
    """Three of `count` matches at a time: all there are, or drawn ones."""
    if count <= 9:
        return islice(combinations(range(count), 3), SAMPLES)
    rng = np.random.default_rng(seed)
    return (tuple(rng.choice(count, 3, replace=False)) for _ in range(SAMPLES))


def p3p(points: Array, bearings: Array) -> list[Array]:
    """Poses of three points, up to four; OpenCV's, turned so that all bearings point forward."""
    import cv2

    middle = bearings.mean(0)
    if np.linalg.norm(middle) < 0.1:
        return []
    forward = middle / np.linalg.norm(middle)
    side = np.cross(forward, [0.0, 1.0, 0.0] if abs(forward[1]) < 0.9 else [1.0, 0.0, 0.0])
    side /= np.linalg.norm(side)
    turn = np.stack([side, np.cross(forward, side), forward])
    turned = bearings @ turn.T
    if turned[:, 2].min() < 0.05:
        return []
    flat = np.ascontiguousarray(turned[:, None, :2] / turned[:, None, 2:])
    try:
        _, rotations, shifts = cv2.solveP3P(
            np.ascontiguousarray(points[:, None]), flat, np.eye(3), None, cv2.SOLVEPNP_P3P
        )
    except cv2.error:  # three points on one line
        return []
    poses = []
    for rotation, shift in zip(rotations, shifts, strict=True):
        T = np.eye(4)
        T[:3, :3] = turn.T @ cv2.Rodrigues(rotation)[0]
        T[:3, 3] = turn.T @ shift.reshape(3)
        if np.isfinite(T).all():
            poses.append(T)
    return poses
