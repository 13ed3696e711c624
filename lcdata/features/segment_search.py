"""How the most consistent pose is looked for: a shrinking search, then parabolas."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lcdata.features.nid_search import Stage, shrinking_search
from lcdata.features.segment_objective import SegmentObjective
from lcdata.geometry import se3

Array = NDArray[np.float64]

THIN = (3000, 6000, 12_000)
"""Points of all pairs together at each level of the search, a pair at least `THIN_PAIR`."""
THIN_PAIR = (1000, 2000, 4000)

STAGES = (
    Stage(0, 0.35, 60, 800),
    Stage(0, 0.2, 40, 600),
    Stage(1, 0.12, 25, 400),
    Stage(1, 0.07, 15, 300),
    Stage(2, 0.04, 10, 250),
    Stage(2, 0.02, 10, 200),
    Stage(2, 0.01, 8, 150),
)

AGAIN = STAGES[3:]
"""Of a box that is already small."""

BOWLS = tuple(np.repeat([[m, np.deg2rad(d)]], 3, axis=1)[0] for m, d in ((0.1, 0.4), (0.06, 0.25)))
"""Half-widths of the boxes in which the cost is taken for a parabola, one after the other, metres
then radians: nearer it is a staircase, farther off it flattens."""

PROBES = 240
"""Poses that a parabola is fitted to."""

BOWL_POINTS = 10_000
"""Points of all pairs that it is fitted with, a pair at least `THIN_PAIR`."""

FLATTEST = 0.1
"""Curvature below which a direction is not followed, as a share of the largest."""


def search(
    current: SegmentObjective, T: Array, reach: Array, samples: int, rng: np.random.Generator
) -> Array:
    """The best pose found in a box: 4x4.

    Args:
        current: What to minimise.
        T: 4x4 middle of the box.
        reach: (6,) half-widths, metres then radians.
        samples: Poses in the first round.
        rng: Of everything random.
    """
    return _shrunk(current, T, reach, samples, STAGES, rng)


def again(
    current: SegmentObjective, T: Array, reach: Array, samples: int, rng: np.random.Generator
) -> Array:
    """The best pose of a box that is already small: 4x4."""
    return _shrunk(current, T, reach, samples, AGAIN, rng)


def _shrunk(
    current: SegmentObjective,
    T: Array,
    reach: Array,
    samples: int,
    stages: Sequence[Stage],
    rng: np.random.Generator,
) -> Array:
    pairs = len(current.views)
    costs = [
        current.thinned(max(number, least * pairs), rng).hard
        for number, least in zip(THIN, THIN_PAIR, strict=True)
    ]
    return np.asarray(shrinking_search(costs, T, swapped(reach), samples, stages, rng)[0][0])


@dataclass(frozen=True, eq=False)
class Bowl:
    """A parabola fitted to the cost around a pose, in half-widths of the box of its probes.

    Args:
        poses: (P, 4, 4) probes.
        terms: (P, 7) of them: 1 and the six coordinates.
        slope: (6,) at the pose.
        curvature: (6, 6).
    """

    poses: Array
    terms: Array
    slope: Array
    curvature: Array


def bowl(
    current: SegmentObjective, T: Array, reach: Array, probes: int, rng: np.random.Generator
) -> Bowl | None:
    """Fit a parabola to the cost in a box around a pose; None where too much is out of view.

    Args:
        current: The cost.
        T: 4x4 the pose.
        reach: (6,) half-widths, metres then radians.
        probes: How many, in opposite pairs.
        rng: Of their places.
    """
    half = rng.uniform(-1, 1, (probes // 2, 6))
    places = np.concatenate([half, -half])
    poses = np.array([se3.exp(place * reach) @ T for place in places])
    costs = current.hard(poses)
    good = np.isfinite(costs)
    if good.sum() < probes // 2:
        return None
    rows, columns = np.triu_indices(6)
    squares = places[:, rows] * places[:, columns] * np.where(rows == columns, 0.5, 1.0)
    terms = np.concatenate([np.ones((len(places), 1)), places], 1)
    fit = np.linalg.lstsq(np.concatenate([terms, squares], 1)[good], costs[good], rcond=None)[0]
    H = np.zeros((6, 6))
    H[rows, columns] = H[columns, rows] = fit[7:]
    return Bowl(poses, terms, fit[1:7], H)


def settled(current: SegmentObjective, T: Array, rng: np.random.Generator) -> Array:
    """The lowest point of parabolas fitted around a pose: 4x4.

    The cost is a staircase; where exactly its lowest step lies is chance, the parabola is not.
    """
    pairs = len(current.views)
    thin = current.thinned(max(BOWL_POINTS, THIN_PAIR[2] * pairs), rng)
    for reach in BOWLS:
        found = bowl(thin, T, reach, PROBES, rng)
        if found is None:
            return T
        values, axes = np.linalg.eigh(found.curvature)
        if values[-1] <= 0:
            return T
        step = -axes @ ((axes.T @ found.slope) / np.maximum(values, FLATTEST * values[-1]))
        T = se3.exp(step / max(1.0, float(np.abs(step).max())) * reach) @ T
    return T


def swapped(reach: Array) -> Array:
    """Half-widths as `shrinking_search` takes them: radians, then metres."""
    return np.concatenate([reach[3:], reach[:3]])
