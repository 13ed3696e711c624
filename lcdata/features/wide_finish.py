"""The last step of the wide-range method: intensities and edges by a quadratic, then gradients."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from lcdata.features import wide_objective
from lcdata.features.nid_objective import Objective, objective
from lcdata.features.nid_registration import averaged
from lcdata.features.nid_search import bfgs
from lcdata.features.wide_features import WideFeatures
from lcdata.features.wide_objective import Images, views
from lcdata.features.wide_search import FINE
from lcdata.features.wide_surface import middle

Array = NDArray[np.float64]

REACH = np.repeat([0.05, np.deg2rad(0.3)], 3)
"""Largest step away from the search's result, metres then radians."""

TERMS = wide_objective.Terms((), 0, (12, 6), 20_000, 1.0, wide_objective.MOST_NID_POINTS)
"""Of the cost whose valley's middle is sought: all edges, and all points for NID."""

POINTS = 15_000
"""Points of a pair; more are thinned out."""


def refined(
    features: Sequence[WideFeatures],
    pictures: Sequence[Images],
    T: Array,
    average: bool,
    rng: np.random.Generator,
) -> tuple[Array, Objective]:
    """The minimum of NID and edges next to the search's result.

    First the middle of the valley that the result lies in, then downhill from there.

    Args:
        features: Of all frames.
        pictures: Of all frames.
        T: 4x4 result of the search.
        average: Take the mean of the minima of random halves of points and edges.
        rng: Of samples and halves.

    Returns:
        4x4, and the cost of which it is the minimum.
    """
    margin = np.deg2rad(FINE.margin_deg)
    T = middle(wide_objective.Objective(views(features, pictures, T, margin, True, rng), TERMS), T)
    last = objective([f.nid for f in features], T, True).thinned(POINTS * len(features), rng)
    found, _ = bfgs(last.slope, T, REACH, 30, 1e-7)
    return averaged(last, found, 0.5 * REACH, rng) if average else found, last
