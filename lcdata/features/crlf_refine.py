"""Refinement of a pose by lane and pole masks (Ma et al. 2021, *CRLF*, section III-D).

`random_refinement` is the paper's Algorithm 1 on J. `refined` is ours, without chance in its result
and better: it asks not only that lane points fall into the lane mask but also that points of the
road beside do not. Per pair, the agreement is

    phi + mean over pole points of s_pole,

phi the correlation of "is a lane point" with s_lane over all ground points, s a mask whose border
is drawn out. J is flat wherever a mark's points all lie inside its mask; phi is not. The search
samples the box around the start evenly, shrinks around the best on ever finer maps, and ends with
BFGS on the analytic gradient.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lcdata.features.crlf_ascent import agreement_slope, climb
from lcdata.features.nid_search import Stage, shrinking_search
from lcdata.features.road_cost import (
    class_means,
    flat_poses,
    group_slopes,
    map_values,
    random_search,
)
from lcdata.features.road_view import COARSE, FINE, HEIGHTS, LAST_POINTS, Road, Stack, stack

Array = NDArray[np.float64]

SAMPLES, QUICK_SAMPLES = 1500, 400
"""Poses of the first round, about a guess and about each of several candidates."""

STAGES = (
    Stage(0, 0.25, 60, 800),
    Stage(1, 0.12, 40, 500),
    Stage(1, 0.06, 30, 400),
    Stage(2, 0.03, 20, 300),
    Stage(2, 0.015, 10, 200),
)
QUICK = (Stage(1, 0.25, 40, 300), Stage(1, 0.12, 20, 200))

STRANGER = 0.25
"""Poles with a smaller mean of the coarse map are none of the image's."""

REACH = np.repeat([0.1, np.deg2rad(0.5)], 3)
"""Largest step of the last ascent, metres then radians."""

CLIMB = 60
"""Steps of an ascent at most."""


def agreement(data: Stack, poses: Array, kind: int = FINE, step: int = 1) -> Array:
    """How well (P, 4, 4) poses explain the masks, the mean over pairs: (P,), at most 2."""
    means = class_means(
        flat_poses(poses),
        data.points,
        data.start,
        data.maps[kind],
        data.place,
        data.shape,
        data.intrinsics,
        True,
        step,
    )
    lane, road, pole = np.moveaxis(means, 2, 0)
    return np.asarray((phi(lane, road, lane_share(data)) + pole).mean(1))


def lane_share(data: Stack) -> Array:
    """(V,) share of the ground's points that are lane points."""
    lanes, roads = data.start[:, 1] - data.start[:, 0], data.start[:, 2] - data.start[:, 1]
    return np.asarray(lanes / np.maximum(lanes + roads / np.maximum(data.road_share, 1e-9), 1))


def phi(lane: Array, road: Array, share: Array) -> Array:
    """Correlation of belonging to a lane with the map, from both means and the lanes' share."""
    mean = share * lane + (1 - share) * road
    spread = np.sqrt(np.maximum(mean - mean * mean, 1e-4))
    return np.asarray(np.sqrt(share * (1 - share)) * (lane - road) / spread)


def cost_j(data: Stack, poses: Array, step: int = 1) -> Array:
    """J of eq. (9) of (P, 4, 4) poses, the mean over pairs: (P,), at most 2."""
    means = class_means(
        flat_poses(poses),
        data.points,
        data.start,
        data.maps[HEIGHTS],
        data.place,
        data.shape,
        data.intrinsics,
        False,
        step,
    )
    return np.asarray((means[..., 0] + means[..., 2]).mean(1))


def random_refinement(
    road: Road,
    T: Array,
    metres: float,
    radians: float,
    settings: tuple[float, float, float, float],
    seed: int,
) -> tuple[Array, Stack]:
    """Algorithm 1.

    The published code swaps the ranges of rotation and translation; and the paper's theta0 of
    0.1 deg is 0.1 rad: its own experiments start 6 deg off.

    Args:
        road: All pairs.
        T: 4x4 start.
        metres: t0.
        radians: theta0.
        settings: Initial step size, its lower bound, search count, decay factor.
        seed: Of the steps.

    Returns:
        4x4, and what was compared.
    """
    data = stack(road, T[None])
    flat = random_search(
        flat_poses(T)[0],
        data.points,
        data.start,
        data.maps[HEIGHTS],
        data.place,
        data.shape,
        data.intrinsics,
        metres,
        radians,
        settings,
        seed,
    )
    U, _, Vt = np.linalg.svd(flat[:9].reshape(3, 3))
    result = np.eye(4)
    result[:3, :3], result[:3, 3] = U @ Vt, flat[9:]
    return result, data


def refined(road: Road, starts: Array, box: Array, seed: int = 0) -> tuple[Array, Stack]:
    """The pose that explains the masks best.

    Args:
        road: All pairs.
        starts: (S, 4, 4) where to look.
        box: (6,) half widths about each, rotation vector (rad), translation (m).
        seed: Of the search's offsets.

    Returns:
        4x4, and what was compared.
    """
    T = starts[0]
    if len(starts) > 1:
        found = np.empty((len(starts), 4, 4))
        for k, T in enumerate(starts):
            data = stack(road, T[None])
            near = searched(data, T, box, seed, QUICK_SAMPLES, QUICK)
            found[k] = polished(data, near, (COARSE,))
        # All by the same points, or they could not be compared.
        values = agreement(stack(road, found), found, COARSE)
        T, box = found[int(np.argmax(values))], 0.4 * box
    T = searched(stack(road, T[None]), T, box, seed)
    T = polished(stack(road, T[None]), T)
    data = without_strangers(stack(road, T[None], LAST_POINTS), T)
    return polished(data, T, (FINE,)), data


def searched(
    data: Stack,
    T: Array,
    box: Array,
    seed: int,
    samples: int = SAMPLES,
    stages: Sequence[Stage] = STAGES,
) -> Array:
    """The best pose of the box about T, to within the last ascent's reach."""
    levels = (
        lambda poses: -cost_j(data, poses, 3),
        lambda poses: -agreement(data, poses, COARSE, 2),
        lambda poses: -agreement(data, poses, FINE),
    )
    found, _ = shrinking_search(levels, T, box, samples, stages, np.random.default_rng(seed))
    return np.asarray(found[0])


def without_strangers(data: Stack, T: Array) -> Stack:
    """What was compared, without poles that are none in the masks: trunks, posts, hidden ones."""
    values = map_values(
        flat_poses(T)[0],
        data.points,
        data.start,
        data.maps[COARSE],
        data.place,
        data.shape,
        data.intrinsics,
    )
    kept = np.ones(len(values), bool)
    for row in data.start:
        pole = slice(row[2], row[3])
        group = data.group[pole]
        if len(group):
            mean = np.bincount(group, values[pole]) / np.maximum(np.bincount(group), 1)
            if (mean[group] > STRANGER).any():
                kept[pole] = mean[group] > STRANGER
    return part(data, kept)


def part(data: Stack, kept: NDArray[np.bool_]) -> Stack:
    """Some of the points."""
    before = np.concatenate([[0], np.cumsum(kept)])
    return replace(
        data,
        points=np.ascontiguousarray(data.points[kept]),
        group=data.group[kept],
        start=np.asarray(before[data.start], np.int64),
    )


def slopes(data: Stack, T: Array, kind: int = FINE) -> tuple[float, Array]:
    """The agreement at a pose and its derivatives, group by group.

    Returns:
        The agreement, and (G, 6) derivatives by a left perturbation, metres then radians; the sum
        over groups is the agreement's gradient.
    """
    pose = flat_poses(T)
    arrays = (data.points, data.start, data.maps[kind], data.place, data.shape, data.intrinsics)
    lane, road, pole = class_means(pose, *arrays, True, 1)[0].T
    share = lane_share(data)
    mean = share * lane + (1 - share) * road
    variance = np.maximum(mean - mean * mean, 1e-4)
    factor = np.sqrt(share * (1 - share) / variance)
    # d phi / d mean, where the variance is not at its floor
    bend = np.where(mean - mean * mean > 1e-4, -0.5 * (lane - road) / variance * (1 - 2 * mean), 0)
    shares = np.column_stack(
        [factor * (1 + bend * share), factor * (bend * (1 - share) - 1), np.ones(len(share))]
    ) / len(share)
    gradients = np.zeros((int(data.group.max(initial=-1)) + 1, 6))
    group_slopes(pose[0], *arrays, shares, data.group, gradients)
    return float((phi(lane, road, share) + pole).mean()), gradients


def slope(data: Stack, T: Array, kind: int = FINE) -> Array:
    """(6,) derivatives of the agreement by a left perturbation, metres then radians."""
    gradient = np.empty(6)
    agreement_slope(flat_poses(T)[0], compared(data, kind), gradient)
    return gradient


def polished(
    data: Stack, T: Array, kinds: Sequence[int] = (COARSE, FINE), reach: Array = REACH
) -> Array:
    """The top of the agreement near a pose, on the coarse and then on the fine maps."""
    pose = flat_poses(T)[0]
    for kind in kinds:
        pose = climb(pose, compared(data, kind), reach, CLIMB)
    result = np.eye(4)
    result[:3, :3], result[:3, 3] = pose[:9].reshape(3, 3), pose[9:]
    return result


def compared(data: Stack, kind: int) -> tuple[NDArray[Any], ...]:
    """What `crlf_ascent` takes of one kind of maps."""
    maps, share = data.maps[kind], lane_share(data)
    return data.points, data.start, maps, data.place, data.shape, data.intrinsics, share
