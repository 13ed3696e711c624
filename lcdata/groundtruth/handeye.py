"""The two hand-measured links from a calibrator's estimates over many arm poses.

T_camera_lidar(i) = X A_i Z is solved for X = T_camera_effector and Z = T_base_lidar: closed form
for the start, then Levenberg-Marquardt on SE(3) with weights, priors and a loss that gets by
with wrong estimates. The loss goes from Huber's, which has one minimum, to Cauchy's, which lets
go of what is wrong, to least squares of the poses that are left: few wrong poses then cost
nothing but their own information.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lcdata.errors import GroundTruthError
from lcdata.geometry import se3
from lcdata.groundtruth.handeye_input import checked, closed_form
from lcdata.groundtruth.handeye_problem import STD_FLOOR, Joints, Prior, Problem, State
from lcdata.groundtruth.handeye_robust import Fit, fit
from lcdata.groundtruth.observability import Observability, observability
from lcdata.groundtruth.twists import adjoint_many

Array = NDArray[np.float64]

__all__ = ["HandEye", "Joints", "Prior", "Residuals", "solve"]

DEGENERATE_RATIO = 0.003
"""Without a prior, nothing is returned below this singular-value ratio."""


@dataclass(frozen=True, eq=False)
class Residuals:
    """Estimates against X A_i Z, a pose.

    Args:
        mm: (N,) distance of the translations in millimetres; NaN where there is no estimate.
        deg: (N,) angle between the rotations in degrees; NaN the same.
    """

    mm: Array
    deg: Array


@dataclass(frozen=True, eq=False)
class HandEye:
    """Solution of T_camera_lidar(i) = X A_i Z.

    Args:
        T_camera_effector: 4x4 X.
        T_base_lidar: 4x4 Z.
        full_covariance: (12 + k, 12 + k) of X then Z, each translation (m) then rotation (rad),
            left perturbations, then of the joint offsets and the clock offset, as far as they were
            asked for. Undetermined directions have metres and radians.
        observable: Whether the arm's rotations determine X and Z without the prior.
        singular_value_ratio: Of the least determined direction; see `observability`.
        unobservable: A sentence for each undetermined direction.
        residuals: Of each pose.
        left_out: The same, predicted for each pose from the others.
        outliers: Indices of the poses whose estimates were left out as wrong.
        failed: Indices of the poses without an estimate.
        scale: By how much the residuals exceed the given covariances (standard deviations).
        joint_offsets: (n,) radians to add to the encoders' readings; empty if not asked for.
        joint_offsets_std: (n,) their standard deviations.
        clock_offset_s: dt where the joints were at positions + dt * velocities when the image was
            taken; NaN if not asked for.
        clock_offset_std_s: Its standard deviation.
    """

    T_camera_effector: Array
    T_base_lidar: Array
    full_covariance: Array
    observable: bool
    singular_value_ratio: float
    unobservable: tuple[str, ...]
    residuals: Residuals
    left_out: Residuals
    outliers: tuple[int, ...]
    failed: tuple[int, ...]
    scale: float
    joint_offsets: Array
    joint_offsets_std: Array
    clock_offset_s: float
    clock_offset_std_s: float

    @property
    def covariance(self) -> Array:
        """(12, 12) of X then Z, see `full_covariance`."""
        return self.full_covariance[:12, :12]

    def extrinsic(self, T_effector_base: ArrayLike) -> Array:
        """(..., 4, 4) T_camera_lidar of arm poses (..., 4, 4)."""
        A = np.asarray(T_effector_base, float)
        return np.asarray(self.T_camera_effector @ A @ self.T_base_lidar)

    def extrinsic_covariance(self, T_effector_base: ArrayLike) -> Array:
        """(N, 6, 6) covariances of `extrinsic` for poses (N, 4, 4), both links' errors together.

        The links' errors are correlated, so the extrinsics are known better than either link.
        """
        A = np.asarray(T_effector_base, float)
        J = np.zeros((len(A), 6, 12))
        J[:, :, :6] = np.eye(6)
        J[:, :, 6:] = adjoint_many(self.T_camera_effector @ A)
        return np.asarray(J @ self.covariance @ np.swapaxes(J, 1, 2))


def solve(
    T_effector_base: ArrayLike,
    T_camera_lidar: ArrayLike,
    *,
    weights: ArrayLike | None = None,
    prior: Prior | None = None,
    joints: Joints | None = None,
) -> HandEye:
    """Both hand-measured links from estimates over many arm poses.

    Args:
        T_effector_base: (N, 4, 4) inverse of the arm's forward kinematics.
        T_camera_lidar: (N, 4, 4) estimates; a matrix of NaN is an estimate that failed.
        weights: (N, 6, 6) covariances of the estimates (translation m, rotation rad, left
            perturbation), taken as lower bounds: they are scaled up where the residuals are
            larger. Or (N,) relative weights; or None, all alike. In the last two cases the
            standard deviations of translation and rotation are taken from the residuals.
        prior: Hand-measured links; the result is then the maximum a posteriori.
        joints: Joint positions, to solve for joint offsets and a clock offset as well. The
            T_effector_base must be this arm's at these positions.

    Raises:
        GeometryError: A matrix that is no rigid transform, a covariance that is none.
        GroundTruthError: Too few poses, all estimates failed, or an arm that did not turn.
    """
    data = checked(T_effector_base, T_camera_lidar, weights, prior, joints)
    seen = observability(data.problem.A)
    if prior is None and seen.ratios[0] < DEGENERATE_RATIO:
        raise GroundTruthError(
            f"{seen.summary()}, so the two links cannot be told apart",
            "turn it about two axes by 30 deg or more, or give the hand measurements as prior",
        )
    found = fit(data.problem, data.weights, _start(data.problem))
    return _result(data.problem, data.failed, data.used, found, seen)


def _start(problem: Problem) -> State:
    """The better of the closed form and the hand measurement, by the median residual."""
    candidates = []
    closed = closed_form(problem.A, problem.T)
    if closed is not None:
        candidates.append(problem.start(*closed))
    if problem.prior is not None:
        candidates.append(
            problem.start(problem.prior.T_camera_effector, problem.prior.T_base_lidar)
        )
    if not candidates:
        raise GroundTruthError(
            "the closed form found no solution for these poses",
            "give the hand measurements as prior",
        )
    return min(
        candidates, key=lambda s: float(np.median(np.linalg.norm(problem.residuals(s), axis=1)))
    )


def _result(
    problem: Problem,
    failed: NDArray[np.intp],
    used: NDArray[np.intp],
    found: Fit,
    seen: Observability,
) -> HandEye:
    state, total = found.state, len(failed) + len(used)
    n_clock = int(problem.joints is not None and problem.joints.velocities is not None)
    n = len(state.extra) - n_clock
    std = np.sqrt(np.diag(found.covariance)[12:])
    names = list(seen.names())
    for k, (before, after) in enumerate(zip(problem.extra_std, std, strict=True)):
        if after > 0.9 * before > STD_FLOOR and problem.joints is not None:
            what = f"offset of {problem.joints.arm.joint_names[k]}" if k < n else "clock offset"
            names.append(f"{what}: the estimates say next to nothing about it")
    predicted = problem.predict(state)
    alone = np.array(
        [
            problem.subset(np.array([i])).predict(state.moved(step))[0]
            for i, step in enumerate(found.left_out_steps)
        ]
    )
    return HandEye(
        T_camera_effector=state.X,
        T_base_lidar=state.Z,
        full_covariance=found.covariance,
        observable=seen.observable,
        singular_value_ratio=float(seen.ratios[0]),
        unobservable=tuple(names),
        residuals=_residuals(predicted, problem.T, used, total),
        left_out=_residuals(alone, problem.T, used, total),
        outliers=tuple(int(i) for i in used[~found.inliers]),
        failed=tuple(int(i) for i in failed),
        scale=found.scale,
        joint_offsets=state.extra[:n],
        joint_offsets_std=std[:n],
        clock_offset_s=float(state.extra[-1]) if n_clock else float("nan"),
        clock_offset_std_s=float(std[-1]) if n_clock else float("nan"),
    )


def _residuals(predicted: Array, T: Array, used: NDArray[np.intp], total: int) -> Residuals:
    mm, deg = np.full(total, np.nan), np.full(total, np.nan)
    finite = np.isfinite(predicted).all(axis=(1, 2))
    for i, a, b in zip(used[finite], predicted[finite], T[finite], strict=True):
        mm[i] = 1e3 * se3.translation_error(a, b)
        deg[i] = np.rad2deg(se3.rotation_error(a, b))
    return Residuals(mm, deg)
