"""A straight, flat urban road, about 330 m of it, with the sensors in one of its lanes."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from lcdata.simulation.light import Lamp, Light
from lcdata.simulation.mesh import TILE, Material, Parts, box, place, rectangle, sphere
from lcdata.simulation.scenes import Scene, buildings, props, street

Rng = np.random.Generator

BEHIND_M, AHEAD_M = -80.0, 250.0
_ASIDE_M = 70.0
PAVING = Material("#a19b91", "#6f6a62", TILE, (0.4, 0.4), 0.01, 0.14, 0.6, retro=0.06)
SLABS = Material("#b3afa6", "#7d7a73", TILE, (0.8, 0.5), 0.012, 0.12, 0.6, retro=0.07)
FIELD = Material("#8a8350", noise=0.4, grain=1.5, near_infrared=2.2, retro=0.1)
GRASS = Material("#5e7a3a", noise=0.45, grain=0.25, near_infrared=3.0, retro=0.1)
FAR_GREEN = Material("#46603a", noise=0.4, grain=3.0, near_infrared=3.0)
LIGHT_RENDER = Material("#e2dccb", noise=0.06, grain=1.5)
GREY_RENDER = Material("#a9abaa", noise=0.08, grain=1.5)
FACADES = (*buildings.FACADES, LIGHT_RENDER, GREY_RENDER)


@dataclass(frozen=True)
class _Plan:
    """Where things run along the road, metres in y, left positive; the sensors are at y = 0.

    Args:
        lane_m: Width of a lane.
        borders: y of the borders of the lanes from right to left; the outer two are edge lines.
        ours: How many lanes from the right run our way.
        kerbs: y of the right and the left kerb.
        walks: y of the outer borders of the right and the left pavement.
        fronts: y of the right and the left building line.
        strips: Whether cars park between the lanes and the right, the left kerb.
        crossings: x of the start and the end of pedestrian crossings.
    """

    lane_m: float
    borders: tuple[float, ...]
    ours: int
    kerbs: tuple[float, float]
    walks: tuple[float, float]
    fronts: tuple[float, float]
    strips: tuple[bool, bool]
    crossings: tuple[tuple[float, float], ...]


def build(rng: Rng) -> Scene:
    """The road; lanes, markings, poles, houses, plants and cars depend on the generator."""
    plan = _draw_plan(rng)
    fixed = _surfaces(rng, plan) + _markings(rng, plan) + _poles(rng, plan)
    trees: list[tuple[float, float, float]] = []
    hedges: list[tuple[float, float, float]] = []
    for side in (0, 1):
        fixed += _frontage(rng, plan, side, trees, hedges)
        if plan.strips[side]:
            fixed += _parked(rng, plan, side)
    fixed += _far_end(rng, plan)
    seeds = rng.integers(2**32, size=len(trees) + len(hedges))
    walkers = [
        (rng.uniform(5, 45), (plan.kerbs[s] + plan.walks[s]) / 2) for s in rng.integers(2, size=4)
    ]

    def moving(chance: Rng) -> Parts:
        parts: Parts = []
        for (x, y, height), seed in zip(trees, seeds, strict=False):
            count = 1600 if abs(x) < 50 else 700
            grown = props.tree(np.random.default_rng(seed), height, count, sway=chance)
            parts += place(grown, (x, y, 0.1))
        for (x, y, length), seed in zip(hedges, seeds[len(trees) :], strict=False):
            hedge = props.hedge(np.random.default_rng(seed), length, sway=chance)
            parts += place(hedge, (x, y, 0.1), np.pi / 2)
        for x, y in walkers:
            here = (x + chance.normal(scale=0.8), y + chance.normal(scale=0.3), 0.12)
            parts += place(props.person(chance), here, chance.uniform(-np.pi, np.pi))
        return parts + _traffic(chance, plan)

    azimuth, altitude = rng.uniform([-np.pi, 0.6], [np.pi, 1.1]).tolist()
    level = np.cos(altitude)
    sun = (level * np.cos(azimuth), level * np.sin(azimuth), np.sin(altitude))
    light = Light((Lamp(sun, (1.35, 1.25, 1.08)),), (0.5, 0.58, 0.7), (0.26, 0.25, 0.23))
    return Scene("road", fixed, moving, light, rng.uniform(0.92, 1.1))


def _draw_plan(rng: Rng) -> _Plan:
    lanes = int(rng.integers(2, 5))
    ours = (lanes + 1) // 2
    lane = float(rng.uniform(3.0, 3.6))
    right = -(int(rng.integers(ours)) + 0.5) * lane
    borders = tuple(right + lane * k for k in range(lanes + 1))
    strips = (bool(rng.uniform() < 0.6), bool(rng.uniform() < 0.6))
    beside = [2.2 if strip else float(rng.uniform(0.3, 0.6)) for strip in strips]
    kerbs = (borders[0] - beside[0], borders[-1] + beside[1])
    wide = rng.uniform(2.2, 4.5, size=2)
    walks = (kerbs[0] - wide[0], kerbs[1] + wide[1])
    garden = np.where(rng.uniform(size=2) < 0.5, rng.uniform(3, 7, size=2), 0.3)
    crossings = []
    if rng.uniform() < 0.45:
        x = float(rng.uniform(9, 26))
        crossings.append((x, x + 3.6))
    x = float(rng.uniform(60, 110))
    crossings.append((x, x + 3.6))
    return _Plan(
        lane,
        borders,
        ours,
        kerbs,
        walks,
        (walks[0] - garden[0], walks[1] + garden[1]),
        strips,
        tuple(crossings),
    )


def _tiles(y0: float, y1: float, z: float, material: Material) -> Parts:
    """A level strip between y0 and y1 along the whole road."""
    parts: Parts = []
    y0, y1 = min(y0, y1), max(y0, y1)
    for a, b in street.pieces(BEHIND_M, AHEAD_M, (), 20.0):
        parts += rectangle(a, y0, b, y1, z, material)
    return parts


def _surfaces(rng: Rng, plan: _Plan) -> Parts:
    right, left = plan.kerbs
    height = float(rng.uniform(0.1, 0.14))
    walk = PAVING if rng.uniform() < 0.6 else SLABS
    parts = _tiles(right, left, 0.0, street.ASPHALT)
    parts += street.worn_asphalt(rng, -20, 60, plan.borders[0], plan.borders[-1])
    for kerb, outer in zip(plan.kerbs, plan.walks, strict=True):
        parts += street.kerb(BEHIND_M, AHEAD_M, kerb, height)
        parts += _tiles(kerb, outer, height, walk)
        far = float(np.copysign(_ASIDE_M, outer))
        land = FIELD if rng.uniform() < 0.3 else GRASS
        parts += _tiles(outer, far, height - 0.03, land)
    return parts


def _markings(rng: Rng, plan: _Plan) -> Parts:
    """Edge lines, lines between lanes, crossings with the lines at which cars stop."""
    white = street.WHITE_LINES[rng.integers(len(street.WHITE_LINES))]
    centre = street.YELLOW_LINE if rng.uniform() < 0.25 else white
    width = float(rng.uniform(0.12, 0.17))
    dash = ((3.0, 6.0), (3.0, 3.0), (4.0, 6.0), (6.0, 6.0))[rng.integers(4)]
    gaps = [(a - 2.0, b + 2.0) for a, b in plan.crossings]
    span = (BEHIND_M + rng.uniform(0, sum(dash)), AHEAD_M)
    parts: Parts = []
    for k, y in enumerate(plan.borders):
        edge = k in (0, len(plan.borders) - 1)
        if edge and (k == 0 or rng.uniform() < 0.85):
            parts += street.solid_line(*span, y, width, white, gaps)
        elif not edge and k == plan.ours:
            kind = rng.integers(3) if len(plan.borders) > 3 else rng.integers(2)
            if kind == 0:
                parts += street.dashed_line(*span, y, width, centre, dash, gaps)
            elif kind == 1:
                parts += street.solid_line(*span, y, width, centre, gaps)
            else:
                for aside in (-0.15, 0.15):
                    parts += street.solid_line(*span, y + aside, 0.12, centre, gaps)
        elif not edge:
            parts += street.dashed_line(*span, y, width, white, dash, gaps)
    middle = plan.borders[plan.ours]
    for x0, x1 in plan.crossings:
        parts += street.crossing(x0, plan.borders[0], plan.borders[-1], white, x1 - x0)
        stop = x0 - 1.5
        parts += rectangle(stop, plan.borders[0], stop + 0.4, middle, street.PAINT_HEIGHT_M, white)
    return parts


def _poles(rng: Rng, plan: _Plan) -> Parts:
    """Street lights, telegraph poles with wires, signs, signals at crossings."""
    parts: Parts = []
    metal = street.GALVANISED if rng.uniform() < 0.7 else street.GREEN_POLE
    height, pitch = rng.uniform(6.5, 9.5), rng.uniform(22, 32)
    reach = rng.uniform(1.2, 2.4)
    lit = ((0,), (1,), (0, 1))[rng.integers(3)]
    first = rng.uniform(6, 18)
    for side in lit:
        y = plan.kerbs[side] + (0.55 if side else -0.55)
        phase = first + (pitch / 2 if len(lit) == 2 and side else 0.0)
        for x in np.arange(phase - 3 * pitch, AHEAD_M - 20, pitch):
            mast = street.light(height, reach, metal)
            parts += place(mast, (x, y, 0.1), 0.0 if side else np.pi)
    if len(lit) == 1 and rng.uniform() < 0.6:
        side = 1 - lit[0]
        y = plan.walks[side] + (-0.35 if side else 0.35)
        tall = rng.uniform(7, 9)
        spots = np.arange(rng.uniform(8, 22) - 64, AHEAD_M - 20, 32.0)
        for x in spots:
            parts += place(street.telegraph_pole(tall), (x, y, 0.1))
        for a, b in pairwise(spots[1:6]):
            parts += place(street.wires(a, b, y, tall), (0, 0, 0.1))
    for side in (0, 1):
        for x in np.arange(rng.uniform(7, 20), 90, rng.uniform(16, 30)):
            y = plan.kerbs[side] + (0.5 if side else -0.5)
            turn = np.pi if side else 0.0
            post = street.sign_post(rng, rng.uniform(2.3, 3.4))
            parts += place(post, (x, y, 0.1), turn + rng.normal(scale=0.08))
    for x0, x1 in plan.crossings:
        if rng.uniform() < 0.5:
            reach = rng.uniform(1.5, 4.0)
            parts += place(street.traffic_light(-reach), (x0 - 0.4, plan.kerbs[0] - 0.5, 0.1))
            other = street.traffic_light(-reach)
            parts += place(other, (x1 + 0.4, plan.kerbs[1] + 0.5, 0.1), np.pi)
    return parts


def _frontage(
    rng: Rng,
    plan: _Plan,
    side: int,
    trees: list[tuple[float, float, float]],
    hedges: list[tuple[float, float, float]],
) -> Parts:
    """Houses or open land on one side with what stands before them; plants are noted."""
    out = 1.0 if side else -1.0
    walk, front = plan.walks[side], plan.fronts[side]
    parts: Parts = []
    built = rng.uniform() < 0.75
    if rng.uniform() < 0.6:
        pitch = rng.uniform(9, 15)
        for x in np.arange(rng.uniform(4, 12) - 2 * pitch, 90, pitch):
            spot = plan.kerbs[side] + out * 1.0 if built else walk + out * 1.5
            trees.append((x + rng.normal(scale=0.5), spot, rng.uniform(4.5, 7.5)))
    if not built:
        for x in np.arange(20, 110, 14):
            at = walk + out * rng.uniform(8, 30)
            trees.append((x + rng.uniform(-6, 6), at, rng.uniform(5, 9)))
        return parts + _boundary(rng, -24, 70, walk, out, hedges)
    x = -40 + float(rng.uniform(-10, 0))
    while x < 170:
        width = float(rng.uniform(9, 21))
        tone = FACADES[rng.integers(len(FACADES))]
        setback = front + out * (rng.uniform(0, 0.8) if abs(front - walk) > 1 else 0.0)
        near = x + width if out < 0 else x
        most = 4 if width > 13 else 3
        parts += buildings.block(rng, (near, setback), 0.0 if out > 0 else np.pi, width, tone, most)
        if abs(front - walk) > 1 and -20 < x < 60:
            parts += _boundary(rng, x + 1.2, x + width - 1.2, walk, out, hedges)
        x += width + (0.02 if rng.uniform() < 0.45 else rng.uniform(2, 7))
    return parts


def _boundary(
    rng: Rng, x0: float, x1: float, y: float, out: float, hedges: list[tuple[float, float, float]]
) -> Parts:
    """A railing, a low wall or a hedge along the outer border of the pavement."""
    kind = rng.integers(3)
    if kind == 0:
        return place(street.railing(x0, min(x1, x0 + 40), y + out * 0.1), (0, 0, 0.1))
    if kind == 1:
        tone = props.RED_BRICK if rng.uniform() < 0.5 else props.CONCRETE
        return street.garden_wall(x0, x1, y + out * 0.2, tone)
    length = min(x1 - x0, 30.0)
    hedges.append(((x0 + x0 + length) / 2, y + out * 0.4, length))
    return []


def _parked(rng: Rng, plan: _Plan, side: int) -> Parts:
    """Cars between the lanes and a kerb, but not at crossings and not right beside the sensors."""
    kerb = plan.kerbs[side]
    y = kerb + (-1.15 if side else 1.15)
    parts: Parts = []
    share = rng.uniform(0.3, 0.8)
    for x in np.arange(-30 + rng.uniform(0, 4), 100, 5.8):
        free = all(x < a - 5 or x > b + 4 for a, b in plan.crossings)
        if free and rng.uniform() < share:
            at = (x + rng.normal(scale=0.2), y + rng.normal(scale=0.08), 0)
            turn = (0.0 if side else np.pi) + rng.normal(scale=0.02)
            parts += place(props.car(rng), at, turn)
    return parts


def _traffic(chance: Rng, plan: _Plan) -> Parts:
    """Cars that drive: one ahead now and then, others on the other lanes."""
    parts: Parts = []
    for k in range(len(plan.borders) - 1):
        y = (plan.borders[k] + plan.borders[k + 1]) / 2
        nearest = 13.0 if abs(y) < 1 else -12.0
        if chance.uniform() < 0.55:
            at = (chance.uniform(nearest, 55), y + chance.normal(scale=0.15), 0)
            parts += place(props.car(chance), at, np.pi if k < plan.ours else 0.0)
    return parts


def _far_end(rng: Rng, plan: _Plan) -> Parts:
    """Trees and houses in the distance, as masses."""
    parts: Parts = []
    for out, walk in zip((-1.0, 1.0), plan.walks, strict=True):
        for x in np.arange(175, AHEAD_M + 20, 9):
            radii = rng.uniform([4, 3, 3], [7, 6, 7])
            at = (x, walk + out * rng.uniform(4, 10), radii[2] * 0.5)
            parts += sphere(at, radii, FAR_GREEN, 7, 0.25, rng)
        for _ in range(4):
            size = rng.uniform([10, 10, 6], [20, 18, 14]).tolist()
            tone = FACADES[rng.integers(len(FACADES))]
            parts += box(size, tone, (rng.uniform(180, 240), walk + out * rng.uniform(20, 50), 0))
    for y in np.arange(-60, 61, 8.0):
        radii = rng.uniform([3, 5, 2.5], [5, 8, 5])
        parts += sphere((AHEAD_M + 8, y, 1.0), radii, FAR_GREEN, 7, 0.25, rng)
    return parts
