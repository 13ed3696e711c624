"""Whether a joint estimate can be trusted: disjoint halves of the frames, each searched anew.

The cost says nothing: a wrong pose can fit better than the right one. Two halves that have no
frame in common and start elsewhere meet by chance at a wrong pose only if all frames share what
draws them there.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from lcdata.features.chamfer_search import displaced
from lcdata.features.wide_features import WideFeatures
from lcdata.features.wide_finish import centred, close_views
from lcdata.features.wide_frames import scenes
from lcdata.features.wide_objective import Images, Objective, views
from lcdata.features.wide_search import FINE, MIDDLE, Pass, solve
from lcdata.geometry import se3

Array = NDArray[np.float64]

ELSEWHERE = 0.15
"""How far the halves start from the guess, in half-widths of the box."""

NEAR_RAD, NEAR_M = np.deg2rad(0.5), 0.1
"""A half that ends farther from the joint estimate is searched again about it."""


def solve_half(
    features: Sequence[WideFeatures],
    pictures: Sequence[Images],
    T_initial: Array,
    T: Array,
    plan: Sequence[Pass],
    rng: np.random.Generator,
) -> Array:
    """The extrinsic by some of the frames alone: 4x4.

    A search that missed the joint estimate may merely have missed it: then what is about that
    estimate is searched too, and the lower cost wins.

    Args:
        features: Of these frames.
        pictures: Of these frames.
        T_initial: 4x4 initial guess.
        T: 4x4 joint estimate.
        plan: Passes of the search.
        rng: Of start, samples and search.
    """
    start = displaced(T_initial, rng.uniform(-1, 1, (1, 6)) * ELSEWHERE * plan[0].box)[0]
    found = solve(features, pictures, start, plan, rng).T
    if (
        se3.rotation_error(found, T) > NEAR_RAD or se3.translation_error(found, T) > NEAR_M
    ) and len(plan) > 2:
        near = displaced(T, rng.uniform(-1, 1, (1, 6)) * ELSEWHERE * MIDDLE.box)[0]
        other = solve(features, pictures, near, (MIDDLE, FINE), rng).T
        frames = views(features, pictures, T, np.deg2rad(MIDDLE.margin_deg), False, rng)
        costs = Objective(frames, MIDDLE.stages[-1].terms)(np.stack([found, other]))
        found = other if costs[1] < costs[0] else found
    return centred(close_views(features, pictures, found, rng), found)


def doubts(
    features: Sequence[WideFeatures],
    pictures: Sequence[Images],
    T_initial: Array,
    T: Array,
    plan: Sequence[Pass],
    limits: tuple[float, float, int],
    rng: np.random.Generator,
) -> list[str]:
    """Why a joint estimate should not be trusted, in words.

    Args:
        features: Of all frames.
        pictures: Of all frames.
        T_initial: 4x4 initial guess.
        T: 4x4 joint estimate.
        plan: Passes of the search.
        limits: How far halves may be off the joint estimate, metres and degrees, and how many
            different scenes there must be.
        rng: Of the halves' searches.
    """
    metres, degrees, fewest = limits
    different = scenes([f.signature for f in features])
    if len(different) < max(fewest, 2):
        frames = f"{len(different)} different scenes in {len(features)} pairs"
        return [f"low confidence: {frames}, fewer than {max(fewest, 2)}"]
    halves: list[Array] = []
    for odd in (0, 1):
        mine = [i for scene in different[odd::2] for i in scene]
        half = solve_half(
            [features[i] for i in mine], [pictures[i] for i in mine], T_initial, T, plan, rng
        )
        # The joint estimate is about their mean, so that they may be farther from each other.
        for other, share in [(T, 1.0), *((h, np.sqrt(2.0)) for h in halves)]:
            turned = float(np.rad2deg(se3.rotation_error(half, other)))
            moved = se3.translation_error(half, other)
            if turned > share * degrees or moved > share * metres:
                what = "half of the pairs alone ends" if other is T else "halves of the pairs end"
                where = "away" if other is T else "apart"
                return [f"{what} {turned:.2g} deg, {moved:.2g} m {where}"]
        halves.append(half)
    return []
