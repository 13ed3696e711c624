"""A simulated Ouster OS1-128: scan geometry, noise, dropouts and the driver's fields."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lcdata.geometry import se3
from lcdata.simulation.raycast import RayCaster

Array = NDArray[np.float64]
Float32 = NDArray[np.float32]

RINGS = 128
COLUMNS = (512, 1024, 2048)
ELEVATION_DEG = 22.5
BEAM_ORIGIN_M = 0.01581
"""Beams start on a circle of this radius around the sensor's axis."""
STAGGER_DEG = (4.23, 1.41, -1.41, -4.23)
"""Azimuth offsets of the four columns of lasers, ring by ring."""
MIN_RANGE_M, MAX_RANGE_M = 0.3, 120.0
SCAN_NS = 100_000_000
_BEAM_STD_DEG = 0.025
_GRID_M = 2.0**-9

POINT = np.dtype(
    {
        "names": ["x", "y", "z", "intensity", "t", "reflectivity", "ring", "ambient", "range"],
        "formats": ["<f4", "<f4", "<f4", "<f4", "<u4", "<u2", "<u2", "<u2", "<u4"],
        "offsets": [0, 4, 8, 16, 20, 24, 26, 28, 32],
        "itemsize": 48,
    }
)
"""A point as the Ouster ROS driver lays it out, padding included."""


@dataclass(frozen=True)
class Ouster:
    """An Ouster OS1-128 that turns at 10 Hz.

    Frame: x forward, y left, z up. Columns run clockwise from behind (-x), so that the
    forward direction is in the middle of the organised scan. Ring 0 is the topmost.

    Args:
        columns: 512, 1024 or 2048 measurements a turn.
        azimuth_window_deg: Width of the sector around forward that it reports; None for all.
        noisy: False for perfect ranges and no dropouts, to check geometry with.
    """

    columns: int = 1024
    azimuth_window_deg: float | None = None
    noisy: bool = True

    def beams(self) -> tuple[Float32, Float32, NDArray[np.uint32], NDArray[np.bool_]]:
        """Directions of a scan's beams, row by row.

        Returns:
            (N, 3) beam origins and (N, 3) unit directions in the LiDAR frame, (N,) time since
            the scan's start in ns, (N,) whether the beam is inside the azimuth window.
        """
        elevation = np.deg2rad(np.linspace(ELEVATION_DEG, -ELEVATION_DEG, RINGS))[:, None]
        per_column = 360.0 / self.columns
        stagger = np.resize(STAGGER_DEG, RINGS)[:, None]
        shift = np.rint(stagger / per_column)  # the driver shifts rows so that columns line up
        measured = np.arange(self.columns)[None] + shift
        encoder = np.pi - np.deg2rad((measured + 0.5) * per_column)
        azimuth = encoder + np.deg2rad(stagger)
        direction = np.stack(
            [
                np.cos(elevation) * np.cos(azimuth),
                np.cos(elevation) * np.sin(azimuth),
                np.sin(elevation) + 0 * azimuth,
            ],
            -1,
        ).reshape(-1, 3)
        origin = BEAM_ORIGIN_M * np.stack(
            [np.cos(encoder), np.sin(encoder), 0 * encoder], -1
        ).reshape(-1, 3)
        t = (measured % self.columns) * (SCAN_NS / self.columns)
        inside = np.ones(azimuth.shape, bool)
        if self.azimuth_window_deg is not None:
            wrapped = (azimuth + np.pi) % (2 * np.pi) - np.pi
            inside = np.abs(wrapped) <= np.deg2rad(self.azimuth_window_deg) / 2
        return (
            origin.astype(np.float32),
            direction.astype(np.float32),
            t.ravel().astype(np.uint32),
            inside.ravel(),
        )

    def scan(
        self, scene: RayCaster, T_world_lidar: Array, sunlight: float, rng: np.random.Generator
    ) -> NDArray[np.void]:
        """One turn.

        Args:
            scene: What stands around the sensor.
            T_world_lidar: 4x4 pose of the sensor.
            sunlight: Ambient near-infrared light, 0 (hall) ... 1 (bright day).
            rng: Source of noise.

        Returns:
            (128 * columns,) records of `POINT`; beams without a return have x = y = z = 0.
        """
        origin, direction, t, inside = self.beams()
        records = np.zeros(len(t), POINT)
        records["t"] = np.where(inside, t, 0)  # nothing is sent of columns outside the window
        records["ring"] = np.repeat(np.arange(RINGS), self.columns)
        origin, direction, n = origin[inside], direction[inside], int(inside.sum())
        aim: NDArray[np.floating[Any]] = direction
        if self.noisy:  # the beam is some centimetres wide: which part returns is chance
            aim = direction + rng.normal(scale=np.deg2rad(_BEAM_STD_DEG), size=(n, 3))
            aim = aim / np.linalg.norm(aim, axis=1, keepdims=True)
        T = np.asarray(T_world_lidar, float)
        rays = np.concatenate([se3.apply(T, origin), aim @ T[:3, :3].T], axis=1)
        rays = np.ascontiguousarray(rays, np.float32)
        hits = scene.cast(rays)
        distance = np.where(hits.hit, hits.distance, 0.0)
        safe = np.maximum(distance, MIN_RANGE_M)
        triangle = hits.triangle
        points = (rays[:, :3] + distance[:, None] * rays[:, 3:]).astype(np.float32)
        footprint = (safe * np.deg2rad(0.2)).astype(np.float32)
        albedo = scene.albedo(points, triangle, footprint).mean(axis=1)
        reflectivity = np.clip(albedo * scene.property_of("near_infrared")[triangle], 0.01, 1.0)
        gloss = scene.property_of("gloss")[triangle]
        diffuse = hits.cosine * (1 - gloss) + gloss * hits.cosine**12
        signal = reflectivity * diffuse / (1 + (safe / 12.0) ** 2)
        returned = hits.hit & (distance >= MIN_RANGE_M) & (distance <= MAX_RANGE_M)
        ambient = sunlight * albedo * 900 * np.where(hits.hit, 1, 1.6)
        if self.noisy:
            weak = np.exp(-signal / 0.0012)
            returned &= rng.uniform(size=n) > 0.002 + weak
            spread = 0.008 + 0.0005 * safe + 0.002 / np.sqrt(np.maximum(signal, 0.002) * 20)
            distance = distance + rng.normal(size=n) * spread
            signal = signal * np.maximum(0.0, 1 + rng.normal(scale=0.06, size=n))
            ambient = ambient + rng.normal(scale=3, size=n)
        millimetres = np.rint(1000 * distance).astype(np.uint32)
        xyz = origin + (millimetres[:, None] / 1000) * direction
        if self.noisy:  # finer than any noise, and coordinates that compress
            xyz = np.rint(xyz / _GRID_M) * _GRID_M
        for k, axis in enumerate("xyz"):
            _put(records, axis, inside, returned, xyz[:, k])
        _put(records, "range", inside, returned, millimetres)
        _put(records, "intensity", inside, returned, np.rint(2500 * signal))
        _put(records, "reflectivity", inside, returned, np.rint(100 * reflectivity))
        _put(records, "ambient", inside, np.ones(n, bool), np.clip(np.rint(ambient), 0, 65535))
        return records


def _put(
    records: NDArray[np.void],
    name: str,
    inside: NDArray[np.bool_],
    returned: NDArray[np.bool_],
    values: NDArray[np.generic],
) -> None:
    """Fill one field of the beams in the window; zero where nothing returned."""
    records[name][inside] = np.where(returned, values, 0)
