"""Tiny published data sets, written to their formats, with random calibrations."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]

SIZE = (64, 48)
LIDAR_TO_CAMERA = np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]])
"""x forward, y left, z up to x right, y down, z forward."""


def image(path: Path, seed: int = 0, size: tuple[int, int] = SIZE) -> bytes:
    """Write a random picture; returns its bytes."""
    pixels = np.random.default_rng(seed).integers(0, 255, (size[1], size[0], 3), np.uint8)
    data = cv2.imencode(path.suffix, pixels)[1].tobytes()
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(data)
    return data


def mask(path: Path, size: tuple[int, int] = SIZE) -> bytes:
    """Write a mask, white on the left."""
    pixels = np.zeros((size[1], size[0]), np.uint8)
    pixels[:, : size[0] // 3] = 255
    data = cv2.imencode(path.suffix, pixels)[1].tobytes()
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(data)
    return data


def points(seed: int = 0, count: int = 60, columns: int = 4) -> NDArray[np.float32]:
    """Points in front of a vehicle, x forward, with intensity and, of five columns, ring."""
    rng = np.random.default_rng(seed)
    result = np.empty((count, 5), np.float32)
    result[:, 0] = rng.uniform(5, 30, count)
    result[:, 1:3] = rng.uniform(-0.3, 0.3, (count, 2)) * result[:, :1]
    result[:, 3] = rng.uniform(0, 1, count)
    result[:, 4] = rng.integers(0, 32, count)
    return np.ascontiguousarray(result[:, :columns])


def scan(path: Path, values: NDArray[np.float32]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(values.astype("<f4").tobytes())


def small_rotation(rng: np.random.Generator, deg: float = 3.0) -> Array:
    return Rotation.from_rotvec(np.deg2rad(rng.uniform(-deg, deg, 3))).as_matrix()


def line(key: str, values: Any) -> str:
    return f"{key}: " + " ".join(f"{v:.12e}" for v in np.ravel(values))


def stamp_text(ns: int) -> str:
    """Nanoseconds of 2011-09-26 13:02 as KITTI writes them."""
    return f"2011-09-26 13:02:{ns // 10**9:02}.{ns % 10**9:09}"


def kitti_calibration(date: Path, seed: int = 0) -> dict[str, Array]:
    """Both calibration files of a date; returns what is in them."""
    rng = np.random.default_rng(seed)
    found: dict[str, Array] = {
        "R": small_rotation(rng) @ LIDAR_TO_CAMERA,
        "T": rng.uniform(-0.3, 0.3, 3),
    }
    date.mkdir(parents=True, exist_ok=True)
    lines = ["calib_time: 15-Mar-2012 11:37:16", line("R", found["R"]), line("T", found["T"])]
    lines += ["delta_f: 0.0 0.0", "delta_c: 0.0 0.0"]
    (date / "calib_velo_to_cam.txt").write_text("\n".join(lines) + "\n")
    lines = ["calib_time: 09-Jan-2012 13:57:47", "corner_dist: 9.950000e-02"]
    for xx in ("00", "01", "02", "03"):
        f = rng.uniform(50, 60)
        K = np.array([[f, 0, 31.5], [0, f + 1, 23.5], [0, 0, 1]])
        P = np.array(
            [
                [55.0, 0, 30.5, rng.uniform(-9, 9)],
                [0, 55.0, 22.5, rng.uniform(-1, 1)],
                [0, 0, 1, rng.uniform(-0.01, 0.01)],
            ]
        )
        values = {
            "S": np.array(SIZE, float) + 2,
            "K": K,
            "D": rng.uniform(-0.05, 0.05, 5),
            "R": small_rotation(rng),
            "T": rng.uniform(-0.5, 0.5, 3),
            "S_rect": np.array(SIZE, float),
            "R_rect": small_rotation(rng),
            "P_rect": P,
        }
        found |= {f"{key}_{xx}": value for key, value in values.items()}
        lines += [line(f"{key}_{xx}", value) for key, value in values.items()]
    (date / "calib_cam_to_cam.txt").write_text("\n".join(lines) + "\n")
    return found


def kitti_drive(date: Path, number: int = 1, frames: int = 3, camera: str = "image_02") -> Path:
    """A synchronised drive."""
    drive = date / f"{date.name}_drive_{number:04}_sync"
    for frame in range(frames):
        image(drive / camera / "data" / f"{frame:010}.png", number * 100 + frame)
        values = points(number * 100 + frame)
        scan(drive / "velodyne_points" / "data" / f"{frame:010}.bin", values)
    for name, offset in ((camera, 10_000_001), ("velodyne_points", 0)):
        stamps = [stamp_text(25 * 10**9 + f * 10**8 + offset) for f in range(frames)]
        (drive / name / "timestamps.txt").write_text("\n".join(stamps) + "\n")
    return drive


def kitti_extract(date: Path, number: int = 1) -> Path:
    """An extracted drive: four images, three scans as text, not of equal numbers."""
    drive = date / f"{date.name}_drive_{number:04}_extract"
    size = SIZE[0] + 2, SIZE[1] + 2
    for frame in range(4):
        image(drive / "image_02" / "data" / f"{frame:010}.png", frame, size)
    for frame in range(3):
        path = drive / "velodyne_points" / "data" / f"{frame:010}.txt"
        path.parent.mkdir(parents=True, exist_ok=True)
        np.savetxt(path, points(frame), fmt="%.3f")
    stamps = [stamp_text(25 * 10**9 + f * 10**8) for f in range(4)]
    (drive / "image_02" / "timestamps.txt").write_text("\n".join(stamps))
    # a scan later than each image but the first, and one that is far from all
    stamps = [stamp_text(25 * 10**9 + ms * 10**6) for ms in (120, 215, 900)]
    (drive / "velodyne_points" / "timestamps.txt").write_text("\n".join(stamps))
    return drive


def kitti_sequence(
    root: Path, name: str = "00", frames: int = 3, seed: int = 0
) -> dict[str, Array]:
    """A sequence of the odometry benchmark; returns its calibration."""
    rng = np.random.default_rng(seed)
    folder = root / "sequences" / name
    found: dict[str, Array] = {}
    for i in range(4):
        P = np.array([[55.0, 0, 30.5, 0], [0, 55.0, 22.5, 0], [0, 0, 1, 0]])
        P[:, 3] = rng.uniform(-9, 9), rng.uniform(-1, 1), rng.uniform(-0.01, 0.01)
        found[f"P{i}"] = P
    R = small_rotation(rng) @ LIDAR_TO_CAMERA
    found["Tr"] = np.column_stack([R, rng.uniform(-0.3, 0.3, 3)])
    folder.mkdir(parents=True)
    (folder / "calib.txt").write_text("\n".join(line(k, v) for k, v in found.items()) + "\n")
    (folder / "times.txt").write_text("".join(f"{f * 0.1037875:.6e}\n" for f in range(frames)))
    for frame in range(frames):
        image(folder / "image_2" / f"{frame:06}.png", seed + frame)
        scan(folder / "velodyne" / f"{frame:06}.bin", points(seed + frame))
    return found


def quaternion(R: Array) -> list[float]:
    """w x y z."""
    x, y, z, w = Rotation.from_matrix(R).as_quat()
    return [float(w), float(x), float(y), float(z)]


class NuScenesFiles:
    """A version of nuScenes with some scenes; tables as lists of rows until `write`."""

    def __init__(self, root: Path, scenes: int = 1, samples: int = 3, seed: int = 0) -> None:
        self.root = root
        rng = np.random.default_rng(seed)
        self.tables: dict[str, list[dict[str, Any]]] = {
            name: [] for name in ("scene", "sample", "sample_data", "calibrated_sensor", "ego_pose")
        }
        self.tables["sensor"] = [
            {"token": f"sensor-{c}", "channel": c, "modality": c[:3].lower()}
            for c in ("CAM_FRONT", "CAM_BACK", "LIDAR_TOP")
        ]
        self.K = np.array([[55.0, 0, 31.5], [0, 55.0, 23.5], [0, 0, 1]])
        for s in range(scenes):
            self._scene(f"scene-{s:04}", samples, rng)
        self.write()

    def _scene(self, name: str, samples: int, rng: np.random.Generator) -> None:
        mounts = {
            # the ego frame is x forward, y left, z up; the LiDAR of nuScenes looks along its y
            "LIDAR_TOP": small_rotation(rng)
            @ Rotation.from_euler("z", 90, degrees=True).as_matrix().T,
            "CAM_FRONT": small_rotation(rng) @ LIDAR_TO_CAMERA.T,
            "CAM_BACK": LIDAR_TO_CAMERA.T,
        }
        for channel, R in mounts.items():
            self.tables["calibrated_sensor"].append(
                {
                    "token": f"{name}-{channel}",
                    "sensor_token": f"sensor-{channel}",
                    "translation": rng.uniform(-0.5, 0.5, 3).tolist(),
                    "rotation": quaternion(R),
                    "camera_intrinsic": self.K.tolist() if channel != "LIDAR_TOP" else [],
                }
            )
        self.tables["scene"].append({"token": f"t-{name}", "name": name, "nbr_samples": samples})
        for i in range(samples):
            sample = f"{name}-{i}"
            us = 1_532_402_927_000_000 + i * 500_000
            self.tables["sample"].append(
                {"token": sample, "timestamp": us, "scene_token": f"t-{name}"}
            )
            for channel, early in (("LIDAR_TOP", 0), ("CAM_FRONT", 35_000), ("CAM_BACK", 10_000)):
                token = f"{sample}-{channel}"
                ending = "pcd.bin" if channel == "LIDAR_TOP" else "jpg"
                file = f"samples/{channel}/{token}__{us - early}.{ending}"
                seconds = (us - early - 1_532_402_927_000_000) / 1e6
                heading = Rotation.from_euler("z", 0.3 + 0.4 * seconds)
                self.tables["ego_pose"].append(
                    {
                        "token": f"pose-{token}",
                        "timestamp": us - early,
                        "translation": [600 + 12 * seconds, 1600 + 5 * seconds, 0.0],
                        "rotation": quaternion(heading.as_matrix()),
                    }
                )
                is_camera = channel != "LIDAR_TOP"
                self.tables["sample_data"].append(
                    {
                        "token": token,
                        "sample_token": sample,
                        "ego_pose_token": f"pose-{token}",
                        "calibrated_sensor_token": f"{name}-{channel}",
                        "filename": file,
                        "fileformat": ending.partition(".")[0],
                        "width": SIZE[0] if is_camera else 0,
                        "height": SIZE[1] if is_camera else 0,
                        "timestamp": us - early,
                        "is_key_frame": True,
                    }
                )
                if is_camera:
                    image(self.root / file, i)
                else:
                    values = points(i, columns=5)
                    values[:, :2] = np.stack([-values[:, 1], values[:, 0]], axis=1)  # along y
                    scan(self.root / file, values)
        # a sweep between key frames, which is none
        row = dict(self.tables["sample_data"][-1], token=f"{name}-sweep", is_key_frame=False)
        self.tables["sample_data"].append(row)

    def write(self) -> None:
        folder = self.root / "v1.0-mini"
        folder.mkdir(parents=True, exist_ok=True)
        for name, rows in self.tables.items():
            (folder / f"{name}.json").write_text(json.dumps(rows))

    def row(self, table: str, token: str) -> dict[str, Any]:
        return next(row for row in self.tables[table] if row["token"] == token)


def matrix(values: Any) -> dict[str, Any]:
    """As OpenCV writes it into JSON."""
    values = np.asarray(values, float)
    return {"rows": len(values), "cols": values.shape[1], "type": 6, "data": values.tolist()}


def opencalib(folder: Path, name: str = "calib", seed: int = 0) -> tuple[Array, Array]:
    """Files as auto_calib's and manual_calib's; returns K and T_camera_lidar."""
    rng = np.random.default_rng(seed)
    K = np.array([[55.0, 0, 31.5], [0, 56.0, 23.5], [0, 0, 1]])
    T = np.eye(4)
    T[:3, :3] = small_rotation(rng) @ LIDAR_TO_CAMERA
    T[:3, 3] = rng.uniform(-0.5, 0.5, 3)
    image(folder / f"{name}.png", seed)
    pcd(folder / f"{name}.pcd", points(seed))
    intrinsic = {
        "sensor_name": "center_camera",
        "target_sensor_name": "center_camera",
        "device_type": "camera",
        "param_type": "intrinsic",
        "param": {
            "img_dist_w": SIZE[0],
            "img_dist_h": SIZE[1],
            "cam_K": matrix(K),
            "cam_dist": matrix([[-0.1, 0.05, 0.001, -0.002]]),
        },
    }
    extrinsic = {
        "sensor_name": "top_center_lidar",
        "target_sensor_name": "center_camera",
        "device_type": "relational",
        "param_type": "extrinsic",
        "param": {"time_lag": 0, "sensor_calib": matrix(T)},
    }
    for key, content in (
        ("center_camera-intrinsic", intrinsic),
        ("top_center_lidar-to-center_camera-extrinsic", extrinsic),
    ):
        (folder / f"{key}.json").write_text(json.dumps({key: content}))
    return K, T


def pcd(path: Path, values: NDArray[np.float32]) -> None:
    from pypcd4 import PointCloud

    path.parent.mkdir(parents=True, exist_ok=True)
    PointCloud.from_xyzi_points(np.ascontiguousarray(values[:, :4])).save(path)


def folder_of_pairs(folder: Path, pairs: int = 3, **changes: Any) -> dict[str, Any]:
    """Images, clouds and reference.json; returns what is in the latter."""
    T = np.eye(4)
    T[:3, :3] = LIDAR_TO_CAMERA
    T[:3, 3] = 0.1, -0.2, 0.05
    reference: dict[str, Any] = {
        "K": [55.0, 56.0, 31.5, 23.5],
        "D": [-0.1, 0.05, 0.001, -0.002, 0.0],
        "T_camera_lidar": T.tolist(),
    }
    reference |= changes
    folder.mkdir(parents=True, exist_ok=True)
    for i in range(pairs):
        image(folder / f"{i:06}.png", i)
        pcd(folder / f"{i:06}.pcd", points(i))
    (folder / "reference.json").write_text(json.dumps(reference))
    return reference
