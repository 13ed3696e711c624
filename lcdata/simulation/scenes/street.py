"""Road markings and what stands along a street: lights, poles, signs, kerbs, fences.

Streets run along x. Markings are seen from above; things on poles are made at the origin.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np

from lcdata.simulation.mesh import (
    TILE,
    Material,
    Parts,
    beam,
    box,
    cylinder,
    rectangle,
)
from lcdata.simulation.scenes import buildings, props

Rng = np.random.Generator

PAINT_HEIGHT_M = 0.004
_PIECE_M = 20.0
"""Solid lines come in pieces of this length, for exact hits."""
_BEADS = 0.25
"""What glass beads send back: pi times the 80 mcd / (m^2 lx) of a worn marking (EN 1436).
Markings are then some four to six times as strong as the road; a Hesai measured 3.6 on a real one.
"""
_ROUGH = 0.06

WHITE_LINES = tuple(
    Material(tone, noise=0.22, grain=0.2, near_infrared=1.1, retro=_BEADS, kind="lane")
    for tone in ("#e9e7df", "#dbd9d1", "#cbc9c2")
)
YELLOW_LINE = Material(
    "#dca92c", noise=0.2, grain=0.2, near_infrared=1.2, retro=_BEADS, kind="lane"
)
GALVANISED = Material("#a3a8ab", noise=0.06, near_infrared=0.9, gloss=0.2, kind="pole")
GREEN_POLE = Material("#37524a", noise=0.06, near_infrared=1.2, gloss=0.15, kind="pole")
TIMBER_POLE = Material("#6b5844", "#54442f", TILE, (0.06, 30.0), 0.01, 0.25, 0.2, kind="pole")
LAMP = Material("#e3e2da", noise=0.03)
SIGN_COLORS = ("#1f4fa3", "#b3261e", "#f2f2ee", "#d9a521")
SIGNALS = (("#c03a2b", 0.5), ("#3a3320", 0.0), ("#1f3a26", 0.0))
ASPHALT = Material("#5c5d61", noise=0.2, grain=0.09, retro=_ROUGH)
PATCH = Material("#48494d", noise=0.22, grain=0.1, retro=_ROUGH * 0.7)
SEAM = Material("#2c2c2e", noise=0.15, grain=0.1)
IRON = Material("#4f4a44", "#2f2b27", TILE, (0.09, 0.09), 0.02, 0.2, 0.2)
RAILING = Material("#2e6b5b", noise=0.06, gloss=0.1)


def pieces(
    x0: float, x1: float, gaps: Sequence[tuple[float, float]], length: float
) -> Iterator[tuple[float, float]]:
    """Spans of at most `length` that cover x0 ... x1 but for the gaps (x from, x to)."""
    edges = sorted({x0, x1, *(min(max(x, x0), x1) for gap in gaps for x in gap)})
    for a, b in pairwise(edges):
        if any(low <= (a + b) / 2 <= high for low, high in gaps):
            continue
        cuts = np.linspace(a, b, max(1, int(np.ceil((b - a) / length))) + 1)
        yield from pairwise(cuts.tolist())


def solid_line(
    x0: float,
    x1: float,
    y: float,
    width: float,
    material: Material,
    gaps: Sequence[tuple[float, float]] = (),
) -> Parts:
    """A painted line along x with gaps, such as at a crossing."""
    parts: Parts = []
    for a, b in pieces(x0, x1, gaps, _PIECE_M):
        parts += rectangle(a, y - width / 2, b, y + width / 2, PAINT_HEIGHT_M, material)
    return parts


def dashed_line(
    x0: float,
    x1: float,
    y: float,
    width: float,
    material: Material,
    dash: tuple[float, float],
    gaps: Sequence[tuple[float, float]] = (),
) -> Parts:
    """A painted line along x in dashes: metres of paint, metres without."""
    painted, free = dash
    parts: Parts = []
    for x in np.arange(x0, x1 - painted, painted + free):
        if not any(low < x + painted and x < high for low, high in gaps):
            parts += rectangle(
                x, y - width / 2, x + painted, y + width / 2, PAINT_HEIGHT_M, material
            )
    return parts


def crossing(x: float, y0: float, y1: float, material: Material, depth: float = 3.6) -> Parts:
    """A zebra crossing from y0 to y1: bars of 0.5 m along x from `x` on."""
    parts: Parts = []
    for y in np.arange(y0 + 0.3, y1 - 0.6, 1.0):
        parts += rectangle(x, y, x + depth, y + 0.5, PAINT_HEIGHT_M, material)
    return parts


def worn_asphalt(rng: Rng, x0: float, x1: float, y0: float, y1: float) -> Parts:
    """Mended patches, seams of tar along and across, manhole covers."""
    parts: Parts = []
    for _ in range(9):
        x, y = rng.uniform([x0, y0], [x1 - 6, y1 - 2])
        sx, sy = rng.uniform([1.0, 0.6], [6.0, 2.0])
        parts += rectangle(x, y, x + sx, y + sy, 0.002, PATCH)
    for _ in range(12):
        x, y = rng.uniform([x0, y0], [x1, y1])
        parts += rectangle(x, y, min(x + rng.uniform(3, 14), x1), y + 0.04, 0.0022, SEAM)
        x = rng.uniform(x0, x1)
        parts += rectangle(x, y0, x + 0.05, y1, 0.0018, SEAM)
    for _ in range(5):
        x, y = rng.uniform([x0, y0 + 0.5], [x1, y1 - 0.5])
        parts += cylinder((x, y, -0.1), (x, y, 0.003), 0.32, IRON, sides=24)
    return parts


def kerb(x0: float, x1: float, y: float, height: float) -> Parts:
    """Kerb stones along x, 0.15 m wide about `y`."""
    parts: Parts = []
    for a, b in pieces(x0, x1, (), _PIECE_M):
        parts += box((b - a, 0.15, height), buildings.KERB, ((a + b) / 2, y, 0))
    return parts


def light(height: float, reach: float, metal: Material) -> Parts:
    """A street light: a conical mast, an arm of length `reach` along -y, the lamp."""
    parts = cylinder((0, 0, 0), (0, 0, 1.1), 0.11, metal, sides=14)
    parts += cylinder((0, 0, 1.1), (0, 0, height - 0.6), 0.085, metal, 0.055, 14)
    bend = (0, -0.35 * reach, height - 0.08)
    parts += cylinder((0, 0, height - 0.6), bend, 0.055, metal, 0.045, 10)
    tip = (0, -reach, height + 0.05)
    parts += cylinder(bend, tip, 0.045, metal, sides=10)
    return parts + box((0.24, 0.65, 0.12), LAMP, (0, -reach - 0.2, height))


def telegraph_pole(height: float) -> Parts:
    """A timber pole with a cross-arm along y and insulators."""
    parts = cylinder((0, 0, 0), (0, 0, height), 0.14, TIMBER_POLE, 0.1, 14)
    parts += beam((0.12, -0.9, height - 0.5), (0.12, 0.9, height - 0.5), 0.1, props.GREY_TIMBER)
    for y in WIRES_Y:
        parts += cylinder((0.12, y, height - 0.45), (0.12, y, height - 0.3), 0.035, props.WHITE)
    return parts


WIRES_Y = (-0.8, -0.3, 0.3, 0.8)
"""Where wires run beside a telegraph pole, metres."""


def sign_post(rng: Rng, height: float) -> Parts:
    """A steel post with one or two plates that face -x."""
    parts = cylinder((0, 0, 0), (0, 0, height), 0.035, GALVANISED, sides=12)
    z = height - 0.7
    for _ in range(int(rng.integers(1, 3))):
        plate = Material(str(rng.choice(SIGN_COLORS)), noise=0.02, near_infrared=1.5, retro=0.4)
        parts += box((0.02, 0.62, 0.62), props.WHITE, (-0.05, 0, z))
        parts += box((0.006, 0.5, 0.5), plate, (-0.063, 0, z + 0.06))
        z -= 0.72
    return parts


def traffic_light(reach: float) -> Parts:
    """A signal post with an arm of length `reach` along -y over the road; it faces -x."""
    parts = cylinder((0, 0, 0), (0, 0, 5.6), 0.1, GALVANISED, 0.08, 14)
    parts += cylinder((0, 0, 5.5), (0, -reach, 5.7), 0.06, GALVANISED, 0.045, 10)
    for y, z in ((0.0, 2.6), (-0.9 * reach, 5.0)):
        parts += box((0.22, 0.32, 0.95), props.DARK_STEEL, (-0.2, y, z))
        for k, (tone, glow) in enumerate(SIGNALS):
            lens = Material(tone, noise=0.02, glow=glow)
            parts += box((0.02, 0.2, 0.2), lens, (-0.32, y, z + 0.66 - 0.28 * k))
    return parts


def railing(x0: float, x1: float, y: float, height: float = 1.05) -> Parts:
    """A steel fence along x: posts, two rails, bars."""
    parts: Parts = []
    for x in np.arange(x0, x1, 2.0):
        parts += box((0.07, 0.07, height + 0.1), RAILING, (x, y, 0))
    for a, b in pieces(x0, x1, (), _PIECE_M):
        for z in (0.2, height):
            parts += beam((a, y, z), (b, y, z), 0.045, RAILING)
    for x in np.arange(x0 + 0.14, x1, 0.14):
        parts += box((0.022, 0.022, height - 0.2), RAILING, (x, y, 0.2))
    return parts


def garden_wall(x0: float, x1: float, y: float, material: Material) -> Parts:
    """A low wall along x with a coping."""
    middle, length = (x0 + x1) / 2, x1 - x0
    parts = box((length, 0.22, 0.9), material, (middle, y, 0))
    return parts + box((length, 0.32, 0.07), props.CONCRETE, (middle, y, 0.9))


def wires(x0: float, x1: float, y: float, height: float) -> Parts:
    """Four sagging wires between two telegraph poles of the same height."""
    parts: Parts = []
    x = np.linspace(x0, x1, 5)
    z = height - 0.3 - 0.6 * (1 - ((x - (x0 + x1) / 2) / ((x1 - x0) / 2)) ** 2)
    for aside in WIRES_Y:
        points = np.column_stack([x + 0.12, np.full(5, y + aside), z])
        for a, b in pairwise(points):
            parts += cylinder(a, b, 0.012, props.RUBBER, sides=5)
    return parts
