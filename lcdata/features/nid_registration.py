"""How the NID methods look for the lowest cost: a search of the box, means on rough ground."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lcdata.features.nid_objective import Objective
from lcdata.features.nid_search import Stage, bfgs, different, shrinking_search
from lcdata.features.pose_cost import PoseCost
from lcdata.geometry import se3

Array = NDArray[np.float64]

BLUNT, MIDDLE, SHARP = (0, 1), (1, 2), (2, 3)
"""Distance fields of the search's levels."""

THIN = (4000, 6000, 10_000)
"""Points of all pairs together at each level of the search, a pair at least `THIN_PAIR`."""
THIN_PAIR = 1000

STAGES = (
    Stage(0, 0.35, 60, 800),
    Stage(0, 0.2, 40, 600),
    Stage(1, 0.12, 25, 400),
    Stage(1, 0.07, 15, 300),
    Stage(2, 0.04, 10, 200),
)

CANDIDATES = 4
"""Different poses of the search that are refined."""

MOST_POINTS = 80_000
"""Points of a pair; more are thinned out."""

REFINED_POINTS = 20_000
"""Points that candidates are refined with."""

BAGS = 8
"""Random halves of the data whose minima are averaged."""


def search(
    current: PoseCost,
    T: Array,
    reach: Array,
    samples: int,
    candidates: int,
    rng: np.random.Generator,
) -> list[tuple[Array, float]]:
    """Different minima in a box, best first, each with its cost.

    Args:
        current: What to minimise.
        T: 4x4 middle of the box.
        reach: (6,) half-widths, metres then radians.
        samples: Poses in the first round.
        candidates: Different poses of the search that are refined.
        rng: Of everything random.
    """
    least = THIN_PAIR * len(current.views)
    thin = [current.thinned(max(count, least * (k + 1)), rng) for k, count in enumerate(THIN)]
    costs = [
        lambda poses, o=o, levels=levels: o.hard(poses, levels)
        for o, levels in zip(thin, (BLUNT, MIDDLE, SHARP), strict=True)
    ]
    half_width = np.concatenate([reach[3:], reach[:3]])
    poses, _ = shrinking_search(costs, T, half_width, samples, STAGES, rng)
    refined = current.thinned(REFINED_POINTS, rng)
    starts = different(poses, candidates, 0.05 * reach)
    return sorted(
        (bfgs(refined.slope, start, 0.25 * reach, 20, 1e-6) for start in starts),
        key=lambda item: item[1],
    )


def averaged(current: PoseCost, T: Array, reach: Array, rng: np.random.Generator) -> Array:
    """Mean of the minima of random halves of points and edges: 4x4.

    The cost of a sparse scan is rough; where exactly its lowest point lies is chance (bagging,
    Breiman 1996).
    """
    twists = []
    for _ in range(BAGS):
        part = current.sampled(0.5, rng)
        found, _ = bfgs(part.slope, T, reach, 20, 1e-6)
        twists.append(se3.log(found @ se3.inverse(T)))
    return se3.exp(np.mean(twists, axis=0)) @ T


def limited(whole: Objective, seed: int) -> Objective:
    """An objective whose points are thinned out where they are more than enough."""
    return whole.thinned(MOST_POINTS * len(whole.views), np.random.default_rng([seed, 2]))
