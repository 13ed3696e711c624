"""Simulated recordings: scenes, sensors, recorder."""

from __future__ import annotations

from lcdata.simulation.camera import CAMERAS
from lcdata.simulation.hand_held import simulate_hand_held
from lcdata.simulation.lidars import LIDARS
from lcdata.simulation.pairs import render_pair
from lcdata.simulation.record import simulate
from lcdata.simulation.scenes import SCENARIOS
from lcdata.simulation.world import World

__all__ = [
    "CAMERAS",
    "LIDARS",
    "SCENARIOS",
    "World",
    "render_pair",
    "simulate",
    "simulate_hand_held",
]
