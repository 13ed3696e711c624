"""Sensors whose clocks have nothing to do with each other."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from lcdata.dataset import build
from lcdata.errors import RecordingError
from lcdata.recording.source import find_recordings
from lcdata.recording.summary import summarise
from lcdata.rig import load_rig

from . import runs


def since_power_up(topic: str, number: int, message: Any) -> Any:
    """A LiDAR that was never told the time."""
    if topic == "/points":
        message.header.stamp.sec -= 1_699_999_000
    return message


@pytest.mark.parametrize(
    ("rig", "stream", "other"),
    [
        (runs.RIG, runs.run(change=since_power_up), "/joint_states"),
        (runs.STATIC, runs.changed(runs.still(), since_power_up), "/image"),
    ],
)
def test_a_clock_decades_off_is_named_with_difference_and_remedy(
    tmp_path: Path, rig: str, stream: Any, other: str
) -> None:
    source = runs.recordings(tmp_path / "in", rig, run=stream)
    words = (
        rf"no pair: the clock of /points is 53\.9 years \(1699999000\.0 s\) behind that of {other}"
    )
    with pytest.raises(RecordingError, match=words) as caught:
        build(source, tmp_path / "out")
    assert "set `stamps: bag` in the rig" in str(caught.value)
    summary = summarise(find_recordings(source)[0], load_rig(source / "rig.yaml"))
    assert any("53.9 years" in line for line in summary.obstacles)
    by_bag = runs.recordings(tmp_path / "bag", rig + "stamps: bag\n", run=stream)
    assert build(by_bag, tmp_path / "made").pairs
