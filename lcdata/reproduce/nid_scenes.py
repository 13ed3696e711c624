"""Simulated counterparts of Koide et al.'s four sensor combinations.

A spinning OS1-64 that a hand moves up and down for two seconds (its scans merged by its true
motion) and a Livox Avia that stands still for two; a pinhole camera with plumb_bob distortion and
a panoramic one. Each camera is fixed beside the LiDAR, and all scenes of a combination have its
extrinsic, so that they can be solved together.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lcdata.geometry import se3
from lcdata.geometry.camera import Camera
from lcdata.pair import Pair

Array = NDArray[np.float64]

SCENARIOS = ("gym", "yard", "parking_lot")

FORWARD = np.array([[0, -1, 0, 0], [0, 0, -1, 0], [1, 0, 0, 0], [0, 0, 0, 1.0]])
"""A camera that looks where the LiDAR's x axis points."""


@dataclass(frozen=True)
class Combination:
    """A LiDAR and a camera, and what the paper printed for them.

    Args:
        name: As the paper calls it.
        table: Where its single-shot figures stand.
        lidar: Name of the simulated model.
        omnidirectional: Camera with a panoramic image.
        paper_success: Initial guesses that succeeded, of 15.
        paper_single: Average single-shot error: metres, degrees.
        paper_joint: Error of all data together (Table IV): metres, degrees.
        paper_seconds: Initial guess and calibration of 15 pairs (Table V).
    """

    name: str
    table: str
    lidar: str
    omnidirectional: bool
    paper_success: int
    paper_single: tuple[float, float]
    paper_joint: tuple[float, float]
    paper_seconds: tuple[float, float]

    @property
    def camera(self) -> Camera:
        """Its camera."""
        if self.omnidirectional:
            return Camera("equirectangular", 2048, 1024, ())
        return Camera(
            "pinhole", 1280, 960, (860.0, 860.0, 637.0, 486.0), (-0.11, 0.08, 3e-4, -2e-4, -0.02)
        )

    @property
    def T_camera_lidar(self) -> Array:
        """4x4 extrinsic of all its scenes."""
        number = COMBINATIONS.index(self)
        rng = np.random.default_rng([number, 2023])
        beside = rng.uniform(0.05, 0.15, 3) * rng.choice([-1.0, 1.0], 3)
        turned = np.deg2rad(rng.uniform(-6.0, 6.0, 3))
        return np.asarray(se3.exp([*beside, *turned]) @ FORWARD)


COMBINATIONS = (
    Combination(
        "OS1-64 and pinhole", "I", "os1_64", False, 12, (0.043, 0.374), (0.034, 0.414), (10.3, 28.8)
    ),
    Combination(
        "Avia and pinhole", "II", "avia", False, 15, (0.059, 0.579), (0.010, 0.132), (10.6, 54.5)
    ),
    Combination(
        "OS1-64 and omnidirectional",
        "III",
        "os1_64",
        True,
        15,
        (0.069, 0.724),
        (0.082, 0.425),
        (11.2, 181.5),
    ),
    Combination(
        "Avia and omnidirectional",
        "III",
        "avia",
        True,
        10,
        (0.101, 0.807),
        (0.011, 0.400),
        (9.7, 84.3),
    ),
)


def scene(combination: Combination, number: int, seed: int) -> Pair:
    """One simulated scene of a combination, with its exact extrinsic.

    Args:
        combination: Sensors.
        number: Of the scene; scenarios take turns, each time with another layout.
        seed: Of layouts, people and noise.
    """
    from lcdata.simulation import render_pair

    scenario = SCENARIOS[number % len(SCENARIOS)]
    return render_pair(
        scenario,
        seed=1000 * seed + number,
        lidar=combination.lidar,
        moving=combination.lidar.startswith("os1"),
        camera=combination.camera,
        T_camera_lidar=combination.T_camera_lidar,
    )
