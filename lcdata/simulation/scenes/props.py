"""Things that stand around in scenes. Each is made at the origin, on the ground, facing -x."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from lcdata.simulation.mesh import (
    BRICK,
    CHECKER,
    PLANK,
    RIB,
    TILE,
    Material,
    Parts,
    beam,
    box,
    cylinder,
    leaves,
    place,
    prism,
    quad,
    rectangle,
    sphere,
)

Rng = np.random.Generator

GLASS = Material("#2c3a44", noise=0.15, grain=2.0, near_infrared=0.5, gloss=0.85)
STEEL = Material("#9aa0a6", noise=0.06, near_infrared=0.9, gloss=0.35)
DARK_STEEL = Material("#3a3f45", noise=0.08, gloss=0.2)
RUBBER = Material("#1d1d1f", noise=0.2, grain=0.1, near_infrared=0.8)
WHITE = Material("#e8e6e0", noise=0.05)
TIMBER = Material("#a87b4f", "#5c3f24", PLANK, (1.8, 0.12), 0.008, 0.18, 0.3)
GREY_TIMBER = Material("#8a8176", "#37322c", PLANK, (2.4, 0.14), 0.012, 0.25, 0.3)
BARK = Material("#5d4a38", "#3b2e22", RIB, (0.09, 1.0), noise=0.35, grain=0.15)
CONCRETE = Material("#a9a69f", "#8d8a84", TILE, (2.4, 1.2), 0.015, 0.12, 0.7)
RED_BRICK = Material("#9c4f3c", "#c3b9aa", BRICK, (0.24, 0.083), 0.012, 0.14, 0.4)
YELLOW_BRICK = Material("#c7a56b", "#8f8672", BRICK, (0.24, 0.083), 0.012, 0.12, 0.4)
ASPHALT = Material("#5c5d61", noise=0.2, grain=0.09)
PAINT = Material("#e9e7df", noise=0.14, grain=0.12, near_infrared=1.1)
YELLOW_PAINT = Material("#e0b02c", noise=0.12, grain=0.12, near_infrared=1.2)
GRASS = Material("#5e7a3a", noise=0.45, grain=0.25, near_infrared=3.0)
HAZARD = Material("#e6c229", "#1c1c1c", CHECKER, (0.2, 50.0), noise=0.05)
CARDBOARD = Material("#b58a5a", "#8e6a41", TILE, (0.6, 0.45), 0.01, 0.1, 0.3)
CAR_COLORS = ("#a32020", "#d9dadb", "#23395b", "#2b2d30", "#8a9099", "#3f6b4f", "#c9b037")


def leaf(rng: Rng) -> Material:
    """A green of its own."""
    greens = ("#4d7a33", "#6a8f3c", "#3f6b3a", "#7d8f45")
    return Material(str(rng.choice(greens)), noise=0.3, grain=0.2, near_infrared=3.5)


def car(rng: Rng) -> Parts:
    """A parked car of 4.4 m along x: hatchback, saloon or van."""
    paint = Material(str(rng.choice(CAR_COLORS)), noise=0.03, near_infrared=1.3, gloss=0.35)
    length, width = rng.uniform([4.0, 1.72], [4.7, 1.85])
    kind = rng.integers(3)
    h = length / 2
    body = [(-h, 0.35), (h, 0.35), (h, 0.82), (h - 0.15, 0.95), (-h + 0.2, 0.88), (-h, 0.7)]
    if kind == 0:
        cabin = [(-h + 1.1, 0.9), (h - 0.1, 0.94), (h - 0.45, 1.48), (-h + 1.75, 1.46)]
    elif kind == 1:
        cabin = [(-h + 1.2, 0.9), (h - 0.8, 0.94), (h - 1.35, 1.42), (-h + 1.95, 1.43)]
    else:
        cabin = [(-h + 0.6, 0.9), (h - 0.02, 0.94), (h - 0.08, 2.0), (-h + 1.25, 1.95)]
    parts = prism(body, -width / 2, width / 2, paint)
    inset = 0.09
    parts += prism(cabin, -width / 2 + inset, width / 2 - inset, GLASS)
    roof = np.array(cabin)
    top = np.array([roof[3], roof[2], roof[2], roof[3]])
    top += [[0.03, -0.04], [-0.03, -0.04], [0.0, 0.02], [0.0, 0.02]]
    parts += prism(top, -width / 2 + 0.07, width / 2 - 0.07, paint)
    for x in (roof[3][0] + 0.95, roof[2][0] - 0.25):  # door pillars
        for y in (-1, 1):
            centre = (x, y * (width / 2 - inset + 0.003), 0.9)
            parts += box((0.09, 0.02, roof[2][1] - 0.92), paint, centre)
    for x in (-h + 0.78, h - 0.8):
        for y in (-1, 1):
            outer = y * (width / 2 + 0.01)
            parts += cylinder((x, outer - 0.2 * y, 0.32), (x, outer, 0.32), 0.32, RUBBER)
            parts += cylinder((x, outer, 0.32), (x, outer + 0.012 * y, 0.32), 0.19, STEEL)
    for aside in (-0.6, 0.6):
        parts += box((0.03, 0.3, 0.14), WHITE, (-h, aside, 0.62))
        parts += box((0.03, 0.22, 0.2), Material("#8e1616", noise=0.02), (h, aside, 0.7))
    parts += box((0.02, 0.5, 0.11), WHITE, (-h - 0.01, 0, 0.45))
    return parts


def tree(rng: Rng, height: float = 5.0, count: int = 1600, sway: Rng | None = None) -> Parts:
    """A tree; `sway` draws the leaves anew, as wind does."""
    crown = leaf(rng)
    top = np.array([*rng.uniform(-0.3, 0.3, 2), height * 0.62])
    parts = cylinder((0, 0, 0), top, 0.035 * height**0.9, BARK, 0.016 * height, 12)
    blobs = []
    for _ in range(5):
        angle, reach = rng.uniform(0, 2 * np.pi), rng.uniform(0.1, 0.22) * height
        aside = np.array([reach * np.cos(angle), reach * np.sin(angle), 0.0])
        tip = top + aside + [0.0, 0.0, rng.uniform(0, 0.2) * height]
        parts += cylinder(top * rng.uniform(0.6, 0.95), tip, 0.05, BARK, 0.025, 7)
        blobs.append((tip, rng.uniform(0.15, 0.25) * height * np.array([1, 1, 0.85])))
    wind = sway or rng
    for tip, radii in blobs:
        parts += leaves(tip, radii, count // 5, 0.09, crown, wind)
    return parts


def bush(rng: Rng, size: float = 0.8, sway: Rng | None = None) -> Parts:
    """A shrub of leaves around a rough core."""
    green = leaf(rng)
    radii = size * rng.uniform(0.7, 1.1, 3)
    parts = sphere((0, 0, radii[2] * 0.7), radii * 0.7, green, 7, 0.2, rng)
    parts += leaves((0, 0, radii[2] * 0.8), radii, 500, 0.06, green, sway or rng)
    return parts


def hedge(rng: Rng, length: float, height: float = 1.1, sway: Rng | None = None) -> Parts:
    """A clipped hedge along y."""
    green = leaf(rng)
    parts = box((0.5, length, height * 0.92), green)
    for y in np.arange(-length / 2, length / 2, 0.5):
        centre = (0, y + 0.25, height / 2)
        parts += leaves(centre, (0.33, 0.35, height / 2), 220, 0.05, green, sway or rng)
    return parts


def person(rng: Rng) -> Parts:
    """Somebody who stands about: legs, trunk, arms, head."""
    shirt = Material(str(rng.choice(["#b3402e", "#2f5d8c", "#e0c34a", "#444a52", "#d7d3c8"])))
    trousers = Material(str(rng.choice(["#2a2d38", "#5b5140", "#1f2a44"])))
    skin = Material("#c99a7a", noise=0.05)
    h, stride = rng.uniform(1.6, 1.88), rng.uniform(-0.15, 0.15)
    parts: Parts = []
    for side in (-1, 1):
        hip, foot = (0, 0.09 * side, 0.5 * h), (stride * side, 0.1 * side, 0.05)
        parts += cylinder(foot, hip, 0.065, trousers, 0.09, 12)
        parts += box((0.26, 0.1, 0.07), RUBBER, (stride * side - 0.05, 0.1 * side, 0))
        hand = (stride * -side - 0.06, 0.27 * side, 0.46 * h)
        parts += cylinder((0, 0.2 * side, 0.8 * h), hand, 0.05, shirt, 0.04, 10)
        parts += sphere(hand, (0.05, 0.05, 0.07), skin, 5)
    parts += sphere((0, 0, 0.66 * h), (0.13, 0.21, 0.19 * h), shirt, 9)
    parts += cylinder((0, 0, 0.8 * h), (0, 0, 0.88 * h), 0.055, skin, sides=10)
    parts += sphere((0, 0, 0.93 * h), (0.1, 0.085, 0.125), skin, 8)
    return parts


def lamp_post(height: float = 6.0) -> Parts:
    """A street lamp with a short arm."""
    parts = box((0.4, 0.4, 0.3), CONCRETE)
    parts += cylinder((0, 0, 0.3), (0, 0, height), 0.075, STEEL, 0.045, 14)
    parts += beam((0, 0, height), (-1.2, 0, height + 0.25), 0.07, STEEL)
    return parts + box((0.6, 0.25, 0.1), DARK_STEEL, (-1.3, 0, height + 0.18))


def sign(rng: Rng, height: float = 2.3) -> Parts:
    """A traffic sign on a thin pole: a plate with a coloured field."""
    color = str(rng.choice(["#1f4fa3", "#b3261e", "#f2f2ee"]))
    parts = cylinder((0, 0, 0), (0, 0, height + 0.65), 0.03, STEEL, sides=10)
    parts += box((0.02, 0.62, 0.62), WHITE, (-0.04, 0, height))
    plate = Material(color, noise=0.02, near_infrared=1.5)
    return parts + box((0.006, 0.5, 0.5), plate, (-0.055, 0, height + 0.06))


def bench(length: float = 1.8) -> Parts:
    """A park bench along y with a slatted seat and back."""
    parts: Parts = []
    for y in (-length / 2 + 0.2, length / 2 - 0.2):
        parts += beam((-0.22, y, 0), (-0.22, y, 0.43), 0.06, DARK_STEEL)
        parts += beam((0.2, y, 0), (0.3, y, 0.9), 0.06, DARK_STEEL)
        parts += beam((-0.25, y, 0.41), (0.24, y, 0.41), 0.05, DARK_STEEL)
    for x in (-0.2, -0.06, 0.08):
        parts += box((0.11, length, 0.035), TIMBER, (x, 0, 0.44))
    for z in (0.58, 0.74):
        parts += place(box((0.035, length, 0.12), TIMBER), (0.2 + 0.11 * (z - 0.4), 0, z))
    return parts


def steps(count: int, width: float, rise: float, tread: float, material: Material) -> Parts:
    """Stairs that rise along +x, `width` along y."""
    parts: Parts = []
    for i in range(count):
        depth = tread * (count - i)
        parts += box((depth, width, rise), material, (tread * i + depth / 2, 0, rise * i))
    return parts


def ladder(height: float, lean: float = 0.25) -> Parts:
    """A ladder that leans towards +x by `lean` of its height."""
    parts: Parts = []
    for y in (-0.22, 0.22):
        parts += beam((0, y, 0), (lean * height, y, height), 0.05, STEEL)
    for z in np.arange(0.3, height - 0.1, 0.3):
        parts += beam((lean * z, -0.22, z), (lean * z, 0.22, z), 0.03, STEEL)
    return parts


def stack(rng: Rng, count: int, material: Material) -> Parts:
    """A loose pile of boxes."""
    parts: Parts = []
    z = 0.0
    for _ in range(count):
        size = rng.uniform([0.5, 0.5, 0.3], [0.8, 0.8, 0.5]).tolist()
        at = (*rng.uniform(-0.08, 0.08, 2), z)
        parts += place(box(size, material), at, rng.uniform(-0.3, 0.3))
        z += size[2]
    return parts


def line(
    start: tuple[float, float],
    end: tuple[float, float],
    width: float,
    material: Material,
    z: float = 0.004,
) -> Parts:
    """A painted line on the ground."""
    a, b = np.array([*start, z]), np.array([*end, z])
    side = np.array([-(b - a)[1], (b - a)[0], 0.0])
    side *= width / 2 / np.linalg.norm(side)
    return quad(a - side, b - side, b + side, a + side, material)


def arc(
    centre: tuple[float, float],
    radius: float,
    start: float,
    end: float,
    width: float,
    material: Material,
    z: float = 0.004,
) -> Parts:
    """A painted arc on the ground, angles in rad."""
    angle = np.linspace(start, end, 40)
    xy = np.column_stack([np.cos(angle), np.sin(angle)])
    inner, outer = centre + (radius - width / 2) * xy, centre + (radius + width / 2) * xy
    parts: Parts = []
    for i in range(len(angle) - 1):
        a, b, c, d = ([*p, z] for p in (inner[i], outer[i], outer[i + 1], inner[i + 1]))
        parts += quad(a, b, c, d, material)
    return parts


def ground(extent: float, material: Material) -> Parts:
    """Ground all around, in tiles, so that triangles are not too long for exact hits."""
    edges = np.linspace(-extent, extent, 9)
    parts: Parts = []
    for x0, x1 in pairwise(edges):
        for y0, y1 in pairwise(edges):
            parts += rectangle(x0, y0, x1, y1, 0.0, material)
    return parts


def room(x0: float, y0: float, x1: float, y1: float, sides: dict[str, Parts]) -> Parts:
    """Walls (see `mesh.wall`) put up around a floor plan: keys front (+x), left, right, rear."""
    at = {
        "front": ((x1, y1, 0.0), -np.pi / 2),
        "left": ((x0, y1, 0.0), 0.0),
        "right": ((x1, y0, 0.0), np.pi),
        "rear": ((x0, y0, 0.0), np.pi / 2),
    }
    return [p for key, parts in sides.items() for p in place(parts, *at[key])]
