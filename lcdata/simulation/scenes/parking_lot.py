"""A car park of about 50 m between buildings."""

from __future__ import annotations

import numpy as np

from lcdata.simulation.light import Lamp, Light
from lcdata.simulation.mesh import (
    RIB,
    TILE,
    Material,
    Parts,
    beam,
    box,
    cylinder,
    place,
    rectangle,
)
from lcdata.simulation.scenes import Scene, buildings, props

Rng = np.random.Generator

PAVING = Material("#a39c92", "#716b63", TILE, (0.4, 0.4), 0.01, 0.14, 0.6)
CONTAINERS = ("#2f6b8f", "#a5482d", "#4d7350", "#b89b3a")


def build(rng: Rng) -> Scene:
    """The car park; facades, rows, cars and islands depend on the generator."""
    front, left, right = rng.uniform(22, 30), rng.uniform(15, 21), -rng.uniform(14, 20)
    fixed = props.ground(80.0, props.ASPHALT)
    tones = [buildings.FACADES[i] for i in rng.permutation(4)]
    fixed += buildings.block(rng, (front, left + 6), -np.pi / 2, left - right + 12, tones[0])
    fixed += buildings.block(rng, (-14.0, left), 0.0, 30.0, tones[1])
    fixed += buildings.block(rng, (front * 0.9, right), np.pi, 26.0, tones[2])
    fixed += buildings.block(rng, (-rng.uniform(22, 28), right - 8), np.pi / 2, 40.0, tones[3])
    fixed += rectangle(front - 2.2, right, front, left, 0.13, PAVING)
    fixed += box(
        (0.16, left - right - 3, 0.13), buildings.KERB, (front - 2.2, (left + right) / 2, 0)
    )
    trees: list[tuple[float, float, float]] = []
    fixed += _row(rng, front - 7.6, right + 3, left - 3, trees)
    fixed += _row(rng, rng.uniform(9.0, 11.0), right + 6.5, -3.6, trees)
    fixed += place(_row(rng, left - 7.6, 11.0 - front, 3.0), yaw=np.pi / 2)
    fixed += _street_furniture(rng, front, left, right)
    for y in rng.uniform(right + 3, left - 3, 2):
        trees.append((front - 1.2, y, rng.uniform(4.5, 6.5)))
    seeds = rng.integers(2**32, size=len(trees) + 1)
    people = [rng.uniform([5, right + 3], [front - 4, left - 4]) for _ in range(3)]

    def moving(chance: Rng) -> Parts:
        parts: Parts = []
        for (x, y, height), seed in zip(trees, seeds, strict=False):
            grown = props.tree(np.random.default_rng(seed), height, sway=chance)
            parts += place(grown, (x, y, 0))
        hedge = props.hedge(np.random.default_rng(seeds[-1]), 6.0, sway=chance)
        parts += place(hedge, (front * 0.55, right + 1.2, 0), np.pi / 2)
        for at in people:
            here = at + chance.normal(scale=0.8, size=2)
            parts += place(props.person(chance), (*here, 0), chance.uniform(-np.pi, np.pi))
        return parts

    azimuth, height = rng.uniform(1.9, 4.4), rng.uniform(0.6, 0.95)
    sun = (np.cos(azimuth) * np.cos(height), np.sin(azimuth) * np.cos(height), np.sin(height))
    light = Light((Lamp(sun, (1.35, 1.25, 1.08)),), (0.48, 0.56, 0.7), (0.24, 0.23, 0.22))
    return Scene("parking_lot", fixed, moving, light, rng.uniform(1.1, 1.5))


def _row(
    rng: Rng,
    x: float,
    y0: float,
    y1: float,
    trees: list[tuple[float, float, float]] | None = None,
) -> Parts:
    """A row of bays along y, cars' noses at `x` + 4.6; islands get trees if they can be noted."""
    parts: Parts = []
    bays = np.arange(y0, y1 - 2.4, 2.5)
    for i, y in enumerate(bays):
        parts += props.line((x, y), (x + 4.9, y), 0.11, props.PAINT)
        middle = y + 1.25
        if i % 6 == 3:
            parts += box((4.9, 1.8, 0.15), buildings.KERB, (x + 2.5, middle, 0), top=props.GRASS)
            if trees is not None:
                trees.append((x + 2.5, middle, rng.uniform(3.8, 5.5)))
            parts += place(props.sign(rng), (x + 0.6, middle, 0.1))
            continue
        parts += box((0.16, 1.7, 0.11), props.HAZARD, (x + 4.55, middle, 0))
        if rng.uniform() < 0.62:
            turn = np.pi if rng.uniform() < 0.4 else 0.0
            centre = (x + rng.uniform(2.1, 2.4), middle + rng.normal(scale=0.08), 0)
            parts += place(props.car(rng), centre, turn + rng.normal(scale=0.03))
    parts += props.line((x, bays[-1] + 2.5), (x + 4.9, bays[-1] + 2.5), 0.11, props.PAINT)
    return parts


def _street_furniture(rng: Rng, front: float, left: float, right: float) -> Parts:
    """Lamp posts, a container, arrows, a zebra crossing, bollards, a barrier, a shelter."""
    parts: Parts = []
    for x, y in ((front * 0.4, left - 2.0), (front - 2.8, right * 0.35), (front * 0.45, right + 2)):
        spot = (x + rng.uniform(-1, 1), y + rng.uniform(-1, 1), 0)
        parts += place(props.lamp_post(rng.uniform(5, 7)), spot, rng.uniform(-np.pi, np.pi))
    tone = Material(str(rng.choice(CONTAINERS)), "#24313a", RIB, (0.28, 1.0), noise=0.1, grain=1)
    container = box((6.06, 2.44, 2.5), tone)
    for x in (-2.98, 2.98):
        for y in (-1.17, 1.17):
            container += box((0.16, 0.16, 2.6), tone, (x, y, 0))
    parts += place(container, (front * 0.62, right + 2.4, 0), rng.uniform(-0.2, 0.2))
    near = rng.uniform(4.2, 6.0)
    for k in range(7):
        y = -3.4 + k
        parts += rectangle(near + 2.4, y, near + 4.9, y + 0.5, 0.004, props.PAINT)
    parts += props.line((near, -6), (near, 6), 0.15, props.PAINT)
    parts += props.line((1.5, 2.6), (near - 0.6, 2.6), 0.14, props.YELLOW_PAINT)
    parts += props.line((1.5, -2.6), (near - 0.6, -2.6), 0.14, props.YELLOW_PAINT)
    for y in (3.1, 4.4, 5.7):
        bollard = cylinder((0, 0, 0), (0, 0, 0.9), 0.08, props.YELLOW_PAINT, sides=16)
        bollard += cylinder((0, 0, 0.62), (0, 0, 0.75), 0.083, props.DARK_STEEL, sides=16)
        parts += place(bollard, (near + 2.2, y, 0))
    barrier = box((0.35, 0.3, 1.05), props.YELLOW_PAINT)
    barrier += beam((0, 0, 0.95), (0, -3.4, 0.95 + rng.uniform(0, 0.6)), 0.08, props.HAZARD)
    parts += place(barrier, (near + 1.2, -4.2, 0))
    shelter: Parts = []
    for x in (-1.5, 1.5):
        for y in (-0.7, 0.7):
            shelter += beam((x, y, 0), (x, y, 2.3 + 0.1 * (y > 0)), 0.08, props.DARK_STEEL)
    shelter += box((3.4, 1.8, 0.08), buildings.SHEET, (0, 0, 2.35))
    shelter += box((3.0, 0.03, 1.1), props.GLASS, (0, 0.7, 0.9))
    shelter += box((3.0, 0.03, 0.7), buildings.CLADDING, (0, 0.7, 0.15))
    shelter += box((1.0, 0.6, 1.15), buildings.DOOR, (-0.7, 0.2, 0))
    parts += place(shelter, (near + 0.5, right * 0.62, 0), np.pi + rng.uniform(-0.2, 0.4))
    crates = props.stack(rng, 3, props.CARDBOARD)
    return parts + place(crates, (near + rng.uniform(3, 5), left * 0.35, 0), rng.uniform(0, 3))
