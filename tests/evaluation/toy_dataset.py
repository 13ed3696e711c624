"""A small data set on disk whose extrinsics can be found in closed form.

Each LiDAR point has its own intensity, and the image has a blob of that grey value where the
point projects to: the correspondences are known, and a PnP solution is the calibration.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from lcdata.dataset import Dataset, cloud_file, schema
from lcdata.dataset.atomic import write_json, write_parquet
from lcdata.dataset.schema import DatasetInfo, PairRecord, PoseRecord, Scenario
from lcdata.geometry import se3
from lcdata.geometry.camera import Camera

CAMERA = Camera("pinhole", 160, 120, (140.0, 140.0, 80.0, 60.0))
BLOBS = 16
COVARIANCE = np.diag([0.004, 0.003, 0.002, 0.001, 0.001, 0.002]) ** 2
AXES = np.array([[0, -1, 0, 0], [0, 0, -1, 0], [1, 0, 0, 0], [0, 0, 0, 1.0]])


def make(
    path: Path,
    scenarios: tuple[str, ...] = ("hall", "lawn"),
    poses: int = 2,
    pairs: int = 2,
    covariance: np.ndarray | None = COVARIANCE,
) -> Dataset:
    """Write a simulated data set and open it; without a covariance it is a static one."""
    rng = np.random.default_rng(7)
    pair_records, pose_records = [], []
    for scenario in scenarios:
        for pose in range(poses):
            pose_id = f"{scenario}/pose_{pose:03d}"
            T = se3.exp(rng.normal(0, [0.1, 0.1, 0.1, 0.05, 0.05, 0.05])) @ AXES
            pose_records.append(
                PoseRecord(
                    pose_id=pose_id,
                    scenario=scenario,
                    start_ns=0,
                    end_ns=10**9,
                    joint_positions=np.zeros(0),
                    joint_positions_std=np.zeros(0),
                    samples=0,
                    T_camera_lidar=T,
                    covariance=np.full((6, 6), np.nan) if covariance is None else covariance,
                    T_camera_effector=None,
                    T_effector_base=None,
                    T_base_lidar=None,
                )
            )
            for pair in range(pairs):
                pair_records.append(_write_pair(path, f"{pose_id}/{pair:03d}", T, rng))
    info = DatasetInfo(
        rig={"ground_truth": "static"},
        arm=None,
        sources=(),
        scenarios={name: Scenario(camera=CAMERA, topics={}) for name in scenarios},
        simulated=True,
    )
    write_parquet(path / schema.PAIRS, schema.pairs_table(pair_records))
    return write_truth(path, info, pose_records)


def write_truth(path: Path, info: DatasetInfo, poses: list[PoseRecord]) -> Dataset:
    """Write poses and dataset.json, and open the data set."""
    version, poses = schema.groundtruth_version(poses), schema.versioned(poses)
    write_parquet(path / schema.POSES, schema.poses_table(poses))
    write_json(path / schema.INFO, replace(info, groundtruth_version=version).to_dict())
    return Dataset.open(path)


def move_truth(dataset: Dataset, twist: np.ndarray) -> Dataset:
    """The data set after its ground truth was recomputed: moved by a twist."""
    poses = [replace(p, T_camera_lidar=se3.exp(twist) @ p.T_camera_lidar) for p in dataset.poses]
    return write_truth(dataset.path, dataset.info, poses)


def _write_pair(path: Path, pair_id: str, T: np.ndarray, rng: np.random.Generator) -> PairRecord:
    pixels = np.stack(np.meshgrid([20, 60, 100, 140], [18, 46, 74, 102]), -1).reshape(-1, 2)
    pixels = pixels + rng.uniform(-5, 5, pixels.shape)
    in_camera = CAMERA.unproject(pixels) * rng.uniform(3, 12, (BLOBS, 1))
    points = se3.apply(se3.inverse(T), in_camera)
    image = np.zeros((CAMERA.height, CAMERA.width), np.uint8)
    for value, (u, v) in zip(_values(), pixels, strict=True):
        center = (round(u * 1024), round(v * 1024))
        cv2.circle(image, center, 5 * 1024, int(value), -1, cv2.LINE_8, 10)
    records = np.zeros(BLOBS, [(name, "<f4") for name in ("x", "y", "z", "intensity")])
    for i, name in enumerate("xyz"):
        records[name] = points[:, i]
    records["intensity"] = _values()
    (path / pair_id).parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(path / f"{pair_id}.png"), image)
    (path / f"{pair_id}.pcd").write_bytes(b"".join(cloud_file.encode(records, 1, BLOBS)))
    scenario, pose, _ = pair_id.split("/")
    return PairRecord(
        pair_id=pair_id,
        scenario=scenario,
        pose_id=f"{scenario}/{pose}",
        stamp_lidar_ns=0,
        stamp_image_ns=0,
        dt_ns=0,
        image=f"{pair_id}.png",
        cloud=f"{pair_id}.pcd",
        image_sha256="",
        cloud_sha256="",
        points=BLOBS,
    )


def _values() -> np.ndarray:
    return np.arange(1, BLOBS + 1) * 15
