"""Light in a scene: sun or lamps with hard shadows, sky and haze."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

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
        self, scene: RayCaster, origin: Float32, directions: Float32, pixel_rad: float
    ) -> tuple[Float32, Hits]:
        """Light that comes in along N rays.

        Args:
            scene: What the rays meet.
            origin: (3,) where they start, metres.
            directions: (N, 3) unit vectors.
            pixel_rad: Angle of one pixel, for the filtering of textures.

        Returns:
            (N, 3) linear RGB, and the hits.
        """
        hits = scene.cast(origin, directions)
        seen = np.flatnonzero(hits.hit)
        out = self._sky(directions)
        distance = hits.distance[seen]
        points = origin + distance[:, None] * directions[seen]
        normal, triangle = hits.normal[seen], hits.triangle[seen]
        footprint = distance * np.float32(pixel_rad) / np.maximum(hits.cosine[seen], 0.15)
        albedo = scene.albedo(points, triangle, footprint.astype(np.float32))
        up = 0.5 + 0.5 * normal[:, 2:]
        light = up * np.float32(self.above) + (1 - up) * np.float32(self.below)
        off_surface = points + 2e-3 * normal
        for lamp in self.lamps:
            towards = np.broadcast_to(np.float32(lamp.xyz), points.shape)
            reach: Float32 | float = 500.0
            fall = np.ones(len(points), np.float32)
            if not lamp.sun:
                towards = towards - off_surface
                reach = np.linalg.norm(towards, axis=1)
                fall = np.minimum(25.0 / reach**2, 4.0)
            towards = towards / np.linalg.norm(towards, axis=1, keepdims=True)
            facing = np.einsum("ni,ni->n", normal, towards)
            bright = np.flatnonzero(facing > 0)
            far = reach if isinstance(reach, float) else reach[bright]
            free = scene.lit(off_surface[bright], towards[bright], far)
            strength = facing[bright] * fall[bright] * free
            light[bright] += strength[:, None] * np.float32(lamp.color)
        out[seen] = albedo * (light + scene.property_of("glow")[triangle][:, None])
        gloss = scene.property_of("gloss")[triangle][:, None]
        mirrored = self._sky(
            directions[seen]
            - 2 * (np.einsum("ni,ni->n", directions[seen], normal)[:, None] * normal)
        )
        fresnel = gloss * (0.08 + 0.6 * (1 - hits.cosine[seen][:, None]) ** 3)
        out[seen] = out[seen] * (1 - fresnel) + fresnel * mirrored
        return out, hits

    def _sky(self, directions: Float32) -> Float32:
        """(N, 3) sky along directions; what looks down meets haze as bright as the ground."""
        height = np.clip(directions[:, 2:], 0, 1) ** 0.6
        below = np.clip(-3 * directions[:, 2:], 0, 1)
        sky = (1 - height) * np.float32(self.horizon) + height * np.float32(self.sky)
        return np.asarray((1 - below) * sky + below * np.float32(self.below), np.float32)
