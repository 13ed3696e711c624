"""A simulated ZED 2i-like camera: rays through a distorted lens, anti-aliasing, sensor noise."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from lcdata.geometry.camera import Camera
from lcdata.simulation.kernels import camera_rays, silhouettes
from lcdata.simulation.light import Light
from lcdata.simulation.raycast import RayCaster

Array = NDArray[np.float64]
Float32 = NDArray[np.float32]

_GRID = 4
"""Edge pixels get _GRID x _GRID rays."""
_CONTRAST = 0.012
"""Edges of less contrast (after gamma) are not worth them."""


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
        exposure: Brightness of the median surface, 0 ... 1 of full scale in linear light.
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

    One ray a pixel first; pixels on the borders of surfaces and shadows get a grid of rays.

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
    R, origin = np.float32(T_world_camera[:3, :3]), np.float32(T_world_camera[:3, 3])
    pixel = 1.0 / camera.intrinsics[0]
    rays = camera_rays(xy.reshape(-1, 2), R, origin)
    radiance, hits, shadows = light.radiance(scene, rays, pixel)
    picture = radiance.reshape(camera.height, camera.width, 3)
    kind = np.where(hits.hit, 256 * (scene.material[hits.triangle] + 1) + shadows, 0)
    edges = silhouettes(picture, rays, hits.distance, hits.normal, kind.astype(np.int32), _CONTRAST)
    where = np.nonzero(edges)
    offsets = ((np.arange(_GRID) + 0.5) / _GRID - 0.5).astype(np.float32)
    total = np.zeros((len(where[0]), 3), np.float32)
    for dv in offsets:
        for du in offsets:
            fine = xy[where] + du * by_u[where] + dv * by_v[where]
            finer = light.radiance(scene, camera_rays(fine, R, origin), pixel / _GRID)[0]
            total += np.minimum(finer, 4.0)
    picture[where] = total / _GRID**2
    middle = np.median(radiance[hits.hit]) if hits.hit.any() else 1.0
    picture *= sensor.exposure / max(float(middle), 1e-3)
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
