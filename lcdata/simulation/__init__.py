"""Simulated recordings: scenes, sensors, recorder."""

from __future__ import annotations

from lcdata.simulation.lidars import LIDARS
from lcdata.simulation.pairs import render_pair
from lcdata.simulation.record import simulate
from lcdata.simulation.scenes import SCENARIOS
from lcdata.simulation.world import World

__all__ = ["LIDARS", "SCENARIOS", "World", "render_pair", "simulate"]
