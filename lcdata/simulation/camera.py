"""A simulated ZED 2i-like camera: rays through a distorted lens, anti-aliasing, sensor noise."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from lcdata.geometry.camera import Camera
from lcdata.simulation.light import Light
from lcdata.simulation.raycast import RayCaster

Array = NDArray[np.float64]
Float32 = NDArray[np.float32]

_GRID = 4
"""Edge pixels get _GRID x _GRID rays."""


def zed2i(width: int = 1280, height: int = 720) -> Camera:
    """The left camera of a ZED 2i with the 2.1 mm lens, raw (distorted) image."""
    scale = width / 1280
    cx, cy = 648.3 * scale, 366.1 * scale + (height - 720 * scale) / 2
    intrinsics = (528.6 * scale, 528.3 * scale, cx, cy)
    return Camera(
        "pinhole", width, height, intrinsics, (-0.0421, 0.0112, -0.00035, 0.00052, -0.0048)
    )


@dataclass(frozen=True)
class Sensor:
    """What happens between the lens and the file.

    Args:
        exposure: Brightness of the mean picture, 0 ... 1 of full scale in linear light.
        blur_px: Standard deviation of the lens's point spread.
        vignetting: Loss of light in the corners.
        shot_noise: Noise at full scale, relative, growing with the root of the signal.
        read_noise: Noise in the dark, relative to full scale.
    """

    exposure: float = 0.20
    blur_px: float = 0.55
    vignetting: float = 0.25
    shot_noise: float = 0.008
    read_noise: float = 0.0015


@lru_cache(maxsize=4)
def _rays(camera: Camera) -> tuple[Float32, Float32, Float32]:
    """(H, W, 2) normalised image coordinates of pixel centres, and their derivatives by u, v."""
    u, v = np.meshgrid(np.arange(-1.0, camera.width + 1), np.arange(-1.0, camera.height + 1))
    bearing = camera.unproject(np.column_stack([u.ravel(), v.ravel()]))
    xy = (bearing[:, :2] / bearing[:, 2:]).reshape(*u.shape, 2)
    by_u = (xy[1:-1, 2:] - xy[1:-1, :-2]) / 2
    by_v = (xy[2:, 1:-1] - xy[:-2, 1:-1]) / 2
    return xy[1:-1, 1:-1].astype(np.float32), by_u.astype(np.float32), by_v.astype(np.float32)


def render(
    scene: RayCaster,
    light: Light,
    camera: Camera,
    T_world_camera: Array,
    rng: np.random.Generator,
    sensor: Sensor | None = None,
) -> NDArray[np.uint8]:
    """A picture as the camera would record it.

    One ray a pixel first; pixels that differ from a neighbour get a grid of rays.

    Args:
        scene: What the camera sees.
        light: What lights it.
        camera: Lens model; the picture is distorted as it says.
        T_world_camera: 4x4 pose.
        rng: Source of noise.
        sensor: Exposure and noise; defaults to a day's picture. Noise-free parts are zeros.

    Returns:
        (H, W, 3) uint8 RGB.
    """
    import cv2

    sensor = sensor or Sensor()
    xy, by_u, by_v = _rays(camera)
    T = np.asarray(T_world_camera, np.float32)
    pixel = 1.0 / camera.intrinsics[0]

    def shoot(coordinates: Float32) -> Float32:
        directions = np.empty((len(coordinates), 3), np.float32)
        directions[:, :2], directions[:, 2] = coordinates, 1
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        return light.radiance(scene, T[:3, 3], directions @ T[:3, :3].T, pixel)[0]

    picture = shoot(xy.reshape(-1, 2)).reshape(camera.height, camera.width, 3)
    where = np.nonzero(_edges(picture))
    offsets = (np.arange(_GRID) + 0.5) / _GRID - 0.5
    total = np.zeros((len(where[0]), 3), np.float32)
    for dv in offsets:
        fine = np.concatenate(
            [
                xy[where] + np.float32(du) * by_u[where] + np.float32(dv) * by_v[where]
                for du in offsets
            ]
        )
        total += np.minimum(shoot(fine), 4.0).reshape(_GRID, -1, 3).sum(axis=0)
    picture[where] = total / _GRID**2
    picture *= sensor.exposure / max(float(np.median(picture)), 1e-3) * 0.9
    if sensor.blur_px > 0:
        picture = cv2.GaussianBlur(picture, (0, 0), sensor.blur_px)
    radius2 = np.square(xy).sum(axis=-1, keepdims=True)
    picture *= 1 - sensor.vignetting * radius2 / radius2.max()
    noise = rng.standard_normal(picture.shape, np.float32)
    spread = np.sqrt(sensor.read_noise**2 + sensor.shot_noise**2 * np.maximum(picture, 0))
    picture = picture + noise * spread
    # a soft shoulder instead of hard clipping, then the display's gamma
    picture = np.where(picture > 0.7, 0.7 + 0.3 * np.tanh((picture - 0.7) / 0.3), picture)
    return np.asarray(np.rint(255 * np.clip(picture, 0, 1) ** (1 / 2.2)), np.uint8)


def _edges(picture: Float32) -> NDArray[np.bool_]:
    """(H, W) pixels that differ visibly from a neighbour."""
    import cv2

    tone = np.minimum(picture, 4.0) ** 0.45
    different = np.zeros(picture.shape[:2], np.uint8)
    step = np.abs(np.diff(tone, axis=0)).max(axis=-1) > 0.03
    different[1:] |= step
    different[:-1] |= step
    step = np.abs(np.diff(tone, axis=1)).max(axis=-1) > 0.03
    different[:, 1:] |= step
    different[:, :-1] |= step
    return np.asarray(cv2.dilate(different, np.ones((3, 3), np.uint8)) > 0)
