"""LiDAR points drawn on the image: the picture that shows whether an extrinsic is right."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lcdata.geometry import se3
from lcdata.pair import Pair

Image = NDArray[np.uint8]

DEPTH_PERCENTILES = (2, 98)
TURBO_ENDS = (18, 240)
"""The scale's ends are left out: they are too dark to be seen."""

IMAGE_BRIGHTNESS = 0.72
"""The image is drawn in dimmed grey, so that colour means depth and nothing else."""


def depth_range(pair: Pair, T_camera_lidar: ArrayLike) -> tuple[float, float]:
    """Nearest and farthest depth (m) worth a colour; share it between pictures of a pair."""
    depths = _project(pair, T_camera_lidar)[1]
    if not depths.size:
        return 1.0, 100.0
    near, far = np.percentile(depths, DEPTH_PERCENTILES)
    return float(near), float(max(far, near * 1.1))


def draw_overlay(
    pair: Pair,
    T_camera_lidar: ArrayLike,
    *,
    width: int | None = None,
    depths: tuple[float, float] | None = None,
) -> Image:
    """Draw the LiDAR points of a pair on its image, coloured by depth: near red, far blue.

    Args:
        pair: Image, points and camera.
        T_camera_lidar: 4x4, maps LiDAR points to camera points.
        width: Width of the picture in pixels; the image's own by default.
        depths: Depths (m) of the ends of the colour scale; by default from these points.

    Returns:
        (H, W, 3) uint8 RGB.
    """
    import cv2

    width = width or pair.camera.width
    scale = width / pair.camera.width
    size = (width, max(1, round(pair.camera.height * scale)))
    pixels, distances = _project(pair, T_camera_lidar)
    near, far = depths or depth_range(pair, T_camera_lidar)
    grey = pair.image if pair.image.ndim == 2 else cv2.cvtColor(pair.image, cv2.COLOR_RGB2GRAY)
    method = cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR
    grey = cv2.resize(grey, size, interpolation=method)
    picture = cv2.cvtColor((grey * IMAGE_BRIGHTNESS).astype(np.uint8), cv2.COLOR_GRAY2RGB)
    if not distances.size:
        return np.asarray(picture)

    order = np.argsort(-distances)  # near points are drawn last, over far ones
    columns, rows = np.round((pixels[order] + 0.5) * scale - 0.5).astype(int).T
    with np.errstate(divide="ignore"):
        shade = 1 - np.log(distances[order] / near) / np.log(far / near)
    shades = (TURBO_ENDS[0] + np.clip(shade, 0, 1) * np.ptp(TURBO_ENDS)).astype(np.uint8)
    colours = cv2.applyColorMap(shades[:, None], cv2.COLORMAP_TURBO)[:, 0, ::-1]
    for dx, dy in _dot(len(order), size):
        x, y = np.clip(columns + dx, 0, size[0] - 1), np.clip(rows + dy, 0, size[1] - 1)
        picture[y, x] = colours
    return np.asarray(picture)


def _project(
    pair: Pair, T_camera_lidar: ArrayLike
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Pixels (N, 2) of the points that are inside the image, and depths (N,).

    A lens that sees to the side and behind has distances instead.
    """
    points = pair.points[np.isfinite(pair.points).all(axis=1)]
    in_camera = se3.apply(T_camera_lidar, points)
    pixels, inside = pair.camera.project(in_camera)
    seen = in_camera[inside]
    pinhole = pair.camera.model == "pinhole"
    return pixels[inside], seen[:, 2] if pinhole else np.linalg.norm(seen, axis=1)


def _dot(points: int, size: tuple[int, int]) -> list[tuple[int, int]]:
    """Pixels of a dot: sparse clouds get larger dots, dense ones leave the image to be seen."""
    share = points / (size[0] * size[1])
    if share > 0.06:
        return [(0, 0)]
    if share > 0.02 or size[0] < 320:
        return [(0, 0), (1, 0), (0, 1), (1, 1)]
    cross = [(0, 0), (1, 0), (-1, 0), (0, 1), (0, -1)]
    if share < 0.012 and size[0] > 800:  # shown smaller than it is
        return [*cross, (1, 1), (1, -1), (-1, 1), (-1, -1)]
    return cross
