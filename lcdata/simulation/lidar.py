"""A simulated Ouster OS1: scan geometry and the driver's fields."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lcdata.simulation.echoes import Echoes, Motion, echoes, poses_at
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
    """An Ouster OS1 that turns at 10 Hz.

    Frame: x forward, y left, z up. Columns run clockwise from behind (-x), so that the
    forward direction is in the middle of the organised scan. Ring 0 is the topmost.

    Args:
        columns: 512, 1024 or 2048 measurements a turn.
        azimuth_window_deg: Width of the sector around forward that it reports; None for all.
        noisy: False for perfect ranges and no dropouts, to check geometry with.
        rings: Lasers, one above the other.
        elevation_deg: Of the topmost laser; of the lowest it is the negative.
        stagger_deg: Azimuth offsets of the columns of lasers, ring by ring.
    """

    columns: int = 1024
    azimuth_window_deg: float | None = None
    noisy: bool = True
    rings: int = RINGS
    elevation_deg: float = ELEVATION_DEG
    stagger_deg: tuple[float, ...] = STAGGER_DEG

    @property
    def scan_ns(self) -> int:
        """Time of a turn, nanoseconds."""
        return SCAN_NS

    def elevations_deg(self) -> Array:
        """(rings,) of the lasers, from top to bottom."""
        return np.linspace(self.elevation_deg, -self.elevation_deg, self.rings)

    def intensity(self, seen: Echoes) -> NDArray[np.floating[Any]]:
        """(N,) what it reports: photons, which fall with range."""
        return 2500 * seen.signal

    def beams(self) -> tuple[Float32, Float32, NDArray[np.uint32], NDArray[np.bool_]]:
        """Directions of a scan's beams, row by row.

        Returns:
            (N, 3) beam origins and (N, 3) unit directions in the LiDAR frame, (N,) time since
            the scan's start in ns, (N,) whether the beam is inside the azimuth window.
        """
        elevation = np.deg2rad(self.elevations_deg())[:, None]
        per_column = 360.0 / self.columns
        stagger = np.resize(self.stagger_deg, self.rings)[:, None]
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
        self,
        scene: RayCaster,
        T_world_lidar: Array | Motion,
        sunlight: float,
        rng: np.random.Generator,
        start_s: float = 0.0,
    ) -> NDArray[np.void]:
        """One turn.

        Args:
            scene: What stands around the sensor.
            T_world_lidar: 4x4 pose of the sensor; of a moving one, its pose at seconds since
                the scan's start.
            sunlight: Ambient near-infrared light, 0 (hall) ... 1 (bright day).
            rng: Source of noise.
            start_s: Does not matter: every turn is like the first.

        Returns:
            (rings * columns,) records of `POINT`; beams without a return have x = y = z = 0.
        """
        origin, direction, t, inside = self.beams()
        records = np.zeros(len(t), POINT)
        records["t"] = np.where(inside, t, 0)  # nothing is sent of columns outside the window
        records["ring"] = np.repeat(np.arange(self.rings), self.columns)
        if callable(T_world_lidar):
            T_world_lidar = poses_at(T_world_lidar, t[inside] * 1e-9)
        seen = echoes(
            scene,
            origin[inside],
            direction[inside],
            T_world_lidar,
            sunlight=sunlight,
            ranges_m=(MIN_RANGE_M, MAX_RANGE_M),
            rng=rng,
            noisy=self.noisy,
        )
        returned, n = seen.returned, int(inside.sum())
        for k, axis in enumerate("xyz"):
            _put(records, axis, inside, returned, seen.xyz[:, k])
        _put(records, "range", inside, returned, seen.millimetres)
        _put(records, "intensity", inside, returned, np.rint(self.intensity(seen)))
        _put(records, "reflectivity", inside, returned, np.rint(100 * seen.reflectivity))
        ambient = np.clip(np.rint(seen.ambient), 0, 65535)
        _put(records, "ambient", inside, np.ones(n, bool), ambient)
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
