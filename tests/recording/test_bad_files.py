"""Damaged recordings: what is good is read, and one line says what is not."""

from __future__ import annotations

import shutil
import sqlite3
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.writer import CompressionType, IndexType
from mcap.writer import Writer as McapWriter

from lcdata.errors import LcdataError, RecordingError
from lcdata.recording.source import open_recording

from .bags import FORMATS, START, Messages, arm_stream, write

RNG = np.random.default_rng(1)
Found = list[tuple[str, int, bytes]]


def big_stream(m: Messages):
    """Clouds of 1 MB: several chunks, and several pages of a database."""
    rng = np.random.default_rng(0)
    for i in range(12):
        records = np.zeros(25_000, [(n, "f4") for n in ("x", "y", "z", "intensity")])
        records["x"] = rng.normal(size=25_000)
        stamp = START + i * 100_000_000
        yield "/joint_states", stamp, m.joints(stamp, ["a"], [0.5])
        yield "/lidar/points", stamp, m.cloud(stamp, records)


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("whole")
    return {kind: write(folder, kind.replace("-", "_"), kind, big_stream) for kind in FORMATS}


def stored(path: Path) -> Path:
    """The file that holds the messages."""
    return path if path.is_file() else next(f for f in path.iterdir() if f.suffix != ".yaml")


def copied(path: Path, folder: Path) -> Path:
    target = folder / path.name
    return Path(shutil.copytree(path, target) if path.is_dir() else shutil.copy(path, target))


def read(path: Path) -> tuple[Found, list[str]]:
    with open_recording(path) as recording:
        counted = sum(info.count for info in recording.topics.values())
        found = [(t, bag, bytes(raw)) for t, _, bag, raw in recording.serialised()]
        assert len(found) <= counted
        return found, recording.problems


@pytest.mark.parametrize("fraction", [0.3, 0.6, 0.98])
@pytest.mark.parametrize("kind", FORMATS)
def test_a_file_that_was_cut_off(
    whole: dict[str, Path], tmp_path: Path, kind: str, fraction: float
) -> None:
    path = copied(whole[kind], tmp_path)
    file = stored(path)
    content = file.read_bytes()
    file.write_bytes(content[: int(len(content) * fraction)])
    everything, _ = read(whole[kind])
    found, problems = read(path)
    assert set(found) <= set(everything)
    assert len(found) >= fraction * len(everything) - 7  # at most a chunk, of three clouds here
    assert len(problems) == 1
    assert file.name in problems[0] and "cut off" in problems[0]
    assert f"the {len(found)} messages before are read" in problems[0]


@pytest.mark.parametrize("kind", FORMATS)
def test_a_file_of_zero_length(whole: dict[str, Path], tmp_path: Path, kind: str) -> None:
    path = copied(whole[kind], tmp_path)
    stored(path).write_bytes(b"")
    with pytest.raises(RecordingError, match="is empty \\(0 bytes\\)"):
        open_recording(path)


@pytest.mark.parametrize("suffix", [".bag", ".mcap", ".db3", ".mcap.zstd"])
def test_a_file_that_is_something_else(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"letter{suffix}"
    path.write_text("Dear recorder,\n" * 100)
    with pytest.raises(RecordingError, match=r"letter.*: copy"):
        open_recording(path)


@pytest.mark.parametrize("kind", ["ros1-bz2", "ros1-lz4"])
def test_a_damaged_chunk_costs_only_its_own_messages(
    whole: dict[str, Path], tmp_path: Path, kind: str
) -> None:
    path = copied(whole[kind], tmp_path)
    content = bytearray(stored(path).read_bytes())
    middle = len(content) // 2
    content[middle : middle + 64] = RNG.bytes(64)
    stored(path).write_bytes(content)
    everything, _ = read(whole[kind])
    found, problems = read(path)
    assert len(everything) - 6 <= len(found) < len(everything)
    assert len(problems) == 1 and "chunks are damaged (the first at byte" in problems[0]


@pytest.mark.parametrize("compression", CompressionType)
def test_a_checksum_finds_a_damaged_chunk(tmp_path: Path, compression: CompressionType) -> None:
    m = Messages(ros1=False)
    path = tmp_path / "run.mcap"
    with path.open("wb") as file:
        writer = McapWriter(file, compression=compression, chunk_size=1000)
        writer.start(profile="ros2", library="rosbag2")
        schema = writer.register_schema("sensor_msgs/msg/JointState", "ros2msg", b"")
        joints = writer.register_channel("/joint_states", "cdr", schema)
        for i in range(100):
            message = m.joints(START + i, ["a", "b"], RNG.normal(size=2))
            data = bytes(m.types.serialize_cdr(message, message.__msgtype__))
            writer.add_message(joints, START + i, data, START)
        writer.finish()
    everything, _ = read(path)
    with path.open("rb") as file:
        chunk = make_reader(file).get_summary().chunk_indexes[1]
    content = bytearray(path.read_bytes())
    content[chunk.chunk_start_offset + 2 * chunk.chunk_length // 3] ^= 0x5A
    path.write_bytes(content)
    found, problems = read(path)
    assert 80 < len(found) < len(everything) == 100
    assert set(found) < set(everything)
    assert len(problems) == 1 and "1 of " in problems[0] and "chunks are damaged" in problems[0]


def test_a_stamp_before_1970_is_damage(small: dict[str, bytes], tmp_path: Path) -> None:
    content = bytearray(small["mcap"])
    at = content.find((1_700_000_000).to_bytes(4, "little"))
    content[at : at + 4] = b"\x00\x00\x00\x80"
    path = tmp_path / "bad.mcap"
    path.write_bytes(content)
    found, problems = read(path)
    assert found
    assert any("before 1970" in problem for problem in problems), problems


@settings(max_examples=40, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.sampled_from(["ros1", "ros1-bz2", "sqlite3", "mcap", "mcap-chunk"]), st.data())
def test_no_damage_crashes_the_reader(
    small: dict[str, bytes], tmp_path: Path, kind: str, data: st.DataObject
) -> None:
    content = bytearray(small[kind])
    for _ in range(data.draw(st.integers(1, 5))):
        start = data.draw(st.integers(0, len(content) - 1))
        patch = data.draw(st.binary(min_size=1, max_size=16))
        content[start : start + len(patch)] = patch
    path = tmp_path / f"bad{'.bag' if 'ros1' in kind else '.db3' if 'sql' in kind else '.mcap'}"
    path.write_bytes(content)
    try:
        with open_recording(path) as recording:
            for _, message in recording.messages():
                assert message.stamp_ns >= 0
    except LcdataError as error:
        assert str(path) in str(error)


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    folder = tmp_path_factory.mktemp("small")
    stream = arm_stream(poses=1, dwell_s=0.2)
    paths = {kind: write(folder, kind.replace("-", "_"), kind, stream) for kind in FORMATS}
    return {kind: stored(path).read_bytes() for kind, path in paths.items()}


def test_a_ros1_recorder_that_was_killed(whole: dict[str, Path], tmp_path: Path) -> None:
    path = tmp_path / "killed.bag.active"
    content = whole["ros1"].read_bytes()
    place = content.index(b"index_pos=") + len(b"index_pos=")
    path.write_bytes(content[:place] + bytes(8) + content[place + 8 :])
    found, problems = read(path)
    assert found == read(whole["ros1"])[0]
    assert "no usable index (its recorder was killed before it wrote the index)" in problems[0]


def test_a_folder_without_one_of_its_files_or_its_metadata(
    whole: dict[str, Path], tmp_path: Path
) -> None:
    path = copied(whole["mcap"], tmp_path)
    metadata = path / "metadata.yaml"
    text = metadata.read_text()
    name = stored(path).name
    metadata.write_text(text.replace(f"- {name}", f"- {name}\n  - more_1.mcap", 1))
    found, problems = read(path)
    assert found == read(whole["mcap"])[0]
    assert problems == [f"{path}: its file more_1.mcap is missing: copy it again"]
    metadata.write_text("{")
    assert read(path) == (found, [])


def test_a_split_recording_is_read_in_order(whole: dict[str, Path], tmp_path: Path) -> None:
    path = copied(whole["mcap"], tmp_path)
    first = stored(path)
    for number in (2, 10):
        shutil.copy(first, first.with_name(f"{first.stem}_{number}.mcap"))
    found, _ = read(path)
    assert found == read(whole["mcap"])[0] * 3


def test_a_database_with_messages_in_its_log(whole: dict[str, Path], tmp_path: Path) -> None:
    path = copied(whole["sqlite3"], tmp_path)
    file = stored(path)
    file.with_name(f"{file.name}-wal").write_bytes(b"pages")
    found, problems = read(path)
    assert found == read(whole["sqlite3"])[0]
    assert "PRAGMA wal_checkpoint" in problems[0]


def test_a_database_without_messages(tmp_path: Path) -> None:
    path = tmp_path / "none.db3"
    with sqlite3.connect(path) as connection:
        connection.execute("CREATE TABLE other (id INTEGER)")
    with pytest.raises(RecordingError, match="no such table"):
        open_recording(path)


@pytest.mark.parametrize("chunked", [False, True])
@pytest.mark.parametrize("indexed", [False, True])
def test_mcap_of_other_writers(tmp_path: Path, chunked: bool, indexed: bool) -> None:
    m = Messages(ros1=True)
    path = tmp_path / "foreign.mcap"
    with path.open("wb") as file:
        writer = McapWriter(
            file,
            compression=CompressionType.LZ4,
            use_chunking=chunked,
            index_types=IndexType.ALL if indexed else IndexType.NONE,
        )
        writer.start(profile="", library="a converter")
        schema = writer.register_schema("sensor_msgs/JointState", "ros1msg", b"")
        joints = writer.register_channel("/joint_states", "ros1", schema)
        proto = writer.register_schema("foxglove.PointCloud", "protobuf", b"")
        cloud = writer.register_channel("/points", "protobuf", proto)
        for i in range(5):
            message = m.joints(START + i, ["a", "b"], [1.0, 2.0 + i])
            data = bytes(m.types.serialize_ros1(message, message.__msgtype__))
            writer.add_message(joints, START + 10 + i, data, START)
            writer.add_message(cloud, START + 10 + i, b"protobuf", START)
        writer.finish()
    with open_recording(path) as recording:
        assert recording.topics["/points"].encoding == "protobuf"
        assert recording.topics["/joint_states"].type == "sensor_msgs/msg/JointState"
        found = [message for _, message in recording.messages()]
        assert [m.positions[1] for m in found] == [2.0, 3, 4, 5, 6]
        assert [m.stamp_ns for m in found] == [START + i for i in range(5)]
        assert not any("damaged" in problem for problem in recording.problems)


def test_messages_that_cannot_be_read_are_counted(tmp_path: Path) -> None:
    def stream(m: Messages):
        for i in range(4):
            good = np.zeros(3, [(n, "<f4") for n in "xyz"])
            cloud = m.cloud(START + i, good)
            if i % 2:
                cloud.data = cloud.data[:10]
            yield "/lidar/points", START + i, cloud
            joints = m.joints(START + i, ["a", "b"], [1.0] * (1 + i % 2))
            yield "/joint_states", START + i, joints

    with open_recording(write(tmp_path, "run", "mcap", stream)) as recording:
        found = [(topic, message.stamp_ns - START) for topic, message in recording.messages()]
        assert sorted(found) == [
            ("/joint_states", 1),
            ("/joint_states", 3),
            ("/lidar/points", 0),
            ("/lidar/points", 2),
        ]
        assert sorted(recording.problems) == [
            f"{recording.path}: topic /joint_states: 2 messages cannot be read: joint state with "
            "2 names and 1 positions",
            f"{recording.path}: topic /lidar/points: 2 messages cannot be read: cloud of 1x3 "
            "points of 12 bytes has 10 bytes instead of 36: the message is damaged or its driver "
            "is wrong",
        ]
