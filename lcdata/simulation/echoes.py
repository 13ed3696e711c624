"""What comes back of a LiDAR's pulses: range, strength, noise, dropouts. Any scan pattern."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lcdata.geometry import se3
from lcdata.simulation.raycast import RayCaster

Array = NDArray[np.float64]
Float32 = NDArray[np.float32]
Motion = Callable[[Array], Array]
"""4x4 poses (..., 4, 4) of a sensor in the world at times (...,) in seconds."""

_BEAM_STD_DEG = 0.025
_GRID_M = 2.0**-9
FALLOFF_M = 12.0
"""From about this range on the signal falls with its square."""


@dataclass(frozen=True, eq=False)
class Echoes:
    """What N pulses met.

    Args:
        returned: (N,) whether anything came back.
        millimetres: (N,) range.
        xyz: (N, 3) in the sensor's frame at the moment of the pulse, metres.
        signal: (N,) strength; it falls with range and incidence.
        reflectivity: (N,) of the surface at the LiDAR's wavelength, 0 ... 1.
        strength: (N,) what incidence and gloss leave of it, and what comes straight back at any.
        ambient: (N,) near-infrared light of the surroundings.
    """

    returned: NDArray[np.bool_]
    millimetres: NDArray[np.uint32]
    xyz: Array
    signal: Array
    reflectivity: Array
    strength: Array
    ambient: Array


def echoes(
    scene: RayCaster,
    origin: Float32,
    direction: Float32,
    T_world_lidar: Array,
    *,
    sunlight: float,
    ranges_m: tuple[float, float],
    rng: np.random.Generator,
    noisy: bool = True,
) -> Echoes:
    """Cast a scan's beams.

    Args:
        scene: What stands around the sensor.
        origin: (N, 3) where the beams start, in the sensor's frame, metres.
        direction: (N, 3) unit vectors.
        T_world_lidar: 4x4 pose of the sensor, or (N, 4, 4) poses at the moments of the pulses.
        sunlight: Ambient near-infrared light, 0 (hall) ... 1 (bright day).
        ranges_m: Least and greatest range that is reported.
        rng: Source of noise.
        noisy: False for perfect ranges and no dropouts.
    """
    n = len(direction)
    nearest, farthest = ranges_m
    aim: NDArray[np.floating[Any]] = direction
    if noisy:  # the beam is some centimetres wide: which part returns is chance
        aim = direction + rng.normal(scale=np.deg2rad(_BEAM_STD_DEG), size=(n, 3))
        aim = aim / np.linalg.norm(aim, axis=1, keepdims=True)
    rays = _rays(np.asarray(T_world_lidar, float), origin, aim)
    hits = scene.cast(rays)
    distance = np.where(hits.hit, hits.distance, 0.0)
    safe = np.maximum(distance, nearest)
    triangle = hits.triangle
    points = (rays[:, :3] + distance[:, None] * rays[:, 3:]).astype(np.float32)
    footprint = (safe * np.deg2rad(0.2)).astype(np.float32)
    albedo = scene.albedo(points, triangle, footprint).mean(axis=1)
    reflectivity = np.clip(albedo * scene.property_of("near_infrared")[triangle], 0.01, 1.0)
    gloss = scene.property_of("gloss")[triangle]
    diffuse = hits.cosine * (1 - gloss) + gloss * hits.cosine**12
    retro = scene.property_of("retro")[triangle]
    strength = reflectivity * diffuse + retro
    signal = strength / (1 + (safe / FALLOFF_M) ** 2)
    returned = hits.hit & (distance >= nearest) & (distance <= farthest)
    ambient = sunlight * albedo * 900 * np.where(hits.hit, 1, 1.6)
    if noisy:
        weak = np.exp(-signal / 0.0012)
        returned &= rng.uniform(size=n) > 0.002 + weak
        spread = 0.008 + 0.0005 * safe + 0.002 / np.sqrt(np.maximum(signal, 0.002) * 20)
        distance = distance + rng.normal(size=n) * spread
        signal = signal * np.maximum(0.0, 1 + rng.normal(scale=0.06, size=n))
        ambient = ambient + rng.normal(scale=3, size=n)
    millimetres = np.rint(1000 * distance).astype(np.uint32)
    xyz = origin + (millimetres[:, None] / 1000) * direction
    if noisy:  # finer than any noise, and coordinates that compress
        xyz = np.rint(xyz / _GRID_M) * _GRID_M
    return Echoes(returned, millimetres, xyz, signal, reflectivity, strength, ambient)


def poses_at(motion: Motion, times: NDArray[np.floating[Any]]) -> Array:
    """(N, 4, 4) poses at (N,) times in seconds, many of which are equal: lasers fire together."""
    moments, index = np.unique(times, return_inverse=True)
    return np.asarray(motion(moments)[index])


def _rays(T: Array, origin: Float32, aim: NDArray[np.floating[Any]]) -> Float32:
    """(N, 6) rays in the world, of one pose or of a pose for each."""
    if T.ndim == 2:
        start, ahead = se3.apply(T, origin), aim @ T[:3, :3].T
    else:
        start = np.einsum("nij,nj->ni", T[:, :3, :3], origin) + T[:, :3, 3]
        ahead = np.einsum("nij,nj->ni", T[:, :3, :3], aim)
    return np.ascontiguousarray(np.concatenate([start, ahead], axis=1), np.float32)
