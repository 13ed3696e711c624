"""A simulated Hesai Pandar64-like LiDAR: rings denser ahead, calibrated reflectivity."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lcdata.simulation.echoes import FALLOFF_M, Echoes
from lcdata.simulation.lidar import Ouster

ELEVATIONS_DEG = (
    *(14.9, 11.0, 8.0, 5.0, 3.0),
    *(2.0 - k / 6 for k in range(49)),
    *(-7.0 - k for k in range(8)),
    *(-19.0, -25.0),
)
"""64 lasers from top to bottom: a sixth of a degree apart where the road is."""
COLUMNS = 1800


@dataclass(frozen=True)
class Pandar(Ouster):
    """A spinning LiDAR whose intensity is the surface's, whatever its range; 10 Hz.

    Velodyne and Hesai report so, 0 ... 255; an Ouster's `intensity` falls with range. Fields and
    organisation are those of the simulated Ouster.
    """

    columns: int = COLUMNS
    rings: int = len(ELEVATIONS_DEG)
    stagger_deg: tuple[float, ...] = (0.0,)

    def elevations_deg(self) -> NDArray[np.float64]:
        """(rings,) of the lasers, from top to bottom."""
        return np.array(ELEVATIONS_DEG)

    def intensity(self, seen: Echoes) -> NDArray[np.floating[Any]]:
        """(N,) reflectivity with what incidence leaves of it, 255 for a white surface ahead."""
        metres = seen.millimetres / 1000
        return np.clip(255 * seen.signal * (1 + (metres / FALLOFF_M) ** 2), 0, 255)
