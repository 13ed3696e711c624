"""Real bag files in every format, written with rosbags."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

START = 1_700_000_000_000_000_000
MS = 1_000_000

Stream = Iterable[tuple[str, int, Any]]
"""Topic, the recorder's stamp in ns, message."""

FORMATS = {
    "ros1": ("ros1", None),
    "ros1-bz2": ("ros1", "BZ2"),
    "ros1-lz4": ("ros1", "LZ4"),
    "sqlite3": ("SQLITE3", None),
    "sqlite3-file": ("SQLITE3", "FILE"),
    "sqlite3-message": ("SQLITE3", "MESSAGE"),
    "mcap": ("MCAP", None),
    "mcap-file": ("MCAP", "FILE"),
    "mcap-message": ("MCAP", "MESSAGE"),
    "mcap-chunk": ("MCAP", "STORAGE"),
}


class Messages:
    """ROS messages of one type store."""

    def __init__(self, ros1: bool) -> None:
        self.ros1 = ros1
        self.types = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_HUMBLE)
        if ros1:
            self.types.register(
                get_types_from_msg(
                    "geometry_msgs/TransformStamped[] transforms", "tf2_msgs/msg/TFMessage"
                )
            )

    def make(self, name: str, /, **fields: Any) -> Any:
        return self.types.types[name](**fields)

    def header(self, stamp: int, frame: str) -> Any:
        time = self.make("builtin_interfaces/msg/Time", sec=stamp // 10**9, nanosec=stamp % 10**9)
        extra = {"seq": 0} if self.ros1 else {}
        return self.make("std_msgs/msg/Header", stamp=time, frame_id=frame, **extra)

    def cloud(
        self, stamp: int, records: np.ndarray, *, frame: str = "lidar", height: int = 1
    ) -> Any:
        codes = {"i1": 1, "u1": 2, "i2": 3, "u2": 4, "i4": 5, "u4": 6, "f4": 7, "f8": 8}
        dtype = records.dtype
        fields = [
            self.make(
                "sensor_msgs/msg/PointField",
                name=name,
                offset=dtype.fields[name][1],
                datatype=codes[dtype[name].base.str[1:]],
                count=int(np.prod(dtype[name].shape, dtype=int)),
            )
            for name in dtype.names
        ]
        width = len(records) // height
        return self.make(
            "sensor_msgs/msg/PointCloud2",
            header=self.header(stamp, frame),
            height=height,
            width=width,
            fields=fields,
            is_bigendian=False,
            point_step=dtype.itemsize,
            row_step=dtype.itemsize * width,
            data=np.frombuffer(records.tobytes(), np.uint8),
            is_dense=True,
        )

    def image(self, stamp: int, pixels: np.ndarray, encoding: str, frame: str = "camera") -> Any:
        data = np.ascontiguousarray(pixels).reshape(-1).view(np.uint8)
        return self.make(
            "sensor_msgs/msg/Image",
            header=self.header(stamp, frame),
            height=pixels.shape[0],
            width=pixels.shape[1],
            encoding=encoding,
            is_bigendian=0,
            step=data.size // pixels.shape[0],
            data=data,
        )

    def compressed(self, stamp: int, data: bytes, encoding: str, frame: str = "camera") -> Any:
        return self.make(
            "sensor_msgs/msg/CompressedImage",
            header=self.header(stamp, frame),
            format=encoding,
            data=np.frombuffer(data, np.uint8),
        )

    def camera_info(
        self,
        stamp: int,
        width: int,
        height: int,
        d: Iterable[float] = (),
        model: str = "plumb_bob",
        roi: tuple[int, int, int, int] = (0, 0, 0, 0),
        binning: tuple[int, int] = (0, 0),
    ) -> Any:
        k = np.array([500.0, 0, width / 2, 0, 500.0, height / 2, 0, 0, 1])
        p = np.hstack([k.reshape(3, 3), np.zeros((3, 1))]).reshape(-1)
        names = "DKRP" if self.ros1 else "dkrp"
        arrays = dict(zip(names, (np.array([*d], float), k, np.eye(3).reshape(-1), p), strict=True))
        region = self.make(
            "sensor_msgs/msg/RegionOfInterest",
            **dict(zip(("x_offset", "y_offset", "width", "height"), roi, strict=True)),
            do_rectify=False,
        )
        return self.make(
            "sensor_msgs/msg/CameraInfo",
            header=self.header(stamp, "camera"),
            height=height,
            width=width,
            distortion_model=model,
            binning_x=binning[0],
            binning_y=binning[1],
            roi=region,
            **arrays,
        )

    def joints(self, stamp: int, names: list[str], positions: Iterable[float]) -> Any:
        empty = np.empty(0)
        return self.make(
            "sensor_msgs/msg/JointState",
            header=self.header(stamp, ""),
            name=names,
            position=np.array([*positions], float),
            velocity=empty,
            effort=empty,
        )

    def transforms(
        self, stamp: int, edges: Iterable[tuple[str, str, Iterable[float], Iterable[float]]]
    ) -> Any:
        stamped = []
        for parent, child, t, q in edges:
            tx, ty, tz = t
            x, y, z, w = q
            transform = self.make(
                "geometry_msgs/msg/Transform",
                translation=self.make("geometry_msgs/msg/Vector3", x=tx, y=ty, z=tz),
                rotation=self.make("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w),
            )
            stamped.append(
                self.make(
                    "geometry_msgs/msg/TransformStamped",
                    header=self.header(stamp, parent),
                    child_frame_id=child,
                    transform=transform,
                )
            )
        return self.make("tf2_msgs/msg/TFMessage", transforms=stamped)


def write(folder: Path, name: str, kind: str, stream: Any) -> Path:
    """Write a recording; `stream` is called with `Messages`. Returns the bag or the folder."""
    plugin, compression = FORMATS[kind]
    messages = Messages(plugin == "ros1")
    path = folder / (f"{name}.bag" if messages.ros1 else name)
    if messages.ros1:
        writer: Any = Writer1(path)
        if compression:
            writer.set_compression(Writer1.CompressionFormat[compression])
    else:
        writer = Writer2(path, version=9, storage_plugin=StoragePlugin[plugin])
        if compression:
            writer.set_compression(CompressionMode[compression], CompressionFormat.ZSTD)
    serialize = messages.types.serialize_ros1 if messages.ros1 else messages.types.serialize_cdr
    connections: dict[str, Any] = {}
    with writer:
        for topic, stamp, message in stream(messages):
            kind_name = message.__msgtype__
            if topic not in connections:
                connections[topic] = writer.add_connection(
                    topic, kind_name, typestore=messages.types
                )
            writer.write(connections[topic], stamp, serialize(message, kind_name))
    return path


OUSTER = np.dtype(
    {
        "names": ["x", "y", "z", "intensity", "t", "reflectivity", "ring", "ambient", "range"],
        "formats": ["<f4", "<f4", "<f4", "<f4", "<u4", "<u2", "<u2", "<u2", "<u4"],
        "offsets": [0, 4, 8, 16, 20, 24, 26, 28, 32],
        "itemsize": 48,
    }
)
"""Layout of the Ouster driver's clouds."""

JOINTS = [f"joint_{i}" for i in range(1, 7)]


def ouster_cloud(seed: int, height: int = 8, width: int = 16) -> np.ndarray:
    """Records with random points and per-point times of a 100 ms turn in ns."""
    rng = np.random.default_rng(seed)
    records = np.zeros(height * width, OUSTER)
    for name in "xyz":
        records[name] = rng.normal(0, 5, len(records))
    records["intensity"] = rng.integers(0, 255, len(records))
    records["t"] = np.tile(np.arange(width) * (100 * MS // width), height)
    records["ring"] = np.repeat(np.arange(height), width)
    return records


def arm_stream(
    *, poses: int = 2, dwell_s: float = 2.0, move_s: float = 1.0, image_delay_ms: float = 7.0
) -> Any:
    """A simulated run of an arm between poses: joint states, scans and raw images at 10 Hz.

    The recorder's stamps are 3 ms after the headers'.
    """

    def stream(m: Messages) -> Stream:
        rng = np.random.default_rng(0)
        goals = rng.uniform(-1, 1, (poses, 6))
        leg = dwell_s + move_s
        total = poses * dwell_s + (poses - 1) * move_s
        yield "/camera/camera_info", START, m.camera_info(START, 32, 24)
        edge = [("tower", "lidar", (0.1, 0.2, 0.3), (0, 0, 0, 1))]
        yield "/tf_static", START, m.transforms(START, edge)
        for i in range(round(total * 100)):
            t = i / 100
            pose = min(int(t // leg), poses - 1)
            moved = np.clip((t - pose * leg - dwell_s) / move_s, 0, 1)
            moved = moved**3 * (10 - 15 * moved + 6 * moved**2)
            q = goals[pose] + moved * (goals[min(pose + 1, poses - 1)] - goals[pose])
            q = q + np.deg2rad(rng.normal(0, 0.02, 6))
            stamp = START + i * 10 * MS
            names = [*JOINTS[::-1], "gripper"]
            yield "/joint_states", stamp + 3 * MS, m.joints(stamp, names, [*q[::-1], 0.5])
            if i % 10 == 0:
                cloud = m.cloud(stamp, ouster_cloud(i), height=8)
                yield "/lidar/points", stamp + 3 * MS, cloud
                taken = stamp + round(image_delay_ms * MS)
                pixels = rng.integers(0, 255, (24, 32, 3), dtype=np.uint8)
                yield "/camera/image_raw", taken + 3 * MS, m.image(taken, pixels, "bgr8")

    return stream
