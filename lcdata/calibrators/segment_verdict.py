"""Whether the most consistent pose can be trusted, and how far it may be off.

The score of masks has several minima, and a single sparse scan can be more consistent elsewhere:
a result is trusted only if it stands out from the poses around, if halves of the data searched
anew come to the same pose, and if the predicted errors are small.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from lcdata.calibrators.agreement import (
    box_doubts,
    contrast_doubts,
    depth_and_contrast,
    halves_apart,
    halves_doubts,
)
from lcdata.calibrators.uncertainty import too_uncertain
from lcdata.features.chamfer_search import displaced
from lcdata.features.nid_search import Stage, shrinking_search
from lcdata.features.segment_objective import Prior, SegmentObjective
from lcdata.features.segment_search import bowl, swapped

Array = NDArray[np.float64]

INFLATION = 1.0
"""Variance of the estimate over the predicted one: errors are about as predicted on real pairs."""

PROBE = np.repeat([0.1, np.deg2rad(0.5)], 3)
"""Half-widths of the box in which the cost is taken for a parabola, metres then radians."""

PROBES = 400

CURVATURE_POINTS = 5000
"""Points of a pair that the parabola is fitted to."""

AROUND = 120
"""Poses that a minimum has to stand out from."""

HALF_POINTS = 3000
"""Points of a pair of a half."""

HALF_STAGES = (
    Stage(0, 0.3, 30, 350),
    Stage(0, 0.15, 20, 250),
    Stage(0, 0.07, 10, 200),
    Stage(0, 0.03, 8, 120),
)


def judge(
    last: SegmentObjective,
    T: Array,
    T_initial: Array,
    box: Array,
    limits: tuple[float, float],
    rng: np.random.Generator,
) -> tuple[Array, list[str], list[str]]:
    """Predicted covariance, what is undetermined, and what is doubtful about a result.

    Args:
        last: What was minimised.
        T: 4x4 its minimum.
        T_initial: 4x4 initial guess.
        box: (6,) half-widths of the search, metres then radians.
        limits: Largest standard deviations, metres and degrees.
        rng: Of the probes.
    """
    doubts: list[str] = []
    undetermined: list[str] = []
    last = replace(last, prior=None)
    covariance = predicted(last, T, Prior(T_initial, box), rng)
    if covariance is None:
        covariance = np.full((6, 6), np.nan)
        undetermined.append("the cost is not curved upwards")
    else:
        undetermined += too_uncertain(covariance, *limits)
    doubts += box_doubts(T, T_initial, box)
    doubts += contrast_doubts(contrast_of(last, T, box, rng))

    def search(half: int, start: Array) -> Array:
        return _half_minimum(last.half(half), start, box, rng)

    doubts += halves_doubts(halves_apart(search, T, box, 0.25, rng), len(last.views))
    return covariance, undetermined, doubts


def predicted(
    last: SegmentObjective, T: Array, prior: Prior, rng: np.random.Generator
) -> Array | None:
    """A minimum as a Gaussian: 6x6 covariance H^-1 (sum g g^T) H^-1 of a left perturbation.

    H is the Hessian of a parabola fitted to the cost around and of the prior, g the slope of the
    share of one part of one image: masks side by side are wrong together, parts of the image are
    not (White 1982, clustered).

    Returns:
        None where the cost is not curved upwards in any direction.
    """
    thin = last.thinned(CURVATURE_POINTS * len(last.views), rng)
    found = bowl(thin, T, PROBE, PROBES, rng)
    if found is None:
        return None
    values, axes = np.linalg.eigh(found.curvature)
    if values[-1] <= 0.0:
        return None
    scale = np.outer(PROBE, PROBE)
    H = axes * np.maximum(values, 0.0) @ axes.T / scale
    shares = thin.shares(found.poses, T)
    slopes = np.linalg.lstsq(found.terms, shares, rcond=None)[0][1:]
    scatter = INFLATION * slopes @ slopes.T / scale
    # The guess counts as an observation, off by half the box.
    known = prior.curvature / len(last.views)
    scatter += known @ np.diag((0.5 * prior.box) ** 2) @ known
    inverse = np.linalg.inv(H + known)
    covariance = inverse @ scatter @ inverse
    # No direction is known worse than from the guess alone.
    bounded = np.linalg.inv(np.linalg.pinv(covariance) + np.diag((0.5 * prior.box) ** -2.0))
    return np.asarray(0.5 * (bounded + bounded.T))


def contrast_of(last: SegmentObjective, T: Array, box: Array, rng: np.random.Generator) -> float:
    """Depth of a minimum under the mean of poses around, in their standard deviations."""
    thin = last.thinned(5000 * len(last.views), rng)
    around = displaced(T, rng.uniform(-1, 1, (AROUND, 6)) * swapped(box))
    costs = thin.hard(np.concatenate([T[None], around]))
    return depth_and_contrast(costs, AROUND // 4)[1]


def _half_minimum(
    half: SegmentObjective, start: Array, box: Array, rng: np.random.Generator
) -> Array:
    """The minimum of half of the data."""
    thin = half.thinned(HALF_POINTS * len(half.views), rng)
    found, _ = shrinking_search([thin.hard], start, 0.5 * swapped(box), 800, HALF_STAGES, rng)
    return np.asarray(found[0])
