"""Initial guesses of PLK-Calib's figures, made from the ground truth."""

from __future__ import annotations

from dataclasses import dataclass
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from lcdata.evaluation.protocol import Protocol
from lcdata.geometry import se3

Array = NDArray[np.float64]

AXES = "xyz"


@dataclass(frozen=True)
class RandomSigns:
    """Figure 5: an error of one size on each axis, signs by chance.

    Args:
        rotation_deg: About each axis, degrees.
        translation_m: Along each axis, metres.
        seed: Of the signs.
    """

    rotation_deg: float
    translation_m: float
    seed: int

    @property
    def name(self) -> str:
        """What it is called in kept rows."""
        return f"{self.rotation_deg:g} deg, {self.translation_m:g} m, seed {self.seed}"

    def guess(self, T_camera_lidar: Array, pair_id: str) -> Array:
        """4x4 initial guess, the one that `lcdata calibrate` starts from."""
        protocol = Protocol(self.rotation_deg, self.translation_m, seed=self.seed)
        return protocol.initial_guess(T_camera_lidar, (pair_id,), 0)


@dataclass(frozen=True)
class Offset:
    """Figure 6: the LiDAR moved along and turned about axes of its own.

    The turn leaves the LiDAR's origin where the camera sees it, as the paper keeps the translation.

    Args:
        metres: Along `translation_axis`.
        degrees: About `rotation_axis`.
        translation_axis: x, y or z of the LiDAR.
        rotation_axis: The same.
        any_sign: The turn's sign is by the pair's name, where both are offset.
    """

    metres: float = 0.0
    degrees: float = 0.0
    translation_axis: str = "y"
    rotation_axis: str = "z"
    any_sign: bool = False

    @property
    def name(self) -> str:
        """What it is called in kept rows."""
        sign = "±" if self.any_sign else ""
        return (
            f"{self.translation_axis}{self.metres:+g} m, "
            f"{self.rotation_axis}{sign}{self.degrees:+g} deg"
        )

    def guess(self, T_camera_lidar: Array, pair_id: str) -> Array:
        """4x4 initial guess."""
        flipped = self.any_sign and crc32(pair_id.encode()) & 1
        twist = np.zeros(6)
        twist[3 + AXES.index(self.rotation_axis)] = np.deg2rad(
            -self.degrees if flipped else self.degrees
        )
        moved = se3.exp(twist)
        moved[AXES.index(self.translation_axis), 3] = self.metres
        return np.asarray(T_camera_lidar @ moved)
