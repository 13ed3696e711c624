"""Simulated recordings: scenes, sensors, recorder."""

from __future__ import annotations

from lcdata.simulation.camera import CAMERAS
from lcdata.simulation.hand_held import simulate_hand_held
from lcdata.simulation.lidars import LIDARS
from lcdata.simulation.pairs import SemanticMasks, render_pair, semantic_masks
from lcdata.simulation.record import simulate
from lcdata.simulation.scenes import SCENARIOS
from lcdata.simulation.world import World

__all__ = [
    "CAMERAS",
    "LIDARS",
    "SCENARIOS",
    "SemanticMasks",
    "World",
    "render_pair",
    "semantic_masks",
    "simulate",
    "simulate_hand_held",
]
