"""Hand-eye refinement of a data set: from its stored results, or from the lines of its pairs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lcdata.arm import Arm
from lcdata.dataset import Dataset
from lcdata.dataset.schema import PoseRecord
from lcdata.errors import GroundTruthError
from lcdata.evaluation.results import TrialResult, read_results
from lcdata.geometry import se3
from lcdata.groundtruth.handeye import HandEye, Joints, Prior, solve
from lcdata.groundtruth.twists import adjoint_many

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


@dataclass(frozen=True, eq=False)
class Refinement:
    """Refined links of a data set's tower.

    Args:
        dataset: The data set; nothing in it is changed.
        source: Method whose estimates were used, or "lines" (`--direct`).
        arm: The arm that the data set was made with.
        poses: Its poses, in the order of `found`'s residuals.
        found: The solution.
        encoders: (N, 6, 6) what encoder noise adds to each pose, in the camera frame.
    """

    dataset: Dataset
    source: str
    arm: Arm
    poses: tuple[PoseRecord, ...]
    found: HandEye
    encoders: Array

    @property
    def refined_arm(self) -> Arm:
        """The arm with the joint offsets that were found added to those it had."""
        if not len(self.found.joint_offsets):
            return self.arm
        total = self.arm.with_offsets(self.found.joint_offsets[None])[0]
        named = zip(self.arm.joint_names, total, strict=True)
        return replace(self.arm, joint_offsets={name: float(x) for name, x in named})

    def extrinsics(self) -> Array:
        """(N, 4, 4) refined T_camera_lidar of the poses."""
        positions = np.array([pose.joint_positions for pose in self.poses])
        forward = self.refined_arm.chain().forward(self.refined_arm.with_offsets(positions))
        return self.found.extrinsic(se3.inverse(forward))

    def covariances(self) -> Array:
        """(N, 6, 6) of the refined extrinsics: links, joints' zero points and encoder noise."""
        A = np.array([pose.T_effector_base for pose in self.poses])
        X, covariance = self.found.T_camera_effector, self.found.full_covariance
        parts = [np.broadcast_to(np.eye(6), (len(A), 6, 6)), adjoint_many(X @ A)]
        if len(self.found.joint_offsets):
            positions = np.array([pose.joint_positions for pose in self.poses])
            _, J = self.refined_arm.chain().jacobians(self.refined_arm.with_offsets(positions))
            parts.append(-se3.adjoint(X) @ J)
            unsolved = np.zeros((6, 6))
        else:
            unsolved = np.array(
                [p.budget.get("joint_offsets", np.zeros((6, 6))) for p in self.poses]
            )
        C = np.concatenate(parts, axis=2)
        n = C.shape[2]
        return C @ covariance[:n, :n] @ np.swapaxes(C, 1, 2) + self.encoders + unsolved

    def sigma(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Root mean square (mm, deg) that the ground truth's covariance predicts: now, refined."""
        return _sigma(np.array([pose.covariance for pose in self.poses])), _sigma(
            self.covariances()
        )


def refine(
    dataset: Dataset,
    *,
    method: str | None = None,
    run: str | None = None,
    joint_offsets: bool = False,
    direct: bool = False,
    progress: Progress | None = None,
) -> Refinement:
    """Both hand-measured links of a data set, refined.

    Args:
        dataset: Data set with an arm.
        method: Whose estimates to use; the one with most poses for None.
        run: Of which run; all runs for None.
        joint_offsets: Solve for the joints' zero points as well.
        direct: Go on from the estimates to the lines of all pairs in one problem. Without any
            stored results that starts from the hand measurement.
        progress: Called with stage, pairs done and pairs in all.

    Raises:
        GroundTruthError: No arm, no estimates, too few poses, or poses all alike.
        ArmError: The arm model cannot be found.
        DatasetError: It is another one by now.
    """
    poses = tuple(pose for pose in dataset.poses if pose.T_effector_base is not None)
    if not poses or dataset.info.arm is None:
        raise GroundTruthError(
            f"{dataset.path} was recorded without an arm (ground_truth: static)",
            "hand-eye refinement needs arm poses",
        )
    arm = dataset.load_arm()
    A = np.array([pose.T_effector_base for pose in poses])
    prior = hand_measured(dataset)
    encoders = encoder_covariances(dataset, arm, poses)
    joints = _joints(dataset, arm, poses) if joint_offsets else None
    estimates = gather(dataset, poses, method, run)
    if direct:
        from lcdata.evaluation.handeye_direct import solve_lines

        found = solve_lines(dataset, poses, A, estimates, prior, joints, encoders, progress)
        return Refinement(dataset, "lines", arm, poses, found, encoders)
    if estimates is None:
        raise GroundTruthError(
            f"{dataset.path} has no stored estimates"
            + (f" of {method}" if method else "")
            + (f" in run {run}" if run else ""),
            "run `lcdata calibrate` first, or --direct from the lines",
        )
    return Refinement(
        dataset,
        estimates.method,
        arm,
        poses,
        solve_estimates(A, estimates, prior, joints, encoders),
        encoders,
    )


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
    known = np.isfinite(prior.covariance_camera_effector).all()
    return prior if known and np.isfinite(prior.covariance_base_lidar).all() else None


def encoder_covariances(dataset: Dataset, arm: Arm, poses: Sequence[PoseRecord]) -> Array:
    """(N, 6, 6) covariance of T_camera_lidar from what encoders get wrong anew at each pose."""
    positions = np.array([pose.joint_positions for pose in poses])
    _, J = arm.chain().jacobians(arm.with_offsets(positions))
    scatter = np.array([p.joint_positions_std**2 / max(p.samples, 1) for p in poses])
    variance = np.deg2rad(dataset.rig.arm.encoder_std_deg) ** 2 + scatter
    X = np.array([pose.T_camera_effector for pose in poses])
    by_joints = adjoint_many(X) @ J
    return np.asarray((by_joints * variance[:, None]) @ np.swapaxes(by_joints, 1, 2))


def _joints(dataset: Dataset, arm: Arm, poses: Sequence[PoseRecord]) -> Joints:
    std = dataset.rig.arm.joint_offset_std_deg or Joints.offset_std_deg
    return Joints(arm, np.array([pose.joint_positions for pose in poses]), std)


def _sigma(covariances: Array) -> tuple[float, float]:
    variances = np.einsum("nii->ni", covariances)
    metres, radians = (
        float(np.sqrt(variances[:, part].sum(axis=1).mean())) for part in (slice(3), slice(3, 6))
    )
    return 1e3 * metres, float(np.rad2deg(radians))


def describe(refinement: Refinement) -> dict[str, Any]:
    """A refinement as plain values."""
    found, rig = refinement.found, refinement.dataset.rig
    std = np.sqrt(np.diag(found.covariance))
    links: dict[str, Any] = {}
    for name, T, measured, part in (
        ("T_camera_effector", found.T_camera_effector, rig.T_camera_effector, std[:6]),
        ("T_base_lidar", found.T_base_lidar, rig.T_base_lidar, std[6:]),
    ):
        if measured is not None:
            links[name] = {
                "matrix": T.tolist(),
                "translation_std_m": part[:3].tolist(),
                "rotation_std_deg": np.rad2deg(part[3:]).tolist(),
                "moved_mm": 1e3 * se3.translation_error(T, measured.T),
                "moved_deg": float(np.rad2deg(se3.rotation_error(T, measured.T))),
            }
    ids = [pose.pose_id for pose in refinement.poses]
    rows = zip(
        ids,
        found.residuals.mm,
        found.residuals.deg,
        found.left_out.mm,
        found.left_out.deg,
        strict=True,
    )
    names = ("pose_id", "mm", "deg", "left_out_mm", "left_out_deg")
    now, refined = refinement.sigma()
    joint_names = refinement.arm.joint_names if len(found.joint_offsets) else ()
    return {
        "dataset": str(refinement.dataset.path),
        "source": refinement.source,
        "poses": len(ids),
        **links,
        "covariance": found.covariance.tolist(),
        "groundtruth_sigma": {"mm": now[0], "deg": now[1]},
        "refined_sigma": {"mm": refined[0], "deg": refined[1]},
        "residuals": [dict(zip(names, row, strict=True)) for row in rows],
        "outliers": [ids[i] for i in found.outliers],
        "failed": [ids[i] for i in found.failed],
        "scale": found.scale,
        "observable": found.observable,
        "singular_value_ratio": found.singular_value_ratio,
        "unobservable": list(found.unobservable),
        "joint_offsets_deg": dict(
            zip(joint_names, np.rad2deg(found.joint_offsets).tolist(), strict=True)
        ),
        "joint_offsets_std_deg": dict(
            zip(joint_names, np.rad2deg(found.joint_offsets_std).tolist(), strict=True)
        ),
    }
