"""Pictures as a pinhole would have taken them, of any camera model."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from lcdata.geometry.camera import Camera

WIDEST_DEG = 55.0
"""Farthest a virtual pinhole sees to each side; there it stretches the picture threefold."""


def virtual_pinhole(camera: Camera) -> Camera:
    """The pinhole camera without distortion whose pictures `undistortion_maps` makes.

    A pinhole keeps its intrinsics and its size. Other models get the resolution that they have
    in the middle of the picture, and an image that reaches as far as theirs, or `WIDEST_DEG`.
    """
    if camera.model == "pinhole":
        return replace(camera, distortion=())
    fx, fy = camera.pixels_per_radian
    ((u, v),) = camera.project([[0.0, 0.0, 1.0]])[0]
    right, bottom = camera.width - 0.5, camera.height - 0.5
    borders = camera.unproject([[-0.5, v], [right, v], [u, -0.5], [u, bottom]])
    forward = np.cos(np.deg2rad(WIDEST_DEG))
    # a border that the lens does not reach is beyond what a pinhole can show, too
    angle = np.arccos(np.fmax(np.nan_to_num(borders[:, 2], nan=-1.0), forward))
    left, right, up, down = np.ceil(np.tan(angle) * [fx, fx, fy, fy] - 0.5)
    return replace(
        camera,
        model="pinhole",
        width=int(left + right) + 1,
        height=int(up + down) + 1,
        intrinsics=(fx, fy, left, up),
        distortion=(),
    )


def undistortion_maps(camera: Camera) -> tuple[NDArray[Any], NDArray[Any]]:
    """The two maps that `cv2.remap` takes to make the picture of `virtual_pinhole`."""
    import cv2

    target = virtual_pinhole(camera)
    size = (target.width, target.height)
    if camera.model == "pinhole":
        D = np.array(camera.distortion or (0.0,) * 4)
        return cv2.initUndistortRectifyMap(camera.K, D, np.eye(3), camera.K, size, cv2.CV_16SC2)
    u, v = np.meshgrid(np.arange(target.width), np.arange(target.height))
    pixels, _ = camera.project(target.unproject(np.column_stack([u.ravel(), v.ravel()])))
    outside = -2.0  # black
    where = np.nan_to_num(pixels, nan=outside).astype(np.float32).reshape(*u.shape, 2)
    return cv2.convertMaps(where[..., 0], where[..., 1], cv2.CV_16SC2)
