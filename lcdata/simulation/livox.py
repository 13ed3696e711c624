"""A simulated Livox Avia: a rosette that never repeats, and the driver's points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lcdata.simulation.echoes import Motion, echoes, poses_at
from lcdata.simulation.raycast import RayCaster

Array = NDArray[np.float64]
Float32 = NDArray[np.float32]

LASERS = 6
POINTS_A_SECOND = 240_000
FIELD_OF_VIEW_DEG = (70.4, 77.2)
"""Horizontal and vertical, of the oval that the rosette fills."""
PRISM_HZ = (7294 / 60, -4664 / 60)
"""Turns of the two prisms a second: they repeat together only once a minute."""
LASER_SPACING_DEG = 0.28
MIN_RANGE_M, MAX_RANGE_M = 1.0, 190.0

POINT = np.dtype(
    [
        ("offset_time", "<u4"),
        ("x", "<f4"),
        ("y", "<f4"),
        ("z", "<f4"),
        ("reflectivity", "u1"),
        ("tag", "u1"),
        ("line", "u1"),
    ]
)
"""A point of `livox_ros_driver/CustomMsg`: nanoseconds since the message's timebase, metres."""

_SINGLE_RETURN = 0x10


@dataclass(frozen=True)
class Avia:
    """A Livox Avia that looks along x (y left, z up) and sends a message every 0.1 s.

    Args:
        noisy: False for perfect ranges and no dropouts, to check geometry with.
        scan_ns: Time between messages.
    """

    noisy: bool = True
    scan_ns: int = 100_000_000

    def beams(self, start_s: float = 0.0) -> tuple[Float32, NDArray[np.uint32], NDArray[np.uint8]]:
        """Directions of a message's beams.

        Two prisms turn against each other; each bends the beam by the same angle, so the beam
        draws petals through the middle of the field of view.

        Args:
            start_s: Time since the prisms' start.

        Returns:
            (N, 3) unit directions, (N,) nanoseconds since the start, (N,) laser.
        """
        count = round(POINTS_A_SECOND * self.scan_ns * 1e-9 / LASERS)
        t = (np.arange(count) * (self.scan_ns / count)).astype(np.uint32)
        first, second = (2 * np.pi * hz * (start_s + t[:, None] * 1e-9) for hz in PRISM_HZ)
        shift = (np.arange(LASERS) - (LASERS - 1) / 2) * LASER_SPACING_DEG
        wide, high = np.array(FIELD_OF_VIEW_DEG) / 2 - [0.0, shift[-1]]
        azimuth = np.deg2rad(wide * (np.cos(first) + np.cos(second)) / 2 + 0 * shift)
        elevation = np.deg2rad(high * (np.sin(first) + np.sin(second)) / 2 + shift)
        direction = np.stack(
            [
                np.cos(elevation) * np.cos(azimuth),
                np.cos(elevation) * np.sin(azimuth),
                np.sin(elevation),
            ],
            -1,
        ).reshape(-1, 3)
        line = np.tile(np.arange(LASERS, dtype=np.uint8), count)
        return direction.astype(np.float32), np.repeat(t, LASERS), line

    def scan(
        self,
        scene: RayCaster,
        T_world_lidar: Array | Motion,
        sunlight: float,
        rng: np.random.Generator,
        start_s: float = 0.0,
    ) -> NDArray[np.void]:
        """The points of one message.

        Args:
            scene: What stands around the sensor.
            T_world_lidar: 4x4 pose of the sensor; of a moving one, its pose at seconds since
                the scan's start.
            sunlight: Ambient near-infrared light, 0 (hall) ... 1 (bright day).
            rng: Source of noise.
            start_s: Time since the prisms' start: no two scans are alike.

        Returns:
            (N,) records of `POINT`; beams without a return have x = y = z = 0. Reflectivity is
            corrected for range, as the sensor does: 150 for a white surface that faces it.
        """
        direction, t, line = self.beams(start_s)
        if callable(T_world_lidar):
            T_world_lidar = poses_at(T_world_lidar, t * 1e-9)
        seen = echoes(
            scene,
            np.zeros_like(direction),
            direction,
            T_world_lidar,
            sunlight=sunlight,
            ranges_m=(MIN_RANGE_M, MAX_RANGE_M),
            rng=rng,
            noisy=self.noisy,
        )
        records = np.zeros(len(t), POINT)
        records["offset_time"], records["line"], records["tag"] = t, line, _SINGLE_RETURN
        for k, axis in enumerate("xyz"):
            records[axis] = np.where(seen.returned, seen.xyz[:, k], 0)
        strength = seen.strength
        if self.noisy:
            strength = strength * np.maximum(0.0, 1 + rng.normal(scale=0.06, size=len(t)))
        grey = np.clip(np.rint(150 * strength), 1, 255)
        records["reflectivity"] = np.where(seen.returned, grey, 0)
        return records
