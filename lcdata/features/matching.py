"""Which cloud line is which image line: gates that shrink around a pose while it is refined."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lcdata.features.distance_fields import NEAR
from lcdata.features.line_features import LineFeatures
from lcdata.features.line_solver import Problem, Solution, Solver

Array = NDArray[np.float64]

GATES = ((5.0, 20.0), (4.0, 14.0), (3.0, 9.0), (2.0, 5.0), (2.0, 5.0), (2.0, 5.0))
"""Largest angle (degrees) and distance (pixels at f = 1000) of a match, round by round."""

SOFTNESS = 0.1
"""Expected residual as a share of the gate while the gates are wide."""

OVERLAP = 0.3
"""Part of the shorter of two lines that must lie beside the other."""

IMAGE_SIGMA = 0.4
"""Standard deviation of an image line's end points across it, pixels."""


@dataclass(frozen=True, eq=False)
class Matches:
    """Matched lines of one pair or several.

    Args:
        pair: (N,) index of the pair.
        segment: (N,) index into its `segments`.
        line: (N,) index into its `image_lines`.
    """

    pair: NDArray[np.int64]
    segment: NDArray[np.int64]
    line: NDArray[np.int64]


def match(
    pairs: Sequence[LineFeatures], T_camera_lidar: Array, angle_deg: float, distance: float
) -> Matches:
    """Mutually nearest lines within gates.

    Args:
        pairs: Features of each pair.
        T_camera_lidar: 4x4 pose to project with.
        angle_deg: Largest angle between image line and projected cloud line, degrees.
        distance: Largest distance between them where they overlap, pixels at f = 1000.
    """
    found = [
        _match_pair(pair, T_camera_lidar, np.deg2rad(angle_deg), distance * pair.focal_length / 1e3)
        for pair in pairs
    ]
    return Matches(
        np.concatenate([np.full(len(s), k, np.int64) for k, (s, _) in enumerate(found)]),
        np.concatenate([s for s, _ in found]),
        np.concatenate([b for _, b in found]),
    )


def _match_pair(
    pair: LineFeatures, T: Array, angle: float, distance: float
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    index, projected = project_segments(pair, T)
    lines = pair.image_lines.reshape(-1, 2, 2)
    if not (len(index) and len(lines)):
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    start, delta = projected[:, 0], projected[:, 1] - projected[:, 0]
    length = np.linalg.norm(delta, axis=1)
    direction = delta / length[:, None]
    line_delta = lines[:, 1] - lines[:, 0]
    line_length = np.linalg.norm(line_delta, axis=1)
    sine = np.abs(_cross(direction[:, None], line_delta[None] / line_length[:, None]))
    a, b = np.nonzero(sine < np.sin(angle))
    away = lines[b] - start[a, None]
    along = np.einsum("nkc,nc->nk", away, direction[a])
    across = _cross(direction[a, None], away)
    low = np.clip(along.min(1), 0.0, length[a])
    high = np.clip(along.max(1), 0.0, length[a])
    # Distance in the middle of the common part, linear along the line.
    slope = (across[:, 1] - across[:, 0]) / np.where(
        np.abs(along[:, 1] - along[:, 0]) < 1e-9, 1e-9, along[:, 1] - along[:, 0]
    )
    middle = np.abs(across[:, 0] + slope * (0.5 * (low + high) - along[:, 0]))
    overlap = (high - low) / np.minimum(length[a], line_length[b])
    good = (middle < distance) & (overlap > OVERLAP)
    a, b = a[good], b[good]
    score = middle[good] / distance + sine[a, b] / np.sin(angle) - overlap[good]
    mutual = _best(score, a, len(index)) & _best(score, b, len(lines))
    return index[a[mutual]], b[mutual]


def _best(score: Array, group: NDArray[np.int64], groups: int) -> NDArray[np.bool_]:
    """Which entries have the lowest score of their group."""
    lowest = np.full(groups, np.inf)
    np.minimum.at(lowest, group, score)
    return np.asarray(score == lowest[group])


def project_segments(pair: LineFeatures, T: Array) -> tuple[NDArray[np.int64], Array]:
    """Cloud lines as seen by the camera.

    Args:
        pair: Its features.
        T: 4x4 `T_camera_lidar`.

    Returns:
        (A',) indices of segments of which a part is in front of the camera and near the image,
        and (A', 2, 2) that part's end points in undistorted pixels.
    """
    points = pair.segments @ T[:3, :3].T + T[:3, 3]
    z = points[..., 2]
    index = np.flatnonzero((z > NEAR).any(1))
    p, q = points[index, 0], points[index, 1]
    for near, far in ((p, q), (q, p)):
        behind = near[:, 2] < NEAR
        t = (NEAR - far[behind, 2]) / (near[behind, 2] - far[behind, 2])
        near[behind] = far[behind] + t[:, None] * (near[behind] - far[behind])
    fx, fy, cx, cy = pair.camera.intrinsics
    both = np.stack([p, q], 1)
    pixels = both[..., :2] / both[..., 2:] * [fx, fy] + [cx, cy]
    pixels, keep = _clip(pixels, pair.camera.width, pair.camera.height)
    return index[keep], pixels[keep]


def _clip(pixels: Array, width: int, height: int) -> tuple[Array, NDArray[np.bool_]]:
    """Clip (A, 2, 2) segments to the image (Liang-Barsky); which have 5 pixels or more left."""
    start, delta = pixels[:, 0], pixels[:, 1] - pixels[:, 0]
    t0, t1 = np.zeros(len(pixels)), np.ones(len(pixels))
    for axis, size in ((0, width), (1, height)):
        step = np.where(np.abs(delta[:, axis]) < 1e-9, 1e-9, delta[:, axis])
        enter, leave = (-0.5 - start[:, axis]) / step, (size - 0.5 - start[:, axis]) / step
        t0 = np.maximum(t0, np.minimum(enter, leave))
        t1 = np.minimum(t1, np.maximum(enter, leave))
    clipped = start[:, None] + np.stack([t0, t1], 1)[..., None] * delta[:, None]
    return clipped, (t1 - t0) * np.linalg.norm(delta, axis=1) > 5.0


def make_problem(
    pairs: Sequence[LineFeatures], matches: Matches, image_sigma_px: float = IMAGE_SIGMA
) -> Problem:
    """The equations of matched lines.

    Args:
        pairs: Features of each pair.
        matches: Their matches.
        image_sigma_px: Standard deviation of image lines, pixels.
    """
    segments, image, image_sigma, cloud_sigma = [], [], [], []
    for k, pair in enumerate(pairs):
        mine = matches.pair == k
        fx, fy, cx, cy = pair.camera.intrinsics
        lines = pair.image_lines[matches.line[mine]].reshape(-1, 2, 2)
        image.append((lines - [cx, cy]) / [fx, fy])
        image_sigma.append(np.full(len(lines), image_sigma_px / pair.focal_length))
        segments.append(pair.segments[matches.segment[mine]])
        cloud_sigma.append(pair.sigma[matches.segment[mine]])
    return Problem(*map(np.concatenate, (segments, image, image_sigma, cloud_sigma)))


def refine(
    pairs: Sequence[LineFeatures], T_initial: Array, solver: Solver
) -> tuple[Solution | None, Matches]:
    """Match and solve with shrinking gates.

    Args:
        pairs: Features of each pair.
        T_initial: 4x4 pose from the search.
        solver: Method I or II.

    Returns:
        The last solution (None with fewer than three matches) and its matches.
    """
    T = T_initial
    solution = None
    for angle, distance in GATES:
        matches = match(pairs, T, angle, distance)
        if len(matches.pair) < 3:
            return None, matches
        sigma = max(IMAGE_SIGMA, distance * SOFTNESS * pairs[0].focal_length / 1e3)
        solution = solver(make_problem(pairs, matches, sigma), T)
        T = solution.T_camera_lidar
    return solution, matches


def _cross(a: Array, b: Array) -> Array:
    """Cross product of 2D vectors."""
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])
