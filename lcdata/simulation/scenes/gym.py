"""A sports hall of about 26 m x 18 m x 7.5 m."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from lcdata.simulation.light import Lamp, Light
from lcdata.simulation.mesh import (
    PLANK,
    RIB,
    TILE,
    Material,
    Parts,
    beam,
    box,
    cylinder,
    place,
    quad,
    rectangle,
    sphere,
    wall,
)
from lcdata.simulation.scenes import Scene, props

Rng = np.random.Generator

FLOOR = Material("#b98d57", "#7d5a33", PLANK, (1.6, 0.11), 0.004, 0.1, 0.4, gloss=0.1)
PLASTER = Material("#d8d3c4", noise=0.06, grain=1.2)
PANEL = Material("#c9a877", "#6b5233", TILE, (1.2, 2.2), 0.02, 0.1, 0.5)
MAT = Material("#2d5f9a", "#1d4068", TILE, (1.0, 2.0), 0.02, 0.08, 0.4)
RED_MAT = Material("#a8322d", "#e0ddd2", TILE, (2.0, 0.4), 0.03, 0.08, 0.3)
ROOF = Material("#b9bcbe", "#8b8e90", RIB, (0.25, 1.0), noise=0.05)
DAYLIGHT = Material("#dfe8ef", noise=0.04, near_infrared=0.5, gloss=0.85, glow=0.9)
BACKBOARD = Material("#f0efe9", noise=0.03)
RED_PAINT = Material("#b3352b", noise=0.05)
BLUE_PAINT = Material("#27507f", noise=0.05)
BALL = Material("#c8692c", noise=0.1, grain=0.05)


def build(rng: Rng) -> Scene:
    """The hall; its size, doors, apparatus and clutter depend on the generator."""
    length, width, height = rng.uniform(23, 29), rng.uniform(15.5, 19), rng.uniform(6.8, 8.2)
    x0, y0 = -length * rng.uniform(0.28, 0.36), -width * rng.uniform(0.44, 0.56)
    x1, y1 = x0 + length, y0 + width
    fixed = rectangle(x0, y0, x1, y1, 0.0, FLOOR)
    fixed += quad([x0, y0, height], [x0, y1, height], [x1, y1, height], [x1, y0, height], ROOF)
    fixed += _walls(rng, x0, y0, x1, y1, height)
    fixed += _frame(x0, y0, x1, y1, height)
    fixed += _court(x0 + 1.2, y0 + 1.2, x1 - 1.2, y1 - 1.2)
    fixed += place(_hoop(), (x1 - 0.9, (y0 + y1) / 2 + rng.uniform(-1, 1), 0))
    fixed += place(_hoop(), (x0 + 0.9, (y0 + y1) / 2, 0), np.pi)
    fixed += place(_wall_bars(), (x1 - 0.2, y1 - rng.uniform(2.0, 4.0), 0))
    fixed += place(_wall_bars(), (x1 - 0.2, y0 + rng.uniform(2.0, 3.5), 0))
    stand = rng.uniform(5.0, 7.0)
    tiers = props.steps(4, stand, 0.42, 0.75, props.TIMBER)
    fixed += place(tiers, (x1 * rng.uniform(0.45, 0.6), y1 - 3.1, 0), np.pi / 2)
    fixed += _apparatus(rng, x1, y0, y1)
    people = [rng.uniform([4, y0 + 2], [x1 - 2, y1 - 4]) for _ in range(3)]

    def moving(chance: Rng) -> Parts:
        parts: Parts = []
        for at in people:
            here = at + chance.normal(scale=0.7, size=2)
            parts += place(props.person(chance), (*here, 0), chance.uniform(-np.pi, np.pi))
        for _ in range(6):
            ball = chance.uniform([3, y0 + 1], [x1 - 1, y1 - 4])
            parts += sphere((*ball, 0.12), (0.12, 0.12, 0.12), BALL, 10)
        return parts

    warm = (0.62, 0.6, 0.56)
    lamps = (
        Lamp((x1 * 0.35, y0 * 0.4, height - 0.8), warm, sun=False),
        Lamp((x1 * 0.75, y1 * 0.5, height - 0.8), warm, sun=False),
    )
    light = Light(
        lamps, (0.5, 0.5, 0.5), (0.34, 0.3, 0.26), (0.6, 0.7, 0.8), (0.8, 0.85, 0.9), 0.08
    )
    return Scene("gym", fixed, moving, light, rng.uniform(0.9, 1.3))


def _walls(rng: Rng, x0: float, y0: float, x1: float, y1: float, height: float) -> Parts:
    length, width = x1 - x0, y1 - y0

    def windows(span: float, pitch: float) -> list[tuple[float, float, float, float]]:
        starts = np.arange(pitch * 0.3, span - pitch * 0.7, pitch)
        return [(s, height - 2.6, s + pitch * 0.62, height - 1.0) for s in starts]

    door = rng.uniform(1.5, width - 4)
    doors = [(door, 0.0, door + 1.9, 2.2), (width - door - 1, 0.0, width - door, 2.1)]
    side_doors = [(length * 0.62, 0.0, length * 0.62 + 1.1, 2.1)]
    sides = {
        "front": wall(width, height, PLASTER, doors[: rng.integers(1, 3)], 0.25, BLUE_PAINT),
        "rear": wall(width, height, PLASTER, doors[:1], 0.25, RED_PAINT),
        "left": wall(length, height, PLASTER, windows(length, 4.2), 0.3, DAYLIGHT, props.WHITE),
        "right": wall(
            length,
            height,
            props.YELLOW_BRICK,
            windows(length, 5.0) + side_doors,
            0.22,
            DAYLIGHT,
            props.WHITE,
        ),
    }
    parts = props.room(x0, y0, x1, y1, sides)
    # mats to 2 m on the end walls, panelling on the left one
    left, right = sorted((y1 - door, y1 - door - 1.9))
    for a, b in ((y0, left - 0.15), (right + 0.15, y1)):
        if b - a > 0.5:
            parts += box((0.09, b - a, 2.0), MAT, (x1 - 0.045, (a + b) / 2, 0.05))
    parts += box((length, 0.06, 2.3), PANEL, ((x0 + x1) / 2, y1 - 0.03, 0.0))
    parts += box((0.12, 2.6, 1.3), props.DARK_STEEL, (x1 - 0.1, y0 + width * 0.72, 4.4))
    for i, tone in enumerate((RED_PAINT, BALL, BACKBOARD)):
        at = (x1 - 0.165, y0 + width * 0.72 - 0.75 + 0.75 * i, 4.85)
        parts += box((0.01, 0.5, 0.55), tone, at)
    return parts


def _frame(x0: float, y0: float, x1: float, y1: float, height: float) -> Parts:
    """Pillars along the walls, girders across the roof with a lower chord and struts."""
    parts: Parts = []
    for x in np.arange(x0 + 3.0, x1 - 1.0, 5.0):
        for y in (y0 + 0.2, y1 - 0.2):
            parts += box((0.45, 0.4, height), props.CONCRETE, (x, y, 0))
        top, low = height - 0.2, height - 1.1
        for z in (top, low):
            parts += beam((x, y0, z), (x, y1, z), 0.16, props.STEEL)
        ys = np.linspace(y0, y1, 13)
        for i in range(12):
            a, b = (low, top) if i % 2 else (top, low)
            parts += beam((x, ys[i], a), (x, ys[i + 1], b), 0.07, props.STEEL)
        for y in np.linspace(y0 + 3, y1 - 3, 4):
            parts += box((0.35, 1.3, 0.12), DAYLIGHT, (x + 2.0, y, height - 0.8))
    for y in np.linspace(y0 + 2, y1 - 2, 4):
        parts += beam((x0, y, height - 0.15), (x1, y, height - 0.15), 0.1, props.STEEL)
    return parts


def _court(x0: float, y0: float, x1: float, y1: float) -> Parts:
    white, blue = props.WHITE, BLUE_PAINT
    corners = [(x0, y0), (x1, y0), (x1, y1), (x0, y1)]
    parts: Parts = []
    for a, b in zip(corners, corners[1:] + corners[:1], strict=True):
        parts += props.line(a, b, 0.06, white)
    xm, ym = (x0 + x1) / 2, (y0 + y1) / 2
    parts += props.line((xm, y0), (xm, y1), 0.06, white)
    parts += props.arc((xm, ym), 1.8, 0, 2 * np.pi, 0.06, white)
    parts += props.arc((x1 - 1.5, ym), 6.2, np.pi / 2, 3 * np.pi / 2, 0.06, white)
    parts += rectangle(x1 - 5.6, ym - 2.4, x1, ym + 2.4, 0.003, RED_PAINT)
    for y in (ym - 2.4, ym + 2.4):
        parts += props.line((x1 - 5.6, y), (x1, y), 0.06, white, 0.006)
    parts += props.line((x1 - 5.6, ym - 2.4), (x1 - 5.6, ym + 2.4), 0.06, white, 0.006)
    for y in (y0 + 2.2, y1 - 3.2):
        parts += props.line((x0, y), (x1, y), 0.05, blue, 0.006)
    for x in (xm + 3.0, xm + 7.0):
        parts += props.line((x, y0), (x, y1), 0.05, blue, 0.008)
    return parts


def _hoop() -> Parts:
    """A basketball stand on the floor, its board facing -x."""
    parts = box((1.0, 0.9, 0.35), MAT, (0.2, 0, 0))
    parts += beam((0.2, 0, 0.3), (0.0, 0, 3.2), 0.16, props.STEEL)
    parts += beam((0.0, 0, 3.1), (-1.1, 0, 3.3), 0.1, props.STEEL)
    parts += box((0.04, 1.8, 1.05), BACKBOARD, (-1.15, 0, 2.9))
    for y in (-0.29, 0.26):
        parts += box((0.006, 0.05, 0.45), RED_PAINT, (-1.175, y, 3.05))
    for z in (3.05, 3.46):
        parts += box((0.006, 0.59, 0.05), RED_PAINT, (-1.175, 0, z))
    angle = np.linspace(0, 2 * np.pi, 21)
    rim = np.column_stack([-1.42 + 0.23 * np.cos(angle), 0.23 * np.sin(angle), 0 * angle + 3.05])
    for a, b in pairwise(rim):
        parts += cylinder(a, b, 0.012, BALL, sides=6)
    return parts


def _wall_bars() -> Parts:
    """Two bays of wall bars along y."""
    parts: Parts = []
    for y in (-1.0, 0.0, 1.0):
        parts += box((0.1, 0.06, 2.7), props.TIMBER, (0, y, 0.05))
    for z in np.arange(0.3, 2.7, 0.17):
        parts += cylinder((-0.05, -1.0, z), (-0.05, 1.0, z), 0.02, props.TIMBER, sides=8)
    return parts


def _apparatus(rng: Rng, x1: float, y0: float, y1: float) -> Parts:
    """Vaulting boxes, mats, benches, volleyball posts with a net, a trolley, a ladder."""
    parts: Parts = []
    # a slot each, so that nothing stands inside something else or around the tower
    slots = [
        (x, y)
        for x in np.linspace(4.2, x1 - 3.2, 4)
        for y in np.linspace(y0 + 1.6, y1 - 4.6, 4)
        if np.hypot(x, y) > 3.8
    ]
    order = rng.permutation(len(slots))
    places = [np.array(slots[i]) + rng.uniform(-0.4, 0.4, 2) for i in order]

    def put(thing: Parts) -> None:
        nonlocal parts
        parts += place(thing, (*places.pop(), 0), rng.uniform(-np.pi, np.pi))

    for _ in range(2):
        vault: Parts = []
        for i in range(4):
            vault += box((1.5 - 0.08 * i, 0.75 - 0.06 * i, 0.235), props.TIMBER, (0, 0, 0.24 * i))
        put(vault + box((1.2, 0.55, 0.14), props.RUBBER, (0, 0, 0.96)))
    pile: Parts = []
    for i in range(int(rng.integers(3, 6))):
        offset = rng.uniform(-0.06, 0.06, 2)
        pile += box((2.0, 1.25, 0.16), (MAT, RED_MAT)[i % 2], (*offset, 0.17 * i))
    put(pile)
    for _ in range(2):
        bench = box((3.2, 0.24, 0.05), props.TIMBER, (0, 0, 0.3))
        for x in (-1.3, 1.3):
            bench += box((0.08, 0.24, 0.3), props.TIMBER, (x, 0, 0))
        put(bench)
    put(props.stack(rng, 3, props.CARDBOARD))
    put(
        box((1.6, 0.7, 1.1), props.STEEL, (0, 0, 0.15))
        + box((1.5, 0.6, 0.02), RED_MAT, (0, 0, 1.3))
    )
    put(
        place(props.ladder(2.6, 0.3), (-0.4, 0, 0))
        + place(props.ladder(2.6, 0.3), (0.4, 0, 0), np.pi)
    )
    x = x1 * rng.uniform(0.55, 0.65)
    posts = (y0 + 2.4, y1 - 5.0)
    for y in posts:
        parts += cylinder((x, y, 0), (x, y, 2.5), 0.05, props.STEEL)
        parts += box((0.5, 0.5, 0.12), RED_MAT, (x, y, 0))
    for z in (2.43, 1.45):
        parts += beam((x, posts[0], z), (x, posts[1], z), 0.05, BACKBOARD)
    for z in np.arange(1.55, 2.4, 0.14):
        parts += beam((x, posts[0], z), (x, posts[1], z), 0.008, props.DARK_STEEL)
    for y in np.arange(posts[0], posts[1], 0.2):
        parts += beam((x, y, 1.45), (x, y, 2.43), 0.008, props.DARK_STEEL)
    return parts
