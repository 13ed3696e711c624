"""Livox's own message, in which its points have their times: CustomMsg of ROS 1 and ROS 2."""

from __future__ import annotations

import struct

import numpy as np
from numpy.typing import NDArray

from lcdata.errors import MessageError
from lcdata.recording.messages import Cloud

CUSTOM_CLOUDS = (
    "livox_ros_driver/msg/CustomMsg",
    "livox_ros_driver2/msg/CustomMsg",
    "livox_interfaces/msg/CustomMsg",
)
"""Names of the message: of both drivers in ROS 1 and 2, and of the first one's ROS 2 port."""

CUSTOM_CLOUD = """\
std_msgs/Header header
uint64 timebase
uint32 point_num
uint8 lidar_id
uint8[3] rsvd
{package}/CustomPoint[] points
"""
CUSTOM_POINT = """\
uint32 offset_time
float32 x
float32 y
float32 z
uint8 reflectivity
uint8 tag
uint8 line
"""
"""Their definitions, for those who write such messages. Here the points are read as one array:
a hundred times faster than as a list of 24,000 messages."""

_POINT = (
    ("offset_time", "u4"),
    ("x", "f4"),
    ("y", "f4"),
    ("z", "f4"),
    ("reflectivity", "u1"),
    ("tag", "u1"),
    ("line", "u1"),
)
_PACKED = np.dtype([(name, f"<{kind}") for name, kind in _POINT])


def read_custom(raw: memoryview, encoding: str, stamp_ns: int, bag_ns: int) -> Cloud:
    """A CustomMsg, every field of its points kept; `offset_time` in ns since the first point.

    Args:
        raw: The serialised message.
        encoding: `ros1` or `cdr`.
        stamp_ns: See `messages.Message`.
        bag_ns: See `messages.Message`.

    Raises:
        MessageError: Bytes that are not such a message, or not all of one.
    """
    try:
        frame, records = _ros1(raw) if encoding == "ros1" else _cdr(raw)
    except (struct.error, IndexError, ValueError) as error:
        raise MessageError(
            f"not a Livox CustomMsg of {len(raw)} bytes", "the message is damaged"
        ) from error
    return Cloud(stamp_ns, bag_ns, frame.lstrip("/"), records, 1, len(records))


def _ros1(raw: memoryview) -> tuple[str, NDArray[np.void]]:
    """ROS 1 lays the fields one after the other without any padding."""
    (length,) = struct.unpack_from("<I", raw, 12)
    frame = bytes(raw[16 : 16 + length]).decode(errors="replace")
    at = 16 + length + 8 + 4 + 1 + 3
    (count,) = struct.unpack_from("<I", raw, at)
    return frame, np.frombuffer(raw, _PACKED, count, at + 4)


def _cdr(raw: memoryview) -> tuple[str, NDArray[np.void]]:
    """CDR aligns each field to its own size, from the end of the 4 bytes before the message."""
    order = "<" if raw[1] else ">"
    body = raw[4:]
    (length,) = struct.unpack_from(f"{order}I", body, 8)
    frame = bytes(body[12 : 12 + length]).rstrip(b"\0").decode(errors="replace")
    at = _aligned(12 + length, 8) + 8 + 4 + 1 + 3
    (count,) = struct.unpack_from(f"{order}I", body, _aligned(at, 4))
    at = _aligned(at, 4) + 4
    if len(body) < at + max(count * 20 - 1, 0):  # the last point has no padding after it
        raise ValueError("too short")
    if not count:
        return frame, np.empty(0, _PACKED)
    padded = np.dtype(
        {
            "names": [name for name, _ in _POINT],
            "formats": [f"{order}{kind}" for _, kind in _POINT],
            "offsets": [0, 4, 8, 12, 16, 17, 18],
            "itemsize": 19,
        }
    )
    points: NDArray[np.void] = np.ndarray((count,), padded, body, at, (20,))
    return frame, points.astype(_PACKED)


def _aligned(at: int, size: int) -> int:
    return at + -at % size
