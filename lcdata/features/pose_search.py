"""Search over all rotations, and translations about zero, for the poses that fit edges best."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lcdata.features.edge_registration import register
from lcdata.features.edge_score import NEAR, EdgeFeatures, scores

Array = NDArray[np.float64]

MODE_DEG = 12.0
"""Poses whose rotations differ by less are one solution."""


@dataclass(frozen=True)
class Stage:
    """One step of the search.

    Args:
        truncation: Names the fields, radians.
        points: Edge points a pair.
        rotation_deg: Standard deviation of the children's rotation about each axis.
        translation_m: Of their translation along each axis.
        keep: Poses that go on.
        children: Children of each.
        modes: Different rotations that go on at most.
    """

    truncation: float
    points: int
    rotation_deg: float
    translation_m: float
    keep: int
    children: int
    modes: int


@dataclass(frozen=True)
class SearchOptions:
    """How widely and finely to search.

    Args:
        rotations: Poses of the first stage, evenly over all rotations.
        translation_m: Standard deviation of their translation along each axis.
        reach_m: No translation component beyond.
        seed: Of all chance.
    """

    rotations: int = 100_000
    translation_m: float = 0.25
    reach_m: float = 1.0
    seed: int = 0


GLANCE = Stage(0.1, 300, 0.0, 0.0, 12_000, 0, 12_000)
FIRST = Stage(0.1, 1000, 0.0, 0.0, 400, 0, 400)
GLOBAL = (
    Stage(0.1, 1000, 2.5, 0.30, 200, 20, 200),
    Stage(0.06, 1200, 1.6, 0.20, 150, 30, 60),
    Stage(0.06, 1500, 1.0, 0.15, 120, 30, 60),
)
NEARER = (
    Stage(0.06, 2000, 0.8, 0.25, 40, 1000, 1),
    Stage(0.02, 2000, 0.6, 0.15, 40, 30, 1),
    Stage(0.02, 2500, 0.4, 0.10, 40, 30, 1),
)
NEAREST = (
    Stage(0.02, 3000, 0.25, 0.06, 40, 30, 1),
    Stage(0.008, 4000, 0.15, 0.04, 40, 30, 1),
    Stage(0.008, 4000, 0.10, 0.02, 2, 30, 1),
)
"""First all solutions together, then a number of them each by itself, then the best of those."""

EXPLORED = Stage(0.06, 3000, 0.0, 0.0, 12, 0, 12)
KEPT = Stage(0.02, 4000, 0.0, 0.0, 5, 0, 5)
LAST = Stage(0.008, 6000, 0.0, 0.0, 6, 0, 6)


@dataclass(frozen=True, eq=False)
class Found:
    """Solutions of the search: poses whose rotations differ by `MODE_DEG` or more.

    Args:
        poses: (M, 4, 4) best first.
        scores: (M,) their scores.
    """

    poses: Array
    scores: Array


def search(
    pairs: Sequence[EdgeFeatures],
    options: SearchOptions,
    witness: Callable[[Array], Array] | None = None,
) -> Found:
    """Find the poses that explain all pairs best.

    Args:
        pairs: Features of pairs with the same extrinsic.
        options: How widely and finely to search.
        witness: Gives (P, 4, 4) poses (P,) factors above 0, by which their scores are multiplied
            where it is decided which solutions are searched locally.
    """

    def believed(some: Array, stage: Stage) -> Array:
        values = np.maximum(_scores(pairs, some, stage), 0.0)
        return np.asarray(values if witness is None else values * witness(some))

    rng = np.random.default_rng(options.seed)
    poses = np.tile(np.eye(4), (options.rotations, 1, 1))
    poses[:, :3, :3] = even_rotations(options.rotations)
    poses[:, :3, 3] = rng.normal(scale=options.translation_m, size=(len(poses), 3))
    poses[:, :3, 3] = np.clip(poses[:, :3, 3], -options.reach_m, options.reach_m)
    promising = np.argsort(-_scores(pairs, poses, GLANCE), kind="stable")[: GLANCE.keep]
    poses = poses[promising]
    values = _scores(pairs, poses, FIRST)
    poses = poses[_different(poses, values, FIRST, 2.5)]
    poses = _shrinking(pairs, poses, GLOBAL, options, rng)
    heads = poses[_different(poses, believed(poses, EXPLORED), EXPLORED, MODE_DEG, MODE_DEG)]
    groups = [_shrinking(pairs, T[None], NEARER, options, rng) for T in heads]
    first = np.stack([group[0] for group in groups])
    best = _different(first, believed(first, KEPT), KEPT, MODE_DEG, MODE_DEG)
    found = np.concatenate([_shrinking(pairs, groups[k], NEAREST, options, rng) for k in best])
    found, values = _registered(pairs, found)
    # Chance may leave a solution on the slope beside its top: the best is searched once more.
    top = found[np.argmax(values if witness is None else np.maximum(values, 0) * witness(found))]
    again = _shrinking(pairs, top[None], NEARER + NEAREST, options, rng)
    again, values_again = _registered(pairs, again)
    found, values = np.concatenate([found, again]), np.concatenate([values, values_again])
    chosen = _different(found, values, LAST, MODE_DEG, MODE_DEG)
    return Found(found[chosen], values[chosen])


def _registered(pairs: Sequence[EdgeFeatures], poses: Array) -> tuple[Array, Array]:
    """The poses and the same registered to lines, and the scores of all."""
    images, clouds = [pair.lines for pair in pairs], [pair.cloud for pair in pairs]
    both = np.concatenate([poses, [register(images, clouds, T) for T in poses]])
    return both, _scores(pairs, both, LAST)


def _shrinking(
    pairs: Sequence[EdgeFeatures],
    poses: Array,
    stages: Sequence[Stage],
    options: SearchOptions,
    rng: np.random.Generator,
) -> Array:
    """The best poses after all stages, best first."""
    for stage in stages:
        poses = np.concatenate([poses, _children(pairs, poses, stage, rng)])
        poses[:, :3, 3] = np.clip(poses[:, :3, 3], -options.reach_m, options.reach_m)
        values = _scores(pairs, poses, stage)
        poses = poses[_different(poses, values, stage, 0.3 * stage.rotation_deg)]
    return poses


def _scores(pairs: Sequence[EdgeFeatures], poses: Array, stage: Stage) -> Array:
    """Scores with a stage's number of points; of each of many pairs fewer are enough."""
    points = stage.points if stage is LAST else math.ceil(stage.points / math.sqrt(len(pairs)))
    return scores(pairs, poses, stage.truncation, points)


def even_rotations(count: int) -> Array:
    """(count, 3, 3) rotations that cover all of SO(3) evenly: super-Fibonacci (Alexa 2022)."""
    from scipy.spatial.transform import Rotation

    phi, psi = np.sqrt(2.0), 1.533751168755204288118041
    s = np.arange(count) + 0.5
    r, R = np.sqrt(s / count), np.sqrt(1.0 - s / count)
    a, b = 2.0 * np.pi * s / phi, 2.0 * np.pi * s / psi
    return np.asarray(
        Rotation.from_quat(
            np.stack([r * np.sin(a), r * np.cos(a), R * np.sin(b), R * np.cos(b)], 1)
        ).as_matrix()
    )


def _children(
    pairs: Sequence[EdgeFeatures], parents: Array, stage: Stage, rng: np.random.Generator
) -> Array:
    """Random poses about the parents, (P * children, 4, 4).

    A wrong translation is made up for by a wrong rotation, so a third of the children turn such
    that a point in view stays where it is in the image, and a third follow the difference to
    another parent of the same solution.
    """
    from scipy.spatial.transform import Rotation

    count = len(parents) * stage.children
    poses = np.repeat(parents, stage.children, axis=0)
    turn = rng.normal(scale=np.deg2rad(stage.rotation_deg), size=(count, 3))
    move = rng.normal(scale=stage.translation_m, size=(count, 3))
    kind = rng.integers(0, 3, (count, 1))
    pivot, known = _points_in_view(pairs[int(rng.integers(len(pairs)))], poses, rng)
    balance = -np.cross(pivot, move) / np.square(pivot).sum(1, keepdims=True)
    turn = np.where((kind == 1) & known[:, None], 0.3 * turn + balance, turn)
    other = parents[rng.integers(0, len(parents), count)]
    apart = Rotation.from_matrix(other[:, :3, :3] @ np.swapaxes(poses[:, :3, :3], 1, 2)).as_rotvec()
    along = (kind == 2) & (np.linalg.norm(apart, axis=1, keepdims=True) < np.deg2rad(MODE_DEG))
    share = rng.uniform(0.3, 1.0, (count, 1))
    turn = np.where(along, 0.2 * turn + share * apart, turn)
    move = np.where(along, 0.2 * move + share * (other[:, :3, 3] - poses[:, :3, 3]), move)
    poses[:, :3, :3] = Rotation.from_rotvec(turn).as_matrix() @ poses[:, :3, :3]
    poses[:, :3, 3] += move
    return poses


def _points_in_view(
    pair: EdgeFeatures, poses: Array, rng: np.random.Generator
) -> tuple[Array, NDArray[np.bool_]]:
    """An edge point that each pose sees, (P, 3) in its camera frame, and (P,) whether there is."""
    result, known = np.ones((len(poses), 3)), np.zeros(len(poses), bool)
    field = next(iter(pair.fields.values()))
    _, _, height, width = field.tables.shape
    fx, fy, cx, cy = field.intrinsics
    for _ in range(4):
        chosen = pair.cloud.points[rng.integers(0, len(pair.cloud.points), len(poses))]
        seen = np.einsum("pij,pj->pi", poses[:, :3, :3], chosen) + poses[:, :3, 3]
        inside = np.linalg.norm(seen, axis=1) > 0.5
        if len(field.R_face_camera) == 1:
            z = np.maximum(seen[:, 2], NEAR)
            u, v = fx * seen[:, 0] / z + cx, fy * seen[:, 1] / z + cy
            inside &= (seen[:, 2] > NEAR) & (u > 0) & (u < width) & (v > 0) & (v < height)
        take = inside & ~known
        result[take], known = seen[take], known | inside
    return result, known


def _different(
    poses: Array, values: Array, stage: Stage, apart_deg: float, mode_deg: float = 5.0
) -> NDArray[np.int64]:
    """Indices of the best poses, best first: none too near a better one, few of one mode."""
    order = np.argsort(-values, kind="stable")
    R = poses[order, :3, :3].reshape(-1, 9)
    quota = max(1, stage.keep // stage.modes)
    near, mode = (1.0 + 2.0 * np.cos(np.deg2rad(a)) for a in (apart_deg, mode_deg))
    away = (apart_deg / max(stage.rotation_deg, 1e-9)) * stage.translation_m
    chosen: list[int] = []
    heads: list[int] = []
    filled: list[int] = []
    for i in range(len(order)):
        if chosen:
            same = R[chosen] @ R[i] > near
            if same.any():
                moved = poses[order[chosen], :3, 3][same] - poses[order[i], :3, 3]
                if np.abs(moved).max(1).min() <= away:
                    continue
        among = np.flatnonzero(R[heads] @ R[i] > mode) if heads else np.zeros(0, int)
        if len(among):
            if filled[among[0]] >= quota:
                continue
            filled[among[0]] += 1
        elif len(heads) < stage.modes:
            heads.append(i)
            filled.append(1)
        else:
            continue
        chosen.append(i)
        if len(chosen) == stage.keep:
            break
    return np.asarray(order[chosen])
