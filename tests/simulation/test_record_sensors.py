"""Recordings of other sensors than the default ones, and of a frame that a hand moves."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from rosbags.highlevel import AnyReader

from lcdata.errors import SimulationError
from lcdata.geometry import se3
from lcdata.recording import fields
from lcdata.recording.messages import CameraInfo, Cloud
from lcdata.recording.source import open_recording
from lcdata.rig import load_rig
from lcdata.simulation import CAMERAS, simulate, simulate_hand_held
from lcdata.simulation.bag import CAMERA_INFO, FORMATS, LIDAR, LIVOX
from lcdata.simulation.camera import make_camera

TINY = {"poses": 1, "pairs": 1, "seed": 3, "width": 64, "height": 36}


@pytest.mark.parametrize("format", FORMATS)
@pytest.mark.parametrize("livox_message", ["custom", "pointcloud2"])
def test_an_avia_speaks_as_its_drivers_do(tmp_path: Path, format: str, livox_message: str) -> None:
    (path,) = simulate(
        tmp_path, scenario="yard", format=format, lidar="avia", livox_message=livox_message, **TINY
    )
    with open_recording(path) as recording:
        (cloud,) = (message for _, message in recording.messages([LIVOX]))
        assert recording.problems == []
        kind = recording.topics[LIVOX].type
    assert isinstance(cloud, Cloud)
    assert fields.is_livox(cloud.records.dtype)
    assert len(cloud.records) == 24_000
    assert cloud.frame_id == "livox_frame"
    time = fields.point_time(cloud.records)
    assert time is not None
    assert time.absolute == (livox_message == "pointcloud2")
    since = time.since(cloud.records, cloud.stamp_ns)
    assert since.min() == pytest.approx(0.0, abs=1e-3)
    assert since.max() == pytest.approx(0.1, abs=1e-3)
    assert fields.intensity_name(cloud.records.dtype) in ("reflectivity", "intensity")
    if livox_message == "custom":
        package = "livox_ros_driver" if format == "ros1" else "livox_ros_driver2"
        assert kind == f"{package}/msg/CustomMsg"
        with AnyReader([path]) as reader:
            (connection,) = (c for c in reader.connections if c.topic == LIVOX)
            (_, _, raw), *_ = reader.messages([connection])
            message = reader.deserialize(raw, connection.msgtype)
        assert message.point_num == len(message.points) == 24_000
        assert [p.x for p in message.points[:50]] == cloud.records["x"][:50].tolist()


@pytest.mark.parametrize("name", CAMERAS)
def test_a_recording_may_be_of_any_camera(tmp_path: Path, name: str) -> None:
    (path,) = simulate(tmp_path, scenario="yard", camera=name, lidar="os1_64", columns=512, **TINY)
    with open_recording(path) as recording:
        messages = dict(recording.messages())
    info = messages[CAMERA_INFO]
    assert isinstance(info, CameraInfo)
    camera = info.camera()
    assert camera == make_camera(name, 64, 36)
    image = next(m for t, m in messages.items() if t.endswith("compressed")).decode()
    assert image.shape == (camera.height, camera.width, 3)
    assert image.std() > 10
    cloud = messages[LIDAR]
    assert cloud.organised == (64, 512)


def test_a_hand_moves_both_sensors(tmp_path: Path) -> None:
    (path,) = simulate_hand_held(
        tmp_path, scenario="gym", seconds=0.5, seed=3, columns=512, width=64, height=36
    )
    rig, truth = load_rig(tmp_path / "rig.yaml"), json.loads((tmp_path / "truth.json").read_text())
    assert rig.simulated
    assert rig.ground_truth == "static"
    assert rig.integration.mode == "dynamic"
    off = se3.log(np.array(truth["T_camera_lidar"]) @ se3.inverse(rig.T_camera_lidar.T))
    sigma = np.sqrt(np.diag(rig.T_camera_lidar.covariance))
    assert (np.abs(off) > 0).all()
    assert (np.abs(off) < 4 * sigma).all()
    with open_recording(path) as recording:
        assert recording.topics[LIDAR].count == 5
        assert recording.topics[CAMERA_INFO].count == 1
    motion = np.array(truth["motions"]["gym"]["T_start_lidar"])
    np.testing.assert_allclose(motion[0], np.eye(4), atol=1e-12)
    assert np.linalg.norm(motion[-1, :3, 3]) > 0.02
    with pytest.raises(SimulationError, match="exists: give another folder, or --force"):
        simulate_hand_held(tmp_path, scenario="gym", seconds=0.5)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"lidar": "hdl_64"}, "unknown LiDAR 'hdl_64'"),
        ({"camera": "leica"}, "unknown camera 'leica': choose from zed2i, fisheye"),
        ({"livox_message": "xml"}, "unknown Livox message 'xml'"),
        ({"lidar": "avia", "columns": 512}, "an Avia has neither columns"),
    ],
)
def test_wrong_choices_of_sensors_are_named(
    tmp_path: Path, wrong: dict[str, object], message: str
) -> None:
    for write in (simulate, simulate_hand_held):
        with pytest.raises(SimulationError, match=message):
            write(tmp_path, **wrong)
    assert list(tmp_path.iterdir()) == []


def test_too_short_a_motion_is_named(tmp_path: Path) -> None:
    with pytest.raises(SimulationError, match=r"0\.01 s of motion"):
        simulate_hand_held(tmp_path, seconds=0.01)
