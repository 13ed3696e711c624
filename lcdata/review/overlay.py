"""A cloud and lines projected into the image as it was recorded, whatever its lens."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from lcdata.geometry import se3
from lcdata.geometry.camera import Camera

Array = NDArray[np.float64]

BENT_POINTS = 24
"""Points of a segment that a lens bends."""

NEAREST_M = 0.05
"""Lines are cut off this far in front of the camera, where a projection still has sense."""


def project_cloud(
    camera: Camera, T_camera_lidar: Array, points: NDArray[Any], at_most: int
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """The points that lie in an image.

    Args:
        camera: Camera of the image.
        T_camera_lidar: 4x4.
        points: (N, 3) in the LiDAR frame, metres.
        at_most: How many points to keep; they are taken evenly.

    Returns:
        (M, 2) pixels and (M,) distances in metres.
    """
    in_camera = se3.apply(T_camera_lidar, points)
    if camera.model == "pinhole":
        in_camera = in_camera[in_camera[:, 2] > 0]
    pixels, inside = camera.project(in_camera)
    kept = np.flatnonzero(inside)
    if len(kept) > at_most:
        kept = kept[np.linspace(0, len(kept) - 1, at_most).astype(int)]
    distances = np.linalg.norm(in_camera[kept], axis=1)
    return pixels[kept].astype(np.float32), distances.astype(np.float32)


def project_strips(camera: Camera, T_camera_lidar: Array, segments: Array) -> list[Array]:
    """Straight segments as they appear in an image: bent where the lens bends them.

    Args:
        camera: Camera of the image.
        T_camera_lidar: 4x4.
        segments: (M, 2, 3) end points in the LiDAR frame, metres.

    Returns:
        (K, 2) pixels each, cut at the image's border; those that are nowhere in it left out.
    """
    if not camera.is_distorted:
        return list(project_segments(camera, T_camera_lidar, segments))
    return _bent(camera, se3.apply(T_camera_lidar, segments.reshape(-1, 3)).reshape(-1, 2, 3))


def image_strips(camera: Camera, segments: Array) -> list[Array]:
    """Segments of the undistorted image as they appear in the recorded one.

    Args:
        camera: Camera of the image.
        segments: (M, 2, 2) pixels of `camera.undistorted()`.

    Returns:
        As of `project_strips`.
    """
    if not camera.is_distorted:
        return list(clip_segments(segments, (camera.width, camera.height)))
    fx, fy, cx, cy = camera.undistorted().intrinsics
    rays = np.dstack([(segments - [cx, cy]) / [fx, fy], np.ones(segments.shape[:2])])
    return _bent(camera, rays)


def _bent(camera: Camera, ends: Array) -> list[Array]:
    """(M, 2, 3) segments in the camera frame as strips of pixels inside the image."""
    share = np.linspace(0, 1, BENT_POINTS)[:, None]
    points = ends[:, None, 0] + share * (ends[:, None, 1] - ends[:, None, 0])
    pixels, inside = camera.project(points.reshape(-1, 3))
    pixels, inside = pixels.reshape(*points.shape[:2], 2), inside.reshape(points.shape[:2])
    strips = []
    for line, seen in zip(pixels, inside, strict=True):
        with np.errstate(invalid="ignore"):
            wraps = np.abs(np.diff(line[:, 0])) > camera.width / 2  # around a panorama's seam
        for run in np.split(np.arange(len(line)), np.flatnonzero(np.diff(seen) | wraps) + 1):
            if seen[run[0]] and len(run) > 1:
                strips.append(line[run])
    return strips


def project_segments(camera: Camera, T_camera_lidar: Array, segments: Array) -> Array:
    """Straight segments as they appear in an image.

    Args:
        camera: Camera without distortion.
        T_camera_lidar: 4x4.
        segments: (M, 2, 3) end points in the LiDAR frame, metres.

    Returns:
        (K, 2, 2) pixels, cut at the image's border; segments that are nowhere in it are left out.
    """
    ends = se3.apply(T_camera_lidar, segments.reshape(-1, 3)).reshape(-1, 2, 3)
    ends = ends[(ends[..., 2] > NEAREST_M).any(axis=1)]
    for i, j in ((0, 1), (1, 0)):  # move an end that is behind the camera in front of it
        behind = ends[:, i, 2] < NEAREST_M
        a, b = ends[behind, i], ends[behind, j]
        share = (NEAREST_M - a[:, 2]) / (b[:, 2] - a[:, 2])
        ends[behind, i] = a + share[:, None] * (b - a)
    fx, fy, cx, cy = camera.intrinsics
    pixels = ends[..., :2] / ends[..., 2:] * [fx, fy] + [cx, cy]
    return clip_segments(pixels, (camera.width, camera.height))


def clip_segments(segments: Array, size: tuple[int, int]) -> Array:
    """Cut segments at an image's border (Liang and Barsky).

    Args:
        segments: (M, 2, 2) pixels.
        size: Width and height in pixels.

    Returns:
        (K, 2, 2); segments that are nowhere inside are left out.
    """
    start, step = segments[:, 0], segments[:, 1] - segments[:, 0]
    enter, leave = np.zeros(len(segments)), np.ones(len(segments))
    outside = np.zeros(len(segments), bool)
    for axis in (0, 1):
        for bound, sign in ((0.0, -1.0), (size[axis] - 1.0, 1.0)):
            p, q = sign * step[:, axis], sign * (bound - start[:, axis])
            with np.errstate(divide="ignore", invalid="ignore"):
                t = q / p
            enter = np.where(p < 0, np.maximum(enter, t), enter)
            leave = np.where(p > 0, np.minimum(leave, t), leave)
            outside |= (p == 0) & (q < 0)
    kept = ~outside & (enter < leave)
    start, step = start[kept, None], step[kept, None]
    return np.asarray(start + np.stack([enter[kept], leave[kept]], 1)[..., None] * step)
