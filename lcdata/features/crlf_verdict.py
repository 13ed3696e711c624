"""Whether a pose found by lane and pole masks can be trusted. Ours, not in the paper.

Three questions: do the marks and poles determine all six degrees of freedom (the covariance from
the curvature of the agreement and the disagreement of marks and poles among themselves), do
disjoint halves of them agree, and is there another pose that explains as much.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lcdata.features.crlf_refine import REACH, agreement, part, polished, slope, slopes
from lcdata.features.road_cost import class_means, flat_poses
from lcdata.features.road_view import COARSE, FINE, Road, RoadView, Stack, in_view, stack
from lcdata.geometry import se3

Array = NDArray[np.float64]

PROBE = np.repeat([0.02, np.deg2rad(0.1)], 3)
"""Spread of the probes of the curvature, metres then radians."""

INFLATION = 1.5
"""On the covariance: masks are wrong in ways that all their parts share."""

FLOOR = np.repeat([0.01, np.deg2rad(0.05)], 3)
"""Standard deviations that no mask is better than, metres then radians."""

SIGMA_M, SIGMA_RAD = 0.035, np.deg2rad(0.15)
"""Largest predicted standard deviations, in the worst direction, of a pose that is trusted."""

HALVES_M, HALVES_RAD = 0.1, np.deg2rad(0.5)
"""How far halves may be apart."""

RIVAL_M, RIVAL = 0.35, 0.04
"""How far starts of rivals are displaced, and how much less than the best they may agree."""

WEIGHTS = np.repeat([1.0, 0.1], 3)
"""Metres and radians that matter alike: those that an object at 10 m moves by."""

LEAST_PHI, LEAST_POLE = 0.25, 0.5
"""Least correlation of lane points with the lane mask, and share of pole points in theirs."""

SEEN = 10
"""Points of a lane or pole in view for it to count."""


@dataclass(frozen=True, eq=False)
class Verdict:
    """What is to be said about a pose.

    Args:
        covariance: 6x6, see `Calibration`; NaN where it cannot be told.
        undetermined: Why the data do not determine the pose; empty if they do.
        doubts: Why it should not be trusted.
    """

    covariance: Array
    undetermined: list[str]
    doubts: list[str]


def judge(road: Road, data: Stack, T: Array) -> Verdict:
    """Judge the pose at the top of the agreement.

    Args:
        road: All pairs.
        data: What was compared at last.
        T: 4x4 pose.
    """
    lanes, poles = seen(road.views, T)
    undetermined: list[str] = []
    doubts: list[str] = []
    if lanes < 2:
        undetermined.append(f"{lanes} lanes in view, two needed")
    if poles < 1:
        undetermined.append("no pole in view")
    covariance = predicted(data, T)
    if covariance is None:
        undetermined.append("the agreement has no top in some direction")
        return Verdict(np.full((6, 6), np.nan), undetermined, doubts)
    metres, radians = (
        float(np.sqrt(np.linalg.eigvalsh(block)[-1]))
        for block in (covariance[:3, :3], covariance[3:, 3:])
    )
    if metres > 10 * SIGMA_M or radians > 10 * SIGMA_RAD:
        undetermined.append(f"uncertain by {metres:.2f} m and {np.rad2deg(radians):.1f} deg")
    elif metres > SIGMA_M or radians > SIGMA_RAD:
        doubts.append(f"uncertain by {metres:.3f} m and {np.rad2deg(radians):.2f} deg")
    pole = float(_means(data, T)[2])
    share = float(agreement(data, T[None])[0]) - pole
    if share < LEAST_PHI or pole < LEAST_POLE:
        doubts.append(
            f"lanes fit to {share:.2f} ({LEAST_PHI} needed), poles to {pole:.2f} ({LEAST_POLE})"
        )
    rival = strongest_rival(road, T, covariance)
    if rival is not None:
        doubts.append(
            f"{se3.translation_error(rival, T):.2f} m and "
            f"{np.rad2deg(se3.rotation_error(rival, T)):.1f} deg away, the masks agree as well"
        )
    apart_m, apart_rad = halves_apart(data, T)
    if apart_m > HALVES_M or apart_rad > HALVES_RAD:
        doubts.append(
            f"halves of the marks and poles disagree by {apart_m:.3f} m and "
            f"{np.rad2deg(apart_rad):.2f} deg"
        )
    return Verdict(covariance, undetermined, doubts)


def seen(views: Sequence[RoadView], T: Array) -> tuple[int, int]:
    """Lanes and poles in view, of the pair that has most of each."""
    lanes = poles = 0
    for view in views:
        cloud = view.cloud
        along = np.abs(_run(cloud.lane_lines) @ cloud.R_ground_lidar[0]) > 0.9
        inside = in_view(view, cloud.lanes, T[None], 0.0)
        count = np.bincount(cloud.lane_of[inside], minlength=len(cloud.lane_lines))
        lanes = max(lanes, int(np.count_nonzero((count >= SEEN) & along)))
        inside = in_view(view, cloud.poles, T[None], 0.0)
        count = np.bincount(cloud.pole_of[inside], minlength=len(cloud.pole_lines))
        poles = max(poles, int(np.count_nonzero(count >= SEEN // 2)))
    return lanes, poles


def _run(segments: Array) -> Array:
    run = segments[:, 1] - segments[:, 0]
    return np.asarray(run / np.maximum(np.linalg.norm(run, axis=1, keepdims=True), 1e-9))


def _means(data: Stack, T: Array) -> Array:
    """(3,) mean of the fine maps under lanes, road and poles, over pairs."""
    arrays = (data.points, data.start, data.maps[FINE], data.place, data.shape, data.intrinsics)
    return np.asarray(class_means(flat_poses(T), *arrays, True, 1)[0].mean(0))


def predicted(data: Stack, T: Array) -> Array | None:
    """6x6 covariance; None where the agreement is not curved downwards in every direction.

    With curvature H and slopes g of the marks and poles, which cancel at the top, a sample of
    other marks and poles would have its top at H^-1 sum(g) off: covariance H^-1 (sum g g^T) H^-1.
    """
    H = curvature(data, T)
    if H is None:
        return None
    gradients = slopes(data, T, COARSE)[1]
    gradients -= gradients.mean(0)
    inverse = np.linalg.inv(H)
    covariance = INFLATION * inverse @ (gradients.T @ gradients) @ inverse + np.diag(FLOOR**2)
    return np.asarray(0.5 * (covariance + covariance.T))


def curvature(data: Stack, T: Array, probes: int = 32) -> Array | None:
    """(6, 6) negative Hessian that explains best how slopes change around a pose."""
    from scipy.stats import qmc

    places = np.sqrt(3.0) * (2.0 * qmc.Sobol(6, rng=0).random(probes) - 1.0)
    changes = np.empty((probes, 6))
    for place, change in zip(places, changes, strict=True):
        ahead, back = (
            slope(data, se3.exp(sign * place * PROBE) @ T, COARSE) for sign in (1.0, -1.0)
        )
        change[:] = -0.5 * (ahead - back) * PROBE
    H = np.linalg.lstsq(places, changes, rcond=None)[0]
    H = 0.5 * (H + H.T)
    values = np.linalg.eigvalsh(H)
    if values[0] <= 1e-3 * max(values[-1], 0.0) or values[-1] <= 0.0:
        return None
    return np.asarray(H / np.outer(PROBE, PROBE))


def strongest_rival(road: Road, T: Array, covariance: Array) -> Array | None:
    """Another top of the agreement nearly as high, None if there is none near by.

    Dashes and stripes repeat themselves along the road, and what is weakly determined has shallow
    tops: starts are displaced along the road and along the two least determined directions.
    """
    along = T[:3, :3] @ road.views[0].cloud.R_ground_lidar[0]
    scaled = covariance / np.outer(WEIGHTS, WEIGHTS)
    weakest = (np.linalg.eigh(scaled)[1][:, -2:] * WEIGHTS[:, None]).T
    weakest *= RIVAL_M / np.maximum(np.abs(weakest[:, :3]).max(1, keepdims=True), 0.1)
    moves = np.concatenate([[RIVAL_M * np.concatenate([along, np.zeros(3)])], weakest])
    data = stack(road, T[None])
    best = float(agreement(data, polished(data, T)[None])[0])
    rivals = []
    for move in np.concatenate([moves, -moves]):
        other = polished(data, se3.exp(move) @ T, reach=2.0 * REACH)
        metres, radians = se3.translation_error(other, T), se3.rotation_error(other, T)
        if metres > HALVES_M or radians > HALVES_RAD:
            rivals.append((float(agreement(data, other[None])[0]), other))
    value, other = max(rivals, key=lambda rival: rival[0], default=(-np.inf, T))
    return other if value > best - RIVAL else None


def halves_apart(data: Stack, T: Array) -> tuple[float, float]:
    """Metres and radians between the tops of two disjoint halves of the marks and poles."""
    poses = [polished(part(data, data.group % 2 == odd), T) for odd in (0, 1)]
    return se3.translation_error(*poses), se3.rotation_error(*poses)
