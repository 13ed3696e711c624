from __future__ import annotations

import tracemalloc
from pathlib import Path

import numpy as np
import pytest

from lcdata.arm import Arm
from lcdata.recording.dwells import find_dwells
from lcdata.recording.plan import plan_poses, stream_pairs
from lcdata.recording.source import open_recording
from lcdata.recording.survey import survey
from lcdata.recording.topics import choose_topics
from lcdata.rig import Dwells

from .bags import FORMATS, MS, OUSTER, START, Messages, Stream, arm_stream, ouster_cloud, write


@pytest.mark.parametrize("kind", FORMATS)
def test_a_run_of_the_arm_in_every_format(tmp_path: Path, kind: str) -> None:
    path = write(tmp_path, "run", kind, arm_stream())
    with open_recording(path) as recording:
        topics = choose_topics(recording)
        assert topics.joint_states == "/joint_states"
        read = survey(recording, topics, Arm.load("gen3_lite"))
        dwells = find_dwells(read.joint_ns, read.positions, Dwells())
        assert len(dwells) == 2
        poses = plan_poses("run", read, dwells, tolerance_ms=50, pairs_per_pose=3)
        pairs = list(stream_pairs(recording, topics, poses))
        assert [p.pair_id for p in pairs] == [
            f"run/pose_{p:03d}/{n:03d}" for p in range(2) for n in range(3)
        ]
        for pair in pairs:
            assert pair.image.stamp_ns - pair.cloud.stamp_ns == 7_000_000
            assert pair.cloud.bag_stamp_ns - pair.cloud.stamp_ns == 3_000_000
            assert pair.cloud.organised == (8, 16)
        assert recording.problems == []
        index = (pairs[0].cloud.stamp_ns - recording.start_ns) // 10_000_000
        expected = ouster_cloud(int(index))
        assert pairs[0].cloud.records.dtype.itemsize == 30  # without the layout's padding
        for name in expected.dtype.names:
            np.testing.assert_array_equal(pairs[0].cloud.records[name], expected[name])


@pytest.mark.parametrize("kind", ["ros1-lz4", "sqlite3", "mcap-chunk"])
def test_memory_does_not_grow_with_the_recording(tmp_path: Path, kind: str) -> None:
    def stream(m: Messages) -> Stream:
        records = np.zeros(20_000, OUSTER)  # 1 MB a cloud
        records["x"] = 1
        yield "/camera_info", START, m.camera_info(START, 32, 24)
        for i in range(60):
            stamp = START + i * 100 * MS
            yield "/points", stamp, m.cloud(stamp, records, height=8)
            yield "/image", stamp, m.image(stamp, np.zeros((24, 32), np.uint8), "mono8")

    with open_recording(write(tmp_path, "road", kind, stream)) as recording:
        topics = choose_topics(recording)
        tracemalloc.start()
        read = survey(recording, topics)
        poses = plan_poses("road", read, None, tolerance_ms=50)
        assert sum(1 for _ in stream_pairs(recording, topics, poses)) == 60
        _, peak = tracemalloc.get_traced_memory()
        tracemalloc.stop()
    assert peak < 15e6


def test_a_damaged_cloud_does_not_keep_its_image_waiting(tmp_path: Path) -> None:
    def stream(m: Messages) -> Stream:
        yield "/camera_info", START, m.camera_info(START, 32, 24)
        for i in range(4):
            stamp = START + i * 100 * MS
            cloud = m.cloud(stamp, ouster_cloud(i))
            if i == 2:
                cloud.data = cloud.data[:99]
            yield "/points", stamp, cloud
            yield "/image", stamp, m.image(stamp, np.zeros((24, 32), np.uint8), "mono8")

    with open_recording(write(tmp_path, "road", "mcap", stream)) as recording:
        topics = choose_topics(recording)
        poses = plan_poses("road", survey(recording, topics), None, tolerance_ms=50)
        pairs = [pair.pair_id for pair in stream_pairs(recording, topics, poses)]
        assert pairs == [f"road/pose_000/00{n}" for n in (0, 1, 3)]
        (problem,) = recording.problems
        assert problem.startswith(f"{recording.path}: topic /points: 1 message cannot be read")
        wanted = stream_pairs(recording, topics, poses, skip={"road/pose_000/001"})
        assert [pair.number for pair in wanted] == [0, 3]
