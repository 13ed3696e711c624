"""Whether edges laid on edges can be trusted, and how far they may be off."""

from __future__ import annotations

from collections.abc import Sequence

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
from lcdata.features.edge_alignment import GATES, Aligned, Alignment, Matches
from lcdata.geometry import se3

Array = NDArray[np.float64]

AGREE_M, AGREE_RAD = 0.06, np.deg2rad(0.3)
"""Halves of the data must come to poses this close: tighter than a success may be off, because
the same clutter draws both halves."""

FEWEST_MATCHES = 150
"""Matched edge points a pair below which a pose may be a coincidence."""

MIN_SHARE = 0.2
"""Part of the edge points in view that must be matched."""

PARALLEL = 0.02
"""Second over first eigenvalue of the edges' directions below which they are all parallel."""

RIVAL = 0.93
"""Another minimum of at least so much of the gain makes the result ambiguous."""

INFLATION = 20.0
"""Variance of the estimate over the predicted one, measured on simulated pairs."""


def judge(
    last: Alignment,
    found: Aligned,
    others: Sequence[Aligned],
    T_initial: Array,
    box: Array,
    limits: tuple[float, float],
    rng: np.random.Generator,
) -> tuple[Array, list[str], list[str]]:
    """Predicted covariance, what is undetermined, and what is doubtful about a result.

    Args:
        last: What was minimised.
        found: Its minimum.
        others: Other minima of the search.
        T_initial: 4x4 initial guess.
        box: (6,) half-widths of the search, metres then radians.
        limits: Largest standard deviations, metres and degrees.
        rng: Of the probes.
    """
    doubts, undetermined = [], []
    matches = found.matches
    covariance = sandwich(matches, found.weights)
    undetermined += too_uncertain(covariance, *limits)
    spread = directions(matches)
    if spread < PARALLEL:
        undetermined.append(f"matched edges are nearly parallel (eigenvalues {spread:.3f})")
    count = len(matches.residual)
    if count < FEWEST_MATCHES:
        doubts.append(f"only {count} edge points match")
    if count < MIN_SHARE * last.count:
        doubts.append(f"only {count} of {last.count} edge points in view match")
    doubts += box_doubts(found.T, T_initial, box)
    doubts += contrast_doubts(contrast(last, found.T, box, rng))
    for other in others:
        near_m = se3.translation_error(other.T, found.T)
        near_rad = se3.rotation_error(other.T, found.T)
        if other.cost < RIVAL * found.cost and (near_m > AGREE_M or near_rad > AGREE_RAD):
            place = f"{np.rad2deg(near_rad):.2g} deg and {near_m:.2g} m away"
            doubts.append(f"a second minimum {place} gains {other.cost / found.cost:.0%} as much")
            break

    def search(half: int, start: Array) -> Array:
        return last.half(half).minimise(start, GATES[1:]).T

    apart = halves_apart(search, found.T, box, 0.2, rng)
    doubts += halves_doubts(apart, len(last.views), AGREE_M, AGREE_RAD)
    return covariance, undetermined, doubts


def sandwich(matches: Matches, weights: Array) -> Array:
    """6x6 covariance H^-1 (H + sum g g^T) H^-1, inflated, of the weighted normal equations.

    H is J^T W J; g is the gradient's share of one part of one image: neighbouring matches are
    wrong together, parts of the image are not (White 1982, clustered). The expected noise, H
    itself, is the floor: a few edges that happen to fit prove nothing.

    Args:
        matches: At the minimum.
        weights: (M,) robust weights times inverse variances.

    Returns:
        Infinite variances where H is singular.
    """
    weighted = matches.jacobian * weights[:, None]
    H = weighted.T @ matches.jacobian
    scale = np.sqrt(np.maximum(np.diag(H), 1e-12))
    values, vectors = np.linalg.eigh(H / np.outer(scale, scale))
    inverse = (vectors / np.maximum(values, 1e-12)) @ vectors.T / np.outer(scale, scale)
    shares = np.zeros((int(matches.cluster.max(initial=0)) + 1, 6))
    np.add.at(shares, matches.cluster, weighted * matches.residual[:, None])
    covariance = INFLATION * inverse @ (H + shares.T @ shares) @ inverse
    return np.asarray(0.5 * (covariance + covariance.T))


def directions(matches: Matches) -> float:
    """Second over first eigenvalue of the matched edges' directions in space; 1 at most."""
    if len(matches.tangents) < 2:
        return 0.0
    values = np.linalg.eigvalsh(matches.tangents.T @ matches.tangents)
    return float(values[1] / max(values[2], 1e-12))


def contrast(last: Alignment, T: Array, box: Array, rng: np.random.Generator) -> float:
    """Depth of a pose under the mean of poses around, in their standard deviations."""
    around = rng.uniform(-1, 1, (150, 6)) * np.concatenate([box[3:], box[:3]])
    thin = last.thinned(1500, rng)
    costs = thin.costs(np.concatenate([T[None], displaced(T, around)]), 2)
    return depth_and_contrast(costs)[1]
