"""Livox's messages in real bags, written by rosbags from their definitions."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from rosbags.typesys import get_types_from_msg

from lcdata.errors import MessageError
from lcdata.recording import fields
from lcdata.recording.livox import CUSTOM_CLOUD, CUSTOM_POINT, read_custom
from lcdata.recording.messages import Cloud, intensity_field, ring_field, time_field, xyz
from lcdata.recording.source import open_recording
from lcdata.recording.summary import summarise
from lcdata.rig import Rig

from .bags import MS, START, Messages, write

POINTS = np.zeros(
    301,
    [
        ("offset_time", "u4"),
        *((axis, "f4") for axis in "xyz"),
        *((name, "u1") for name in ("reflectivity", "tag", "line")),
    ],
)
rng = np.random.default_rng(4)
POINTS["offset_time"] = np.linspace(0, 99_000_000, len(POINTS)).astype(np.uint32)
for axis in "xyz":
    POINTS[axis] = rng.uniform(1, 20, len(POINTS))
POINTS["reflectivity"] = rng.integers(1, 255, len(POINTS))
POINTS["tag"], POINTS["line"] = 0x10, np.arange(len(POINTS)) % 6
for axis in "xyz":
    POINTS[axis][7] = 0  # no return


def custom(messages: Messages, package: str, stamp: int, points: np.ndarray, frame: str) -> Any:
    """A CustomMsg, its types registered as a driver's package defines them."""
    kind = f"{package}/msg/CustomMsg"
    if kind not in messages.types.types:
        point = get_types_from_msg(CUSTOM_POINT, f"{package}/msg/CustomPoint")
        messages.types.register(point)
        cloud = get_types_from_msg(CUSTOM_CLOUD.format(package=package), kind)
        messages.types.register({kind: cloud[kind]})
    rows = [
        messages.make(
            f"{package}/msg/CustomPoint",
            **{name: record[name].item() for name in points.dtype.names},
        )
        for record in points
    ]
    return messages.make(
        kind,
        header=messages.header(stamp, frame),
        timebase=stamp,
        point_num=len(rows),
        lidar_id=1,
        rsvd=np.zeros(3, np.uint8),
        points=rows,
    )


@pytest.mark.parametrize(
    ("kind", "package"),
    [
        ("ros1", "livox_ros_driver"),
        ("ros1-bz2", "livox_ros_driver2"),
        ("mcap-chunk", "livox_ros_driver2"),
        ("sqlite3", "livox_ros_driver2"),
        ("mcap", "livox_interfaces"),
    ],
)
@pytest.mark.parametrize("frame", ["livox_frame", "livox", ""])
def test_custom_messages_are_read(tmp_path: Path, kind: str, package: str, frame: str) -> None:
    def stream(messages: Messages) -> Any:
        for k, points in enumerate((POINTS, POINTS[:1], POINTS[:0])):
            stamp = START + 100 * k * MS
            yield "/livox/lidar", stamp + MS, custom(messages, package, stamp, points, frame)

    path = write(tmp_path, "run", kind, stream)
    with open_recording(path) as recording:
        clouds = [message for _, message in recording.messages(["/livox/lidar"])]
        assert recording.problems == []
    assert [len(cloud.records) for cloud in clouds] == [301, 1, 0]
    first = clouds[0]
    assert isinstance(first, Cloud)
    assert (first.stamp_ns, first.bag_stamp_ns, first.frame_id) == (START, START + MS, frame)
    assert first.organised is None
    for name in POINTS.dtype.names:
        np.testing.assert_array_equal(first.records[name], POINTS[name])
    points = xyz(first)
    assert np.isnan(points[7]).all()
    assert np.isfinite(np.delete(points, 7, axis=0)).all()
    assert intensity_field(first) == "reflectivity"
    assert ring_field(first) is None, "a Livox's line is no ring"
    time = time_field(first)
    assert (time.name, time.unit, time.absolute) == ("offset_time", "ns", False)
    assert time.seconds(first.records).max() == pytest.approx(0.099)


def test_the_drivers_point_clouds_are_read(tmp_path: Path) -> None:
    """Both drivers can publish PointCloud2: the second one's has absolute times as doubles."""
    kinds = [("x", "f4"), ("y", "f4"), ("z", "f4"), ("intensity", "f4"), ("tag", "u1")]
    kinds += [("line", "u1"), ("timestamp", "f8")]
    second = np.zeros(len(POINTS), kinds)
    for name in ("x", "y", "z", "tag", "line"):
        second[name] = POINTS[name]
    second["intensity"] = POINTS["reflectivity"]
    second["timestamp"] = START + POINTS["offset_time"].astype(float)
    first = second[[name for name in second.dtype.names if name != "timestamp"]]
    first = np.array(first.tolist(), kinds[:-1])

    def stream(messages: Messages) -> Any:
        yield "/livox/lidar", START, messages.cloud(START, second)
        yield "/livox/first", START, messages.cloud(START, first)

    with open_recording(write(tmp_path, "run", "mcap", stream)) as recording:
        clouds = dict(recording.messages())
    time = time_field(clouds["/livox/lidar"])
    assert (time.name, time.unit, time.absolute) == ("timestamp", "ns", True)
    assert time.seconds(clouds["/livox/lidar"].records).max() == pytest.approx(0.099, abs=1e-6)
    for cloud in clouds.values():
        assert fields.is_livox(cloud.records.dtype)
        assert intensity_field(cloud) == "intensity"
    assert time_field(clouds["/livox/first"]) is None


def test_damaged_custom_messages_are_named() -> None:
    messages = Messages(ros1=False)
    message = custom(messages, "livox_ros_driver2", START, POINTS, "livox")
    raw = memoryview(bytes(messages.types.serialize_cdr(message, message.__msgtype__)))
    assert len(read_custom(raw, "cdr", 0, 0).records) == 301
    for length in (len(raw) - 1, 200, 30, 12, 3):
        with pytest.raises(MessageError, match=f"not a Livox CustomMsg of {length} bytes"):
            read_custom(raw[:length], "cdr", 0, 0)
    one = Messages(ros1=True)
    message = custom(one, "livox_ros_driver", START, POINTS, "livox")
    raw = memoryview(bytes(one.types.serialize_ros1(message, message.__msgtype__)))
    for length in (len(raw) - 1, 40, 10):
        with pytest.raises(MessageError, match="the message is damaged"):
            read_custom(raw[:length], "ros1", 0, 0)


def test_info_takes_them_as_the_lidar(tmp_path: Path) -> None:
    def stream(messages: Messages) -> Any:
        pixels = np.zeros((48, 64), np.uint8)
        for k in range(3):
            stamp = START + 100 * k * MS
            yield "/livox/lidar", stamp, custom(messages, "livox_ros_driver", stamp, POINTS, "l")
            yield "/camera/image", stamp, messages.image(stamp, pixels, "mono8")
            yield "/camera/camera_info", stamp, messages.camera_info(stamp, 64, 48)

    path = write(tmp_path, "run", "ros1", stream)
    summary = summarise(path)
    roles = {topic.name: topic.role for topic in summary.topics}
    assert roles["/livox/lidar"] == "lidar"
    text = "\n".join(summary.lines())
    assert "livox_ros_driver/CustomMsg" in text
    assert "intensity reflectivity, ring none" in text
    assert "time offset_time in ns" in text
    assert "a Livox: no two of its scans are alike" in text
    assert "integration: static" in summary.rig_yaml
    rig = Rig.from_dict(yaml.safe_load(summary.rig_yaml))
    assert rig.integration.mode == "static"
    again = "\n".join(summarise(path, rig).lines())
    assert "build would take 1 pair of 3 scans merged, at 1 of 1 pose" in again
