"""How a hand moves a LiDAR: up and down, swaying and turning a little, from rest."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

_AMPLITUDE = np.array([0.10, 0.10, 0.40, *np.deg2rad([3.0, 4.0, 8.0])])
"""Largest way along x, y, z (m) and about them (rad)."""
_PERIOD_S = np.array([3.7, 4.3, 2.9, 3.1, 4.7, 5.3])


@dataclass(frozen=True, eq=False)
class HandMotion:
    """A smooth motion that starts at rest, at the identity.

    Args:
        amplitude: (6,) largest way along x, y, z in metres and about them in radians, signed.
        period_s: (6,) of each.
    """

    amplitude: Array
    period_s: Array

    @classmethod
    def draw(cls, rng: np.random.Generator) -> HandMotion:
        """A motion of a few seconds as a person would make it."""
        return cls(
            _AMPLITUDE * rng.uniform(0.7, 1.1, 6) * rng.choice([-1.0, 1.0], 6),
            _PERIOD_S * rng.uniform(0.9, 1.1, 6),
        )

    def __call__(self, times: ArrayLike) -> Array:
        """(..., 4, 4) `T_start_now` at times in seconds; at rest before 0."""
        from scipy.spatial.transform import Rotation

        t = np.maximum(np.asarray(times, float), 0.0)[..., None]
        way = self.amplitude * (1 - np.cos(2 * np.pi * t / self.period_s)) / 2
        T = np.zeros((*way.shape[:-1], 4, 4))
        R = Rotation.from_euler("xyz", way[..., 3:].reshape(-1, 3)).as_matrix()
        T[..., :3, :3] = R.reshape(*way.shape[:-1], 3, 3)
        T[..., :3, 3] = way[..., :3]
        T[..., 3, 3] = 1.0
        return T
