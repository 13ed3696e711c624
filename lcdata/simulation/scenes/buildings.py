"""Buildings whose facades stand along streets and squares."""

from __future__ import annotations

import numpy as np

from lcdata.simulation.mesh import RIB, TILE, Material, Parts, box, cylinder, place, wall
from lcdata.simulation.scenes import props

Rng = np.random.Generator

RENDER = Material("#c9bda2", noise=0.08, grain=1.5)
CLADDING = Material("#8f9ba3", "#6a747b", TILE, (1.5, 0.9), 0.02, 0.05, 0.8, gloss=0.15)
SHEET = Material("#7f8b8a", "#5f6968", RIB, (0.22, 1.0), noise=0.06, gloss=0.15)
KERB = Material("#b4b1a8", "#77756f", TILE, (1.0, 0.5), 0.012, 0.15, 0.3)
DOOR = Material("#6f3b2c", "#4a261c", TILE, (0.5, 1.0), 0.02, 0.06)
FACADES = (props.RED_BRICK, RENDER, props.YELLOW_BRICK, CLADDING)


def block(
    rng: Rng,
    corner: tuple[float, float],
    yaw: float,
    width: float,
    tone: Material,
    most_storeys: int = 3,
) -> Parts:
    """A block whose facade starts at `corner`: rows of windows, doors, sills, a parapet."""
    storey, storeys = rng.uniform(3.0, 3.4), int(rng.integers(2, most_storeys + 1))
    height = storey * storeys + 0.8
    pitch, share = rng.uniform(2.6, 3.6), rng.uniform(0.45, 0.62)
    door = int(rng.integers(1, max(2, int(width / pitch) - 1)))
    openings = []
    for i, x in enumerate(np.arange(0.8, width - pitch, pitch)):
        for level in range(storeys):
            z = storey * level + 1.0
            if level == 0 and i % 5 == door % 5:
                openings.append((x, 0.0, x + 1.3, 2.3))
            elif rng.uniform() < 0.9:
                openings.append((x, z, x + share * pitch, z + 1.45))
    doors = [o for o in openings if o[1] == 0.0]
    windows = [o for o in openings if o[1] > 0.0]
    parts = wall(width, height, tone, openings, 0.2, props.GLASS)
    frame = props.WHITE if rng.uniform() < 0.6 else props.DARK_STEEL
    for x0, z0, x1, z1 in windows:
        parts += box((x1 - x0 + 0.16, 0.22, 0.06), KERB, ((x0 + x1) / 2, -0.03, z0 - 0.06))
        parts += box((0.06, 0.06, z1 - z0), frame, ((x0 + x1) / 2, 0.16, z0))
        for x in (x0 + 0.03, x1 - 0.03):
            parts += box((0.06, 0.06, z1 - z0), frame, (x, 0.16, z0))
        parts += box((x1 - x0, 0.06, 0.06), frame, ((x0 + x1) / 2, 0.16, z0 + 1.0))
    for x0, _, x1, z1 in doors:
        parts += box((x1 - x0, 0.06, z1), DOOR, ((x0 + x1) / 2, 0.14, 0))
        parts += box((2.4, 1.3, 0.14), props.CONCRETE, ((x0 + x1) / 2, -0.65, z1 + 0.25))
        for x in (x0 - 0.45, x1 + 0.45):
            parts += cylinder((x, -1.2, 0), (x, -1.2, z1 + 0.25), 0.05, props.STEEL, sides=12)
    parts += box((width + 0.3, 0.5, 0.25), KERB, (width / 2, 0.05, height))
    parts += box((width, 0.12, 0.5), props.CONCRETE, (width / 2, -0.02, 0.0))
    for x in (0.3, width * 0.5, width - 0.3):
        parts += cylinder((x, -0.08, 0), (x, -0.08, height), 0.055, props.STEEL, sides=10)
    parts += box((width, 9.0, height - 0.1), SHEET, (width / 2, 4.8, 0))
    return place(parts, (*corner, 0.0), yaw)
