"""Bearings of pixels: the camera models backwards."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from lcdata.geometry import camera_formulas as formulas
from lcdata.geometry.camera_models import radial_profile

if TYPE_CHECKING:
    from lcdata.geometry.camera import Camera

Array = NDArray[np.float64]

_STEPS = 12
"""Most Newton steps; each doubles the digits of what a table has brought to three."""
_DONE = 1e-13
"""Smallest step worth another, on the plane at depth 1 or in radians."""
_BLOCK = 8192
"""Pixels at a time, so that what is in between stays in the processor's cache."""
_TOLERANCE_PX = 1e-3
"""A bearing that projects farther from its pixel is none."""


def bearings(camera: Camera, pixels: Array) -> Array:
    """Unit bearings of pixels.

    Args:
        camera: The camera.
        pixels: (N, 2).

    Returns:
        (N, 3) in the camera frame, NaN where the lens shows nothing.
    """
    result = np.empty((len(pixels), 3))
    with np.errstate(all="ignore"):
        for start in range(0, len(pixels), _BLOCK):
            block = slice(start, start + _BLOCK)
            result[block] = _bearings(camera, pixels[block])
    result[np.isnan(result).any(axis=1)] = np.nan
    return result


def _bearings(camera: Camera, pixels: Array) -> Array:
    if camera.model == "equirectangular":
        longitude = ((pixels[:, 0] + 0.5) / camera.width - 0.5) * 2 * np.pi
        latitude = ((pixels[:, 1] + 0.5) / camera.height - 0.5) * np.pi
        level = np.where(np.abs(latitude) <= np.pi / 2, np.cos(latitude), np.nan)
        return np.stack(
            [level * np.sin(longitude), np.sin(latitude), level * np.cos(longitude)], axis=1
        )
    fx, fy, cx, cy = camera.intrinsics[-4:]
    plane = (pixels - [cx, cy]) / [fx, fy]
    if camera.model in ("fisheye", "atan"):
        return _radial(camera, plane)
    rays = _from_plane(
        camera.intrinsics[0] if camera.model == "omni" else 0.0, _undistort(camera, plane)
    )
    return np.asarray(rays / np.linalg.norm(rays, axis=1, keepdims=True))


def _from_plane(xi: float, plane: Array) -> Array:
    """Bearings (N, 3) of points (N, 2) of the unified model's plane; a pinhole's if xi is 0.

    C. Mei, P. Rives: Single view point omnidirectional camera calibration from planar grids,
    ICRA 2007, eq. 6.
    """
    square = np.square(plane).sum(axis=1)
    reach = (xi + np.sqrt(1 + (1 - xi * xi) * square)) / (1 + square)
    return np.column_stack([reach[:, None] * plane, reach - xi])


def _radial(camera: Camera, plane: Array) -> Array:
    """Bearings (N, 3) where the image radius depends on the angle from the axis alone."""
    radius = np.hypot(plane[:, 0], plane[:, 1])
    if camera.model == "atan" and any(camera.distortion):
        w = camera.distortion[0]
        angle = np.arctan2(np.tan(radius * w), 2 * np.tan(w / 2))
        angle[radius * w >= np.pi / 2] = np.nan
    elif camera.model == "atan":
        angle = np.arctan(radius)
    else:
        k1, k2, k3, k4 = camera.distortion or (0.0,) * 4
        angle = _undo_radial(camera, radius)
        for _ in range(_STEPS):
            t = angle * angle
            value = angle * (1 + t * (k1 + t * (k2 + t * (k3 + t * k4))))
            slope = 1 + t * (3 * k1 + t * (5 * k2 + t * (7 * k3 + t * 9 * k4)))
            step = (value - radius) / slope
            angle = angle - step
            if not (np.abs(step) > _DONE).any():
                break
    sine = np.divide(np.sin(angle), radius, out=np.ones_like(radius), where=radius > 0)
    return np.column_stack([sine[:, None] * plane, np.cos(angle)])


def _undistort(camera: Camera, distorted: Array) -> Array:
    """Undo Brown's distortion (N, 2) by Newton's method, from the radial part's table."""
    model, p = camera.formula
    if not any(camera.distortion):
        return distorted
    distorted = _untilt(p, distorted) if model == formulas.TILTED else distorted
    radius = np.hypot(*distorted.T)
    scale = np.divide(
        _undo_radial(camera, radius), radius, out=np.ones_like(radius), where=radius > 0
    )
    a, b = scale * distorted[:, 0], scale * distorted[:, 1]
    for _ in range(_STEPS):
        u, v, ua, ub, va, vb = formulas.distort(p, a, b)
        u, v = u - distorted[:, 0], v - distorted[:, 1]
        i = 1.0 / (ua * vb - ub * va)
        da, db = i * (vb * u - ub * v), i * (ua * v - va * u)
        a, b = a - da, b - db
        if not (np.maximum(np.abs(da), np.abs(db)) > _DONE).any():
            break
    u, v, *_ = formulas.distort(p, a, b)
    missed = np.hypot(u - distorted[:, 0], v - distorted[:, 1]) * p[0] > _TOLERANCE_PX
    beyond = np.hypot(a, b) > camera.distortion_limit
    return np.where((missed | beyond)[:, None], np.nan, np.column_stack([a, b]))


def _undo_radial(camera: Camera, radius: Array) -> Array:
    """Angles or radii from the axis that are shown at a radius, from a table; NaN beyond it."""
    r, shown = radial_profile(camera)
    good = r <= camera.distortion_limit
    return np.interp(radius, shown[good], r[good], right=np.nan)


def _untilt(p: Array, plane: Array) -> Array:
    back = np.linalg.inv(p[formulas.TILT :].reshape(3, 3))
    lifted = np.column_stack([plane, np.ones(len(plane))]) @ back.T
    return np.asarray(lifted[:, :2] / lifted[:, 2:])
