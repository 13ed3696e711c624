"""An estimate that is nearly right, made better by intensities and edges, and judged by them.

The cost is that of `nid_edge`; what is left out is its search and its verdict, since whoever asks
knows the pose to a fraction of a degree and has a verdict of his own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lcdata.calibrators.nid_verdict import landscape, sandwich
from lcdata.features.nid_objective import NidFeatures, objective
from lcdata.features.nid_registration import averaged, limited
from lcdata.features.nid_search import bfgs

Array = NDArray[np.float64]

REACH = np.repeat([0.06, np.deg2rad(0.5)], 3)
"""Farthest that one round goes, metres then radians."""

AROUND = np.repeat([0.3, np.deg2rad(3.0)], 3)
"""Box whose poses a right one stands out from, metres then radians."""

ROUNDS = 2
"""Hidden points are removed so often."""

FEWEST_POINTS = 300
"""Points in view below which a histogram says nothing."""


@dataclass(frozen=True, eq=False)
class Polished:
    """A minimum of intensities and edges near an estimate.

    Args:
        T: 4x4 `T_camera_lidar`.
        covariance: 6x6, left perturbation; None where the cost leaves a direction open.
        contrast: How far its cost lies under those of poses up to 3 deg and 0.3 m away on each
            axis, in their standard deviations: 7 and more at right poses of simulated rooms, 3.5
            to 6 on roads, mostly below 2.5 at wrong ones.
        cost: At the minimum.
        cost_before: At the estimate, of the same points.
    """

    T: Array
    covariance: Array | None
    contrast: float
    cost: float
    cost_before: float


def polish(features: Sequence[NidFeatures], T: Array, seed: int = 0) -> Polished | None:
    """Register intensities and edges from a pose that is nearly right.

    Args:
        features: Of each pair, with edges.
        T: 4x4 `T_camera_lidar`.
        seed: Of what is drawn at random.

    Returns:
        The minimum; None where too few points are in view.
    """
    rng = np.random.default_rng([seed, 3])
    found = T
    for k in range(ROUNDS):
        current = limited(objective(features, found, True), seed + k)
        if current.inside < FEWEST_POINTS * len(features):
            return None
        found, _ = bfgs(current.slope, found, REACH, 30, 1e-7)
    found = averaged(current, found, REACH, rng)
    gaussian = sandwich(current, found)
    contrast = landscape(current, found, AROUND, rng)[1]
    return Polished(
        found,
        None if gaussian is None else gaussian[0],
        contrast,
        current.slope(found)[0],
        current.slope(T)[0],
    )
