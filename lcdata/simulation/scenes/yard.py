"""A back yard of about 15 m: house, shed, fence, steps, furniture, plants."""

from __future__ import annotations

import numpy as np

from lcdata.simulation.light import Lamp, Light
from lcdata.simulation.mesh import (
    TILE,
    Material,
    Parts,
    beam,
    box,
    cylinder,
    place,
    prism,
    quad,
    rectangle,
    sphere,
    wall,
)
from lcdata.simulation.scenes import Scene, props

Rng = np.random.Generator

FLAGS = Material("#b0a796", "#7a7263", TILE, (0.6, 0.6), 0.012, 0.16, 0.4)
STUCCO = Material("#d9c9a8", noise=0.09, grain=0.7)
ROOF_TILES = Material("#8c4534", "#5e2d22", TILE, (0.3, 0.35), 0.03, 0.18, 0.3)
GREEN_PAINT = Material("#3f6d55", "#2f5241", TILE, (0.16, 4.0), 0.01, 0.07, 0.3)
SOIL = Material("#4e3a2a", noise=0.4, grain=0.12)
TERRACOTTA = Material("#b5653f", noise=0.12, grain=0.15)
BIN = Material("#2f4a3a", noise=0.06, gloss=0.1)
CLOTH = ("#d64f3f", "#3f76c4", "#efe9da", "#e3b23c")
ROCK = Material("#8b8780", noise=0.3, grain=0.2)


def build(rng: Rng) -> Scene:
    """The yard; walls, shed, beds and furniture depend on the generator."""
    front, left, right = rng.uniform(7.8, 9.8), rng.uniform(5.2, 6.6), -rng.uniform(5.2, 6.6)
    rear = -rng.uniform(4.0, 5.5)
    fixed = props.ground(30.0, props.GRASS)
    fixed += rectangle(rear, right * 0.75, front, left * 0.62, 0.02, FLAGS)
    fixed += _house(rng, front, left, right)
    fixed += place(_fence(front - rear - 0.1), (rear, left, 0))
    fixed += place(_garden_wall(rng, front - rear), (front, right, 0), np.pi)
    fixed += place(_fence(left - right), (rear, right, 0), np.pi / 2)
    shed = (front - rng.uniform(3.0, 4.2), left - 1.6, 0)
    fixed += place(_shed(rng), shed, -np.pi / 2 + rng.uniform(-0.1, 0.1))
    fixed += place(_pergola(), (rng.uniform(4.4, 5.4), right + 1.7, 0), rng.uniform(-0.08, 0.08))
    fixed += _clutter(rng, front, left, right)
    seeds = rng.integers(2**32, size=12)
    plants = [
        (front - 1.0, right + 1.0, 1),
        (rng.uniform(2.5, 3.5), left - 0.9, 1),
        (rng.uniform(5.5, 6.5), left - 0.8, 1),
        (rng.uniform(1.0, 2.0), right + 0.8, 1),
        (front * 0.55, right - 2.2, 0),
        (front * 0.2, left + 2.0, 0),
        (rear - 1.6, 1.0, 0),
    ]
    stand = rng.uniform([3.6, -1.8], [5.6, 1.8])
    cloths = [Material(str(c), noise=0.08) for c in rng.permutation(CLOTH)]

    def moving(chance: Rng) -> Parts:
        parts: Parts = []
        for (x, y, is_bush), seed in zip(plants, seeds, strict=False):
            own = np.random.default_rng(seed)
            plant = props.bush(own, 0.65, chance) if is_bush else props.tree(own, 4.6, sway=chance)
            parts += place(plant, (x, y, 0))
        here = stand + chance.normal(scale=0.6, size=2)
        parts += place(props.person(chance), (*here, 0), chance.uniform(-np.pi, np.pi))
        for i, cloth in enumerate(cloths):
            y0 = -2.2 + 1.15 * i + chance.uniform(-0.1, 0.1)
            sag, blow = chance.uniform(-0.03, 0.03), chance.uniform(-0.15, 0.15)
            x = front - 2.6
            parts += quad(
                [x, y0, 2.05],
                [x, y0 + 0.8, 2.05 + sag],
                [x + blow, y0 + 0.8, 1.15],
                [x + blow, y0, 1.15],
                cloth,
            )
        return parts

    azimuth, height = rng.uniform(2.1, 4.2), rng.uniform(0.65, 1.0)
    sun = (np.cos(azimuth) * np.cos(height), np.sin(azimuth) * np.cos(height), np.sin(height))
    light = Light((Lamp(sun, (1.4, 1.28, 1.08)),), (0.46, 0.54, 0.66), (0.25, 0.26, 0.2))
    return Scene("yard", fixed, moving, light, rng.uniform(0.85, 1.15))


def _house(rng: Rng, front: float, left: float, right: float) -> Parts:
    """The back of the house: bricks below, stucco above, steps, bay, balcony, a roof overhead."""
    width = left - right + 4
    door = rng.uniform(0.42, 0.5) * width
    bay = door + rng.uniform(2.0, 2.6)
    frame = props.DARK_STEEL if rng.uniform() < 0.5 else props.WHITE
    openings = [(door, 0.45, door + 1.0, 2.5)]
    openings += [(x, 1.15, x + 1.2, 2.4) for x in (door - 4.2, door - 2.0) if x > 0.5]
    lower = wall(width, 2.9, props.RED_BRICK, openings, 0.15, props.GLASS, frame)
    upper_windows = [(x, 0.7, x + 1.1, 1.8) for x in np.arange(1.2, width - 2, 2.7)]
    upper = wall(width, 2.6, STUCCO, upper_windows, 0.1, props.GLASS)
    parts = lower + place(upper, (0, 0, 2.9))
    parts += box((1.0, 0.08, 2.05), GREEN_PAINT, (door + 0.5, 0.1, 0.45))
    for x0, z0, x1, _ in openings[1:]:
        parts += box((x1 - x0 + 0.2, 0.24, 0.07), props.CONCRETE, ((x0 + x1) / 2, -0.05, z0 - 0.07))
    parts += box((2.0, 1.6, 2.55), STUCCO, (bay + 1.0, 0, 0))
    parts += box((2.3, 1.95, 0.12), props.CONCRETE, (bay + 1.0, 0, 2.55))
    parts += box((1.3, 0.02, 1.2), props.GLASS, (bay + 1.0, -0.81, 0.95))
    parts += _balcony(door - rng.uniform(2.4, 3.2))
    treads = props.steps(3, 1.6, 0.15, 0.32, props.CONCRETE)
    parts += place(treads, (door + 0.5, -0.96, 0), np.pi / 2)
    for x in (door - 0.28, door + 1.28):
        for y in (-0.9, -0.1):
            parts += cylinder((x, y, 0), (x, y, 1.15 + 0.4 * (y > -0.5)), 0.022, props.STEEL)
        parts += cylinder((x, -0.9, 1.15), (x, -0.1, 1.55), 0.022, props.STEEL)
    eaves, ridge = (-0.6, 5.35), (3.5, 7.8)
    parts += quad([0, *eaves], [width, *eaves], [width, *ridge], [0, *ridge], ROOF_TILES)
    parts += cylinder((0, -0.62, 5.32), (width, -0.62, 5.32), 0.07, props.STEEL)
    pipe = rng.uniform(0.6, 1.4)
    parts += cylinder((pipe, -0.08, 0), (pipe, -0.08, 5.3), 0.05, props.STEEL)
    return place(parts, (front, left + 2, 0), -np.pi / 2)


def _balcony(x: float) -> Parts:
    """A slab with a railing on the house's wall, 2.6 m wide from `x`."""
    parts = box((2.6, 1.1, 0.16), props.CONCRETE, (x + 1.3, -0.55, 2.86))
    for at in (x + 0.05, x + 2.55):
        parts += beam((at, -1.05, 3.02), (at, 0, 3.02), 0.05, props.DARK_STEEL)
        parts += beam((at, -1.05, 3.95), (at, 0, 3.95), 0.05, props.DARK_STEEL)
    for z in (3.1, 3.95):
        parts += beam((x, -1.05, z), (x + 2.6, -1.05, z), 0.05, props.DARK_STEEL)
    for at in np.arange(x + 0.05, x + 2.6, 0.125):
        parts += beam((at, -1.05, 3.0), (at, -1.05, 3.95), 0.018, props.DARK_STEEL)
    return parts


def _fence(length: float) -> Parts:
    """A fence along x, seen from -y: posts, rails, and boards with gaps between."""
    parts: Parts = []
    for x in np.arange(0.0, length, 2.0):
        parts += box((0.1, 0.1, 1.95), props.GREY_TIMBER, (x, 0.08, 0))
    for z in (0.35, 1.5):
        parts += beam((0, 0.05, z), (length, 0.05, z), 0.06, props.GREY_TIMBER, 0.09)
    for i, x in enumerate(np.arange(0.08, length, 0.19)):
        tall = 1.78 + 0.02 * np.sin(7.3 * i)
        parts += box((0.15, 0.025, tall - 0.08), props.GREY_TIMBER, (x, 0, 0.08))
    return parts


def _garden_wall(rng: Rng, length: float) -> Parts:
    """A brick wall with piers and coping, a gate in it."""
    gate = rng.uniform(0.55, 0.7) * length
    parts: Parts = []
    for a, b in ((0.0, gate), (gate + 1.1, length)):
        parts += box((b - a, 0.24, 1.6), props.YELLOW_BRICK, ((a + b) / 2, 0.12, 0))
        parts += box((b - a, 0.34, 0.08), props.CONCRETE, ((a + b) / 2, 0.12, 1.6))
    for x in (gate, gate + 1.1, length * 0.25, length * 0.02):
        parts += box((0.38, 0.38, 1.85), props.YELLOW_BRICK, (x, 0.12, 0))
        parts += box((0.48, 0.48, 0.09), props.CONCRETE, (x, 0.12, 1.85))
    for x in np.arange(gate + 0.25, gate + 0.95, 0.11):
        parts += cylinder((x, 0.1, 0.05), (x, 0.1, 1.55), 0.011, props.DARK_STEEL, sides=8)
    for z in (0.2, 1.35):
        parts += beam((gate + 0.15, 0.1, z), (gate + 0.95, 0.1, z), 0.035, props.DARK_STEEL)
    return parts


def _shed(rng: Rng) -> Parts:
    """A garden shed of 2.6 m x 1.9 m with a gable roof, its door towards -x."""
    boards = GREEN_PAINT if rng.uniform() < 0.5 else props.TIMBER
    parts = box((1.9, 2.6, 2.0), boards)
    gable = np.array([[-1.3, 2.0], [1.3, 2.0], [0.0, 2.75]])
    parts += place(prism(gable, -0.95, 0.95, boards), (0, 0, 0), np.pi / 2)
    for y in (-1.0, 1.0):
        a, b = np.array([0.0, 2.82]), np.array([1.55 * y, 1.93])
        parts += quad(
            [-1.15, a[0], a[1]],
            [1.15, a[0], a[1]],
            [1.15, b[0], b[1]],
            [-1.15, b[0], b[1]],
            ROOF_TILES,
        )
        parts += beam((-1.15, b[0], b[1]), (1.15, b[0], b[1]), 0.05, props.WHITE, 0.1)
        parts += beam((-1.14, a[0], a[1]), (-1.14, b[0], b[1]), 0.05, props.WHITE, 0.12)
    parts += box((0.05, 0.85, 1.8), props.GREY_TIMBER, (-0.96, -0.5, 0.05))
    parts += box((0.05, 0.8, 0.6), props.WHITE, (-0.96, 0.65, 1.05))
    parts += box((0.04, 0.66, 0.46), props.GLASS, (-0.98, 0.65, 1.12))
    return parts + place(props.ladder(2.3, 0.22), (-1.5, 1.0, 0))


def _pergola() -> Parts:
    """Four posts, two beams, rafters across; a table under it."""
    parts: Parts = []
    for x in (-1.4, 1.4):
        for y in (-1.1, 1.1):
            parts += box((0.12, 0.12, 2.3), props.TIMBER, (x, y, 0))
    for y in (-1.1, 1.1):
        parts += beam((-1.7, y, 2.36), (1.7, y, 2.36), 0.1, props.TIMBER, 0.14)
    for x in np.arange(-1.5, 1.6, 0.5):
        parts += beam((x, -1.4, 2.48), (x, 1.4, 2.48), 0.06, props.TIMBER, 0.1)
    parts += box((1.5, 0.8, 0.05), props.TIMBER, (0, 0, 0.7))
    for x in (-0.65, 0.65):
        for y in (-0.32, 0.32):
            parts += box((0.07, 0.07, 0.7), props.TIMBER, (x, y, 0))
    for y in (-0.75, 0.75):
        parts += box((1.4, 0.28, 0.05), props.TIMBER, (0, y, 0.42))
        for x in (-0.55, 0.55):
            parts += box((0.06, 0.24, 0.42), props.TIMBER, (x, y, 0))
    return parts


def _clutter(rng: Rng, front: float, left: float, right: float) -> Parts:
    """Bench, bins, beds, pots, rocks, crates, clothes line."""
    parts = place(props.bench(), (front - 1.3, rng.uniform(-1.0, 1.0), 0))
    for i, y in enumerate((-2.4, -3.1)):
        bin_ = box((0.6, 0.58, 0.95), BIN) + box((0.66, 0.62, 0.08), BIN, (0, 0, 0.95))
        parts += place(bin_, (front - 0.7, y, 0), 0.1 * i)
    bed = box((2.6, 1.1, 0.38), props.TIMBER, top=SOIL)
    parts += place(bed, (rng.uniform(3.4, 4.2), left * 0.62, 0), rng.uniform(-0.1, 0.1))
    for _ in range(6):
        x, y = rng.uniform([2.8, right + 1.2], [front - 1.8, left - 2.2])
        size = rng.uniform(0.14, 0.26)
        pot = cylinder((0, 0, 0), (0, 0, 2 * size), size * 0.8, TERRACOTTA, size * 1.15)
        parts += place(pot, (x, y, 0))
    for _ in range(5):
        x, y = rng.uniform([2.6, right + 0.8], [front - 1.0, left - 1.0])
        parts += sphere((x, y, 0.1), rng.uniform(0.12, 0.3, 3), ROCK, 6, 0.25, rng)
    crates = props.stack(rng, 3, props.CARDBOARD)
    parts += place(crates, (front - 2.2, right * 0.5, 0), rng.uniform(0, 3))
    barrel = cylinder((0, 0, 0), (0, 0, 0.9), 0.3, props.DARK_STEEL, sides=24)
    parts += place(barrel, (front - 0.6, left * 0.55, 0))
    for y in (-2.6, 2.6):
        parts += cylinder((front - 2.6, y, 0), (front - 2.6, y, 2.2), 0.035, props.STEEL)
        parts += beam((front - 3.0, y, 2.15), (front - 2.2, y, 2.15), 0.05, props.STEEL)
    for x in (-0.35, 0.0, 0.35):
        at = front - 2.6 + x
        parts += cylinder((at, -2.6, 2.15), (at, 2.6, 2.15), 0.006, props.WHITE, sides=5)
    return parts
