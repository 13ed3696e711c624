from __future__ import annotations

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

from .bags import FORMATS, arm_stream, ouster_cloud, write


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
