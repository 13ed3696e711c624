"""A small data set, written with the writer, for the tests of this room."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from lcdata.dataset import writer
from lcdata.dataset.schema import DatasetInfo, PairRecord, PoseRecord, Scenario
from lcdata.geometry import se3
from lcdata.geometry.camera import Camera
from lcdata.recording.messages import Cloud, Image

CAMERA = Camera("pinhole", 64, 48, (50.0, 50.0, 32.0, 24.0), (0.1, -0.05, 0.0, 0.0, 0.0))
RIG = {
    "ground_truth": "arm",
    "T_camera_effector": {"translation_m": [0.01, 0.02, 0.03], "rotation_rpy_deg": [1, 2, 3]},
    "T_base_lidar": {"translation_m": [0.1, 0.2, 0.3], "rotation_rpy_deg": [4, 5, 6]},
}
OUSTER = np.dtype(
    [
        ("x", "f4"),
        ("y", "f4"),
        ("z", "f4"),
        ("intensity", "f4"),
        ("t", "u4"),
        ("reflectivity", "u2"),
        ("ring", "u2"),
    ]
)


def records(count: int, seed: int = 0) -> NDArray[np.void]:
    """Random points; every tenth without a return."""
    rng = np.random.default_rng(seed)
    result = np.zeros(count, OUSTER)
    for name in "xyz":
        result[name] = rng.uniform(1, 9, count)
        result[name][::10] = 0
    result["intensity"] = rng.uniform(0, 255, count)
    result["t"] = np.arange(count)
    result["reflectivity"] = rng.integers(0, 65535, count)
    result["ring"] = np.arange(count) % 4
    return result


def cloud(height: int = 4, width: int = 50, seed: int = 0) -> Cloud:
    return Cloud(0, 0, "lidar", records(height * width, seed), height, width)


def jpeg(seed: int = 0) -> Image:
    pixels = np.random.default_rng(seed).integers(0, 255, (48, 64, 3), np.uint8)
    data = cv2.imencode(".jpg", pixels)[1].tobytes()
    return Image(0, 0, "camera", memoryview(data), "jpeg", True, 48, 64)


def transform(seed: int) -> NDArray[np.float64]:
    return se3.exp(np.random.default_rng(seed).uniform(-1, 1, 6))


def pose(pose_id: str, seed: int) -> PoseRecord:
    X, A, Z = (transform(seed + k) for k in range(3))
    root = np.random.default_rng(seed).normal(size=(6, 6)) * 1e-3
    return PoseRecord(
        pose_id,
        pose_id.split("/", maxsplit=1)[0],
        start_ns=1_000_000_000,
        end_ns=2_000_000_000,
        joint_positions=np.arange(6) * 0.1,
        joint_positions_std=np.full(6, 1e-4),
        samples=100,
        T_camera_lidar=X @ A @ Z,
        covariance=root @ root.T,
        T_camera_effector=X,
        T_effector_base=A,
        T_base_lidar=Z,
    )


def write(folder: Path) -> None:
    """Two scenarios, two poses each, two pairs a pose; `b` has unorganised clouds."""
    pairs, poses = [], []
    for s, scenario in enumerate(("a", "b")):
        for p in range(2):
            pose_id = f"{scenario}/pose_{p:03}"
            poses.append(pose(pose_id, seed=10 * s + p))
            for n in range(2):
                pair_id, seed = f"{pose_id}/{n:03}", 100 * s + 10 * p + n
                scan = cloud(seed=seed) if scenario == "a" else cloud(1, 200, seed)
                cloud_name, cloud_sha, points = writer.write_cloud(folder, pair_id, scan)
                image_name, image_sha = writer.write_image(folder, pair_id, *jpeg(seed).encoded())
                stamp = 1_100_000_000 + n * 100_000_000
                pairs.append(
                    PairRecord(
                        pair_id,
                        scenario,
                        pose_id,
                        stamp_lidar_ns=stamp,
                        stamp_image_ns=stamp + 5_000_000,
                        dt_ns=5_000_000,
                        image=image_name,
                        cloud=cloud_name,
                        image_sha256=image_sha,
                        cloud_sha256=cloud_sha,
                        points=points,
                    )
                )
    topics = {"lidar": "/points", "image": "/image", "camera_info": None, "joint_states": "/j"}
    info = DatasetInfo(
        rig=RIG,
        arm={"model": "gen3_lite", "joint_names": [f"joint_{k}" for k in range(1, 7)]},
        sources=tuple({"scenario": name, "name": f"{name}.bag"} for name in ("a", "b")),
        scenarios={name: Scenario(CAMERA, topics, "lidar", "camera", ("odd",)) for name in "ab"},
        simulated=True,
    )
    writer.write_index(folder, info, pairs, poses)
