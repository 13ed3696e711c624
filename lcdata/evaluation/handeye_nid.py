"""Hand-eye from intensities: the NID of all poses in one problem.

Unknown are X = T_camera_effector and Z = T_base_lidar alone; each pose's extrinsic X A_i Z follows
from the arm. A left perturbation of it is xi_i = x + Ad(X A_i) z, so the gradient of the summed
cost is that of each pose's NID by its own extrinsic, carried over to the links.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lcdata.calibrators.nid_verdict import sandwich
from lcdata.dataset import Dataset
from lcdata.dataset.schema import PoseRecord
from lcdata.errors import CalibrationError, GroundTruthError
from lcdata.evaluation.handeye import Estimates, Progress, solve_estimates
from lcdata.features.nid_objective import NidFeatures, Objective, nid_features, objective
from lcdata.geometry import se3
from lcdata.groundtruth.handeye import HandEye, Joints, Prior
from lcdata.groundtruth.observability import observability
from lcdata.pair import Pair

Array = NDArray[np.float64]

METHODS = {"nid": False, "nid_edge": True}
"""What `lcdata handeye --direct --features` calls them, and whether edges count."""

UNIT = np.tile(np.repeat([0.01, np.deg2rad(0.1)], 3), 2)
"""Metres and radians that matter alike: the minimiser works in these units."""

SETTLED = 0.05
"""Rounds end when no link moves by more, in `UNIT`."""

FEWEST_POINTS = 300
"""Points in view below which a pose says nothing."""

FARTHEST = 5.0
"""A pose whose own minimum seems farther from the common one, in `UNIT`, is not near it at all."""

MOST_POINTS = 20_000
"""Points of a pose; more are thinned out."""


@dataclass(frozen=True, eq=False)
class NidHandEye:
    """Both links from the intensities of all poses.

    Args:
        T_camera_effector: 4x4.
        T_base_lidar: 4x4.
        extrinsics: (N, 4, 4) T_camera_lidar of the poses.
        cost_initial: Mean NID of the poses at the start.
        cost_final: The same in the end.
        observable: Whether the poses turn the arm about axes enough to know X and Z singly.
            The extrinsics are determined all the same.
        used: (N,) bool, poses with points in view.
    """

    T_camera_effector: Array
    T_base_lidar: Array
    extrinsics: Array
    cost_initial: float
    cost_final: float
    observable: bool
    used: NDArray[np.bool_]


def solve_nid(
    pairs: Sequence[Sequence[Pair]],
    A: Array,
    X: Array,
    Z: Array,
    *,
    reach_m: float = 0.1,
    reach_deg: float = 2.0,
    rounds: int = 5,
    with_edges: bool = False,
    prepared: Sequence[Sequence[NidFeatures]] | None = None,
) -> NidHandEye:
    """Both links of a tower from its poses' intensities.

    Args:
        pairs: The pairs of each of N poses.
        A: (N, 4, 4) T_effector_base of the poses.
        X: 4x4 first T_camera_effector.
        Z: 4x4 first T_base_lidar.
        reach_m: How far each link may move along an axis, metres.
        reach_deg: How far each may turn about one, degrees.
        rounds: Hidden points are removed and the rest registered so many times at most.
        with_edges: Count edges too, for sparse scans.
        prepared: `nid_features` of each pair, if they are there already.

    Raises:
        GroundTruthError: Fewer than two poses with points in view.
        CalibrationError: Pairs without intensities, or not as many poses as arm positions.
    """
    if len(pairs) != len(A):
        raise CalibrationError(f"{len(pairs)} poses of pairs, {len(A)} of the arm", "give as many")
    features = prepared or [[nid_features(p, with_edges) for p in pose] for pose in pairs]
    X, Z = np.array(X, float), np.array(Z, float)
    first: tuple[float, NDArray[np.bool_]] | None = None
    for _ in range(rounds):
        costs = _objectives(features, X @ A @ Z, with_edges)
        used = np.array([c is not None for c in costs])
        if used.sum() < 2:
            raise GroundTruthError(
                f"{int(used.sum())} of {len(A)} poses have points in view", "check the links"
            )
        if first is None:
            first = _summed(costs, A, X, Z)[0], used
        step = _minimise(costs, A, X, Z, np.tile(np.repeat([reach_m, np.deg2rad(reach_deg)], 3), 2))
        X, Z = se3.exp(step[:6]) @ X, se3.exp(step[6:]) @ Z
        if np.abs(step / UNIT).max() < SETTLED:
            break
    assert first is not None
    return NidHandEye(
        X, Z, X @ A @ Z, first[0], _summed(costs, A, X, Z)[0], observability(A).observable, used
    )


def _objectives(
    features: Sequence[Sequence[NidFeatures]], T: Array, with_edges: bool
) -> list[Objective | None]:
    """What each pose minimises, of the points in view at its extrinsic; None if too few."""
    found: list[Objective | None] = []
    for i, pose in enumerate(features):
        whole = objective(pose, T[i], with_edges)
        thin = whole.thinned(MOST_POINTS * len(pose), np.random.default_rng(i))
        found.append(thin if whole.inside >= FEWEST_POINTS * max(len(pose), 1) else None)
    return found


def _summed(costs: Sequence[Objective | None], A: Array, X: Array, Z: Array) -> tuple[float, Array]:
    """Mean cost of the poses and its (12,) gradient by left perturbations of X and Z."""
    total, gradient, count = 0.0, np.zeros(12), 0
    for cost, a in zip(costs, A, strict=True):
        if cost is None:
            continue
        value, slope = cost.slope(X @ a @ Z)
        total += value
        gradient[:6] += slope
        gradient[6:] += se3.adjoint(X @ a).T @ slope
        count += 1
    return total / count, gradient / count


def _minimise(
    costs: Sequence[Objective | None], A: Array, X: Array, Z: Array, reach: Array
) -> Array:
    """(12,) left perturbations of X and Z that minimise the summed cost."""
    import pinocchio
    from scipy.optimize import minimize

    def function(x: Array) -> tuple[float, Array]:
        twists = x * UNIT
        moved = se3.exp(twists[:6]) @ X, se3.exp(twists[6:]) @ Z
        value, gradient = _summed(costs, A, *moved)
        for part in (slice(6), slice(6, 12)):
            # exp(twist + d) = exp(Jl d) exp(twist); Jl is the right Jacobian of -twist.
            J = np.asarray(pinocchio.Jexp6(pinocchio.Motion(-twists[part])))
            gradient[part] = J.T @ gradient[part]
        return value, gradient * UNIT

    found = minimize(
        function,
        np.zeros(12),
        jac=True,
        method="L-BFGS-B",
        bounds=[(-r, r) for r in reach / UNIT],
        options={"maxiter": 60, "ftol": 1e-8, "gtol": 1e-7},
    )
    return np.asarray(found.x * UNIT)


def refine_nid(
    dataset: Dataset,
    poses: Sequence[PoseRecord],
    A: Array,
    method: str,
    estimates: Estimates | None,
    prior: Prior | None,
    joints: Joints | None,
    encoders: Array,
    progress: Progress | None = None,
) -> HandEye:
    """Both links of a data set from the intensities of one pair a pose.

    First all poses in one problem, links alone; then what each pose's own cost says about its
    extrinsic there, a Gaussian, is weighed with the priors and the encoders' noise. Scans of one
    pose show the same scene, so one pair stands for all. See `evaluation.handeye.refine`.
    """
    if estimates is not None and estimates.found >= (2 if prior else 3):
        first = solve_estimates(A, estimates, prior, joints, encoders)
        X, Z = first.T_camera_effector, first.T_base_lidar
    elif prior is not None:
        X, Z = prior.T_camera_effector, prior.T_base_lidar
    else:
        raise GroundTruthError(
            f"{dataset.path} has neither stored estimates nor standard deviations of its links",
            "run `lcdata calibrate`, or give the rig's links standard deviations",
        )
    with_edges = METHODS[method]
    names: dict[str, str] = {}
    for record in dataset.pairs:
        names.setdefault(record.pose_id, record.pair_id)
    pairs = [[dataset.load(names[p.pose_id])] if p.pose_id in names else [] for p in poses]
    features = []
    for i, pose in enumerate(pairs):
        features.append([nid_features(pair, with_edges) for pair in pose])
        if progress:
            progress("intensities", i + 1, len(pairs))
    found = solve_nid(pairs, A, X, Z, with_edges=with_edges, prepared=features)
    T, covariances = np.full((len(A), 4, 4), np.nan), np.full((len(A), 6, 6), np.nan)
    for i, cost in enumerate(_objectives(features, found.extrinsics, with_edges)):
        gaussian = sandwich(cost, found.extrinsics[i]) if cost is not None else None
        if gaussian is not None and np.abs(gaussian[1] / UNIT[:6]).max() < FARTHEST:
            covariances[i], T[i] = gaussian[0], se3.exp(gaussian[1]) @ found.extrinsics[i]
    return solve_estimates(A, Estimates(method, T, covariances), prior, joints, encoders)
