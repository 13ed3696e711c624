"""Attributes of LiDAR points that agree within one object: intensity, normal, and class.

Luo et al., *Calib-Anything*, 2023, section III-B: normals of the neighbourhood, planes by RANSAC
(the ground first), Euclidean clusters of what is left. All of it is done on the means of voxels,
so that a dense foreground does not cost more than it tells, nor a single ring look like a line.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]
Floats = NDArray[np.float32]
Bytes = NDArray[np.uint8]
Labels = NDArray[np.int32]

VOXEL_M = 0.1
"""Edge of a voxel, metres; the published one."""

NEIGHBOURS = 20
"""Voxels whose plane gives a normal."""

PLANE_DISTANCE_M = 0.2
"""Points so near a plane belong to it; the published one."""

PLANE_ANGLE = np.deg2rad(25)
"""Their normals may be off so much."""

PLANE_SHARE = 0.04
"""Least share of the voxels in a plane that is taken out."""

MOST_PLANES = 8
PLANE_TRIALS = 300

CLUSTER_M = 0.25
"""Points so near belong together; the published one."""

CLUSTER_RANGE_SHARE = 0.02
"""Or nearer than this share of their range: rings diverge."""

FEWEST_IN_CLUSTER = 10
"""Voxels of the smallest cluster."""

NO_CLASS = -1
"""Class of points in no plane and no cluster."""

DIRECTIONS = 32
"""Directions that normals are counted by, on the half sphere."""

INTENSITY_QUANTILE = 0.99
"""This quantile of the intensities becomes 1: the brightest point of all is a retroreflector."""


@dataclass(frozen=True, eq=False)
class CloudAttributes:
    """Points of one cloud and what they are like.

    Args:
        points: (N, 3) float32 in the LiDAR frame, metres, finite.
        intensity: (N,) float32 0 .. 1; None if the cloud has none.
        normals: (N, 3) float32 unit vectors, of either sign.
        directions: (N,) uint8 nearest of `DIRECTIONS` to the normal.
        classes: (N,) int32, planes first, then clusters, the largest first; or `NO_CLASS`.
        planes: How many of the classes are planes.
    """

    points: Floats
    intensity: Floats | None
    normals: Floats
    directions: Bytes
    classes: Labels
    planes: int


def direction_vectors() -> Array:
    """(DIRECTIONS, 3) unit vectors spread evenly over the half sphere (a Fibonacci lattice)."""
    k = np.arange(DIRECTIONS)
    z = (k + 0.5) / DIRECTIONS
    angle = k * np.pi * (3.0 - np.sqrt(5.0))
    across = np.sqrt(1.0 - z * z)
    return np.stack([across * np.cos(angle), across * np.sin(angle), z], 1)


def cloud_attributes(
    points: NDArray[np.floating[Any]],
    intensity: NDArray[np.floating[Any]] | None,
    cluster_m: float = CLUSTER_M,
) -> CloudAttributes:
    """Normals and classes of a cloud.

    Args:
        points: (N, 3) in the LiDAR frame, metres, finite.
        intensity: (N,) finite, in any unit; None if there is none.
        cluster_m: Points so near each other belong to one cluster.
    """
    points = np.ascontiguousarray(points, np.float32)
    if len(points) < 4:
        nothing = np.zeros(0, np.int32)
        return CloudAttributes(points[:0], None, points[:0], nothing.astype(np.uint8), nothing, 0)
    voxel, means = _voxels(points)
    neighbours, distances = _neighbours(means)
    normals = _normals(means, neighbours)
    classes, planes = _plane_classes(means, normals)
    classes = _cluster_classes(means, neighbours, distances, classes, planes, cluster_m)
    own = normals[voxel]
    directions = np.abs(normals @ direction_vectors().T.astype(np.float32)).argmax(1)
    light = None
    if intensity is not None:
        bright = float(np.quantile(intensity, INTENSITY_QUANTILE))
        dark = float(np.min(intensity))
        light = np.clip((intensity - dark) / max(bright - dark, 1e-12), 0, 1).astype(np.float32)
    return CloudAttributes(
        points, light, own, directions.astype(np.uint8)[voxel], classes[voxel], planes
    )


def _voxels(points: Floats) -> tuple[NDArray[np.intp], Floats]:
    """Voxel of each point, and the means of the voxels."""
    cells = np.floor((points - points.min(0)) / VOXEL_M).astype(np.int64)
    extent = cells.max(0) + 1
    key = (cells[:, 0] * extent[1] + cells[:, 1]) * extent[2] + cells[:, 2]
    _, voxel, count = np.unique(key, return_inverse=True, return_counts=True)
    sums = [np.bincount(voxel, points[:, k].astype(float)) for k in range(3)]
    return voxel, np.ascontiguousarray((np.stack(sums, 1) / count[:, None]).astype(np.float32))


def _neighbours(means: Floats) -> tuple[Labels, Floats]:
    """(V, NEIGHBOURS) nearest voxels of each, itself among them, and their distances."""
    from scipy.spatial import cKDTree

    count = min(NEIGHBOURS, len(means))
    tree = cKDTree(means, leafsize=24, balanced_tree=False)
    distances, index = (np.asarray(found) for found in tree.query(means, count))
    shape = len(means), count
    return index.reshape(shape).astype(np.int32), distances.reshape(shape).astype(np.float32)


def _normals(means: Floats, neighbours: Labels) -> Floats:
    """(V, 3) unit normals of the neighbourhoods' planes."""
    covariances = _covariances(means, neighbours)
    return np.ascontiguousarray(np.linalg.eigh(covariances)[1][:, :, 0].astype(np.float32))


@njit(cache=True, nogil=True)
def _covariances(means, neighbours):  # type: ignore[no-untyped-def]
    """(V, 3, 3) scatter of each neighbourhood."""
    result = np.zeros((len(means), 3, 3), np.float32)
    count = neighbours.shape[1]
    for i in range(len(means)):
        mx = my = mz = 0.0
        for j in neighbours[i]:
            mx += means[j, 0]
            my += means[j, 1]
            mz += means[j, 2]
        mx, my, mz = mx / count, my / count, mz / count
        xx = xy = xz = yy = yz = zz = 0.0
        for j in neighbours[i]:
            x, y, z = means[j, 0] - mx, means[j, 1] - my, means[j, 2] - mz
            xx += x * x
            xy += x * y
            xz += x * z
            yy += y * y
            yz += y * z
            zz += z * z
        c = result[i]
        c[0, 0], c[0, 1], c[0, 2] = xx, xy, xz
        c[1, 0], c[1, 1], c[1, 2] = xy, yy, yz
        c[2, 0], c[2, 1], c[2, 2] = xz, yz, zz
    return result


def _plane_classes(means: Floats, normals: Floats) -> tuple[Labels, int]:
    """Planes by RANSAC, the largest first: (V,) its number or -1, and how many there are.

    A point and its normal are a hypothesis; a plane is fitted again to those that it explains.
    """
    rng = np.random.default_rng(0)
    classes = np.full(len(means), -1, np.int32)
    least = max(PLANE_SHARE * len(means), 50)
    for plane in range(MOST_PLANES):
        left = np.flatnonzero(classes < 0)
        if len(left) < least:
            return classes, plane
        tried = rng.choice(left, min(PLANE_TRIALS, len(left)), replace=False)
        judges = rng.choice(left, min(2000, len(left)), replace=False)
        apart = np.abs((means[judges][None] - means[tried][:, None]) @ normals[tried][:, :, None])
        near = (apart[..., 0] < PLANE_DISTANCE_M) & (
            np.abs(normals[tried] @ normals[judges].T) > np.cos(PLANE_ANGLE)
        )
        best = int(near.sum(1).argmax())
        centre, normal = means[tried[best]], normals[tried[best]]
        for _ in range(3):
            inside = np.abs((means[left] - centre) @ normal) < PLANE_DISTANCE_M
            inside &= np.abs(normals[left] @ normal) > np.cos(PLANE_ANGLE)
            if inside.sum() < least:
                return classes, plane
            centre = means[left][inside].mean(0)
            normal = np.linalg.svd(np.cov((means[left][inside] - centre).T))[2][2]
        # What lies in the plane belongs to it, whatever its noisy normal says.
        classes[left[np.abs((means[left] - centre) @ normal) < PLANE_DISTANCE_M]] = plane
    return classes, MOST_PLANES


def _cluster_classes(
    means: Floats,
    neighbours: Labels,
    distances: Floats,
    classes: Labels,
    planes: int,
    cluster_m: float,
) -> Labels:
    """(V,) classes with the clusters of what is in no plane, the largest first."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    free = classes < 0
    reach = np.maximum(cluster_m, CLUSTER_RANGE_SHARE * np.linalg.norm(means, axis=1))
    joined = (distances < reach[:, None]) & free[:, None] & free[neighbours]
    row, column = np.nonzero(joined)
    ones = np.ones(len(row), np.int8)
    graph = coo_array((ones, (row, neighbours[row, column])), (len(means),) * 2)
    parts = connected_components(graph, directed=False)[1]
    size = np.bincount(parts[free], minlength=parts.max() + 1)
    order = np.argsort(-size, kind="stable")
    order = order[size[order] >= FEWEST_IN_CLUSTER]
    number = np.full(len(size), NO_CLASS, np.int32)
    number[order] = planes + np.arange(len(order))
    return np.where(free, number[parts], classes).astype(np.int32)
