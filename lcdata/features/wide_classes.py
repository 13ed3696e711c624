"""What a LiDAR point is like, in 32 classes: ground and its paint, height, roughness, reflectance.

Chosen for roads, and nothing but a code: what a class looks like in the image is learned from the
frames themselves (mutual information).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lcdata.features.nid_views import equalised

Array = NDArray[np.float64]
Floats = NDArray[np.float32]

CLASSES = 32

GROUND_SHADES = 8
"""Classes of the ground, by rank of reflectance."""
SHADES = 3
"""Classes of the rest, by rank of reflectance, for each height and roughness."""
HEIGHTS = (0.9, 2.0, 4.0)
"""What parts the rest by height above the ground, metres."""

TILT = np.deg2rad(15.0)
"""The ground's normal is no farther from up."""
REACH_M, INLIER_M = 30.0, 0.12
"""The plane is taken from points no farther than this, with this tolerance."""
THICKNESS = (0.25, 0.006)
"""What counts as ground: metres off the plane, and how much more a metre of range."""
HYPOTHESES, TESTED = 300, 1500
"""Planes tried, and the points that judge them."""
LEAST_SHARE = 0.05
"""Of the points, for a plane to be the ground."""


@dataclass(frozen=True, eq=False)
class Ground:
    """A plane below the camera.

    Args:
        normal: (3,) unit vector upwards, in the LiDAR frame.
        offset: `normal . p + offset` is the height of a point p, metres.
        found: Whether there is such a plane; if not, heights count from the lowest points.
    """

    normal: Array
    offset: float
    found: bool


def find_ground(points: Floats, up: Array, rng: np.random.Generator) -> Ground:
    """The ground by RANSAC among planes whose normal is about upwards.

    Args:
        points: (N, 3) in the LiDAR frame, metres.
        up: (3,) unit vector, roughly up in the LiDAR frame.
        rng: Of the hypotheses.
    """
    near = points[np.linalg.norm(points, axis=1) < REACH_M].astype(float)
    lowest = Ground(up, -float(np.percentile(points @ up, 2)) if len(points) else 0.0, False)
    if len(near) < 50:
        return lowest
    corners = near[rng.integers(0, len(near), (HYPOTHESES, 3))]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    size = np.linalg.norm(normals, axis=1)
    normals /= np.maximum(size, 1e-9)[:, None]
    normals *= np.where(normals @ up < 0, -1.0, 1.0)[:, None]
    upright = (normals @ up > np.cos(TILT)) & (size > 1e-3)
    if not upright.any():
        return lowest
    normals, offsets = normals[upright], -np.einsum("ij,ij->i", normals, corners[:, 0])[upright]
    judges = near[rng.permutation(len(near))[:TESTED]]
    votes = (np.abs(judges @ normals.T + offsets) < INLIER_M).sum(axis=0)
    best = int(np.argmax(votes))
    if votes[best] < LEAST_SHARE * len(judges):
        return lowest
    normal, offset = normals[best], float(offsets[best])
    for _ in range(2):
        inliers = near[np.abs(near @ normal + offset) < INLIER_M]
        centre = inliers.mean(axis=0)
        normal = np.linalg.eigh(np.cov((inliers - centre).T))[1][:, 0]
        normal *= np.sign(normal @ up) or 1.0
        offset = -float(normal @ centre)
    return Ground(normal, offset, True)


def point_classes(
    points: Sequence[Floats],
    reflectance: Sequence[Floats],
    roughness: Sequence[Floats],
    grounds: Sequence[Ground],
) -> list[NDArray[np.uint8]]:
    """Classes of the points of all frames; ranks are those among all of them.

    Args:
        points: (N, 3) of each frame in the LiDAR frame, metres.
        reflectance: (N,) of each frame, any unit.
        roughness: (N,) of each frame.
        grounds: Of each frame.

    Returns:
        (N,) of each frame, below `CLASSES`.
    """
    height = np.concatenate([p @ g.normal + g.offset for p, g in zip(points, grounds, strict=True)])
    distance = np.concatenate([np.linalg.norm(p, axis=1) for p in points])
    has_ground = np.repeat([g.found for g in grounds], [len(p) for p in points])
    ground = has_ground & (np.abs(height) < THICKNESS[0] + THICKNESS[1] * distance)
    light, rough = np.concatenate(reflectance), np.concatenate(roughness)
    result = np.zeros(len(height), np.uint8)
    if ground.any():
        result[ground] = (equalised(light[ground]) * GROUND_SHADES).astype(np.uint8)
    rest = ~ground
    if rest.any():
        level = np.searchsorted(HEIGHTS, height[rest])
        rugged = rough[rest] > np.median(rough[rest])
        shade = (equalised(light[rest]) * SHADES).astype(int)
        result[rest] = GROUND_SHADES + (level * 2 + rugged) * SHADES + shade
    return np.split(result, np.cumsum([len(p) for p in points])[:-1])
