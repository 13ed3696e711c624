"""Three passes of a shrinking random search, each about the result of the one before."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lcdata.features.chamfer_search import displaced, low_discrepancy
from lcdata.features.wide_features import WideFeatures
from lcdata.features.wide_objective import Images, Objective, Terms, View, views

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Stage:
    """One round of the search.

    Args:
        terms: Of the cost.
        spread: Standard deviation of the children, in half-widths of the box; 0 fills the box.
        keep: Poses that go on.
        children: Poses that are tried.
    """

    terms: Terms
    spread: float
    keep: int
    children: int


@dataclass(frozen=True)
class Pass:
    """One search of a box.

    Args:
        rotation_deg: Half-width of the box about each axis; 0 for that of the initial guess.
        translation_m: Half-width along each axis.
        margin_deg: How far beside the image points are taken.
        stages: Rounds of the search.
    """

    rotation_deg: float
    translation_m: float
    margin_deg: float
    stages: tuple[Stage, ...]

    @property
    def box(self) -> Array:
        """(6,) half-widths, radians then metres."""
        return np.repeat([np.deg2rad(self.rotation_deg), self.translation_m], 3)


def _stage(
    levels: tuple[int, ...],
    points: int,
    truncations: tuple[int, ...],
    edges: int,
    spread: float,
    keep: int,
    children: int,
    beta: float = 1.0,
    nid: bool = False,
) -> Stage:
    return Stage(Terms(levels, points, truncations, edges, beta, nid), spread, keep, children)


WIDE = (
    _stage((0,), 1200, (100,), 500, 0.0, 250, 8192),
    _stage((0,), 1500, (100, 60), 600, 0.3, 150, 2000),
    _stage((0, 1), 2000, (60,), 800, 0.18, 100, 1600),
    _stage((0, 1), 2500, (60, 25), 1000, 0.1, 60, 1400),
    _stage((1,), 2500, (25,), 1200, 0.06, 40, 1000),
    _stage((1,), 2500, (25, 12), 1200, 0.03, 20, 800),
)
MIDDLE = Pass(
    2.2,
    0.3,
    4.0,
    (
        _stage((1,), 2000, (60, 25), 1000, 0.0, 100, 3000),
        _stage((1,), 2500, (25,), 1200, 0.3, 50, 1200),
        _stage((1,), 3000, (25, 12), 1500, 0.15, 30, 1000),
        _stage((1,), 4000, (12,), 2400, 0.07, 20, 800),
        _stage((1,), 4000, (12, 6), 2400, 0.03, 20, 600),
    ),
)
FINE = Pass(
    0.7,
    0.09,
    3.0,
    tuple(
        _stage((1,), 3000, (12, 6), 5000, spread, keep, children, 3.0, True)
        for spread, keep, children in (
            (0.0, 30, 1000),
            (0.35, 25, 700),
            (0.2, 20, 600),
            (0.1, 15, 500),
            (0.05, 15, 400),
        )
    ),
)


def search(
    frames: Sequence[View], T: Array, one: Pass, rng: np.random.Generator
) -> tuple[Array, Array]:
    """Search a box about a pose.

    Args:
        frames: As sampled about the pose.
        T: 4x4 middle of the box.
        one: What to do.
        rng: Of the children.

    Returns:
        (K, 6) last generation as rotation vector (rad) and translation (m) from T, best first,
        and its (K,) costs.
    """
    box = one.box
    places, values = np.zeros((0, 6)), np.zeros(0)
    terms = None
    for stage in one.stages:
        if stage.terms != terms:
            terms, costs = stage.terms, Objective(frames, stage.terms)
            values = costs(displaced(T, places))
        if stage.spread:
            parents = places[rng.integers(0, len(places), stage.children)]
            children = parents + rng.normal(size=(stage.children, 6)) * stage.spread * box
            children = np.clip(children, -1.2 * box, 1.2 * box)
        else:
            shift = int(rng.integers(1 << 30))
            children = (2.0 * low_discrepancy(stage.children, shift) - 1.0) * box
            children[0] = 0.0
        values = np.concatenate([values, costs(displaced(T, children))])
        places = np.concatenate([places, children])
        best = np.argsort(values, kind="stable")[: stage.keep]
        places, values = places[best], values[best]
    return places, values


@dataclass(frozen=True, eq=False)
class Found:
    """Where the passes ended.

    Args:
        T: 4x4 `T_camera_lidar`.
        cost_initial: Cost of the start by the terms of the last stage.
        cost_final: Cost of T by the same.
    """

    T: Array
    cost_initial: float
    cost_final: float


def passes(rotation_deg: float, translation_m: float) -> tuple[Pass, ...]:
    """What to do about a guess.

    Args:
        rotation_deg: Half-width of the box about each axis.
        translation_m: Half-width along each axis.
    """
    if rotation_deg <= MIDDLE.rotation_deg and translation_m <= MIDDLE.translation_m:
        return MIDDLE, FINE
    return Pass(rotation_deg, translation_m, 10.0, WIDE), MIDDLE, FINE


def solve(
    features: Sequence[WideFeatures],
    pictures: Sequence[Images],
    T_initial: Array,
    plan: Sequence[Pass],
    rng: np.random.Generator,
) -> Found:
    """All passes, each about the best pose of the one before."""
    T = T_initial
    for one in plan:
        nid = any(stage.terms.nid for stage in one.stages)
        frames = views(features, pictures, T, np.deg2rad(one.margin_deg), nid, rng)
        places, _ = search(frames, T, one, rng)
        T = displaced(T, places[:1])[0]
    costs = Objective(frames, plan[-1].stages[-1].terms)(np.stack([T_initial, T]))
    return Found(T, float(costs[0]), float(costs[1]))
