"""Points of a simulated Livox in the messages of its drivers."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from lcdata.recording.livox import CUSTOM_CLOUD, CUSTOM_POINT

_POINT_CLOUD = np.dtype(
    [
        ("x", "<f4"),
        ("y", "<f4"),
        ("z", "<f4"),
        ("intensity", "<f4"),
        ("tag", "u1"),
        ("line", "u1"),
        ("timestamp", "<f8"),
    ]
)
"""A point of livox_ros_driver2's PointCloud2."""


def custom(
    store: Any, header: Any, timebase_ns: int, records: NDArray[np.void], ros1: bool
) -> tuple[str, Any]:
    """Type and message of a CustomMsg.

    Args:
        store: rosbags' types; the driver's are registered where they are not.
        header: The message's.
        timebase_ns: Time of the first point.
        records: (N,) `livox.POINT`.
        ros1: Whether to take the name that the type has in ROS 1.
    """
    from rosbags.typesys import get_types_from_msg

    package = "livox_ros_driver" if ros1 else "livox_ros_driver2"
    kind, point_kind = (f"{package}/msg/{name}" for name in ("CustomMsg", "CustomPoint"))
    if kind not in store.types:
        store.register(get_types_from_msg(CUSTOM_POINT, point_kind))
        store.register(get_types_from_msg(CUSTOM_CLOUD.format(package=package), kind))
    point = store.types[point_kind]
    message = store.types[kind](
        header=header,
        timebase=timebase_ns,
        point_num=len(records),
        lidar_id=0,
        rsvd=np.zeros(3, np.uint8),
        points=[point(*row) for row in records.tolist()],
    )
    return kind, message


def with_absolute_times(records: NDArray[np.void], timebase_ns: int) -> NDArray[np.void]:
    """(N,) points of livox_ros_driver2's PointCloud2, each with its time since 1970."""
    result = np.empty(len(records), _POINT_CLOUD)
    for name in ("x", "y", "z", "tag", "line"):
        result[name] = records[name]
    result["intensity"] = records["reflectivity"]
    result["timestamp"] = timebase_ns + records["offset_time"].astype(np.float64)
    return result
