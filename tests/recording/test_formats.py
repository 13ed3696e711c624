"""Every format and compression, as a folder and as a bare file, against rosbags' own reading."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from rosbags.highlevel import AnyReader

from lcdata.errors import RecordingError
from lcdata.recording.messages import CameraInfo, Cloud, Image, JointState, Transforms
from lcdata.recording.source import find_recordings, open_recording, scenario_name
from lcdata.recording.storage import HEAD

from .bags import FORMATS, START, arm_stream, ouster_cloud, write


@pytest.fixture(scope="module", params=FORMATS)
def recorded(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write(tmp_path_factory.mktemp("bags"), "run", request.param, arm_stream(dwell_s=0.5))


def read_all(path: Path) -> list[tuple[str, int, bytes]]:
    with open_recording(path) as recording:
        found = [(t, bag, bytes(raw)) for t, _, bag, raw in recording.serialised()]
        assert recording.problems == []
    return sorted(found)


def test_the_bytes_are_those_that_rosbags_reads(recorded: Path) -> None:
    with AnyReader([recorded]) as reader:
        expected = sorted((c.topic, stamp, bytes(raw)) for c, stamp, raw in reader.messages())
        counts = {topic: info.msgcount for topic, info in reader.topics.items()}
        times = reader.start_time, reader.end_time - 1
    assert read_all(recorded) == expected
    with open_recording(recorded) as recording:
        assert {name: info.count for name, info in recording.topics.items()} == counts
        assert (recording.start_ns, recording.end_ns) == times


def test_a_bare_storage_file_reads_like_its_folder(recorded: Path, tmp_path: Path) -> None:
    if recorded.is_file():
        bare = tmp_path / "run.bag"
        shutil.copy(recorded, bare)
    else:
        (stored,) = (file for file in recorded.iterdir() if file.suffix != ".yaml")
        bare = tmp_path / stored.name
        shutil.copy(stored, bare)
    assert scenario_name(bare) == "run"
    assert find_recordings(tmp_path) == [bare]
    assert read_all(bare) == read_all(recorded)


def test_heads_are_the_beginnings_of_the_messages(recorded: Path) -> None:
    big = ["/camera/image_raw", "/lidar/points"]
    with open_recording(recorded) as recording:
        whole = list(recording.serialised())
        cut = list(recording.serialised(heads=big))
    assert [m[:3] for m in cut] == [m[:3] for m in whole]
    for (topic, _, _, head), (_, _, _, full) in zip(cut, whole, strict=True):
        assert bytes(head) == bytes(full[: len(head)])
        assert len(head) == len(full) if topic not in big else len(head) >= HEAD


def test_messages_are_typed(recorded: Path) -> None:
    with open_recording(recorded) as recording:
        messages = list(recording.messages())
        kinds = {topic: type(message) for topic, message in messages}
        assert kinds == {
            "/camera/camera_info": CameraInfo,
            "/camera/image_raw": Image,
            "/joint_states": JointState,
            "/lidar/points": Cloud,
            "/tf_static": Transforms,
        }
        cloud = next(m for _, m in messages if isinstance(m, Cloud))
        assert (cloud.stamp_ns, cloud.bag_stamp_ns) == (START, START + 3_000_000)
        assert cloud.frame_id == "lidar"
        assert cloud.organised == (8, 16)
        assert (cloud.records["t"] == ouster_cloud(0)["t"]).all()
        joints = next(m for _, m in messages if isinstance(m, JointState))
        assert joints.names[0] == "joint_6" and joints.positions[-1] == 0.5
        transform = next(m for _, m in messages if isinstance(m, Transforms)).transforms[0]
        assert (transform.parent, transform.child) == ("tower", "lidar")
        assert transform.T_parent_child[:3, 3].tolist() == [0.1, 0.2, 0.3]
        info = next(m for _, m in messages if isinstance(m, CameraInfo))
        assert info.camera().intrinsics == (500, 500, 16, 12)


def test_the_recorder_s_stamps_on_request(recorded: Path) -> None:
    with open_recording(recorded, "bag") as recording:
        assert all(m.stamp_ns == m.bag_stamp_ns for _, m in recording.messages())


def test_only_wanted_messages_are_read(recorded: Path) -> None:
    with open_recording(recorded) as recording:
        wanted = START + 100_000_000
        found = list(recording.messages(["/lidar/points"], lambda _, stamp: stamp == wanted))
        assert [m.stamp_ns for _, m in found] == [wanted]


def test_finding_recordings(tmp_path: Path) -> None:
    stream = arm_stream(poses=1, dwell_s=0.1)
    one = write(tmp_path, "one", "mcap", stream)
    (tmp_path / "deeper").mkdir()
    two = write(tmp_path / "deeper", "two.v1", "ros1", stream)
    (tmp_path / "notes.txt").write_text("no recording")
    (tmp_path / ".hidden").mkdir()
    shutil.copy(two, tmp_path / ".hidden" / "three.bag")
    assert find_recordings(tmp_path) == sorted([one, two])
    assert find_recordings(one) == [one]
    assert [scenario_name(p) for p in (one, two)] == ["one", "two.v1"]
    shutil.copy(two, tmp_path / "two.v1.bag")
    with pytest.raises(RecordingError, match="have the same name: rename one"):
        find_recordings(tmp_path)


def test_no_recording(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("no recording")
    for path, message in (
        (tmp_path, "no recording in"),
        (tmp_path / "notes.txt", "is not a recording: give a ROS 2 folder, a folder with images"),
        (tmp_path / "missing.bag", "does not exist"),
    ):
        with pytest.raises(RecordingError, match=message):
            find_recordings(path)
