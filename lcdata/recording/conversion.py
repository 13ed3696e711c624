"""Serialised ROS messages to the types of `lcdata.recording.messages`."""

from __future__ import annotations

import struct
from collections.abc import Callable
from functools import cached_property
from typing import Any

import numpy as np

from lcdata.errors import GeometryError, MessageError
from lcdata.geometry import se3
from lcdata.recording import fields, images
from lcdata.recording.livox import CUSTOM_CLOUDS, read_custom
from lcdata.recording.messages import (
    CameraInfo,
    Cloud,
    Image,
    JointState,
    Message,
    StaticTransform,
    Transforms,
)
from lcdata.recording.plain_folder import FILE, read_file
from lcdata.recording.pointcloud import Field, unpack

CLOUD = "sensor_msgs/msg/PointCloud2"
IMAGE = "sensor_msgs/msg/Image"
COMPRESSED_IMAGE = "sensor_msgs/msg/CompressedImage"
CAMERA_INFO = "sensor_msgs/msg/CameraInfo"
JOINT_STATE = "sensor_msgs/msg/JointState"
TRANSFORMS = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")


def header_stamp(raw: memoryview, encoding: str) -> int:
    """Stamp in ns of a serialised message that begins with a header, without deserialising it."""
    if encoding == "ros1":
        seconds, nanoseconds = struct.unpack_from("<II", raw, 4)
    else:
        seconds, nanoseconds = struct.unpack_from("<iI" if raw[1] else ">iI", raw, 4)
    return int(seconds) * 10**9 + int(nanoseconds)


def has_header(type_name: str) -> bool:
    """Whether a message type that we read begins with a header."""
    return type_name not in TRANSFORMS


class Converter:
    """Deserialises the message types we read; one a recording.

    The definitions come from rosbags' type stores, not from the recording: those of the types
    we read have not changed within ROS 1 or ROS 2, and a recording's other, perhaps broken,
    definitions do not matter then.

    Args:
        encoding: `ros1` or `cdr`; `file` where messages are paths of files.
    """

    def __init__(self, encoding: str) -> None:
        self.encoding = encoding

    @cached_property
    def _deserialize(self) -> Callable[[memoryview, str], Any]:
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore

        if self.encoding == "cdr":
            return get_typestore(Stores.ROS2_HUMBLE).deserialize_cdr  # type: ignore[no-any-return]
        store = get_typestore(Stores.ROS1_NOETIC)
        for name in TRANSFORMS:
            definition = "geometry_msgs/TransformStamped[] transforms"
            store.register(get_types_from_msg(definition, name))
        return store.deserialize_ros1  # type: ignore[no-any-return]

    def __call__(self, raw: memoryview, type_name: str, stamp_ns: int, bag_ns: int) -> Message:
        """Typed message; arrays are views of `raw` where they can be.

        Raises:
            MessageError: Bytes that are not such a message.
        """
        if self.encoding == FILE:
            return read_file(raw, stamp_ns, bag_ns)
        if type_name in CUSTOM_CLOUDS:
            return read_custom(raw, self.encoding, stamp_ns, bag_ns)
        from rosbags.serde import SerdeError

        try:
            message = self._deserialize(raw, type_name)
        except (SerdeError, AssertionError, IndexError) as error:
            raise MessageError(f"not a {type_name} ({error})", "the message is damaged") from error
        return READERS[type_name](message, stamp_ns, bag_ns)


def _frame(message: Any) -> str:
    return str(message.header.frame_id).lstrip("/")


def _cloud(message: Any, stamp_ns: int, bag_ns: int) -> Cloud:
    records = unpack(
        [Field(f.name, int(f.offset), int(f.datatype), int(f.count)) for f in message.fields],
        message.data,
        height=int(message.height),
        width=int(message.width),
        point_step=int(message.point_step),
        row_step=int(message.row_step),
        big_endian=bool(message.is_bigendian),
    )
    fields.check_points(records.dtype)
    height, width = int(message.height), int(message.width)
    return Cloud(stamp_ns, bag_ns, _frame(message), records, height, width)


def _image(message: Any, stamp_ns: int, bag_ns: int) -> Image:
    return Image(
        stamp_ns,
        bag_ns,
        _frame(message),
        memoryview(message.data),
        str(message.encoding),
        False,
        int(message.height),
        int(message.width),
        int(message.step),
        bool(message.is_bigendian),
    )


def _compressed_image(message: Any, stamp_ns: int, bag_ns: int) -> Image:
    data = memoryview(message.data)
    height, width = images.size(data)
    return Image(stamp_ns, bag_ns, _frame(message), data, str(message.format), True, height, width)


def _camera_info(message: Any, stamp_ns: int, bag_ns: int) -> CameraInfo:
    ros1, roi = hasattr(message, "K"), message.roi
    return CameraInfo(
        stamp_ns,
        bag_ns,
        _frame(message),
        str(message.distortion_model),
        int(message.height),
        int(message.width),
        np.array(message.K if ros1 else message.k, np.float64),
        np.array(message.D if ros1 else message.d, np.float64),
        (int(roi.x_offset), int(roi.y_offset), int(roi.width), int(roi.height)),
        (int(message.binning_x), int(message.binning_y)),
    )


def _joint_state(message: Any, stamp_ns: int, bag_ns: int) -> JointState:
    names, positions = tuple(message.name), np.array(message.position, np.float64)
    if len(positions) != len(names):
        raise MessageError(f"joint state with {len(names)} names and {len(positions)} positions")
    return JointState(stamp_ns, bag_ns, _frame(message), names, positions)


def _transforms(message: Any, stamp_ns: int, bag_ns: int) -> Transforms:
    transforms = []
    for stamped in message.transforms:
        t, q = stamped.transform.translation, stamped.transform.rotation
        parent, child = _frame(stamped), str(stamped.child_frame_id).lstrip("/")
        try:
            T = se3.from_xyz_xyzw([t.x, t.y, t.z, q.x, q.y, q.z, q.w])
        except GeometryError as error:
            raise MessageError(f"transform from {child} to {parent}: {error}") from error
        transforms.append(StaticTransform(parent, child, T))
    return Transforms(stamp_ns, bag_ns, "", tuple(transforms))


READERS: dict[str, Callable[[Any, int, int], Message]] = {
    CLOUD: _cloud,
    IMAGE: _image,
    COMPRESSED_IMAGE: _compressed_image,
    CAMERA_INFO: _camera_info,
    JOINT_STATE: _joint_state,
    **dict.fromkeys(TRANSFORMS, _transforms),
}
"""Readers of the message types that rosbags deserialises."""

READ_TYPES = frozenset({*READERS, *CUSTOM_CLOUDS})
"""Message types we read."""
