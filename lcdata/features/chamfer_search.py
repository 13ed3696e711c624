"""Search over all six degrees of freedom for the pose that lays cloud lines on image lines.

Coarse to fine: low-discrepancy samples of the whole box on coarse distance fields, then rounds
of shrinking random children of the best poses on finer and finer fields.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from lcdata.features.distance_fields import NEAR, chamfer
from lcdata.features.held import NOTHING, released
from lcdata.features.line_features import LineFeatures

Array = NDArray[np.float64]


@dataclass(frozen=True)
class SearchOptions:
    """How widely and finely to search.

    Args:
        rotation_deg: Half-width of the box of each rotation component, degrees.
        translation_m: Half-width of the box of each translation component, metres.
        samples: Poses of the first stage.
        keep: Poses that have children.
        children: Children of each.
        candidates: Different poses that are returned.
        segments: Cloud lines of a pair that are used at most.
        seed: Of the children's offsets.
        hold: What stays as it is in the initial guess, see `held.HOLDS`.
    """

    rotation_deg: float = 10.0
    translation_m: float = 0.7
    samples: int = 20_000
    keep: int = 40
    children: int = 25
    candidates: int = 6
    segments: int = 150
    seed: int = 0
    hold: str = NOTHING


@dataclass(frozen=True)
class Stage:
    """One step of the search.

    Args:
        truncation: Pixels at a focal length of 1000; names the distance fields.
        spread: Standard deviation of the children, as a share of the box's half-width.
        samples: Look-ups a segment.
    """

    truncation: float
    spread: float
    samples: int


WIDEST = 2.0
"""How far children may leave the box of the first stage, in half-widths of the usual one, or of
its own where that is narrower."""

CROWD, APART = 8, 0.3
"""In a box wider than the usual one so many times as many poses go through the coarse rounds, the
first of them so far apart (half-widths of the usual box): halls repeat themselves every few metres,
and the poses of one wrong bay would crowd out those of the right one."""

COARSE = Stage(60.0, 1.0, 6)
ROUNDS = (
    Stage(60.0, 0.25, 8),
    Stage(60.0, 0.15, 8),
    Stage(20.0, 0.10, 12),
    Stage(20.0, 0.07, 12),
    Stage(20.0, 0.05, 12),
    Stage(20.0, 0.03, 12),
    Stage(8.0, 0.02, 12),
    Stage(8.0, 0.014, 12),
    Stage(8.0, 0.01, 12),
    Stage(8.0, 0.007, 12),
)
FINEST = Stage(4.0, 0.0, 24)


@dataclass(frozen=True, eq=False)
class Objective:
    """Chamfer cost of poses over pairs that share their extrinsic.

    Args:
        pairs: Features of each pair.
        segments: For each pair, the (M, 2, 3) cloud lines that count.
        weights: For each pair, the (M,) weights; over all pairs they sum to 1.
    """

    pairs: Sequence[LineFeatures]
    segments: Sequence[Array]
    weights: Sequence[Array]

    def __call__(self, poses: Array, stage: Stage) -> Array:
        """Costs of (P, 4, 4) poses: (P,) in 0..1."""
        flat = np.concatenate([poses[:, :3, :3].reshape(-1, 9), poses[:, :3, 3]], 1)
        costs = np.zeros(len(poses))
        for pair, segments, weights in zip(self.pairs, self.segments, self.weights, strict=True):
            field = pair.fields[stage.truncation]
            chamfer(
                flat,
                segments,
                weights,
                stage.samples,
                field.table,
                field.stride,
                field.intrinsics,
                costs,
            )
        return costs


def make_objective(
    pairs: Sequence[LineFeatures], poses: Array, limit: int, share: float = 0.3
) -> Objective:
    """The objective of those cloud lines that some of the poses bring into the image.

    Args:
        pairs: Features of each pair.
        poses: (P, 4, 4) a few poses that stand for the region of the search.
        limit: Cloud lines a pair at most; the heaviest stay.
        share: Part of a segment that must be in the image in one pose at least.
    """
    chosen, weights = [], []
    for pair in pairs:
        seen = visible_share(pair, poses).max(0, initial=0.0) >= share
        segments = pair.segments[seen]
        length = np.linalg.norm(segments[:, 1] - segments[:, 0], axis=1)
        order = np.sort(np.argsort(-length, kind="stable")[:limit])
        chosen.append(np.ascontiguousarray(segments[order]))
        weights.append(np.sqrt(np.minimum(length[order], 6.0)))
    total = sum(float(w.sum()) for w in weights)
    return Objective(pairs, chosen, [w / max(total, 1e-12) for w in weights])


def visible_share(pair: LineFeatures, poses: Array, samples: int = 8) -> Array:
    """Share of each cloud line that is in the image, (P, M), for (P, 4, 4) poses."""
    t = (np.arange(samples) + 0.5) / samples
    points = pair.segments[:, :1] + t[:, None] * (pair.segments[:, 1:] - pair.segments[:, :1])
    camera = np.einsum("pij,msj->pmsi", poses[:, :3, :3], points) + poses[:, None, None, :3, 3]
    fx, fy, cx, cy = pair.camera.intrinsics
    z = np.maximum(camera[..., 2], NEAR)
    u, v = fx * camera[..., 0] / z + cx, fy * camera[..., 1] / z + cy
    inside = (camera[..., 2] > NEAR) & (u >= -0.5) & (u < pair.camera.width - 0.5)
    inside &= (v >= -0.5) & (v < pair.camera.height - 0.5)
    return np.asarray(inside.mean(-1))


def search(
    pairs: Sequence[LineFeatures], T_initial: Array, options: SearchOptions
) -> tuple[Array, Objective]:
    """Find poses near the initial guess that fit the image lines.

    Args:
        pairs: Features of pairs with the same extrinsic.
        T_initial: 4x4 initial guess of `T_camera_lidar`.
        options: How widely and finely to search.

    Returns:
        (C, 4, 4) different poses, best first, and the objective over the whole box.
    """
    rng = np.random.default_rng(options.seed)
    box = np.repeat([np.deg2rad(options.rotation_deg), options.translation_m], 3)
    box = released(box, options.hold)
    free = box > 0.0
    scale = np.where(free, box, 1.0)
    deltas = np.zeros((options.samples, 6))
    grid = low_discrepancy(options.samples, options.seed, int(free.sum()))
    deltas[:, free] = (2.0 * grid - 1.0) * box[free]
    deltas[0] = 0.0
    poses = displaced(T_initial, deltas)
    objective = make_objective(pairs, poses[:: max(1, len(poses) // 64)], options.segments)
    costs = objective(poses, COARSE)
    rounds = _rounds(scale)
    wide = len(rounds) > len(ROUNDS)
    many = options.keep * (CROWD if wide else 1)
    best = _different(deltas / rounds[-1][1], costs, many, APART if wide else 0.0)
    deltas, costs = deltas[best], costs[best]
    widest = box + (WIDEST - 1.0) * np.where(free, rounds[-1][1], 0.0)
    for stage, size in rounds:
        spread = np.where(free, stage.spread * size, 0.0)
        deltas = np.concatenate([deltas, _children(deltas, spread, options, rng)])
        deltas = np.clip(deltas, -widest, widest)
        costs = objective(displaced(T_initial, deltas), stage)
        keep = many if stage.truncation == COARSE.truncation else options.keep
        best = _different(deltas / size, costs, keep, 0.3 * stage.spread)
        deltas, costs = deltas[best], costs[best]
    best = _different(deltas / size, costs, options.candidates, 0.1)
    return displaced(T_initial, deltas[best]), objective


def _rounds(box: Array) -> list[tuple[Stage, Array]]:
    """Stages, and the (6,) half-widths that their spread is a share of.

    Where the box is wider than the usual one, coarse rounds come first in which it shrinks to
    that: later stages look for details of some pixels, and children must not jump over them.
    """
    usual = np.repeat([np.deg2rad(SearchOptions.rotation_deg), SearchOptions.translation_m], 3)
    close = np.minimum(box, usual)
    count = math.ceil(math.log2(float((box / close).max())))
    wide = [box * (close / box) ** (k / count) for k in range(count)]
    return [(ROUNDS[0], size) for size in wide] + [(stage, close) for stage in ROUNDS]


def contrast(
    objective: Objective, T: Array, rotation_deg: float = 3.0, metres: float = 0.3
) -> float:
    """How far a pose stands out from the poses around it.

    A pose that lines support stands alone; one that clutter supports has equals all around.

    Args:
        objective: See `search`.
        T: 4x4 pose.
        rotation_deg: Half-width of the surroundings about each axis, degrees.
        metres: Half-width along each axis.

    Returns:
        Cost of the best of 300 poses around minus that of the pose, in standard deviations of
        the costs around.
    """
    box = np.repeat([np.deg2rad(rotation_deg), metres], 3)
    around = displaced(T, (2.0 * low_discrepancy(300, 0) - 1.0) * box)
    costs = objective(np.concatenate([T[None], around]), FINEST)
    return float((costs[1:].min() - costs[0]) / max(float(costs[1:].std()), 1e-9))


def _children(
    parents: Array, spread: Array, options: SearchOptions, rng: np.random.Generator
) -> Array:
    """Random poses about the parents.

    Half of them are steps along the difference of two other parents, as in differential
    evolution: those follow the long valleys in which rotation makes up for translation.
    """
    count = len(parents)
    offsets = rng.normal(size=(count, options.children, 6)) * spread
    half = options.children // 2
    first, second = rng.integers(0, count, (2, count, half))
    offsets[:, :half] *= 0.2
    offsets[:, :half] += rng.uniform(0.3, 1.0, (count, half, 1)) * (
        parents[first] - parents[second]
    )
    return np.asarray((parents[:, None] + offsets).reshape(-1, 6))


def displaced(T: Array, deltas: Array) -> Array:
    """Poses Exp(w) R, t + p for (P, 6) deltas w (rad), p (m): (P, 4, 4)."""
    w = deltas[:, :3]
    angle = np.linalg.norm(w, axis=1)
    axis = w / np.maximum(angle, 1e-12)[:, None]
    s, c = np.sin(angle), 1.0 - np.cos(angle)
    x, y, z = axis.T
    zero = np.zeros_like(x)
    k = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], 1).reshape(-1, 3, 3)
    R = np.eye(3) + s[:, None, None] * k + c[:, None, None] * (k @ k)
    poses = np.tile(np.eye(4), (len(deltas), 1, 1))
    poses[:, :3, :3] = R @ T[:3, :3]
    poses[:, :3, 3] = T[:3, 3] + deltas[:, 3:]
    return poses


def low_discrepancy(count: int, seed: int, dimensions: int = 6) -> Array:
    """(count, d) points that fill the unit cube evenly: additive recurrence (Roberts 2018)."""
    root = 1.0
    for _ in range(50):  # root of x^(d+1) = x + 1
        root = (1.0 + root) ** (1.0 / (dimensions + 1.0))
    steps = root ** -np.arange(1.0, dimensions + 1.0)
    start = np.random.default_rng(seed).random(dimensions)
    return np.asarray((start + np.arange(count)[:, None] * steps) % 1.0)


def _different(places: Array, costs: Array, count: int, apart: float) -> NDArray[np.int64]:
    """Indices of the best places, none closer than `apart` to a better one, best first."""
    order = np.argsort(costs, kind="stable")
    return np.asarray(_thinned(np.ascontiguousarray(places), order, count, apart))


@njit(cache=True)
def _thinned(places, order, count, apart):  # type: ignore[no-untyped-def]
    """The first `count` places in an order of which none is near one before it."""
    chosen = np.empty(count, np.int64)
    found = 0
    for i in order:
        near = False
        for k in range(found):
            away = 0.0
            for axis in range(places.shape[1]):
                away = max(away, abs(places[chosen[k], axis] - places[i, axis]))
            near = away <= apart
            if near:
                break
        if not near:
            chosen[found] = i
            found += 1
            if found == count:
                break
    return chosen[:found]
