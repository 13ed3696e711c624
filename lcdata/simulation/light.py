"""Light in a scene: sun or lamps with hard shadows, sky and haze."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lcdata.simulation import kernels
from lcdata.simulation.raycast import Hits, RayCaster

Float32 = NDArray[np.float32]


@dataclass(frozen=True)
class Lamp:
    """A light: the sun (a direction) or a lamp (a position).

    Args:
        xyz: Direction towards the sun, or position of the lamp in metres.
        color: Linear RGB of its light on a white surface that faces it (lamp: from 5 m).
        sun: Whether `xyz` is a direction.
    """

    xyz: tuple[float, float, float]
    color: tuple[float, float, float]
    sun: bool = True


@dataclass(frozen=True)
class Light:
    """All light of a scene.

    Args:
        lamps: Lights that cast shadows.
        above: Ambient linear RGB on surfaces that face up.
        below: Ambient linear RGB on surfaces that face down.
        sky: Linear RGB at the zenith.
        horizon: Linear RGB at the horizon.
        near_infrared: Ambient light at the LiDAR's wavelength, 0 ... 1.
    """

    lamps: tuple[Lamp, ...]
    above: tuple[float, float, float]
    below: tuple[float, float, float]
    sky: tuple[float, float, float] = (0.18, 0.35, 0.75)
    horizon: tuple[float, float, float] = (0.75, 0.82, 0.9)
    near_infrared: float = 1.0

    def radiance(
        self, scene: RayCaster, rays: Float32, pixel_rad: float
    ) -> tuple[Float32, Hits, NDArray[np.uint8]]:
        """Light that comes in along rays.

        Args:
            scene: What the rays meet.
            rays: (N, 6) origin (m) and unit direction.
            pixel_rad: Angle of one pixel, for the filtering of textures.

        Returns:
            (N, 3) linear RGB, the hits, and (N,) a bit for each lamp that is hidden.
        """
        hits = scene.cast(rays)
        distance = np.where(hits.hit, hits.distance, 0).astype(np.float32)
        points = rays[:, :3] + distance[:, None] * rays[:, 3:]
        footprint = pixel_rad * distance / np.maximum(hits.cosine, 0.15)
        albedo = scene.albedo(points, hits.triangle, footprint.astype(np.float32))
        light = kernels.ambient(
            hits.normal, np.array(self.above, np.float32), np.array(self.below, np.float32)
        )
        shadows = np.zeros(len(rays), np.uint8)
        for bit, lamp in enumerate(self.lamps):
            to_lamp, index, strength = kernels.shadow_rays(
                points, hits.normal, np.array(lamp.xyz, np.float32), lamp.sun
            )
            color = np.array(lamp.color, np.float32)
            blocked = scene.blocked(to_lamp)
            kernels.add_light(light, shadows, bit, index, strength, blocked, color)
        radiance = kernels.compose(
            rays,
            hits.normal,
            hits.cosine,
            albedo,
            light,
            scene.property_of("glow")[hits.triangle],
            scene.property_of("gloss")[hits.triangle],
            np.array(self.sky, np.float32),
            np.array(self.horizon, np.float32),
            np.array(self.below, np.float32),
        )
        return radiance, hits, shadows
