"""LiDARs by name."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from lcdata.errors import SimulationError
from lcdata.simulation.echoes import Motion
from lcdata.simulation.lidar import COLUMNS, Ouster
from lcdata.simulation.livox import Avia
from lcdata.simulation.pandar import Pandar
from lcdata.simulation.raycast import RayCaster

Array = NDArray[np.float64]

OS1_64_ELEVATION_DEG = 16.6
OS1_64_STAGGER_DEG = (3.164, 1.055, -1.055, -3.164)
"""Of the first generation, which Koide et al. calibrated."""


class Lidar(Protocol):
    """What all simulated LiDARs do."""

    @property
    def scan_ns(self) -> int:
        """Time that a scan takes, nanoseconds."""

    def scan(
        self,
        scene: RayCaster,
        T_world_lidar: Array | Motion,
        sunlight: float,
        rng: np.random.Generator,
        start_s: float = 0.0,
    ) -> NDArray[np.void]:
        """(N,) structured points of one scan; without a return x = y = z = 0."""


def _os1_128(columns: int | None, window: float | None) -> Lidar:
    return Ouster(columns or 2048, window)


def _os1_64(columns: int | None, window: float | None) -> Lidar:
    return Ouster(
        columns or 1024,
        window,
        rings=64,
        elevation_deg=OS1_64_ELEVATION_DEG,
        stagger_deg=OS1_64_STAGGER_DEG,
    )


def _pandar_64(columns: int | None, window: float | None) -> Lidar:
    if columns is not None:
        raise SimulationError("a Pandar64 has 1800 columns", "leave --columns out, or take an os1")
    return Pandar(azimuth_window_deg=window)


def _avia(columns: int | None, window: float | None) -> Lidar:
    if columns is not None or window is not None:
        raise SimulationError(
            "an Avia has neither columns nor an azimuth window", "leave them out, or take an os1"
        )
    return Avia()


LIDARS: dict[str, Callable[[int | None, float | None], Lidar]] = {
    "os1_128": _os1_128,
    "os1_64": _os1_64,
    "avia": _avia,
    "pandar_64": _pandar_64,
}
"""Makers of the models, from columns and azimuth window."""


def make_lidar(
    name: str, columns: int | None = None, azimuth_window_deg: float | None = None
) -> Lidar:
    """A LiDAR.

    Args:
        name: os1_128, os1_64, pandar_64 (all spin at 10 Hz) or avia (draws a rosette).
        columns: Of an os1, measurements a turn: 512, 1024 or 2048; None for the usual.
        azimuth_window_deg: Of a spinning one, sector ahead that it reports; None for all.

    Raises:
        SimulationError: Unknown name, or a choice that it does not have.
    """
    make = LIDARS.get(name)
    if make is None:
        raise SimulationError(f"unknown LiDAR {name!r}", f"choose from {', '.join(LIDARS)}")
    if columns is not None and columns not in COLUMNS:
        raise SimulationError(
            f"unknown number of columns {columns}", f"choose from {', '.join(map(str, COLUMNS))}"
        )
    return make(columns, azimuth_window_deg)
