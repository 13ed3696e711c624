"""Scenes: world frame with x forward from the tower, z up, origin on the ground below it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from zlib import crc32

import numpy as np

from lcdata.errors import SimulationError
from lcdata.simulation.light import Light
from lcdata.simulation.mesh import Parts

SCENARIOS = ("parking_lot", "gym", "yard", "road")


@dataclass(frozen=True, eq=False)
class Scene:
    """A place and what moves in it.

    Args:
        name: Its scenario.
        fixed: What stands still, for the whole recording.
        moving: Draws people and leaves anew for every pair.
        light: Its lights.
        base_height_m: Height of the arm's base on the tower above the ground.
    """

    name: str
    fixed: Parts
    moving: Callable[[np.random.Generator], Parts]
    light: Light
    base_height_m: float


def scenario_rng(seed: int, scenario: str, *stream: int) -> np.random.Generator:
    """A source of chance of its own for every purpose: scene, sensor, pose, pair."""
    return np.random.default_rng([seed, crc32(scenario.encode()), *stream])


def build_scene(scenario: str, seed: int, stop: int = 0) -> Scene:
    """The scene of a scenario; every seed, and every stop of a car, lays it out differently.

    Raises:
        SimulationError: Unknown scenario.
    """
    if scenario not in SCENARIOS:
        raise SimulationError(
            f"unknown scenario {scenario!r}", f"choose from {', '.join(SCENARIOS)}"
        )
    module = import_module(f"lcdata.simulation.scenes.{scenario}")
    scene: Scene = module.build(scenario_rng(seed, scenario, 0, *([stop] if stop else [])))
    return scene
