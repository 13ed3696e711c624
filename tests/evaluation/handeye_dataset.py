"""A data set of arm poses with stored estimates, and line features that such poses see."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from lcdata.arm import Arm
from lcdata.dataset import Dataset, schema
from lcdata.dataset.arms import describe_arm
from lcdata.dataset.atomic import write_json, write_parquet
from lcdata.dataset.schema import DatasetInfo, PoseRecord, Scenario
from lcdata.evaluation.results import TrialResult, results_path, write_run
from lcdata.geometry import se3
from lcdata.geometry.camera import Camera
from lcdata.rig import Rig
from lcdata.simulation.mounts import default_rig, true_mounts

CAMERA = Camera("pinhole", 1280, 720, (530.0, 530.0, 640.0, 360.0))
STD = np.repeat([0.003, np.deg2rad(0.05)], 3)
"""Metres and radians of an estimate."""


def positions(poses: int, seed: int = 0) -> np.ndarray:
    """(poses, 6) joint positions, the wrist turned every way."""
    rng = np.random.default_rng(seed)
    return np.array([0.2, -0.4, 1.0, 0.3, -0.8, 0.5]) + rng.uniform(-0.6, 0.6, (poses, 6))


def make(path: Path, poses: int = 12, rig: Rig | None = None, seed: int = 1) -> Dataset:
    """Write a simulated data set: true mounts off the rig's by its standard deviations."""
    rig = rig or default_rig()
    arm = rig.load_arm()
    q = positions(poses)
    A = se3.inverse(arm.chain().forward(q))
    X, Z = rig.T_camera_effector.T, rig.T_base_lidar.T
    records = [
        PoseRecord(
            pose_id=f"gym/pose_{i:03d}",
            scenario="gym",
            start_ns=0,
            end_ns=10**9,
            joint_positions=q[i],
            joint_positions_std=np.zeros(6),
            samples=100,
            T_camera_lidar=X @ A[i] @ Z,
            covariance=np.diag(np.repeat([0.005, 0.004], 3) ** 2),
            T_camera_effector=X,
            T_effector_base=A[i],
            T_base_lidar=Z,
        )
        for i in range(poses)
    ]
    version, records = schema.groundtruth_version(records), schema.versioned(records)
    info = DatasetInfo(
        rig=rig.to_dict(),
        arm=describe_arm("gen3_lite", arm),
        sources=({"scenario": "gym", "fingerprint": f"{seed:064x}"},),
        scenarios={"gym": Scenario(camera=CAMERA, topics={})},
        simulated=True,
        groundtruth_version=version,
    )
    write_parquet(path / schema.PAIRS, schema.pairs_table([]))
    write_parquet(path / schema.POSES, schema.poses_table(records))
    write_json(path / schema.INFO, info.to_dict())
    return Dataset.open(path)


def truth(dataset: Dataset, seed: int = 1, arm: Arm | None = None) -> np.ndarray:
    """(N, 4, 4) true extrinsics of the poses."""
    mounts = true_mounts(dataset.rig, seed)
    arm = arm or dataset.rig.load_arm()
    q = np.array([pose.joint_positions for pose in dataset.poses])
    A = se3.inverse(arm.chain().forward(arm.with_offsets(q)))
    return mounts.T_camera_effector @ A @ mounts.T_base_lidar


def store(dataset: Dataset, method: str = "projection", wrong: tuple[int, ...] = ()) -> None:
    """Store two trials a pose: the truth with noise, and half a metre off for some poses."""
    rng = np.random.default_rng(2)
    trials = []
    for i, (pose, T) in enumerate(zip(dataset.poses, truth(dataset), strict=True)):
        own = rng.normal(size=6) * STD
        for trial in range(2):
            off = [0.5, 0, 0, 0, 0, 0.1] if i in wrong else own + 1e-5 * rng.normal(size=6)
            estimate = se3.exp(off) @ T
            blank = TrialResult(
                run=method,
                method=method,
                method_version=1,
                parameters="{}",
                lcdata_version="0",
                pair_ids=(f"{pose.pose_id}/000",),
                scenario=pose.scenario,
                pose_id=pose.pose_id,
                trial=trial,
                seed=0,
                group="pair",
                init_rotation_deg=5.0,
                init_translation_m=0.5,
                T_camera_lidar_initial=T,
                groundtruth_version=pose.pose_version,
                T_camera_lidar_estimated=estimate,
                covariance=np.diag(STD**2),
                converged=True,
                failed=False,
            )
            trials.append(blank.against(pose))
    write_run(results_path(dataset, method), trials)
