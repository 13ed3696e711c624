"""Small data sets of a room: an arm on a tower (or none) inside a box of five metres.

Scans and images follow from the geometry: a ray's end on the walls, a colour for each wall.
Results are real files; their estimates are ground truth plus a known error.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from lcdata.arm import Arm
from lcdata.calibrators.base import LineMatches
from lcdata.dataset import Dataset, writer
from lcdata.dataset.arms import describe_arm
from lcdata.dataset.schema import DatasetInfo, PairRecord, PoseRecord, Scenario
from lcdata.evaluation.protocol import Protocol
from lcdata.evaluation.results import TrialResult, results_path, write_run
from lcdata.geometry import se3
from lcdata.geometry.camera import Camera
from lcdata.groundtruth.chain import arm_truth
from lcdata.recording.messages import Cloud
from lcdata.rig import Rig

HALF_M = 2.5
DISTORTED = Camera("pinhole", 320, 240, (200.0, 200.0, 160.0, 120.0), (-0.1, 0.02, 0, 0, 0))
CLEAN = Camera("pinhole", 240, 180, (150.0, 150.0, 120.0, 90.0))
CAMERAS = {"den": DISTORTED, "lab": CLEAN}
RIG = {
    "simulated": True,
    "T_camera_effector": {
        "translation_m": [0, 0.03, 0.05],
        "rotation_rpy_deg": [0, 0, 10],
        "translation_std_m": 0.003,
        "rotation_std_deg": 0.1,
    },
    "T_base_lidar": {
        "translation_m": [-0.2, 0.1, 0.6],
        "rotation_rpy_deg": [0, 0, 5],
        "translation_std_m": 0.003,
        "rotation_std_deg": 0.1,
    },
}
JOINTS = np.array([[0.1, -0.4, 0.9, 0.2, -0.5, 0.3], [-0.6, 0.3, 1.4, -0.3, 0.6, -0.2]])
LIDAR = np.dtype([("x", "f4"), ("y", "f4"), ("z", "f4"), ("intensity", "f4")])
RINGS, COLUMNS = 16, 128
RUN = "5deg-0.5m-seed0"
GOOD, BAD = "alpha", "beta"


OFFSETS = {"joint_2": 0.02}  # of the arm that made the data set; its rig's file is elsewhere now


def load_arm(rig: Rig) -> Arm:
    return replace(rig.load_arm(), joint_offsets=OFFSETS)


def make(
    path: Path,
    *,
    arm: bool = True,
    pairs: int = 2,
    cameras: dict[str, Camera] = CAMERAS,
    fields: np.dtype = LIDAR,
) -> Dataset:
    """Scenarios by their cameras with two poses each (without an arm one), `pairs` pairs a pose."""
    rig = Rig.from_dict(RIG if arm else {"ground_truth": "static"})
    pair_records, pose_records = [], []
    for s, scenario in enumerate(cameras):
        for p in range(2 if arm else 1):
            pose = _pose(f"{scenario}/pose_{p:03}", rig, JOINTS[p], 10**9 * (1 + 100 * s + 10 * p))
            pose_records.append(pose)
            for n in range(pairs):
                pair_records.append(_write_pair(path, pose, n, cameras[scenario], fields))
    info = DatasetInfo(
        rig=rig.to_dict(),
        arm=describe_arm("gen3_lite", load_arm(rig)) if arm else None,
        sources=(),
        scenarios={name: Scenario(camera, {}) for name, camera in cameras.items()},
        simulated=True,
        failures=("den/pose_002: no image within 50 ms",),
    )
    writer.write_index(path, info, pair_records, pose_records)
    return Dataset.open(path)


def _pose(pose_id: str, rig: Rig, joints: np.ndarray, start_ns: int) -> PoseRecord:
    scenario = pose_id.split("/", maxsplit=1)[0]
    links = {}
    if rig.ground_truth == "arm":
        truth = arm_truth(rig, load_arm(rig), joints)
        T, covariance = truth.T_camera_lidar, truth.covariance
        names = ("T_camera_effector", "T_effector_base", "T_base_lidar")
        links = {name: getattr(truth, name) for name in names}
    else:
        joints = np.zeros(0)
        T = np.array([[0, -1, 0, 0.1], [0, 0, -1, 0.2], [1, 0, 0, -0.1], [0, 0, 0, 1.0]])
        covariance = np.full((6, 6), np.nan)
    empty = dict.fromkeys(("T_camera_effector", "T_effector_base", "T_base_lidar"))
    return PoseRecord(
        pose_id=pose_id,
        scenario=scenario,
        start_ns=start_ns,
        end_ns=start_ns + 10**9,
        joint_positions=joints,
        joint_positions_std=np.zeros_like(joints),
        samples=50,
        T_camera_lidar=T,
        covariance=covariance,
        **empty | links,
    )


def _walls(directions: np.ndarray, origin: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Ranges to the room's walls, and the wall's number from 0 to 5."""
    with np.errstate(divide="ignore", invalid="ignore"):
        ranges = (np.sign(directions) * HALF_M - origin) / directions
    axis = np.argmin(ranges, axis=1)
    side = directions[np.arange(len(axis)), axis] > 0
    return ranges[np.arange(len(axis)), axis], axis * 2 + side


def _write_pair(
    path: Path, pose: PoseRecord, number: int, camera: Camera, fields: np.dtype
) -> PairRecord:
    pair_id = f"{pose.pose_id}/{number:03}"
    azimuth = np.linspace(np.pi, -np.pi, COLUMNS, endpoint=False)
    elevation = np.deg2rad(np.linspace(22.5, -22.5, RINGS))[:, None]
    around = np.broadcast_arrays(
        np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)
    )
    rays = np.stack(around, -1).reshape(-1, 3)
    ranges, wall = _walls(rays, np.zeros(3))
    records = np.zeros(len(rays), fields)
    for i, name in enumerate("xyz"):
        records[name] = rays[:, i] * ranges
        records[name][number::7] = 0  # no return
    if "intensity" in fields.names:
        records["intensity"] = wall * 40 + ranges
    cloud_name, cloud_sha, points = writer.write_cloud(
        path, pair_id, Cloud(0, 0, "lidar", records, RINGS, COLUMNS)
    )
    pixels = np.stack(np.meshgrid(np.arange(camera.width), np.arange(camera.height)), -1)
    T_lidar_camera = se3.inverse(pose.T_camera_lidar)
    rays = camera.unproject(pixels.reshape(-1, 2)) @ T_lidar_camera[:3, :3].T
    _, wall = _walls(rays, T_lidar_camera[:3, 3])
    palette = np.random.default_rng(3).integers(60, 220, (6, 3), np.uint8)
    image = palette[wall].reshape(camera.height, camera.width, 3)
    suffix = ".png" if camera is CLEAN else ".jpg"
    data = cv2.imencode(suffix, image)[1].tobytes()
    image_name, image_sha = writer.write_image(path, pair_id, data, suffix)
    stamp = pose.start_ns + 10**8 * number
    return PairRecord(
        pair_id=pair_id,
        scenario=pose.scenario,
        pose_id=pose.pose_id,
        stamp_lidar_ns=stamp,
        stamp_image_ns=stamp + 4_000_000,
        dt_ns=4_000_000,
        image=image_name,
        cloud=cloud_name,
        image_sha256=image_sha,
        cloud_sha256=cloud_sha,
        points=points,
    )


def corners() -> np.ndarray:
    """(4, 2, 3) vertical edges of the room in the LiDAR frame, metres."""
    feet = [(x, y) for x in (-HALF_M, HALF_M) for y in (-HALF_M, HALF_M)]
    return np.array([[[x, y, -1.0], [x, y, 1.0]] for x, y in feet])


def add_results(dataset: Dataset, trials: int = 1) -> list[TrialResult]:
    """Method `alpha` is nearly right; `beta` fails on pair 1, is wrong on 2, has no trial on 3."""
    protocol = Protocol(trials=trials)
    results = []
    for number, record in enumerate(dataset.pairs):
        pose = dataset.pose(record.pose_id)
        T = pose.T_camera_lidar
        for trial in range(trials):
            blank = TrialResult(
                run=RUN,
                method=GOOD,
                method_version=1,
                parameters="{}",
                lcdata_version="0",
                pair_ids=(record.pair_id,),
                group="pair",
                scenario=record.scenario,
                pose_id=record.pose_id,
                trial=trial,
                seed=0,
                init_rotation_deg=protocol.init_rotation_deg,
                init_translation_m=protocol.init_translation_m,
                T_camera_lidar_initial=protocol.initial_guess(T, (record.pair_id,), trial),
                groundtruth_version=pose.pose_version,
                seconds=0.5,
            )
            slight = se3.exp(np.array([5, -3, 2, 1, 1, -1]) * 1e-3 * (1 + trial))
            large = se3.exp([0.2, 0.1, 0, 0, 0.2, 0])
            lines = LineMatches(corners(), np.full((4, 2, 2), 50.0), np.zeros(4, np.int64))
            lines.points_image[:, 1, 1] = 100.0
            done = {"converged": True, "failed": False, "matches": lines}
            results.append(replace(blank, T_camera_lidar_estimated=slight @ T, **done))
            if number == 1:
                results.append(replace(blank, method=BAD, message="no lines in the image"))
            elif number != 3:
                estimate = (large if number == 2 else slight) @ T
                results.append(
                    replace(blank, method=BAD, T_camera_lidar_estimated=estimate, **done)
                )
    results = [r.against(dataset.pose(r.pose_id)) for r in results]
    write_run(results_path(dataset, RUN), results)
    return results
