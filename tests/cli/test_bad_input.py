"""Bad input as a user gives it: one clear line, an exit code, and what was good is kept."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from dataset import runs

from .conftest import Lcdata

Change = Callable[[str, int, Any], Any]


def on(topic: str, change: Callable[[int, Any], Any]) -> Change:
    return lambda name, number, message: change(number, message) if name == topic else message


def without_z(number: int, message: Any) -> Any:
    return replace(message, fields=[f for f in message.fields if f.name != "z"])


def cut(number: int, message: Any) -> Any:
    return replace(message, data=message.data[: len(message.data) // 3])


BAD: dict[str, tuple[Change, list[str]]] = {
    "foreign_joints": (
        on("/joint_states", lambda _, m: replace(m, name=[f"a{i}" for i in range(6)])),
        ["/joint_states: joint states lack joint_1", "they have a0, a1"],
    ),
    "nan_joints": (
        on("/joint_states", lambda _, m: replace(m, position=m.position * float("nan"))),
        ["no dwell: none of the", "joint states has finite positions"],
    ),
    "clouds_without_z": (
        on("/points", without_z),
        ["/points", "cloud without x, y, z", "topics.lidar"],
    ),
    "cut_images": (
        on("/image/compressed", cut),
        ["/image/compressed", "compressed image (jpeg) is cut off"],
    ),
}


def only_line(result: subprocess.CompletedProcess[str], code: int) -> str:
    assert result.returncode == code, result.stderr
    assert "Traceback" not in result.stderr
    (line,) = result.stderr.splitlines()
    return line


def test_each_bad_recording_has_one_line_and_the_good_one_is_kept(
    lcdata: Lcdata, tmp_path: Path
) -> None:
    one_cut = on("/image/compressed", lambda number, m: cut(number, m) if number == 5 else m)
    streams = {name: runs.run(change=change) for name, (change, _) in BAD.items()}
    streams["good"] = runs.run(change=one_cut)
    source = runs.recordings(tmp_path / "in", **streams)
    result = lcdata("build", source, "-o", tmp_path / "out", "--no-calibrate")
    assert result.returncode == 3, result.stderr
    lines = result.stderr.splitlines()
    expected = {name: words for name, (_, words) in BAD.items()}
    expected["good"] = ["good/pose_000/", "/image/compressed: compressed image (jpeg) is cut off"]
    assert len(lines) == len(expected), lines
    for name, words in expected.items():
        (line,) = [line for line in lines if f"{source / name}:" in line]
        assert all(word in line for word in words), line
    assert [path.name for path in (tmp_path / "out").iterdir() if path.is_dir()] == ["good"]
    assert lcdata("validate", tmp_path / "out").returncode == 0


@pytest.mark.skipif(sys.platform != "linux", reason="other systems refuse such a name themselves")
def test_names_of_any_kind(lcdata: Lcdata, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    source = runs.recordings(tmp_path / "ünï 日本", run=runs.run())
    monkeypatch.setenv("PYTHONIOENCODING", "ascii")
    shown = lcdata("info", source)
    assert shown.returncode == 0, shown.stderr
    (source / os.fsdecode(b"bad\xff.mcap")).write_bytes(b"x")
    line = only_line(lcdata("build", source, "-o", tmp_path / "out"), 1)
    assert "its name is not UTF-8: rename it" in line


def test_what_is_no_recording_data_set_or_method(lcdata: Lcdata, tmp_path: Path) -> None:
    assert "neither a file nor a folder" in only_line(lcdata("info", os.devnull), 1)
    assert "is no data set" in only_line(lcdata("validate", tmp_path), 1)
    line = only_line(lcdata("build", tmp_path, "-o", tmp_path / "out", "--methods", ","), 1)
    assert "no methods to run" in line
