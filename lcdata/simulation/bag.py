"""Messages as the sensors' ROS drivers publish them, written to a bag of any format."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lcdata.errors import SimulationError
from lcdata.geometry.camera import Camera
from lcdata.geometry.camera_files import info_of_camera
from lcdata.recording.fields import is_livox
from lcdata.simulation import livox_messages

Format = Literal["ros1", "mcap", "sqlite3"]
FORMATS = ("ros1", "mcap", "sqlite3")
IMAGE_FORMATS = ("jpeg", "png", "bgr8", "mono8", "bayer_rggb8")

LIVOX_MESSAGES = ("custom", "pointcloud2")

LIDAR, LIDAR_FRAME = "/ouster/points", "os_lidar"
LIVOX, LIVOX_FRAME = "/livox/lidar", "livox_frame"
CAMERA = "/zed2i/zed_node/left_raw"
IMAGE = f"{CAMERA}/image_raw_color"
COMPRESSED = f"{IMAGE}/compressed"
CAMERA_INFO = f"{CAMERA}/camera_info"
JOINTS = "/my_gen3_lite/joint_states"
TF_STATIC = "/tf_static"
CAMERA_FRAME = "zed2i_left_camera_optical_frame"

_TF_MESSAGE = "tf2_msgs/msg/TFMessage"
_POINT_TYPES = {"|u1": 2, "<u2": 4, "<u4": 6, "<f4": 7, "<f8": 8}


def bag_path(folder: Path, scenario: str, format: str) -> Path:
    """Where a recording goes: a .bag file or a ROS 2 folder."""
    return folder / (f"{scenario}.bag" if format == "ros1" else scenario)


class Bag:
    """An open bag to write to.

    Args:
        path: From `bag_path`.
        format: `ros1` (bz2 chunks), `mcap` (zstd chunks) or `sqlite3` (zstd messages).
        level: Of the compression of mcap: 3 is usual, 15 is small and slow.
    """

    def __init__(self, path: Path, format: str, level: int = 15) -> None:
        from rosbags import rosbag1, rosbag2
        from rosbags.rosbag2 import enums
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore

        if format not in FORMATS:
            raise SimulationError(
                f"unknown recording format {format!r}", f"choose from {', '.join(FORMATS)}"
            )
        self._ros1, self._mcap = format == "ros1", format == "mcap"
        self._store: Any = get_typestore(Stores.ROS1_NOETIC if self._ros1 else Stores.ROS2_HUMBLE)
        if _TF_MESSAGE not in self._store.types:
            definition = "geometry_msgs/TransformStamped[] transforms"
            self._store.register(get_types_from_msg(definition, _TF_MESSAGE))
        self._writer: Any
        if self._ros1:
            self._writer = rosbag1.Writer(path)
            self._writer.set_compression(rosbag1.Writer.CompressionFormat.BZ2)
        else:
            plugin = enums.StoragePlugin[format.upper()]
            modes = enums.CompressionMode
            mode = modes.STORAGE if format == "mcap" else modes.MESSAGE
            self._writer = rosbag2.Writer(path, version=9, storage_plugin=plugin)
            self._writer.set_compression(mode, enums.CompressionFormat.ZSTD)
        self._level = level
        self._connections: dict[str, Any] = {}
        self._sequence: dict[str, int] = {}

    def __enter__(self) -> Bag:
        self._writer.open()
        if self._mcap:  # rosbags offers no other level than 3
            self._writer.storage.compressor = partial(_zstd().compress, level=self._level)
        return self

    def __exit__(self, *exception: object) -> None:
        self._writer.close()

    def _type(self, name: str) -> Any:
        return self._store.types[name]

    def _time(self, stamp_ns: int) -> Any:
        seconds, nanoseconds = divmod(int(stamp_ns), 10**9)
        return self._type("builtin_interfaces/msg/Time")(sec=seconds, nanosec=nanoseconds)

    def _header(self, topic: str, stamp_ns: int, frame: str) -> Any:
        fields: dict[str, Any] = {"stamp": self._time(stamp_ns), "frame_id": frame}
        if self._ros1:
            fields["seq"] = self._sequence[topic] = self._sequence.get(topic, -1) + 1
        return self._type("std_msgs/msg/Header")(**fields)

    def _write(self, topic: str, kind: str, bag_ns: int, message: Any) -> None:
        if topic not in self._connections:
            connection = self._writer.add_connection(topic, kind, typestore=self._store)
            self._connections[topic] = connection
        serialize = self._store.serialize_ros1 if self._ros1 else self._store.serialize_cdr
        self._writer.write(self._connections[topic], int(bag_ns), serialize(message, kind))

    def cloud(
        self,
        stamp_ns: int,
        bag_ns: int,
        records: NDArray[np.void],
        columns: int | None,
        livox_message: str = "custom",
    ) -> None:
        """A scan as its driver publishes it.

        Args:
            stamp_ns: Header's stamp, of the scan's start.
            bag_ns: The recorder's.
            records: `lidar.POINT` or `livox.POINT`.
            columns: Of an organised scan.
            livox_message: Of a Livox: `custom` or `pointcloud2`.
        """
        livox = is_livox(records.dtype)
        topic, frame = (LIVOX, LIVOX_FRAME) if livox else (LIDAR, LIDAR_FRAME)
        header = self._header(topic, stamp_ns, frame)
        if livox and livox_message == "custom":
            kind, message = livox_messages.custom(
                self._store, header, stamp_ns, records, self._ros1
            )
            self._write(topic, kind, bag_ns, message)
            return
        if livox:
            records = livox_messages.with_absolute_times(records, stamp_ns)
        field = self._type("sensor_msgs/msg/PointField")
        layout = (records.dtype.fields or {}).items()
        width = columns or len(records)
        message = self._type("sensor_msgs/msg/PointCloud2")(
            header=header,
            height=len(records) // width,
            width=width,
            fields=[
                field(name=name, offset=at[1], datatype=_POINT_TYPES[at[0].str], count=1)
                for name, at in layout
            ],
            is_bigendian=False,
            point_step=records.dtype.itemsize,
            row_step=records.dtype.itemsize * width,
            data=np.frombuffer(records.tobytes(), np.uint8),
            is_dense=True,
        )
        self._write(topic, "sensor_msgs/msg/PointCloud2", bag_ns, message)

    def image(
        self, stamp_ns: int, bag_ns: int, image: NDArray[np.uint8], format: str, quality: int
    ) -> None:
        """A picture, (H, W, 3) RGB, encoded as one of `IMAGE_FORMATS`."""
        import cv2

        if format in ("jpeg", "png"):
            flags = [cv2.IMWRITE_JPEG_QUALITY, quality] if format == "jpeg" else []
            data = cv2.imencode(f".{format}", image[..., ::-1], flags)[1]
            message = self._type("sensor_msgs/msg/CompressedImage")(
                header=self._header(COMPRESSED, stamp_ns, CAMERA_FRAME),
                format=f"bgr8; {format} compressed bgr8",
                data=data.reshape(-1),
            )
            self._write(COMPRESSED, "sensor_msgs/msg/CompressedImage", bag_ns, message)
            return
        pixels = _raw(image, format)
        message = self._type("sensor_msgs/msg/Image")(
            header=self._header(IMAGE, stamp_ns, CAMERA_FRAME),
            height=image.shape[0],
            width=image.shape[1],
            encoding=format,
            is_bigendian=0,
            step=pixels.size // image.shape[0],
            data=pixels.reshape(-1),
        )
        self._write(IMAGE, "sensor_msgs/msg/Image", bag_ns, message)

    def camera_info(self, stamp_ns: int, bag_ns: int, camera: Camera) -> None:
        """Intrinsics and distortion."""
        distortion_model, k, d = info_of_camera(camera)
        P = np.zeros((3, 4))
        P[:, :3] = k.reshape(3, 3)
        values = {
            "d": d,
            "k": k,
            "r": np.eye(3).reshape(-1),
            "p": P.reshape(-1),
        }
        if self._ros1:
            values = {name.upper(): value for name, value in values.items()}
        roi = self._type("sensor_msgs/msg/RegionOfInterest")
        message = self._type("sensor_msgs/msg/CameraInfo")(
            header=self._header(CAMERA_INFO, stamp_ns, CAMERA_FRAME),
            height=camera.height,
            width=camera.width,
            distortion_model=distortion_model,
            binning_x=0,
            binning_y=0,
            roi=roi(x_offset=0, y_offset=0, height=0, width=0, do_rectify=False),
            **values,
        )
        self._write(CAMERA_INFO, "sensor_msgs/msg/CameraInfo", bag_ns, message)

    def joints(
        self, stamp_ns: int, bag_ns: int, names: Sequence[str], positions: ArrayLike
    ) -> None:
        """Encoder readings in radians."""
        message = self._type("sensor_msgs/msg/JointState")(
            header=self._header(JOINTS, stamp_ns, "base_link"),
            name=list(names),
            position=np.asarray(positions, float),
            velocity=np.zeros(0),
            effort=np.zeros(0),
        )
        self._write(JOINTS, "sensor_msgs/msg/JointState", bag_ns, message)

    def static_transforms(self, stamp_ns: int, bag_ns: int, ouster: bool = True) -> None:
        """What the sensors' drivers publish of their own frames; a Livox's publishes nothing."""
        vector = self._type("geometry_msgs/msg/Vector3")
        turn = self._type("geometry_msgs/msg/Quaternion")
        transform = self._type("geometry_msgs/msg/Transform")
        links = (
            ("os_sensor", "os_lidar", (0.0, 0.0, 0.038), (0.0, 0.0, 0.0, 1.0)),
            ("os_sensor", "os_imu", (0.006, -0.012, 0.008), (0.0, 0.0, 0.0, 1.0)),
            ("zed2i_left_camera_frame", CAMERA_FRAME, (0.0, 0.0, 0.0), (-0.5, 0.5, -0.5, 0.5)),
        )
        stamped = [
            self._type("geometry_msgs/msg/TransformStamped")(
                header=self._header(TF_STATIC, stamp_ns, parent),
                child_frame_id=child,
                transform=transform(
                    translation=vector(*xyz),
                    rotation=turn(*xyzw),
                ),
            )
            for parent, child, xyz, xyzw in (links if ouster else links[2:])
        ]
        message = self._type(_TF_MESSAGE)(transforms=stamped)
        self._write(TF_STATIC, _TF_MESSAGE, bag_ns, message)


def _zstd() -> Any:
    """Zstandard: in the standard library from Python 3.14 on, before that from rosbags' needs."""
    try:
        return import_module("compression.zstd")
    except ModuleNotFoundError:
        return import_module("backports.zstd")


def _raw(image: NDArray[np.uint8], format: str) -> NDArray[np.uint8]:
    """Pixels of an RGB picture in a raw encoding."""
    import cv2

    if format == "bgr8":
        return np.ascontiguousarray(image[..., ::-1])
    if format == "mono8":
        return np.asarray(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY))
    if format != "bayer_rggb8":
        raise SimulationError(
            f"unknown image format {format!r}", f"choose from {', '.join(IMAGE_FORMATS)}"
        )
    mosaic = image[..., 1].copy()
    mosaic[0::2, 0::2] = image[0::2, 0::2, 0]
    mosaic[1::2, 1::2] = image[1::2, 1::2, 2]
    return mosaic
