"""Edge points of an image with their directions, and what is looked up near them.

After Yuan, Liu, Hong, Zhang: *Pixel-level Extrinsic Self Calibration of High Resolution LiDAR and
Camera in Targetless Environments*, 2021, section III-B and III-C: Canny's edges, short ones left
out, each with the direction of its nearest neighbours. Everything is in the image as recorded: the
camera model is in the projection.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lcdata.features.nid_views import NidImage

Array = NDArray[np.float64]
Floats = NDArray[np.float32]

BLUR = 0.0012
"""Standard deviation of the blur before Canny, radians."""

STRONG_PERCENTILE, WEAK_SHARE = 90.0, 0.4
"""Canny's upper threshold as a percentile of the gradients, and the lower one as a share of it."""

LEAST_GRADIENT = 25.0
"""Canny's least upper threshold: the noise of a plain image has no edges."""

SHORTEST = 0.04
"""Edges of fewer pixels are left out, radians."""

NEIGHBOURS = 5
"""Edge points that give a point its place across the edge and its direction (the paper's kappa)."""

LARGEST_SHIFT = 0.7
"""Largest shift of a point to the peak of the gradient, pixels."""

ORIENTATIONS = 12
"""Directions that the fields of the search tell apart."""

ORIENTATION_REACH = np.deg2rad(15.0)
"""How far from its own direction an edge counts in the fields of the search."""

TRUNCATIONS = (0.05, 0.02, 0.008)
"""Distances beyond which nothing is gained in the search, radians, coarse to fine."""

CLUTTER = 0.2
"""Edge of the box over which the distances' mean is taken away, radians."""

ALONE_TRUNCATION, ALONE_BOX = TRUNCATIONS[1], 0.1
"""How alone an edge is: the mean of this field in a box about it, radians."""

DIRECTION_WEIGHT = 0.02
"""What a direction at right angles costs beside a distance, radians: see `nearest`."""


@dataclass(frozen=True, eq=False)
class ImageEdges:
    """Edge points of one image.

    Args:
        points: (M, 2) pixels of the image that they were found in, to a fraction of a pixel.
        normals: (M, 2) unit vectors across the edge.
        alone: (M,) what a match with the point proves, 0 .. 1: little among many edges of its
            direction, as those of a brick wall.
        focal: Pixels a radian.
        tree: k-d tree of (u, v, direction); None without edges. See `nearest`.
        fields: At each of `TRUNCATIONS`, (ORIENTATIONS, h, w) float32: distance to the next edge
            of such a direction, the mean of its surroundings taken away; below 0 near an edge
            that stands alone.
        strides: Pixels a cell of each field.
    """

    points: Array
    normals: Array
    alone: Array
    focal: float
    tree: Any
    fields: tuple[Floats, ...]
    strides: tuple[float, ...]

    def nearest(self, pixels: Array, along: Array, gate: float, angle: float) -> NDArray[np.int64]:
        """The edge point next to each pixel in place and direction.

        Distances are those of (u, v, D cos 2a, D sin 2a) with direction a and D of
        `DIRECTION_WEIGHT`: an edge that crosses is farther than one that runs alongside.

        Args:
            pixels: (N, 2).
            along: (N, 2) unit directions.
            gate: Largest distance in the image, pixels.
            angle: Largest angle between the directions, radians.

        Returns:
            (N,) indices of edge points, -1 where there is none.
        """
        if self.tree is None or not len(pixels):
            return np.full(len(pixels), -1)
        weight = DIRECTION_WEIGHT * self.focal
        reach = float(np.hypot(gate, 2.0 * weight * np.sin(angle)))
        queries = _lifted(pixels, along, weight)
        _, index = self.tree.query(queries, distance_upper_bound=reach)
        found = np.minimum(index, len(self.points) - 1)
        apart = np.linalg.norm(self.points[found] - pixels, axis=1)
        # The sine of the angle between the lines: across one, along the other.
        sine = np.abs((self.normals[found] * along).sum(axis=1))
        good = (index < len(self.points)) & (apart <= gate) & (sine <= np.sin(angle))
        return np.where(good, found, -1)


def _lifted(pixels: Array, along: Array, weight: float) -> Array:
    """(N, 4) places and doubled directions."""
    c, s = along.T
    return np.column_stack([pixels, weight * (c * c - s * s), weight * 2.0 * c * s])


def image_edges(image: NidImage) -> ImageEdges:
    """Edge points of one image, at the resolution of the registration."""
    import cv2
    from scipy.spatial import cKDTree

    focal = image.focal
    smooth = cv2.GaussianBlur(image.grey, (0, 0), max(BLUR * focal, 0.6))
    gx, gy = (cv2.Sobel(smooth, cv2.CV_16S, dx, 1 - dx) for dx in (1, 0))
    strength = np.hypot(gx.astype(np.float32), gy.astype(np.float32))
    high = min(float(np.percentile(strength, STRONG_PERCENTILE)), 0.6 * float(strength.max()))
    high = max(high, LEAST_GRADIENT)
    edges = cv2.Canny(gx, gy, WEAK_SHARE * high, high, L2gradient=True)
    _, labels, stats, _ = cv2.connectedComponentsWithStats(edges, connectivity=8)
    long = stats[:, cv2.CC_STAT_AREA] >= SHORTEST * focal
    long[0] = False
    row, column = np.nonzero(long[labels])
    points, normals = _refined(row, column, gx, gy, strength)
    tree = None
    if len(points):
        points, normals = _fitted(points, normals)
        along = np.stack([-normals[:, 1], normals[:, 0]], 1)
        tree = cKDTree(_lifted(points, along, DIRECTION_WEIGHT * focal))
    fields, strides, alone = _fields(points, normals, image.grey.shape, focal)
    return ImageEdges(points, normals, alone, focal, tree, fields, strides)


def _refined(
    row: NDArray[np.intp],
    column: NDArray[np.intp],
    gx: NDArray[np.int16],
    gy: NDArray[np.int16],
    strength: Floats,
) -> tuple[Array, Array]:
    """Pixels moved along the gradient to its peak, and the gradient's directions."""
    import cv2

    normals = np.stack([gx[row, column], gy[row, column]], 1).astype(float)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-9)
    points = np.stack([column, row], 1).astype(float)
    if not len(points):
        return points, normals
    ahead, back = (
        _sampled(strength, points + side * normals, cv2.INTER_LINEAR) for side in (1.0, -1.0)
    )
    bend = ahead - 2.0 * strength[row, column] + back
    shift = np.where(bend < 0.0, 0.5 * (back - ahead) / np.minimum(bend, -1e-6), 0.0)
    return points + np.clip(shift, -LARGEST_SHIFT, LARGEST_SHIFT)[:, None] * normals, normals


def _sampled(values: Floats, places: Array, how: int) -> Array:
    import cv2

    maps = places.astype(np.float32)
    # OpenCV's maps are limited to 32767 rows and columns.
    parts = [
        cv2.remap(values, part[None], None, how, borderMode=cv2.BORDER_REPLICATE)[0]
        for part in np.array_split(maps, len(maps) // 30_000 + 1)
    ]
    return np.concatenate(parts).astype(float)


def _fitted(points: Array, normals: Array) -> tuple[Array, Array]:
    """Points and directions averaged over the nearest neighbours of like direction."""
    from scipy.spatial import cKDTree

    count = min(NEIGHBOURS, len(points))
    _, near = cKDTree(points).query(points, count)
    near = near.reshape(len(points), count)
    cosine = np.einsum("nc,nkc->nk", normals, normals[near])
    like = np.abs(cosine) > 0.8
    c, s = normals[near][..., 0], normals[near][..., 1]
    double = np.stack([((c * c - s * s) * like).sum(1), (2.0 * c * s * like).sum(1)], 1)
    angle = 0.5 * np.arctan2(double[:, 1], double[:, 0])
    mean = np.stack([np.cos(angle), np.sin(angle)], 1)
    off = np.einsum("nkc,nc->nk", points[near] - points[:, None], mean)
    shift = (off * like).sum(1) / np.maximum(like.sum(1), 1)
    return points + np.clip(shift, -LARGEST_SHIFT, LARGEST_SHIFT)[:, None] * mean, mean


def orientation(along: Array) -> NDArray[np.int64]:
    """Bins of (N, 2) directions in the image, below `ORIENTATIONS`."""
    angle = np.arctan2(along[:, 1], along[:, 0]) % np.pi
    return np.minimum((angle * (ORIENTATIONS / np.pi)).astype(np.int64), ORIENTATIONS - 1)


def _fields(
    points: Array, normals: Array, shape: tuple[int, ...], focal: float
) -> tuple[tuple[Floats, ...], tuple[float, ...], Array]:
    """Fields of the search, their strides, and how alone each point is."""
    import cv2

    angle = (np.arctan2(normals[:, 1], normals[:, 0]) + np.pi / 2) % np.pi
    away = np.abs(angle[None] - (np.arange(ORIENTATIONS)[:, None] + 0.5) * np.pi / ORIENTATIONS)
    near = np.minimum(away, np.pi - away) < ORIENTATION_REACH
    fields, strides = [], []
    alone = np.ones(len(points))
    own = orientation(np.stack([-normals[:, 1], normals[:, 0]], 1))
    for truncation in TRUNCATIONS:
        stride = max(2.0, float(round(truncation * focal / 5.0)))
        size = int(np.ceil(shape[0] / stride)), int(np.ceil(shape[1] / stride))
        cells = np.clip((points + 0.5) / stride, 0.0, np.array(size)[::-1] - 1).astype(np.int64)
        box = (max(3, round(CLUTTER * focal / stride)),) * 2
        field = np.empty((ORIENTATIONS, *size), np.float32)
        for b in range(ORIENTATIONS):
            free = np.full(size, 255, np.uint8)
            free[cells[near[b], 1], cells[near[b], 0]] = 0
            distance = cv2.distanceTransform(free, cv2.DIST_L2, 3)
            if not near[b].any():
                distance[:] = np.inf
            cut = np.minimum(distance * np.float32(stride / (truncation * focal)), np.float32(1))
            field[b] = cut - cv2.blur(cut, box, borderType=cv2.BORDER_REFLECT)
            if truncation == ALONE_TRUNCATION:
                near_by = (max(3, round(ALONE_BOX * focal / stride)),) * 2
                mean = cv2.blur(cut, near_by, borderType=cv2.BORDER_REFLECT)
                mine = own == b
                alone[mine] = mean[cells[mine, 1], cells[mine, 0]]
        fields.append(field)
        strides.append(stride)
    return tuple(fields), tuple(strides), alone
