"""What NID compares: rank-equalised image, and the LiDAR points that the camera can see.

Koide et al., *General, Single-shot, Target-less, and Automatic LiDAR-Camera Extrinsic Calibration
Toolbox*, 2023, sections III-C (equalisation) and III-E (hidden points).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numba import njit
from numpy.typing import NDArray

from lcdata.features.nid_kernels import BINS
from lcdata.geometry import camera_kernels
from lcdata.geometry.camera import Camera
from lcdata.geometry.camera_kernels import FAST

Array = NDArray[np.float64]
Floats = NDArray[np.float32]
Bytes = NDArray[np.uint8]

FINEST = 1000.0
"""Pixels a radian beyond which images are reduced: a LiDAR's spot is a few mrad wide."""

BLUR = 0.0015
"""Standard deviation of the image's blur, radians: about that of the LiDAR's spot."""

LEVELS = 1 << 15
"""Steps of the blurred image's range within which pixels have the same rank."""

GREY_NOISE = 3.0
"""Spread of grey values below which a neighbourhood is flat."""

CELL = 0.006
"""Edge of a depth buffer's cell on the cube around the camera: 0.006 f pixels."""

TOLERANCE = 0.02
"""Points so much farther than the nearest of their cell are hidden."""

MARGIN = 0.06
"""Points so far outside the image belong to the sample, radians: they may come into view."""

NEAREST_M = 0.3
"""Closer returns, and the zeros of missing ones, are left out."""

BLOCK_GRID = (8, 6)
"""The image's parts, columns and rows, whose points count as wrong together."""

BLOCKS = BLOCK_GRID[0] * BLOCK_GRID[1]


@dataclass(frozen=True, eq=False)
class NidImage:
    """One image, equalised, at the resolution of the registration.

    Args:
        grey: (h, w) uint8, as it was before.
        camera: Of the image at this resolution.
        model: Number of the camera model in `camera_kernels`.
        parameters: Its parameters.
        hard: (h, w) uint8 bin of each pixel.
        soft: (h, w) float32 intensity in units of bins, 0 .. BINS - 3.
        focal: Pixels a radian in the middle of the image.
    """

    grey: Bytes
    camera: Camera
    model: int
    parameters: Array
    hard: Bytes
    soft: Floats
    focal: float


def pixels_per_radian(camera: Camera) -> float:
    """Resolution of a camera in the middle of its image."""
    u, v = camera.width / 2, camera.height / 2
    bearings = camera.unproject([[u - 0.5, v], [u + 0.5, v]])
    return 1.0 / max(float(np.linalg.norm(bearings[1] - bearings[0])), 1e-9)


def nid_image(image: Bytes, camera: Camera, neighbourhood: float = 0.0) -> NidImage:
    """Reduce, blur and equalise one image.

    Args:
        image: (H, W) or (H, W, 3) uint8 RGB, as recorded (distorted).
        camera: Of the image.
        neighbourhood: Compare pixels with the mean and spread of a box of so many radians around
            them before they are ranked; 0 ranks them as they are. On a road, light falls off
            from row to row as the LiDAR's does from ring to ring: that alone draws a sparse scan
            up or down.
    """
    import cv2

    grey = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY) if image.ndim == 3 else image
    focal: float = pixels_per_radian(camera)
    if focal > 1.25 * FINEST:
        width = round(camera.width * FINEST / focal)
        height = round(camera.height * FINEST / focal)
        grey = cv2.resize(grey, (width, height), interpolation=cv2.INTER_AREA)
        camera, focal = camera.resized(width, height), FINEST
    smooth = cv2.GaussianBlur(grey.astype(np.float32), (0, 0), max(BLUR * focal, 0.3))
    if neighbourhood:
        box = (max(3, round(neighbourhood * focal)),) * 2
        smooth -= cv2.blur(smooth, box, borderType=cv2.BORDER_REFLECT)
        square = cv2.blur(smooth * smooth, box, borderType=cv2.BORDER_REFLECT)
        smooth /= np.sqrt(square + GREY_NOISE**2)
    rank = equalised_levels(smooth)
    return NidImage(
        np.ascontiguousarray(grey),
        camera,
        camera_kernels.model_id(camera),
        camera_kernels.parameters(camera),
        np.ascontiguousarray((rank * BINS).astype(np.uint8)),
        np.ascontiguousarray(rank * np.float32(BINS - 3)),
        focal,
    )


def equalised(values: NDArray[Any]) -> Floats:
    """Ranks of values, 0 <= rank < 1; equal values have the middle rank of their run.

    Args:
        values: Any shape, finite.
    """
    flat = values.reshape(-1)
    order = np.argsort(flat, kind="stable")
    ordered = flat[order]
    first = np.flatnonzero(np.r_[True, ordered[1:] != ordered[:-1]])
    count = np.diff(np.r_[first, len(ordered)])
    ranks = np.empty(len(flat), np.float32)
    ranks[order] = np.repeat((first + 0.5 * count) / max(len(ordered), 1), count)
    return np.minimum(ranks, np.float32(1 - 1e-6)).reshape(values.shape)


def equalised_levels(values: Floats) -> Floats:
    """`equalised` of pixels in `LEVELS` equal steps: without sorting a million of them.

    Args:
        values: Any shape, finite.
    """
    lowest, highest = float(values.min()), float(values.max())
    step = max(highest - lowest, 1e-9) / (LEVELS - 1)
    level = ((values - np.float32(lowest)) * np.float32(1.0 / step)).astype(np.uint16)
    count = np.bincount(level.reshape(-1), minlength=LEVELS)
    rank = ((np.cumsum(count) - 0.5 * count) / values.size).astype(np.float32)
    return np.minimum(rank, np.float32(1 - 1e-6))[level]


class HasCamera(Protocol):
    """An image whose camera is known."""

    @property
    def camera(self) -> Camera:
        """Of the image."""


@dataclass(frozen=True, eq=False)
class NidCloud:
    """Points that the camera sees or nearly sees from one pose.

    Args:
        points: (N, 3) float32 in the LiDAR frame, metres, sorted by place in the image.
        bins: (N,) uint8 bin of the intensity among these points.
        blocks: (N,) uint8 part of the image that they were in, below `BLOCKS`.
        inside: How many of them were inside the image.
    """

    points: Floats
    bins: Bytes
    blocks: Bytes
    inside: int

    def part(self, index: NDArray[Any]) -> NidCloud:
        """Some of the points."""
        share = len(np.atleast_1d(self.points[index])) / max(len(self.points), 1)
        return NidCloud(
            self.points[index], self.bins[index], self.blocks[index], int(self.inside * share)
        )


@dataclass(frozen=True, eq=False)
class Visible:
    """Which points of a cloud a camera sees or nearly sees.

    Args:
        index: (M,) of the points, sorted by place in the image.
        pixels: (M, 2) float32.
        blocks: (M,) uint8 part of the image, below `BLOCKS`.
        inside: (M,) bool, in the image and not only near it.
    """

    index: NDArray[np.int64]
    pixels: Floats
    blocks: Bytes
    inside: NDArray[np.bool_]


def visible(image: NidImage, points: Floats, T: Array) -> Visible:
    """Leave out what is hidden by something nearer, or far out of view.

    Args:
        image: What sees the points.
        points: (N, 3) float32 in the LiDAR frame, metres, finite.
        T: 4x4 `T_camera_lidar`.
    """
    height, width = image.hard.shape
    margin = MARGIN * image.focal
    kept, pixels = unhidden(image.camera, points, T, margin, TOLERANCE)
    u, v = pixels.T
    inside = (u >= -0.5) & (v >= -0.5) & (u < width - 0.5) & (v < height - 0.5)
    columns, rows = BLOCK_GRID
    column = np.clip(u * columns / width, 0, columns - 1).astype(np.uint8)
    row = np.clip(v * rows / height, 0, rows - 1).astype(np.uint8)
    return Visible(kept, pixels, (row * columns + column).astype(np.uint8), inside)


def unhidden(
    camera: Camera, points: Floats, T: Array, margin: float, tolerance: float
) -> tuple[NDArray[np.int64], Floats]:
    """Points in or near the image that nothing nearer hides.

    Args:
        camera: What sees the points.
        points: (N, 3) float32 in the LiDAR frame, metres, finite.
        T: 4x4 `T_camera_lidar`.
        margin: How far outside the image is near, pixels.
        tolerance: Points so much farther than the nearest of their cell are hidden, as a share.

    Returns:
        (M,) indices, sorted by place in the image, and (M, 2) float32 pixels.
    """
    pixels, range_m, cell = _project(
        camera_kernels.model_id(camera),
        camera_kernels.parameters(camera),
        flat(T[None])[0],
        points,
        camera.width,
        camera.height,
        margin,
    )
    kept = np.flatnonzero(_unhidden(range_m, cell, tolerance))
    u, v = pixels[kept].T
    # Strips of 16 rows, from left to right: neighbours in memory are neighbours in the image.
    kept = kept[np.argsort(np.floor(v / 16) * 1e5 + u, kind="stable")]
    return kept, pixels[kept]


def nid_cloud(seen: Visible, points: Floats, intensity: Floats) -> NidCloud:
    """Visible points with their intensities equalised among themselves."""
    rank = equalised(intensity[seen.index])
    return NidCloud(
        np.ascontiguousarray(points[seen.index]),
        (rank * BINS).astype(np.uint8),
        seen.blocks,
        int(seen.inside.sum()),
    )


def whereabouts(image: HasCamera, points: Floats, T: Array) -> str:
    """Where points lie as the camera sees it, in words."""
    if not len(points):
        return "the cloud has no points"
    x, y, z = (points @ T[:3, :3].T + T[:3, 3]).T
    pixels, inside = image.camera.project(np.stack([x, y, z], 1))
    with np.errstate(invalid="ignore"):
        u, v = pixels.T
        behind = ~np.isfinite(u) & (z <= 0)
        # Where a lens has no pixel for a point, its direction tells.
        u = np.where(np.isfinite(u), u, np.where(np.abs(x) > np.abs(y), np.sign(x) * np.inf, 0))
        v = np.where(np.isfinite(v), v, np.where(np.abs(x) > np.abs(y), 0, np.sign(y) * np.inf))
    out = ~inside & ~behind
    sides = {
        "in the image": inside,
        "behind the camera": behind,
        "left of the image": out & (u < 0),
        "right of it": out & (u >= image.camera.width - 0.5),
    }
    rest = out & ~sides["left of the image"] & ~sides["right of it"]
    sides |= {"above it": rest & (v < 0), "below it": rest & (v >= 0)}
    shares = {name: float(mask.mean()) for name, mask in sides.items()}
    ordered = sorted(shares.items(), key=lambda item: -item[1])
    return "points are " + ", ".join(f"{s:.0%} {name}" for name, s in ordered if s >= 0.005)


def flat(poses: Array) -> Array:
    """(P, 4, 4) poses as the (P, 12) that kernels take: R row by row, then t."""
    return np.concatenate([poses[:, :3, :3].reshape(-1, 9), poses[:, :3, 3]], 1)


SIDE = int(np.ceil(2.0 / CELL))


@njit(cache=True, nogil=True, fastmath=FAST, error_model="numpy")
def _project(model, parameters, pose, points, width, height, margin):  # type: ignore[no-untyped-def]
    """Pixels, ranges and depth-buffer cells of points; cell -1 where out of view."""
    n = points.shape[0]
    pixels, range_m, cell = (
        np.zeros((n, 2), np.float32),
        np.zeros(n, np.float32),
        np.empty(n, np.int32),
    )
    for i in range(n):
        x, y, z = np.float64(points[i, 0]), np.float64(points[i, 1]), np.float64(points[i, 2])
        px = pose[0] * x + pose[1] * y + pose[2] * z + pose[9]
        py = pose[3] * x + pose[4] * y + pose[5] * z + pose[10]
        pz = pose[6] * x + pose[7] * y + pose[8] * z + pose[11]
        cell[i] = -1
        u, v, ok = camera_kernels.project_point(model, parameters, px, py, pz)
        if not (ok and u > -margin and v > -margin and u < width + margin and v < height + margin):
            continue
        ax, ay, az = abs(px), abs(py), abs(pz)
        if az >= ax and az >= ay:
            face, a, b, c = 0 if pz > 0 else 1, px, py, az
        elif ax >= ay:
            face, a, b, c = 2 if px > 0 else 3, py, pz, ax
        else:
            face, a, b, c = 4 if py > 0 else 5, px, pz, ay
        column = min(int((a / c + 1.0) / CELL), SIDE - 1)
        row = min(int((b / c + 1.0) / CELL), SIDE - 1)
        cell[i] = (face * SIDE + row) * SIDE + column
        pixels[i, 0], pixels[i, 1] = u, v
        range_m[i] = np.sqrt(px * px + py * py + pz * pz)
    return pixels, range_m, cell


@njit(cache=True, nogil=True)
def _unhidden(range_m, cell, tolerance):  # type: ignore[no-untyped-def]
    """Which points are nearly the nearest of their cell."""
    nearest = np.full(6 * SIDE * SIDE, np.float32(np.inf))
    for i in range(cell.shape[0]):
        if cell[i] >= 0 and range_m[i] < nearest[cell[i]]:
            nearest[cell[i]] = range_m[i]
    kept = np.zeros(cell.shape[0], np.bool_)
    for i in range(cell.shape[0]):
        kept[i] = cell[i] >= 0 and range_m[i] <= (1.0 + tolerance) * nearest[cell[i]]
    return kept
