"""The minimum of a rough cost by a quadratic fitted to it (response surface, Box and Wilson 1951).

Where exactly the lowest of many poses lies is chance; the valley around has its middle.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from lcdata.features.chamfer_search import displaced, low_discrepancy
from lcdata.geometry import se3

Array = NDArray[np.float64]
Costs = Callable[[Array], Array]

SPREAD = np.repeat([np.deg2rad(0.1), 0.012], 3)
"""Standard deviation of the poses that are tried, radians and metres: a few pixels."""

POSES = 512
OPPOSITES = 64
"""Pairs of opposite poses that tell the slopes of halves of the data."""
ROUNDS = 5
LONGEST = 1.5
"""Largest step of a round on one axis, in standard deviations."""
REACH = 6.0
"""How far the middle may end from where it started, in standard deviations."""
SETTLED = 0.1
INFLATION = 2.6
"""Variance of the estimate over that by parts of images, at least: what a frame's parts have in
common they do not tell. Measured on mixed groups of real frames."""
PRIOR = 6.0
"""Degrees of freedom that the scatter by parts counts beside that of the frames."""
FLATTEST = 0.02
"""Least curvature that is believed, as a share of the largest."""


def middle(costs: Costs, T: Array) -> Array:
    """The middle of the valley that a pose lies in: 4x4.

    Args:
        costs: (P, 4, 4) poses to (P,) costs.
        T: 4x4 start.
    """
    tried, solver = _design()
    place = np.zeros(6)
    for _ in range(ROUNDS):
        slope, H = _quadratic(solver @ costs(displaced(T, (place + tried) * SPREAD)))
        inverse = _inverse(H)
        if inverse is None:
            break
        step = -inverse @ slope
        longest = float(np.abs(step).max())
        place = np.clip(place + step * min(1.0, LONGEST / max(longest, 1e-12)), -REACH, REACH)
        if longest < SETTLED:
            break
    return np.asarray(displaced(T, (place * SPREAD)[None])[0])


def scatter(
    whole: Costs, frames: Sequence[Costs], halves: Sequence[Costs], T: Array
) -> Array | None:
    """6x6 covariance of the minimum of a cost, from those of random halves of its data.

    Half of the data has twice the variance, and half of that it shares with the whole: the halves'
    minima scatter about the whole's as that does about the truth (delete-half jackknife, Shao and
    Wu 1989). All have the whole's curvature. Halves of the images' parts are many but blind to
    what a frame has in common with itself, frames (White 1982, clustered) are few: how much they
    scatter in all is the frames' word, which way mostly the halves', and that both together are
    few is Student's factor.

    Args:
        whole: The cost, (P, 4, 4) poses to (P,).
        frames: The costs whose mean it is, of one frame each.
        halves: The same of halves of every frame's parts.
        T: 4x4 the minimum.

    Returns:
        Translation (m) then rotation (rad), left perturbation; None where the cost is not curved
        upwards.
    """
    tried, solver = _design()
    inverse = _inverse(_quadratic(solver @ whole(displaced(T, tried * SPREAD)))[1])
    if inverse is None:
        return None
    # Opposite poses: what they differ by is slope, whatever the curvature.
    some = tried[:OPPOSITES]
    poses = displaced(T, np.concatenate([some, -some]) * SPREAD)
    opposite = 0.5 * np.asarray(np.linalg.pinv(some))

    def slope(costs: Costs) -> Array:
        ahead, back = np.split(costs(poses), 2)
        return np.asarray(opposite @ (ahead - back))

    middle_slope = slope(whole)
    parts = np.array([slope(half) - middle_slope for half in halves])
    slopes = _spread(parts, np.array([slope(frame) for frame in frames]))
    # From Exp(w) R, t + p to the left perturbation: the rotation turns the translation too.
    J = np.zeros((6, 6))
    J[:3, 3:], J[3:, :3] = np.eye(3), np.eye(3)
    J[:3, :3] = se3.skew(T[:3, 3])
    turned = (J * SPREAD) @ inverse
    covariance = turned @ slopes @ turned.T
    return np.asarray(0.5 * (covariance + covariance.T))


def _spread(parts: Array, frames: Array) -> Array:
    """Covariance of the whole's slope.

    Args:
        parts: (K, 6) slopes of halves of all frames' parts, less the whole's.
        frames: (N, 6) slopes of each frame.
    """
    within, free = parts.T @ parts / len(parts), len(frames) - 1
    among, ratio = np.zeros((6, 6)), INFLATION
    if free:
        gaps = frames - frames.mean(axis=0)
        among = gaps.T @ gaps / (free * len(frames))
        ratio = max(float(np.trace(np.linalg.pinv(within) @ among)) / 6.0, INFLATION)
    known = PRIOR + free
    both = (PRIOR * ratio * within + free * among) / known
    return np.asarray(both * known / (known - 2.0))


def _design() -> tuple[Array, Array]:
    """(POSES, 6) places in standard deviations, and the matrix that fits quadratics to costs."""
    from scipy.special import ndtri

    tried = np.clip(ndtri(low_discrepancy(POSES, 0)), -2.5, 2.5)
    first, second = np.triu_indices(6)
    columns = [np.ones((POSES, 1)), tried, tried[:, first] * tried[:, second]]
    return tried, np.linalg.pinv(np.concatenate(columns, axis=1))


def _quadratic(fit: Array) -> tuple[Array, Array]:
    """Slope (6,) and Hessian (6, 6) of a fit."""
    H = np.zeros((6, 6))
    H[np.triu_indices(6)] = fit[7:]
    return fit[1:7], H + H.T


def _inverse(H: Array) -> Array | None:
    """Inverse of a Hessian whose flattest directions are taken to be less flat.

    None for one that curves downwards more than upwards.
    """
    curvature, axes = np.linalg.eigh(H)
    if curvature[-1] <= max(-curvature[0], 0.0):
        return None
    return np.asarray((axes / np.maximum(curvature, FLATTEST * curvature[-1])) @ axes.T)
