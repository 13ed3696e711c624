"""A simulated ZED 2i-like camera: rays through a distorted lens, anti-aliasing, sensor noise."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from lcdata.errors import SimulationError
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


def _fisheye(width: int, height: int) -> Camera:
    f = width / 3.2
    centre = (0.504 * width, 0.497 * height)
    return Camera("fisheye", width, height, (f, f, *centre), (0.021, -0.0062, 0.0011, -0.0002))


def _atan(width: int, height: int) -> Camera:
    f = 0.38 * width
    return Camera("atan", width, height, (f, f, 0.503 * width, 0.498 * height), (0.93,))


def _omni(width: int, height: int) -> Camera:
    f = 0.6 * width
    intrinsics = (1.2, f, f, 0.502 * width, 0.499 * height)
    return Camera("omni", width, height, intrinsics, (-0.04, 0.012, 0.0003, -0.0002))


def _equirectangular(width: int, height: int) -> Camera:
    return Camera("equirectangular", width, width // 2, (width, width // 2))


CAMERAS: dict[str, Callable[[int, int], Camera]] = {
    "zed2i": zed2i,
    "fisheye": _fisheye,
    "atan": _atan,
    "omni": _omni,
    "equirectangular": _equirectangular,
}
"""A camera of each kind, of width and height; an equirectangular image is half as high as wide."""


def make_camera(name: str, width: int = 1280, height: int = 720) -> Camera:
    """A camera by its name in `CAMERAS`.

    Raises:
        SimulationError: Unknown name.
    """
    if name not in CAMERAS:
        raise SimulationError(f"unknown camera {name!r}", f"choose from {', '.join(CAMERAS)}")
    return CAMERAS[name](width, height)


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


@dataclass(frozen=True, eq=False)
class _Optics:
    """Where each pixel looks.

    Args:
        ahead: (H, W, 3) direction of pixel centres.
        by_u: (H, W, 3) its change a pixel to the right.
        by_v: (H, W, 3) its change a pixel down.
        seen: (H, W) whether light reaches the pixel.
        falloff: (H, W, 1) 0 in the middle ... 1 where vignetting is worst.
        pixel_rad: Angle of a pixel.
    """

    ahead: Float32
    by_u: Float32
    by_v: Float32
    seen: NDArray[np.bool_]
    falloff: Float32
    pixel_rad: float


@lru_cache(maxsize=4)
def _optics(camera: Camera) -> _Optics:
    u, v = np.meshgrid(np.arange(-1.0, camera.width + 1), np.arange(-1.0, camera.height + 1))
    ahead = camera.unproject(np.column_stack([u.ravel(), v.ravel()]))
    if camera.model == "pinhole":
        ahead = ahead / ahead[:, 2:]
    ahead = ahead.reshape(*u.shape, 3)
    by_u = (ahead[1:-1, 2:] - ahead[1:-1, :-2]) / 2
    by_v = (ahead[2:, 1:-1] - ahead[:-2, 1:-1]) / 2
    ahead = ahead[1:-1, 1:-1]
    seen = np.asarray(np.isfinite(ahead).all(axis=2))
    if camera.model == "pinhole":
        pixel = 1.0 / camera.intrinsics[0]
        falloff = np.square(ahead[..., :2].astype(np.float32)).sum(axis=-1, keepdims=True)
    else:
        pixel = float(np.nanmedian(np.linalg.norm(by_v, axis=2)))
        angle = np.arccos(np.clip(np.where(seen, ahead[..., 2], 1.0), -1.0, 1.0))
        around = camera.model == "equirectangular"  # put together of several images
        falloff = (0.0 if around else 1.0) * np.square(angle)[..., None]
    return _Optics(
        np.where(seen[..., None], ahead, [0.0, 0.0, 1.0]).astype(np.float32),
        np.nan_to_num(by_u).astype(np.float32),
        np.nan_to_num(by_v).astype(np.float32),
        seen,
        (falloff / max(falloff.max(), 1e-12)).astype(np.float32),
        pixel,
    )


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
        (H, W, 3) uint8 RGB; black where no light reaches the sensor.
    """
    import cv2

    sensor = sensor or Sensor()
    optics = _optics(camera)
    ahead, by_u, by_v, pixel = optics.ahead, optics.by_u, optics.by_v, optics.pixel_rad
    R, origin = np.float32(T_world_camera[:3, :3]), np.float32(T_world_camera[:3, 3])
    rays = camera_rays(ahead.reshape(-1, 3), R, origin)
    radiance, hits, shadows = light.radiance(scene, rays, pixel)
    picture = radiance.reshape(camera.height, camera.width, 3)
    kind = np.where(hits.hit, 256 * (scene.material[hits.triangle] + 1) + shadows, 0)
    edges = silhouettes(picture, rays, hits.distance, hits.normal, kind.astype(np.int32), _CONTRAST)
    where = np.nonzero(edges)
    offsets = ((np.arange(_GRID) + 0.5) / _GRID - 0.5).astype(np.float32)
    total = np.zeros((len(where[0]), 3), np.float32)
    for dv in offsets:
        for du in offsets:
            fine = ahead[where] + du * by_u[where] + dv * by_v[where]
            finer = light.radiance(scene, camera_rays(fine, R, origin), pixel / _GRID)[0]
            total += np.minimum(finer, 4.0)
    picture[where] = total / _GRID**2
    picture[~optics.seen] = 0.0
    lit = hits.hit & optics.seen.ravel()
    middle = np.median(radiance[lit]) if lit.any() else 1.0
    picture *= sensor.exposure / max(float(middle), 1e-3)
    if sensor.blur_px > 0:
        picture = cv2.GaussianBlur(picture, (0, 0), sensor.blur_px)
    picture *= 1 - sensor.vignetting * optics.falloff
    noise = rng.standard_normal(picture.shape, np.float32)
    spread = np.sqrt(sensor.read_noise**2 + sensor.shot_noise**2 * np.maximum(picture, 0))
    picture = picture + noise * spread
    # a soft shoulder instead of hard clipping, then the display's gamma
    picture = np.where(picture > 0.7, 0.7 + 0.3 * np.tanh((picture - 0.7) / 0.3), picture)
    return np.asarray(np.rint(255 * np.clip(picture, 0, 1) ** (1 / 2.2)), np.uint8)


def kinds(
    scene: RayCaster, camera: Camera, T_world_camera: Array, names: Sequence[str]
) -> dict[str, NDArray[np.bool_]]:
    """What the middles of a camera's pixels see.

    Args:
        scene: What the camera sees.
        camera: Lens model.
        T_world_camera: 4x4 pose.
        names: Kinds of material, see `mesh.Material`.

    Returns:
        (H, W) masks by name.
    """
    optics = _optics(camera)
    R, origin = np.float32(T_world_camera[:3, :3]), np.float32(T_world_camera[:3, 3])
    hits = scene.cast(camera_rays(optics.ahead.reshape(-1, 3), R, origin))
    return {
        name: scene.of_kind(name, hits).reshape(optics.seen.shape) & optics.seen for name in names
    }
