"""Iteratively reweighted least squares over a pose, with a Cauchy loss a line."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lcdata.features.held import free_directions, stepped

Array = NDArray[np.float64]

CAUCHY_SCALE = 1.0
"""Residual, in standard deviations, at which a line's weight has fallen to one half.

Small, because good lines fit to a fraction of a pixel and every third is another edge beside
the right one: a skirting board, a window's frame."""


@dataclass(frozen=True, eq=False)
class Solution:
    """A pose and its fit.

    Args:
        T_camera_lidar: 4x4.
        covariance: 6x6, left perturbation, metres and radians; infinite where undetermined.
        weights: (N,) robust weight of each line, 0..1.
        cost: Mean robust cost of a line, squared standard deviations.
    """

    T_camera_lidar: Array
    covariance: Array
    weights: Array
    cost: float


def minimise(
    evaluate: Callable[[Array], tuple[Array, Array]], T_initial: Array, iterations: int, hold: str
) -> Solution:
    """Levenberg-Marquardt with a Cauchy loss a line.

    Args:
        evaluate: Gives at a pose (N, 2) residuals in standard deviations and their (N, 2, 6)
            derivative by a left perturbation.
        T_initial: 4x4.
        iterations: At most so many steps.
        hold: What stays as it is, see `held.HOLDS`.
    """
    T = np.array(T_initial, float)
    free = free_directions(T, hold)
    r, J = evaluate(T)
    J = J @ free
    weights, cost = cauchy(0.5 * (r * r).sum(1))
    damping = 1e-4
    for _ in range(iterations):
        H = np.einsum("nki,n,nkj->ij", J, weights, J)
        gradient = np.einsum("nki,n,nk->i", J, weights, r)
        step = -np.linalg.lstsq(H + damping * np.diag(np.diag(H)), gradient, rcond=1e-15)[0]
        T_next = stepped(T, free @ step, hold)
        r_next, J_next = evaluate(T_next)
        weights_next, cost_next = cauchy(0.5 * (r_next * r_next).sum(1))
        if cost_next > cost:
            damping *= 10.0
            if damping > 1e6:
                break
            continue
        done = cost - cost_next < 1e-9 * cost
        T, r, J, weights, cost = T_next, r_next, J_next @ free, weights_next, cost_next
        damping = max(damping * 0.1, 1e-9)
        if done:
            break
    H = np.einsum("nki,n,nkj->ij", J, weights, J)
    covariance = invert(H, unit_variance(r, weights, free.shape[1]))
    return Solution(T, free @ covariance @ free.T, weights, cost)


def cauchy(squared: Array) -> tuple[Array, float]:
    """Weights and mean cost of squared residuals in standard deviations."""
    scaled = squared / CAUCHY_SCALE**2
    return 1.0 / (1.0 + scaled), float(CAUCHY_SCALE**2 * np.log1p(scaled).mean())


def unit_variance(residuals: Array, weights: Array, unknowns: int) -> float:
    """Variance of unit weight from the scatter of the residuals, at least 1.

    The expected noise is the floor: a few lines that happen to fit well prove nothing.
    """
    freedom = residuals.shape[1] * weights.sum() - unknowns
    if freedom < 1.0:
        return 1.0
    return max(1.0, float((weights[:, None] * residuals**2).sum() / freedom))


def invert(H: Array, variance: float) -> Array:
    """Covariance of an information matrix; infinite variances where it is singular."""
    diagonal = np.diag(H)
    scale = np.sqrt(np.maximum(diagonal, 1e-12 * diagonal.max(initial=1e-12)))
    values, vectors = np.linalg.eigh(H / np.outer(scale, scale))
    values = np.maximum(values, 1e-14)
    return np.asarray(variance * ((vectors / values) @ vectors.T) / np.outer(scale, scale))
