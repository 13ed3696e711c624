"""Edges of a cloud from its images: borders and creases of shape, borders of intensity.

Works on any cloud, whatever pattern its LiDAR scans in: the edges are found in virtual pinhole
images, where inverse depth is linear on planes, so that its second derivative tells creases and
borders from everything else.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lcdata.features.lidar_view import LidarView, views_around

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

FOCAL = 256.0
"""Of the virtual cameras, pixels."""

SIZE = 512
"""Their image without margin, pixels: 90 degrees."""

MARGIN = 64
"""Margin, so that edges on the border between two images are whole in one of them, pixels."""

BLUR = 1.5
"""Smallest smoothing, pixels."""

MIN_BEND = 0.02
"""Smallest second derivative of log inverse depth of an edge of shape, per pixel squared."""

MIN_JUMP = 0.03
"""Smallest gradient of log inverse depth of a border between surfaces, per pixel."""

MIN_STEP = 0.03
"""Smallest gradient of the intensity's rank (0..1), per pixel."""

CELL_DEG = 2.0
"""Edges are thinned evenly over cells of directions of about this size."""


@dataclass(frozen=True, eq=False)
class CloudEdges:
    """Points on edges.

    Args:
        points: (N, 3) in the LiDAR frame, metres.
        tangents: (N, 3) direction of the edge in the LiDAR frame, with any depth: only its image
            is right.
        painted: (N,) whether it is a border of intensity rather than of shape.
    """

    points: Array
    tangents: Array
    painted: Mask


def extract_cloud_edges(
    points: NDArray[Any],
    intensity: NDArray[Any] | None,
    *,
    limit: int = 6000,
    seed: int = 0,
    views: Sequence[LidarView] | None = None,
) -> CloudEdges:
    """Find the edges of a cloud.

    Args:
        points: (N, 3) in the LiDAR frame, metres; NaN where nothing returned.
        intensity: (N,) or None.
        limit: Points of each of the two kinds at most.
        seed: Of the choice.
        views: Images of the cloud to find them in, of `FOCAL` and with `MARGIN`; None for all
            around.
    """
    found: list[tuple[Array, Array, Mask]] = []
    if views is None:
        views = views_around(points, intensity, focal=FOCAL, size=SIZE + 2 * MARGIN)
    for view in views:
        found += _edges_of(view, np.asarray(points, float), intensity is not None)
    if not found:
        return CloudEdges(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0, bool))
    where, tangents, painted = (np.concatenate(part) for part in zip(*found, strict=True))
    rng = np.random.default_rng(seed)
    chosen = np.concatenate(
        [_spread(where, np.flatnonzero(painted == kind), limit, rng) for kind in (False, True)]
    )
    return CloudEdges(where[chosen], tangents[chosen], painted[chosen])


def _edges_of(
    view: LidarView, points: Array, has_intensity: bool
) -> list[tuple[Array, Array, Mask]]:
    """Edges of shape and of intensity of one image."""
    import cv2

    shown = view.index >= 0
    core = np.zeros(shown.shape, bool)
    core[MARGIN:-MARGIN, MARGIN:-MARGIN] = True
    core &= cv2.erode(shown.astype(np.uint8), np.ones((5, 5)), borderValue=1) > 0
    if not core.any():
        return []
    sigma = _blur(view)
    depth = points[np.maximum(view.index, 0)] @ view.R_view_lidar[2]
    inverse = _smooth(1.0 / np.maximum(depth, 0.05), view.measured, sigma)
    inverse = np.where(shown, np.maximum(inverse, 1e-6), 1e-6)
    bend, along = _bends(inverse)
    scale = (sigma / BLUR) ** 2
    jump, across = _jumps(inverse)
    near_jump = cv2.dilate((jump & shown).astype(np.uint8), np.ones((9, 9))) > 0
    # A border belongs to the nearer surface.
    nearest = 1.0 / cv2.dilate(1.0 / np.maximum(depth, 0.05), np.ones((5, 5)))
    crease = core & (bend * scale > MIN_BEND) & ~near_jump
    found = [
        _lifted(view, nearest, core & jump, across, False),
        _lifted(view, depth, crease, along, False),
    ]
    if has_intensity:
        rank = _smooth(view.intensity / 255.0, view.measured, sigma)
        x = cv2.Sobel(rank, cv2.CV_64F, 1, 0, ksize=3) / 8
        y = cv2.Sobel(rank, cv2.CV_64F, 0, 1, ksize=3) / 8
        step, across = np.hypot(x, y), np.arctan2(y, x)
        sharp = (step * sigma / BLUR > MIN_STEP) & _is_ridge(step, across)
        found.append(_lifted(view, depth, core & sharp & ~near_jump, across, True))
    return found


def _blur(view: LidarView) -> float:
    """Smoothing that bridges the gaps between measured pixels."""
    import cv2

    distance = cv2.distanceTransform((~view.measured).astype(np.uint8), cv2.DIST_L2, 5)
    return max(BLUR, 0.8 * float(np.percentile(distance[view.index >= 0], 95)))


def _smooth(values: Array, mask: Mask, sigma: float) -> Array:
    """Normalised convolution with a Gaussian: only pixels of the mask count."""
    import cv2

    weight = cv2.GaussianBlur(mask.astype(float), (0, 0), sigma)
    total = cv2.GaussianBlur(np.where(mask, values, 0.0), (0, 0), sigma)
    return np.asarray(total / np.maximum(weight, 1e-9))


def _jumps(inverse: Array) -> tuple[Mask, Array]:
    """Borders between surfaces: ridges of the gradient of log inverse depth.

    Returns:
        (H, W) where they are, and (H, W) the angle across them, radians.
    """
    import cv2

    log = np.log(inverse)
    x = cv2.Sobel(log, cv2.CV_64F, 1, 0, ksize=3) / 8
    y = cv2.Sobel(log, cv2.CV_64F, 0, 1, ksize=3) / 8
    slope, across = np.hypot(x, y), np.arctan2(y, x)
    # A plane seen at a grazing angle is steep as well, but everywhere.
    around = cv2.blur(slope, (11, 11))
    return _is_ridge(slope, across) & (slope > MIN_JUMP) & (slope > 1.5 * around), across


def _bends(inverse: Array) -> tuple[Array, Array]:
    """Creases: ridges of the second derivative of inverse depth.

    Returns:
        (H, W) strength where a ridge is, else 0, and (H, W) the angle across it, radians.
    """
    import cv2

    scale = 1.0 / (16.0 * inverse)
    xx = cv2.Sobel(inverse, cv2.CV_64F, 2, 0, ksize=5) * scale
    yy = cv2.Sobel(inverse, cv2.CV_64F, 0, 2, ksize=5) * scale
    xy = cv2.Sobel(inverse, cv2.CV_64F, 1, 1, ksize=5) * scale
    mean, spread = (xx + yy) / 2, np.hypot((xx - yy) / 2, xy)
    high, low = mean + spread, mean - spread
    first = np.abs(high) > np.abs(low)
    bend = np.where(first, np.abs(high), np.abs(low))
    other = np.where(first, np.abs(low), np.abs(high))
    across = 0.5 * np.arctan2(2 * xy, xx - yy) + np.where(first, 0.0, np.pi / 2)
    good = _is_ridge(bend, across) & (other < 0.5 * bend)
    return np.where(good, bend, 0.0), across


def _is_ridge(strength: Array, angle: Array) -> Mask:
    """Whether a pixel is stronger than its neighbours on both sides across the edge."""
    import cv2

    rows, columns = np.indices(strength.shape, np.float32)
    dx, dy = np.cos(angle).astype(np.float32), np.sin(angle).astype(np.float32)
    values = strength.astype(np.float32)
    ahead = cv2.remap(values, columns + dx, rows + dy, cv2.INTER_LINEAR)
    behind = cv2.remap(values, columns - dx, rows - dy, cv2.INTER_LINEAR)
    return np.asarray((values >= ahead) & (values > behind))


def _lifted(
    view: LidarView, depth: Array, edges: Mask, across: Array, painted: bool
) -> tuple[Array, Array, Mask]:
    """Edge pixels as points: in the pixel's direction, in the depth that it shows."""
    v, u = np.nonzero(edges)
    fx, fy, cx, cy = view.camera.intrinsics
    rays = np.stack([(u - cx) / fx, (v - cy) / fy, np.ones(len(u))], 1)
    angle = across[v, u]
    tangents = np.stack([-np.sin(angle), np.cos(angle), np.zeros(len(u))], 1)
    R = view.R_view_lidar
    return (rays * depth[v, u, None]) @ R, tangents @ R, np.full(len(u), painted)


def _spread(
    points: Array, rows: NDArray[np.int64], limit: int, rng: np.random.Generator
) -> NDArray[np.int64]:
    """Rows spread over the directions: crowded cells (leaves, texture) do not drown the rest."""
    if not len(rows):
        return rows
    rows = rng.permutation(rows)
    bearings = points[rows] / np.linalg.norm(points[rows], axis=1, keepdims=True)
    code = np.rint(bearings / np.deg2rad(CELL_DEG)).astype(np.int64) @ [1_000_000, 1_000, 1]
    order = np.argsort(code, kind="stable")
    starts = np.flatnonzero(np.diff(code[order], prepend=code[order][0] - 1))
    counts = np.diff(np.append(starts, len(order)))
    turn = np.empty(len(order), np.int64)  # how many of its cell come before
    turn[order] = np.arange(len(order)) - np.repeat(starts, counts)
    return np.asarray(rows[np.argsort(turn, kind="stable")[:limit]])
