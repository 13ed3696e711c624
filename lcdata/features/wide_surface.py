"""The minimum of a rough cost by a quadratic fitted to it (response surface, Box and Wilson 1951).

Where exactly the lowest of many poses lies is chance; the valley around has its middle.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from lcdata.features.chamfer_search import displaced, low_discrepancy

Array = NDArray[np.float64]

SPREAD = np.repeat([np.deg2rad(0.1), 0.012], 3)
"""Standard deviation of the poses that are tried, radians and metres: a few pixels."""

POSES = 512
ROUNDS = 5
LONGEST = 1.5
"""Largest step of a round on one axis, in standard deviations."""
REACH = 6.0
"""How far the middle may end from where it started, in standard deviations."""
SETTLED = 0.1
FLATTEST = 0.02
"""Least curvature that is believed, as a share of the largest."""


def middle(costs: Callable[[Array], Array], T: Array) -> Array:
    """The middle of the valley that a pose lies in: 4x4.

    Args:
        costs: (P, 4, 4) poses to (P,) costs.
        T: 4x4 start.
    """
    from scipy.special import ndtri

    z = np.clip(ndtri(low_discrepancy(POSES, 0)), -2.5, 2.5)
    first, second = np.triu_indices(6)
    design = np.concatenate([np.ones((POSES, 1)), z, z[:, first] * z[:, second]], axis=1)
    solver = np.linalg.pinv(design)
    place = np.zeros(6)
    for _ in range(ROUNDS):
        fit = solver @ costs(displaced(T, (place + z) * SPREAD))
        H = np.zeros((6, 6))
        H[first, second] = fit[7:]
        curvature, axes = np.linalg.eigh(H + H.T)
        if curvature[-1] <= 0.0:
            break
        curvature = np.maximum(curvature, FLATTEST * curvature[-1])
        step = -axes @ ((axes.T @ fit[1:7]) / curvature)
        longest = float(np.abs(step).max())
        place = np.clip(place + step * min(1.0, LONGEST / max(longest, 1e-12)), -REACH, REACH)
        if longest < SETTLED:
            break
    return np.asarray(displaced(T, (place * SPREAD)[None])[0])
