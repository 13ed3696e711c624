"""Hand-eye refinement of a data set: from its stored results, or from the lines of its pairs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lcdata.arm import Arm
from lcdata.dataset import Dataset
from lcdata.dataset.schema import PoseRecord
from lcdata.errors import GroundTruthError
from lcdata.evaluation.refinement import Refinement, recordings_of, still_clock
from lcdata.evaluation.results import TrialResult, read_results
from lcdata.geometry import se3
from lcdata.groundtruth.chain import offset_covariance
from lcdata.groundtruth.handeye import HandEye, Joints, Prior, solve
from lcdata.groundtruth.twists import adjoint_many
from lcdata.rig_links import LINKS

Array = NDArray[np.float64]
Progress = Callable[[str, int, int], None]

SAME = 4.0
"""Estimates of one pose that are so many standard deviations from their medoid are another
solution, and do not count."""


@dataclass(frozen=True, eq=False)
class Estimates:
    """What a method made of each pose.

    Args:
        method: Its name.
        T: (N, 4, 4) T_camera_lidar; NaN where no trial converged.
        covariances: (N, 6, 6) predicted; NaN where there is no estimate or no prediction.
    """

    method: str
    T: Array
    covariances: Array

    @property
    def found(self) -> int:
        """Number of poses with an estimate."""
        return int(np.isfinite(self.T[:, 0, 0]).sum())


def refine(
    dataset: Dataset,
    *,
    method: str | None = None,
    run: str | None = None,
    joint_offsets: bool = False,
    clock_offset: bool = False,
    direct: bool = False,
    features: str = "lines",
    progress: Progress | None = None,
) -> Refinement:
    """Both hand-measured links of a data set, refined.

    Args:
        dataset: Data set with an arm.
        method: Whose estimates to use; the one with most poses for None.
        run: Of which run; all runs for None.
        joint_offsets: Solve for the joints' zero points as well; always done where the rig's
            `links_covariance` holds them.
        clock_offset: Solve for the offset between arm and camera clock as well, as far as poses of
            dwells can tell: not at all, which the refinement then says.
        direct: Go on from the estimates to the lines of all pairs in one problem. Without any
            stored results that starts from the hand measurement.
        features: What of the pairs `direct` uses: lines, or intensities by nid or nid_edge.
        progress: Called with stage, pairs done and pairs in all.

    Raises:
        GroundTruthError: No arm, no estimates, too few poses, poses all alike, joint offsets that
            are known exactly, or links that were refined from these recordings already.
        ArmError: The arm model cannot be found.
        DatasetError: It is another one by now.
    """
    poses = tuple(pose for pose in dataset.poses if pose.T_effector_base is not None)
    if not poses or dataset.info.arm is None:
        raise GroundTruthError(
            f"{dataset.path} was recorded without an arm (ground_truth: static)",
            "hand-eye refinement needs arm poses",
        )
    _check_new(dataset)
    arm = dataset.load_arm()
    A = np.array([pose.T_effector_base for pose in poses])
    prior = hand_measured(dataset)
    encoders = encoder_covariances(dataset, arm, poses)
    together = len(dataset.rig.covariance_of_links()) > LINKS
    joints = _joints(dataset, arm, poses) if joint_offsets or together else None
    estimates = gather(dataset, poses, method, run)
    asked = (still_clock(poses),) if clock_offset else ()
    if direct and features != "lines":
        from lcdata.evaluation.handeye_nid import METHODS, refine_nid

        if features not in METHODS:
            raise GroundTruthError(
                f"no hand-eye from {features!r}", f"use lines, {' or '.join(METHODS)}"
            )
        found = refine_nid(
            dataset, poses, A, features, estimates, prior, joints, encoders, progress
        )
        return Refinement(dataset, features, arm, poses, found, asked)
    if direct:
        from lcdata.evaluation.handeye_direct import solve_lines

        found = solve_lines(dataset, poses, A, estimates, prior, joints, encoders, progress)
        return Refinement(dataset, "lines", arm, poses, found, asked)
    if estimates is None:
        raise GroundTruthError(
            f"{dataset.path} has no stored estimates"
            + (f" of {method}" if method else "")
            + (f" in run {run}" if run else ""),
            "run `lcdata calibrate` first, or --direct from the lines",
        )
    found = solve_estimates(A, estimates, prior, joints, encoders)
    return Refinement(dataset, estimates.method, arm, poses, found, asked)


def solve_estimates(
    A: Array, estimates: Estimates, prior: Prior | None, joints: Joints | None, encoders: Array
) -> HandEye:
    """`lcdata.handeye.solve` with the encoders' noise added to what the method predicts."""
    predicted = np.isfinite(estimates.covariances).all(axis=(1, 2))
    weights = estimates.covariances + encoders if predicted.any() else None
    return solve(A, estimates.T, weights=weights, prior=prior, joints=joints)


def gather(
    dataset: Dataset, poses: Sequence[PoseRecord], method: str | None, run: str | None
) -> Estimates | None:
    """One estimate a pose from the trials that converged; None if there are none at all."""
    trials: dict[str, dict[str, list[TrialResult]]] = {}
    for trial in read_results(dataset, run).trials:
        if trial.T_camera_lidar_estimated is not None and method in (None, trial.method):
            by_pose = trials.setdefault(trial.method, {})
            if trial.converged and not trial.degenerate:
                by_pose.setdefault(trial.pose_id, []).append(trial)
    found = [_combine(name, poses, by_pose) for name, by_pose in sorted(trials.items())]
    return max(found, key=lambda estimates: estimates.found, default=None)


def _combine(
    method: str, poses: Sequence[PoseRecord], trials: dict[str, list[TrialResult]]
) -> Estimates:
    T, covariances = np.full((len(poses), 4, 4), np.nan), np.full((len(poses), 6, 6), np.nan)
    for i, pose in enumerate(poses):
        if mine := trials.get(pose.pose_id):
            T[i], covariances[i] = _middle(mine)
    return Estimates(method, T, covariances)


def _middle(trials: Sequence[TrialResult]) -> tuple[Array, Array]:
    """The mean of a pose's estimates that agree with their medoid.

    Its covariance is that of one estimate: scans of one scene, and trials on one scan, are wrong
    together.
    """
    T = np.array([trial.T_camera_lidar_estimated for trial in trials], float)
    covariances = np.array([trial.covariance for trial in trials], float)
    known = np.isfinite(covariances).all(axis=(1, 2))
    if known.any():
        T, covariances = T[known], covariances[known]
    mean = covariances.mean(axis=0)
    scale = mean if known.any() else np.diag(np.repeat([0.03, np.deg2rad(0.3)], 3) ** 2)
    whiten = np.linalg.inv(np.linalg.cholesky(scale))
    steps = np.array([[whiten @ se3.log(b @ se3.inverse(a)) for b in T] for a in T])
    apart = np.linalg.norm(steps, axis=2)
    medoid = int(np.argmin(np.median(apart, axis=1)))
    near = apart[medoid] < SAME
    step = np.linalg.solve(whiten, steps[medoid][near].mean(axis=0))
    return se3.exp(step) @ T[medoid], covariances[near].mean(axis=0)


def hand_measured(dataset: Dataset) -> Prior | None:
    """The rig's links; None if they have no standard deviations."""
    prior = Prior.of_rig(dataset.rig)
    return prior if np.isfinite(prior.joint).all() else None


def encoder_covariances(dataset: Dataset, arm: Arm, poses: Sequence[PoseRecord]) -> Array:
    """(N, 6, 6) covariance of T_camera_lidar from what encoders get wrong anew at each pose."""
    positions = np.array([pose.joint_positions for pose in poses])
    _, J = arm.chain().jacobians(arm.with_offsets(positions))
    scatter = np.array([p.joint_positions_std**2 / max(p.samples, 1) for p in poses])
    variance = np.deg2rad(dataset.rig.arm.encoder_std_deg) ** 2 + scatter
    X = np.array([pose.T_camera_effector for pose in poses])
    by_joints = adjoint_many(X) @ J
    return np.asarray((by_joints * variance[:, None]) @ np.swapaxes(by_joints, 1, 2))


def _check_new(dataset: Dataset) -> None:
    """Refuse to learn from the same recordings twice: what is said twice seems twice as sure."""
    known = {name.split()[-1] for name in dataset.rig.links_refined_from or ()}
    again = [name for name in recordings_of(dataset) if name.split()[-1] in known]
    if again:
        raise GroundTruthError(
            f"the links of {dataset.path} were refined from {again[0].split()[0]} already",
            "apply the rig before that first (`lcdata groundtruth --rig`), or take new recordings",
        )


def _joints(dataset: Dataset, arm: Arm, poses: Sequence[PoseRecord]) -> Joints:
    known = offset_covariance(dataset.rig, arm)
    links = dataset.rig.covariance_of_links()
    if len(links) > LINKS:
        known = links[LINKS:, LINKS:]
    if not known.any():
        raise GroundTruthError(
            "the joint offsets are known exactly: the rig's joint_offset_std_deg is 0",
            "leave --joint-offsets out, or say in the rig how far they may be off",
        )
    positions = np.array([pose.joint_positions for pose in poses])
    return Joints(arm, positions, offset_covariance=known)
