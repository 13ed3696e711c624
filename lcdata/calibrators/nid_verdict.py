"""Whether a minimum of NID can be trusted, and how far it may be off.

NID has many minima, and its depth alone says little: a sparse scan can fit a wrong pose better
than the right one. So a result is trusted only if halves of the data, searched anew from
elsewhere, come to the same pose.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lcdata.calibrators.agreement import (
    AGREE_M,
    AGREE_RAD,
    box_doubts,
    contrast_doubts,
    depth_and_contrast,
    halves_apart,
    halves_doubts,
)
from lcdata.calibrators.uncertainty import too_uncertain
from lcdata.features.chamfer_search import displaced
from lcdata.features.nid_search import Stage, bfgs, shrinking_search
from lcdata.features.pose_cost import PoseCost
from lcdata.geometry import se3

Array = NDArray[np.float64]

RIVAL = 0.9
"""Another minimum of at least so much of the depth makes the result ambiguous."""

INFLATION = 3.0
"""Variance of the estimate over the predicted one, measured on simulated pairs."""

PROBE = np.repeat([0.004, np.deg2rad(0.04)], 3)
"""Spread of the probes of the cost's curvature: nearer it is rough, farther off it flattens."""

CURVATURE_POINTS = 30_000
"""Points of a pair that the curvature is taken from."""

HALF_STAGES = (
    Stage(0, 0.3, 30, 400),
    Stage(0, 0.15, 20, 300),
    Stage(0, 0.07, 10, 200),
)


@dataclass(frozen=True, eq=False)
class Minimum:
    """Where a registration ended.

    Args:
        T: 4x4 `T_camera_lidar`.
        others: Other minima with their costs.
    """

    T: Array
    others: tuple[tuple[Array, float], ...]


def judge(
    last: PoseCost,
    found: Minimum,
    T_initial: Array,
    box: Array,
    limits: tuple[float, float],
    rng: np.random.Generator,
) -> tuple[Array, list[str], list[str]]:
    """Predicted covariance, what is undetermined, and what is doubtful about a result.

    Args:
        last: What was minimised.
        found: Its minimum.
        T_initial: 4x4 initial guess.
        box: (6,) half-widths of the search, metres then radians.
        limits: Largest standard deviations, metres and degrees.
        rng: Of the probes.
    """
    doubts = []
    undetermined = []
    gaussian = sandwich(last, found.T)
    if gaussian is None:
        covariance = np.full((6, 6), np.nan)
        undetermined.append("the cost is not curved in every direction")
    else:
        covariance = gaussian[0]
        undetermined += too_uncertain(covariance, *limits)
    doubts += box_doubts(found.T, T_initial, box)
    depth, contrast = landscape(last, found.T, box, rng)
    doubts += contrast_doubts(contrast)
    for T, rival_depth in _rivals(last, found, depth):
        degrees = np.rad2deg(se3.rotation_error(T, found.T))
        metres = se3.translation_error(T, found.T)
        place = f"{degrees:.2g} deg and {metres:.2g} m away"
        doubts.append(f"a second minimum {place} is {rival_depth:.0%} as deep")

    def search(half: int, start: Array) -> Array:
        return _half_minimum(last.half(half), start, box, rng)

    apart = halves_apart(search, found.T, box, 0.25, rng)
    doubts += halves_doubts(apart, len(last.views))
    return covariance, undetermined, doubts


def sandwich(last: PoseCost, T: Array) -> tuple[Array, Array] | None:
    """A minimum as a Gaussian: 6x6 covariance H^-1 (sum g g^T) H^-1, and how far it is from T.

    H is the Hessian of the cost, g the gradient's share of one part of one image: neighbouring
    points are wrong together, parts of the image are not (White 1982, clustered).

    Returns:
        The covariance and the (6,) Newton step from T to the minimum, both of a left
        perturbation; None where the cost is not curved upwards in every direction.
    """
    thin = last.thinned(CURVATURE_POINTS * len(last.views), np.random.default_rng(0))
    for scale in (1.0, 0.5, 2.0):
        H = _curvature(thin, T, scale * PROBE)
        if H is not None:
            break
    else:
        return None
    shares = last.soft(T)[1]
    inverse = np.linalg.inv(H)
    covariance = INFLATION * inverse @ (shares.T @ shares) @ inverse
    return np.asarray(0.5 * (covariance + covariance.T)), np.asarray(-inverse @ shares.sum(0))


def _curvature(last: PoseCost, T: Array, spread: Array, probes: int = 32) -> Array | None:
    """Hessian that explains best how the gradient changes from place to place around a pose.

    The cost is rough on the scale of a pixel, so that differences close by say little.

    Args:
        last: The cost.
        T: 4x4 its minimum.
        spread: (6,) standard deviations of the probes, metres then radians.
        probes: Pairs of them, opposite to each other.

    Returns:
        (6, 6), or None where it is not positive definite.
    """
    from scipy.stats import qmc

    places = np.sqrt(3.0) * (2.0 * qmc.Sobol(6, rng=0).random(probes) - 1.0)
    changes = np.empty((probes, 6))
    for place, change in zip(places, changes, strict=True):
        ahead, back = (last.slope(se3.exp(s * place * spread) @ T)[1] for s in (1.0, -1.0))
        change[:] = 0.5 * (ahead - back) * spread
    H = np.linalg.lstsq(places, changes, rcond=None)[0]
    H = 0.5 * (H + H.T)
    values = np.linalg.eigvalsh(H)
    if values[0] <= 1e-3 * max(values[-1], 0.0) or values[-1] <= 0.0:
        return None
    return np.asarray(H / np.outer(spread, spread))


def landscape(
    last: PoseCost, T: Array, box: Array, rng: np.random.Generator
) -> tuple[float, float]:
    """Depth of a minimum under the mean of poses around, and over their standard deviation."""
    around = rng.uniform(-1, 1, (200, 6)) * np.concatenate([box[3:], box[:3]])
    thin = last.thinned(8000, rng)
    costs = thin.hard(np.concatenate([T[None], displaced(T, around)]))
    return depth_and_contrast(costs, 20)


def _rivals(last: PoseCost, found: Minimum, depth: float) -> list[tuple[Array, float]]:
    """Other minima nearly as deep, not the same by the limits of success."""
    cost = last.soft(found.T)[0]
    result = []
    for T, _ in found.others:
        if (
            se3.translation_error(T, found.T) < AGREE_M
            and se3.rotation_error(T, found.T) < AGREE_RAD
        ):
            continue
        share = 1.0 - (last.soft(T)[0] - cost) / max(depth, 1e-12)
        if share > RIVAL:
            result.append((T, share))
    return result[:1]


def _half_minimum(half: PoseCost, start: Array, box: Array, rng: np.random.Generator) -> Array:
    """The minimum of half of the data."""
    width = np.concatenate([box[3:], box[:3]])
    thin = half.thinned(3000 * len(half.views), rng)
    found, _ = shrinking_search([thin.hard], start, 0.5 * width, 1000, HALF_STAGES, rng)
    return bfgs(half.thinned(15_000, rng).slope, found[0], 0.3 * box, 20, 1e-6)[0]
