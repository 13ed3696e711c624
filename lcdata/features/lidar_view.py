"""What a LiDAR sees, as images of virtual cameras in its place (Koide et al., section III-D)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lcdata.features.compiled import compiled
from lcdata.geometry.camera import Camera

Array = NDArray[np.float64]
Index = NDArray[np.int64]

WIDE = np.deg2rad(150.0)
"""Field of view from which the virtual camera is equirectangular."""

MIN_RANGE = 0.3
"""Nearer points are the sensor's own mount, metres."""

LARGEST_GAP = np.deg2rad(2.4)
"""Holes up to so wide between measured pixels are filled: twice the gap of 16 rings in 30 deg."""


@dataclass(frozen=True, eq=False)
class LidarView:
    """An image of a cloud.

    Args:
        camera: The virtual camera.
        R_view_lidar: 3x3; the camera stands in the LiDAR's origin.
        index: (H, W) row of the point that a pixel shows, its holes filled with the nearest
            measured pixel's; -1 where there is none.
        measured: (H, W) whether a point fell into the pixel itself.
        intensity: (H, W) uint8 histogram-equalised intensity (range, where there is no
            intensity); 0 where there is no point.
    """

    camera: Camera
    R_view_lidar: Array
    index: Index
    measured: NDArray[np.bool_]
    intensity: NDArray[np.uint8]


def usable_points(points: NDArray[Any]) -> NDArray[np.bool_]:
    """(N,) which of the (N, 3) points are returns of the surroundings."""
    with np.errstate(invalid="ignore"):
        distance = np.linalg.norm(points, axis=1)
        return np.asarray(np.isfinite(points).all(1) & (distance > MIN_RANGE))


def field_of_view(points: NDArray[Any]) -> tuple[float, Array]:
    """The largest angle between two bearings of a cloud.

    Args:
        points: (N, 3) in the LiDAR frame; NaN where nothing returned.

    Returns:
        The angle in radians (0 of no points) and the (3,) unit direction of the view's middle.
    """
    from scipy.spatial import ConvexHull, QhullError

    found = np.asarray(points, float)[usable_points(points)]
    if not len(found):
        return 0.0, np.array([1.0, 0.0, 0.0])
    bearings = _thinned(found / np.linalg.norm(found, axis=1, keepdims=True))
    middle = bearings.mean(0)
    length = float(np.linalg.norm(middle))
    middle = middle / length if length > 1e-6 else np.array([1.0, 0.0, 0.0])
    if (bearings @ middle).min() > np.cos(0.5 * WIDE):  # the hull of a central projection
        across = _upright(middle)
        plane = bearings @ across.T
        try:
            hull = np.asarray(ConvexHull(plane[:, :2] / plane[:, 2:]).vertices, np.int64)
        except (QhullError, ValueError):  # a line or fewer than three points
            hull = np.arange(len(bearings))
        bearings = bearings[hull]
        extent = bearings @ across.T
        low, high = (extent[:, :2] / extent[:, 2:]).min(0), (extent[:, :2] / extent[:, 2:]).max(0)
        middle = np.append((low + high) / 2, 1.0) @ across
        middle /= np.linalg.norm(middle)
    smallest = min(float((part @ bearings.T).min()) for part in _chunks(bearings))
    return float(np.arccos(np.clip(smallest, -1.0, 1.0))), middle


def _thinned(bearings: Array) -> Array:
    """One bearing in each cell of about a degree, those of wide views in coarser cells."""
    for cell in (0.015, 0.05):
        code = np.rint(bearings / cell).astype(np.int64)
        chosen = np.unique(code @ np.array([1_000_000, 1_000, 1]), return_index=True)[1]
        if len(chosen) < 6000:
            break
    return np.asarray(bearings[chosen])


def _chunks(rows: Array) -> list[Array]:
    return np.array_split(rows, 1 + len(rows) // 500)


def _upright(forward: Array) -> Array:
    """3x3 rotation to a view that looks along `forward` with the LiDAR's z axis upwards."""
    up = np.array([0.0, 0.0, 1.0]) if abs(forward[2]) < 0.9 else np.array([1.0, 0.0, 0.0])
    right = np.cross(forward, up)
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(forward, right), forward])


def lidar_view(
    points: NDArray[Any], intensity: NDArray[Any] | None, *, size: int = 1024
) -> LidarView:
    """The whole cloud in one image: a pinhole below 150 degrees, else equirectangular.

    Args:
        points: (N, 3) in the LiDAR frame, metres; NaN where nothing returned.
        intensity: (N,) or None.
        size: Width of the image; an equirectangular one is twice as wide.
    """
    angle, middle = field_of_view(points)
    if angle >= WIDE:
        # Forward (the LiDAR's x axis) in the middle.
        forward = np.array([1.0, 0.0, 0.0])
        camera = Camera("equirectangular", 2 * size, size)
        return make_view(points, intensity, camera, _upright(forward))
    focal = 0.5 * size / np.tan(max(0.5 * angle, 0.1) * 1.05)
    centre = 0.5 * (size - 1)
    camera = Camera("pinhole", size, size, (focal, focal, centre, centre))
    return make_view(points, intensity, camera, _upright(middle))


def views_around(
    points: NDArray[Any], intensity: NDArray[Any] | None, *, focal: float, size: int
) -> list[LidarView]:
    """Pinhole images in the six directions of the LiDAR's axes, where there are points.

    Args:
        points: (N, 3) in the LiDAR frame, metres; NaN where nothing returned.
        intensity: (N,) or None.
        focal: Focal length, pixels.
        size: Width and height, pixels.
    """
    centre = 0.5 * (size - 1)
    camera = Camera("pinhole", size, size, (focal, focal, centre, centre))
    rows = np.flatnonzero(usable_points(points))
    seen = np.asarray(points[rows], float)
    least = 0.5 * np.linalg.norm(seen, axis=1)  # within 60 degrees
    views = []
    for axis in np.concatenate([np.eye(3), -np.eye(3)]):
        near = seen @ axis > least
        if near.any():
            views.append(_rendered(points, intensity, camera, _upright(axis), rows[near]))
    return [view for view in views if view.measured.any()]


def make_view(
    points: NDArray[Any], intensity: NDArray[Any] | None, camera: Camera, R_view_lidar: Array
) -> LidarView:
    """Render a cloud: the nearest point of each pixel, small holes filled.

    Args:
        points: (N, 3) in the LiDAR frame, metres; NaN where nothing returned.
        intensity: (N,) or None.
        camera: Virtual camera in the LiDAR's origin.
        R_view_lidar: 3x3 its orientation.
    """
    rows = np.flatnonzero(usable_points(points))
    return _rendered(points, intensity, camera, R_view_lidar, rows)


def _rendered(
    points: NDArray[Any],
    intensity: NDArray[Any] | None,
    camera: Camera,
    R_view_lidar: Array,
    rows: Index,
) -> LidarView:
    """The image of some rows of a cloud."""
    seen = np.asarray(points[rows], float)
    pixels, inside = camera.project(seen @ R_view_lidar.T)
    index = np.full((camera.height, camera.width), -1)
    distance = np.linalg.norm(seen, axis=1)
    _nearest(np.rint(pixels[inside]).astype(np.int64), distance[inside], rows[inside], index)
    measured = index >= 0
    reach = max(2, int(np.ceil(0.5 * LARGEST_GAP * camera.pixels_per_radian[1])))
    index = fill_holes(index, reach)
    shown = index >= 0
    if intensity is None:
        values = np.linalg.norm(points[np.maximum(index, 0)], axis=-1)
    else:
        values = intensity[np.maximum(index, 0)]
    return LidarView(camera, R_view_lidar, index, measured, equalised(values, shown))


@compiled
def _nearest(pixels: Index, distance: Array, rows: Index, index: Index) -> None:
    """Write the row of the nearest point into each pixel; `index` is -1 before."""
    nearest = np.full(index.shape, np.inf)
    for i in range(len(rows)):
        u, v = pixels[i, 0], pixels[i, 1]
        if distance[i] < nearest[v, u]:
            nearest[v, u] = distance[i]
            index[v, u] = rows[i]


def fill_holes(index: Index, reach: int) -> Index:
    """Give holes up to `2 * reach` pixels wide the index of their nearest pixel.

    The outline of what was measured stays: filled is what a morphological closing fills.

    Args:
        index: (H, W), -1 in holes.
        reach: Pixels.
    """
    import cv2

    measured = index >= 0
    if not measured.any() or measured.all():
        return index
    empty = (~measured).astype(np.uint8)
    labels = cv2.distanceTransformWithLabels(empty, cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL)[
        1
    ]
    of_label = np.zeros(labels.max() + 1, np.int64)
    of_label[labels[measured]] = index[measured]
    return np.where(closed(measured, reach), of_label[labels], -1)


def closed(mask: NDArray[np.bool_], reach: int) -> NDArray[np.bool_]:
    """Morphological closing of a mask by a disc, (H, W)."""
    import cv2

    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * reach + 1, 2 * reach + 1))
    wide = cv2.copyMakeBorder(mask.astype(np.uint8), reach, reach, reach, reach, cv2.BORDER_REFLECT)
    done = cv2.morphologyEx(wide, cv2.MORPH_CLOSE, disc)[reach:-reach, reach:-reach]
    return np.asarray(done > 0)


def equalised(values: NDArray[Any], mask: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """Histogram equalisation by rank: (H, W) uint8, 1..255 where `mask`, else 0."""
    result = np.zeros(mask.shape, np.uint8)
    chosen = np.nan_to_num(np.asarray(values[mask], float))
    if len(chosen):
        ordered = np.sort(chosen)
        rank = np.searchsorted(ordered, chosen, "left") + np.searchsorted(ordered, chosen, "right")
        result[mask] = 1 + np.rint(127.0 * rank / len(chosen)).astype(np.uint8)
    return result
