"""Hand-eye from lines: the matched lines of all poses in one problem.

Unknown are X = T_camera_effector and Z = T_base_lidar (and joint offsets, if asked for); each
pose's extrinsic X A_i Z follows from the arm. Residuals are those of projection (PLK-Calib's
Method I); a left perturbation of a pose's extrinsic is

    xi_i = x + Ad(X A_i) z - Ad(X) J_i dq

so its 6x6 normal equations H_i, g_i of its lines are all that the links need of it. What encoders
get wrong at a pose, e_i ~ N(0, S_i), is taken out of them: (1 + H_i S_i)^-1 [H_i, g_i].
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lcdata.dataset import Dataset
from lcdata.dataset.schema import PoseRecord
from lcdata.errors import GroundTruthError
from lcdata.evaluation.handeye import Estimates, Progress, solve_estimates
from lcdata.evaluation.handeye_outliers import MIN_LINES, judge, own_lines
from lcdata.features.line_features import LineFeatures, extract_line_features
from lcdata.features.line_solver import CAUCHY_SCALE, projection_system
from lcdata.features.matching import GATES, SOFTNESS, make_problem, match
from lcdata.geometry import se3
from lcdata.groundtruth.handeye import HandEye, Joints, Prior, Residuals
from lcdata.groundtruth.handeye_problem import Problem, State
from lcdata.groundtruth.handeye_robust import FAR
from lcdata.groundtruth.observability import observability
from lcdata.groundtruth.twists import adjoint_many

Array = NDArray[np.float64]

SETTLED = (1.5, 2.5)
"""Last gate: narrower than one pose can afford, because the other poses hold it in place."""

IMAGE_SIGMA = 0.25
"""Standard deviation of image lines from pose to pose, pixels."""

CORRELATION = 3.0
"""Variance over that of independent lines: all poses see the same scan's lines, wrong in the same
way. Chosen on simulated rigs of other seeds than the benchmark's."""

COARSE = (*np.repeat(GATES[:3], 2, axis=0).tolist(), *GATES[3:])
FINE = (SETTLED,) * 8
"""Rounds of matching: gates shrink, then the links settle."""

MOST_TURNS = 3
"""Of leaving wrong poses out and settling again."""


@dataclass(frozen=True, eq=False)
class _Lines:
    """Normal equations of the poses' own lines at a state.

    Args:
        H: (N, 6, 6) information of a left perturbation of each extrinsic.
        g: (N, 6) gradient.
        used: (N,) bool, poses with lines enough.
        support: Sum of the robust weights of all lines.
    """

    H: Array
    g: Array
    used: NDArray[np.bool_]
    support: float


def solve_lines(
    dataset: Dataset,
    poses: Sequence[PoseRecord],
    A: Array,
    estimates: Estimates | None,
    prior: Prior | None,
    joints: Joints | None,
    encoders: Array,
    progress: Progress | None = None,
) -> HandEye:
    """Both links from the lines of all pairs; see `evaluation.handeye.refine`.

    Starts from the hand measurement and from the estimates, as far as there are any.
    """
    starts = []
    if estimates is not None and estimates.found >= (2 if prior else 3):
        first = solve_estimates(A, estimates, prior, joints, encoders)
        starts.append(State(first.T_camera_effector, first.T_base_lidar, first.joint_offsets))
    problem = Problem(A, A, prior, joints)
    if prior is not None:
        starts.append(problem.start(prior.T_camera_effector, prior.T_base_lidar))
    if not starts:
        raise GroundTruthError(
            f"{dataset.path} has neither stored estimates nor standard deviations of its links",
            "run `lcdata calibrate`, or give the rig's links standard deviations",
        )
    return solve_features(extract(dataset, poses, progress), problem, encoders, *starts)


def extract(
    dataset: Dataset, poses: Sequence[PoseRecord], progress: Progress | None = None
) -> list[list[LineFeatures]]:
    """Lines of each pair of each pose."""
    index = {pose.pose_id: i for i, pose in enumerate(poses)}
    features: list[list[LineFeatures]] = [[] for _ in poses]
    for k, record in enumerate(dataset.pairs):
        features[index[record.pose_id]].append(extract_line_features(dataset.load(record.pair_id)))
        if progress:
            progress("lines", k + 1, len(dataset.pairs))
    return features


def solve_features(
    features: Sequence[Sequence[LineFeatures]], problem: Problem, encoders: Array, *starts: State
) -> HandEye:
    """Both links from lines, near the better of some states.

    Args:
        features: Lines of each pair of each pose.
        problem: The N arm poses and the priors; its estimates are not used.
        encoders: (N, 6, 6) covariance of each extrinsic from encoder noise.
        starts: Where to start.

    Raises:
        GroundTruthError: No pose has lines enough that match.
    """
    scale, inliers = 1.0, np.ones(len(features), bool)
    ends = [
        _settle(features, problem, encoders, start, scale, inliers, (*COARSE, *FINE))
        for start in starts
    ]
    state, lines = max(ends, key=lambda end: _worth(problem, *end))
    for _ in range(MOST_TURNS):
        own = own_lines(features, problem.predict(state))
        scale, within = judge(own, encoders)
        if np.array_equal(within, inliers):
            break
        inliers = within
        state, lines = _settle(features, problem, encoders, state, scale, inliers, FINE)
    return _result(problem, state, lines, own, encoders, scale, inliers)


def _settle(
    features: Sequence[Sequence[LineFeatures]],
    problem: Problem,
    encoders: Array,
    state: State,
    scale: float,
    inliers: NDArray[np.bool_],
    rounds: Sequence[Sequence[float]],
) -> tuple[State, _Lines]:
    """Match and solve, round by round."""
    for angle, distance in rounds:
        lines = _lines(features, problem.predict(state), angle, distance)
        if not lines.used.any():
            raise GroundTruthError(
                f"no pose has {MIN_LINES} matching lines", "run `lcdata calibrate` first"
            )
        H, gradient, *_ = _system(problem, state, lines, encoders, scale, inliers)
        step = -np.asarray(np.linalg.solve(H, gradient), float)
        state = state.moved(step)
        if distance == SETTLED[1] and np.abs(step).max() < 1e-7:
            break
    return state, lines


def _worth(problem: Problem, state: State, lines: _Lines) -> float:
    """How much speaks for a solution: what its lines gain it less what the priors cost it.

    A line that fits gains about as much log-likelihood as its robust weight over one that does not.
    """
    prior, _ = problem.prior_rows(state)
    return lines.support / CORRELATION - 0.5 * float(prior @ prior)


def _lines(
    features: Sequence[Sequence[LineFeatures]], T: Array, angle: float, distance: float
) -> _Lines:
    """Match at the extrinsics (N, 4, 4) and linearise there."""
    H, g = np.zeros((len(T), 6, 6)), np.zeros((len(T), 6))
    count = np.zeros(len(T), int)
    squares = freedom = support = 0.0
    for i, pairs in enumerate(features):
        for pair in pairs:
            matches = match([pair], T[i], angle, distance)
            if not len(matches.pair):
                continue
            sigma = max(IMAGE_SIGMA, distance * SOFTNESS * pair.focal_length / 1e3)
            r, J = projection_system(make_problem([pair], matches, sigma), T[i])(T[i])
            weights = 1 / (1 + 0.5 * (r * r).sum(axis=1) / CAUCHY_SCALE**2)
            H[i] += np.einsum("nki,n,nkj->ij", J, weights, J) / len(pairs)
            g[i] += np.einsum("nki,n,nk->i", J, weights, r) / len(pairs)
            squares += float((weights[:, None] * r**2).sum())
            freedom += 2 * float(weights.sum())
            support += float(weights.sum()) / len(pairs)
            count[i] += len(r)
    # Pairs of a pose show the same lines, wrong in the same way: together they count as one.
    variance = CORRELATION * max(1.0, squares / max(freedom - 12, 1.0))
    return _Lines(H / variance, g / variance, count >= MIN_LINES, support)


def _system(
    problem: Problem,
    state: State,
    lines: _Lines,
    encoders: Array,
    scale: float,
    inliers: NDArray[np.bool_],
) -> tuple[Array, Array, Array, Array, Array]:
    """Normal equations of the links: H, gradient, each pose's share of both, chain Jacobians."""
    A, J = problem.motion(state)
    C = np.concatenate(
        [
            np.broadcast_to(np.eye(6), (len(A), 6, 6)),
            adjoint_many(state.X @ A),
            -se3.adjoint(state.X) @ J,
        ],
        axis=2,
    )
    counts = (inliers & lines.used)[:, None, None] / scale**2
    reduce = np.linalg.inv(np.eye(6) + lines.H @ encoders) * counts
    blocks = np.einsum("nki,nkl,nlj->nij", C, reduce @ lines.H, C)
    gradients = np.einsum("nki,nkl,nl->ni", C, reduce, lines.g)
    prior, prior_J = problem.prior_rows(state)
    weak = np.zeros(C.shape[2])
    weak[:12] = np.tile(np.repeat([1 / FAR**2, 1 / np.pi**2], 3), 2)
    H = blocks.sum(axis=0) + prior_J.T @ prior_J + np.diag(weak)
    return H, gradients.sum(axis=0) + prior_J.T @ prior, blocks, gradients, C


def _result(
    problem: Problem,
    state: State,
    lines: _Lines,
    own: tuple[Array, Array],
    encoders: Array,
    scale: float,
    inliers: NDArray[np.bool_],
) -> HandEye:
    H, _, blocks, gradients, C = _system(problem, state, lines, encoders, scale, inliers)
    covariance = np.asarray(np.linalg.inv(H), float)
    seen = observability(problem.A[lines.used])
    residuals, left_out = np.full((2, len(C)), np.nan), np.full((2, len(C)), np.nan)
    for i in map(int, np.flatnonzero(np.isfinite(own[0][:, 0]))):
        alone = C[i] @ np.linalg.solve(H - blocks[i], gradients[i])
        for target, twist in ((residuals, own[0][i]), (left_out, own[0][i] - alone)):
            target[:, i] = 1e3 * np.linalg.norm(twist[:3]), np.rad2deg(np.linalg.norm(twist[3:]))
    return HandEye(
        T_camera_effector=state.X,
        T_base_lidar=state.Z,
        full_covariance=covariance,
        observable=seen.observable,
        singular_value_ratio=float(seen.ratios[0]),
        unobservable=seen.names(),
        residuals=Residuals(*residuals),
        left_out=Residuals(*left_out),
        outliers=tuple(int(i) for i in np.flatnonzero(~inliers)),
        failed=tuple(int(i) for i in np.flatnonzero(~lines.used & inliers)),
        scale=scale,
        joint_offsets=state.extra,
        joint_offsets_std=np.sqrt(np.diag(covariance)[12:]),
        clock_offset_s=float("nan"),
        clock_offset_std_s=float("nan"),
    )
