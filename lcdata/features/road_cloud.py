"""Lane marks and poles of a LiDAR scan of a road (Ma et al. 2021, *CRLF*, section III-B1).

The ground is a plane of 0.2 m by RANSAC; lane points on it are brighter than mean plus standard
deviation and lie within 0.3 m of a line (eq. 3). In the ground-parallel frame G, whose origin is
the LiDAR's, z up and x along the lanes (eq. 4), the cells of a 0.5 m grid that reach higher than
H1 = 3 m hold poles (eq. 5), whose points above H0 = -1 m count (eq. 6).

Put right and added:

- eq. (6) prints the inverse of (R_G^L)^-1 where R_L^G is meant: points are tested in G and given
  in L.
- Both heights are measured from the LiDAR, as z of G is. A scanner that does not look 3 m above
  itself at a pole's distance would find none: there, a cell is tall that reaches up to what the
  scanner can see.
- Tall cells also hold trees, facades and gantries. A pole is a steep line of points with little
  else around it.
- The grid goes all around, not only to x = 100 m: which way the camera looks is not known yet.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lcdata.errors import CalibrationError
from lcdata.features.pole_points import find_poles
from lcdata.features.ransac_fits import ransac_lines, ransac_plane
from lcdata.pair import Pair

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

NEAREST_M = 1.0
"""Closer returns are the car's own, or the zeros of missing ones."""

GROUND_REACH_M = 50.0
"""The plane is sought among points within this range."""

UPRIGHT_DEG = 35.0
"""Largest angle between the LiDAR's z axis and the ground's normal."""

FLAT_CELL_M, FLAT_REACH_M, FLAT_SHARE = 2.0, 20.0, 0.45
"""Of the cells within reach, so many must have their lowest point on the plane."""

FEWEST_GROUND = 500

LANE_NEAR_M = 0.15
"""Points so near form a line; those within D0 belong to it afterwards."""

CELL_M = 0.2
"""Lane points are thinned to one a cell for the lines: rings pass the car densely."""

LANE_REACH_M = 60.0
"""Lanes are sought within this range: farther away, rings are too sparse."""

LANE_LENGTH_M, LANE_POINTS, LANE_LINES = 2.5, 8, 8
"""A line's least length and points, and lines at most in each of the two directions."""

BEYOND_M = 1.0
"""Lane points lie so far beyond the ends of their line at most."""


@dataclass(frozen=True)
class CloudOptions:
    """The paper's parameters.

    Args:
        thickness_m: Of the ground plane.
        lane_sigmas: Lane points are brighter than the ground's mean by so many deviations.
        lane_distance_m: D0.
        cell_m: Edge of the cells of the grid S.
        lowest_m: H0, metres above the LiDAR.
        tallest_m: H1, metres above the LiDAR.
        reach_m: Half length of S along the road.
        aside_m: Half width of S.
        seed: Of RANSAC.
    """

    thickness_m: float = 0.2
    lane_sigmas: float = 1.0
    lane_distance_m: float = 0.3
    cell_m: float = 0.5
    lowest_m: float = -1.0
    tallest_m: float = 3.0
    reach_m: float = 100.0
    aside_m: float = 20.0
    seed: int = 0


@dataclass(frozen=True, eq=False)
class RoadCloud:
    """Lane marks and poles of one scan, in the LiDAR frame, metres.

    Args:
        R_ground_lidar: 3x3, turns LiDAR coordinates into those of G: x along the lanes, z up.
        height: Of the LiDAR above the ground.
        lanes: (N, 3) lane points.
        lane_of: (N,) line of each lane point.
        lane_lines: (L, 2, 3) segments, the fullest first.
        poles: (M, 3) pole points.
        pole_of: (M,) pole of each.
        pole_lines: (P, 2, 3) segments from below up.
        road: (K, 3) points of the ground that are no lane points.
        directions: Of all lines of bright points that are straight, degrees from x.
    """

    R_ground_lidar: Array
    height: float
    lanes: Array
    lane_of: NDArray[np.int64]
    lane_lines: Array
    poles: Array
    pole_of: NDArray[np.int64]
    pole_lines: Array
    road: Array
    directions: Array


def road_cloud(pair: Pair, options: CloudOptions | None = None) -> RoadCloud:
    """Find lane marks and poles.

    Args:
        pair: Its points and intensities.
        options: The paper's by default.

    Raises:
        CalibrationError: No intensities, or all the same; no ground, or no flat one.
    """
    options = options or CloudOptions()
    name = f"pair {pair.pair_id}" if pair.pair_id else "pair"
    if pair.intensity is None:
        raise CalibrationError(
            f"{name}: a cloud without intensity, in which lanes cannot be told from the road",
            "give a cloud with an intensity or reflectivity field, or use another method",
        )
    rng = np.random.default_rng(options.seed)
    points = np.asarray(pair.points, float)
    intensity = np.asarray(pair.intensity, float)
    distance = np.linalg.norm(points, axis=1)
    good = np.isfinite(distance) & (distance > NEAREST_M) & np.isfinite(intensity)
    points, intensity, distance = points[good], intensity[good], distance[good]
    normal, d = _ground(points, distance, options, rng, name)
    height_of = points @ normal - d
    ground = np.abs(height_of) < 0.5 * options.thickness_m
    light = intensity[ground]
    if not light.std() > 1e-6 * max(abs(float(light.mean())), 1e-9):
        raise CalibrationError(
            f"{name}: all {len(light)} ground points have intensity {light.mean():g}",
            "give a cloud with the sensor's intensities, or use another method",
        )
    R = _level(normal)
    bright = ground.copy()
    bright[ground] = light > light.mean() + options.lane_sigmas * light.std()
    flat = points @ R.T
    bright &= np.hypot(flat[:, 0], flat[:, 1]) < LANE_REACH_M
    lines, counts = _lane_lines(flat[bright, :2], rng)
    turn = _along_lanes(lines, counts)
    R, flat = turn @ R, flat @ turn.T
    inside = (np.abs(flat[:, 0]) < options.reach_m) & (np.abs(flat[:, 1]) < options.aside_m)
    bright &= inside
    segments = np.concatenate([_parallel(flat[bright, :2], axis) for axis in (0, 1)])
    lane, lane_of = _near_lines(flat, bright, segments, options.lane_distance_m)
    level = np.full((len(segments), 2, 1), d)
    above = inside & (height_of > 0.5 * options.thickness_m) & (flat[:, 2] > options.lowest_m)
    pole, pole_of, pole_lines = find_poles(
        flat, np.flatnonzero(above), options.cell_m, options.tallest_m
    )
    return RoadCloud(
        R,
        -d,
        points[lane],
        lane_of,
        np.concatenate([segments, level], 2) @ R,
        points[pole],
        pole_of,
        pole_lines @ R,
        points[np.flatnonzero(ground & inside & ~bright)],
        _directions(lines @ turn[:2, :2].T),
    )


def _directions(lines: Array) -> Array:
    """Angles of (L, 2, 2) lines to the x axis, -90..90 degrees."""
    run = lines[:, 1] - lines[:, 0]
    angle = np.arctan2(run[:, 1], run[:, 0])
    return np.asarray(np.rad2deg((angle + np.pi / 2) % np.pi - np.pi / 2))


def _ground(
    points: Array, distance: Array, options: CloudOptions, rng: np.random.Generator, name: str
) -> tuple[Array, float]:
    """Normal towards the LiDAR and distance of the ground plane: n . p = d, d below 0."""
    near = points[distance < GROUND_REACH_M]
    half = 0.5 * options.thickness_m
    found = ransac_plane(near, half, np.deg2rad(UPRIGHT_DEG), rng)
    count = 0 if found is None else int(np.count_nonzero(np.abs(near @ found[0] - found[1]) < half))
    if found is None or count < FEWEST_GROUND:
        raise CalibrationError(
            f"{name}: no ground seen: {count} of {len(near)} points within "
            f"{GROUND_REACH_M:g} m lie on one plane within {UPRIGHT_DEG:g} deg of level",
            "give scans that show the road, with the LiDAR's z axis up or down",
        )
    normal, d = found
    if d > 0:  # the ground is below the LiDAR, whichever side has more points
        normal, d = -normal, -d
    share = _flatness(near, normal, d, half)
    if share < FLAT_SHARE:
        raise CalibrationError(
            f"{name}: the ground is not flat: {share:.0%} of it lies within "
            f"{options.thickness_m:g} m of one plane, {FLAT_SHARE:.0%} needed",
            "give scans of a flat road",
        )
    return normal, d


def _flatness(points: Array, normal: Array, d: float, half: float) -> float:
    """Share of the cells around the LiDAR whose lowest point lies on the plane."""
    R = _level(normal)
    flat = points @ R.T
    low = (np.hypot(flat[:, 0], flat[:, 1]) < FLAT_REACH_M) & (np.abs(flat[:, 2] - d) < 1.5)
    if not low.any():
        return 0.0
    side = int(np.ceil(2 * FLAT_REACH_M / FLAT_CELL_M))
    cell = ((flat[low, :2] + FLAT_REACH_M) / FLAT_CELL_M).astype(np.int64) @ np.array([side, 1])
    lowest = np.full(side * side, np.inf)
    np.minimum.at(lowest, cell, flat[low, 2] - d)
    return float(np.mean(np.abs(lowest[np.isfinite(lowest)]) < 1.5 * half))


def _level(normal: Array) -> Array:
    """3x3 rotation that turns the normal to z and keeps x as near as it can be."""
    x = np.array([1.0, 0.0, 0.0])
    x -= (x @ normal) * normal
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(normal, x), normal])


def _lane_lines(bright: Array, rng: np.random.Generator) -> tuple[Array, NDArray[np.int64]]:
    """(L, 2, 2) lines through bright points of the ground."""
    return ransac_lines(
        _thinned(bright), LANE_NEAR_M, 0.3, LANE_POINTS, LANE_LENGTH_M, LANE_LINES, rng
    )


def _thinned(bright: Array) -> Array:
    """One point a cell."""
    cell = np.floor(bright / CELL_M).astype(np.int64)
    _, first = np.unique(cell @ np.array([1_000_000, 1]), return_index=True)
    return np.asarray(bright[np.sort(first)])


def _along_lanes(segments: Array, counts: NDArray[np.int64]) -> Array:
    """3x3 rotation about z that turns x along most lines: the x axis of G (eq. 4)."""
    if not len(segments):
        return np.eye(3)
    run = segments[:, 1] - segments[:, 0]
    angle = np.arctan2(run[:, 1], run[:, 0])
    weight = counts * np.minimum(np.linalg.norm(run, axis=1), 20.0)
    near = np.cos(2 * (angle[:, None] - angle)) > np.cos(np.deg2rad(6))
    best = int(np.argmax(near @ weight))
    sum2 = (weight[near[best]] * np.exp(2j * angle[near[best]])).sum()
    theta = 0.5 * float(np.angle(sum2))  # within 90 deg of the LiDAR's x axis
    c, s = np.cos(theta), np.sin(theta)
    return np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])


def _parallel(bright: Array, axis: int) -> Array:
    """(L, 2, 2) lines along an axis of G: bands with more points than their neighbours."""
    points = _thinned(bright)
    segments: list[Array] = []
    while len(points) >= LANE_POINTS and len(segments) < LANE_LINES:
        offset = points[:, 1 - axis]
        order = np.sort(offset)
        edges = np.array([[-3, -1], [-1, 1], [1, 3]]) * LANE_NEAR_M
        low, high = (np.searchsorted(order, offset[:, None] + edges[:, k]) for k in (0, 1))
        before, within, after = (high - low).T
        contrast = within - np.maximum(before, after)
        best = int(contrast.argmax())
        if contrast[best] < LANE_POINTS:
            break
        centre, slope = float(offset[best]), 0.0
        for _ in range(3):
            away = offset - centre - slope * points[:, axis]
            on = np.abs(away) < LANE_NEAR_M
            if on.sum() < LANE_POINTS or np.ptp(points[on, axis]) < LANE_LENGTH_M:
                break
            x = points[on, axis]
            middle = x.mean()
            turn = float((x - middle) @ away[on] / ((x - middle) @ (x - middle)))
            centre, slope = centre + float(away[on].mean()) - turn * middle, slope + turn
        away = np.abs(offset - centre - slope * points[:, axis])
        along = points[away < LANE_NEAR_M, axis]
        if len(along) >= LANE_POINTS and np.ptp(along) >= LANE_LENGTH_M:
            ends = np.array([along.min(), along.max()])
            segment = np.column_stack([ends, centre + slope * ends])
            segments.append(segment if axis == 0 else segment[:, ::-1])
        gone = away < 2 * LANE_NEAR_M
        gone[best] = True
        points = points[~gone]
    return np.array(segments).reshape(-1, 2, 2)


def _near_lines(
    flat: Array, bright: Mask, segments: Array, limit: float
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Indices of bright points near a line (eq. 3), and which line."""
    index = np.flatnonzero(bright)
    if not len(segments) or not len(index):
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    run = segments[:, 1] - segments[:, 0]
    length = np.linalg.norm(run, axis=1)
    run /= length[:, None]
    offset = flat[index, None, :2] - segments[None, :, 0]
    away = np.abs(offset[..., 0] * run[:, 1] - offset[..., 1] * run[:, 0])
    along = np.einsum("nlk,lk->nl", offset, run)
    away[(along < -BEYOND_M) | (along > length + BEYOND_M)] = np.inf
    nearest = away.argmin(1)
    kept = away.min(1) < limit
    return index[kept], nearest[kept]
