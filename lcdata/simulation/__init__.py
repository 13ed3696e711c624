"""Simulated recordings: scenes, sensors, recorder."""

from __future__ import annotations

from lcdata.simulation.record import simulate
from lcdata.simulation.scenes import SCENARIOS
from lcdata.simulation.world import World, render_pair

__all__ = ["SCENARIOS", "World", "render_pair", "simulate"]
