"""Simulated runs as bags, their rig, and builds in a process of their own."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from recording.bags import JOINTS, MS, OUSTER, START, Messages, write

import lcdata

RIG = """\
ground_truth: arm
simulated: true
T_camera_effector:
  translation_m: [0.01, -0.02, 0.05]
  rotation_rpy_deg: [-90, 0, -90]
  translation_std_m: 0.004
  rotation_std_deg: 0.3
T_base_lidar:
  translation_m: [0.1, 0.2, 0.3]
  rotation_rpy_deg: [0, 1, 90]
  translation_std_m: 0.004
  rotation_std_deg: 0.3
"""
STATIC = "ground_truth: static\n"
WIDTH, HEIGHT = 64, 48

Change = Callable[[str, int, Any], Any]
"""Topic, number of the message on it, message: the message to record, or None."""


def goals(poses: int) -> np.ndarray:
    """(poses, 6) joint positions of the dwells in radians."""
    return np.random.default_rng(1).uniform(-1, 1, (poses, 6))


def records(seed: int, rings: int, columns: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    result = np.zeros(rings * columns, OUSTER)
    for name in "xyz":
        result[name] = rng.normal(0, 5, len(result)).astype("f4")
        result[name][::7] = 0
    result["reflectivity"] = rng.integers(0, 60000, len(result))
    result["ring"] = np.repeat(np.arange(rings), columns)
    return result


def jpeg(seed: int, width: int = WIDTH, height: int = HEIGHT) -> bytes:
    pixels = np.random.default_rng(seed).integers(0, 255, (height, width, 3), np.uint8)
    return bytes(cv2.imencode(".jpg", pixels)[1])


def run(
    poses: int = 2,
    pairs: int = 4,
    shape: tuple[int, int] = (4, 32),
    change: Change | None = None,
    places: np.ndarray | None = None,
) -> Any:
    """A run of an arm: dwells with scans and JPEGs at 10 Hz, fast moves between them."""
    dwell_s, move_s = 0.1 * pairs + 0.8, 1.0
    leg = dwell_s + move_s

    def stream(m: Messages) -> Iterable[tuple[str, int, Any]]:
        q_of = goals(poses) if places is None else places
        yield "/camera_info", START, m.camera_info(START, WIDTH, HEIGHT)
        for i in range(round((poses * leg - move_s) * 100)):
            t, stamp = i / 100, START + i * 10 * MS
            pose = min(int(t // leg), poses - 1)
            share = np.clip((t - pose * leg - dwell_s) / move_s, 0, 1)
            q = q_of[pose] + share * (q_of[min(pose + 1, poses - 1)] - q_of[pose])
            yield "/joint_states", stamp, m.joints(stamp, JOINTS, q)
            if i % 10 == 0:
                taken = stamp + 7 * MS
                scan = m.cloud(stamp, records(i, *shape), height=shape[0])
                yield "/points", stamp + MS, scan
                yield "/image/compressed", taken + MS, m.compressed(taken, jpeg(i), "jpeg")

    return stream if change is None else changed(stream, change)


def still(pairs: int = 3, tf: bool = True) -> Any:
    """A recording without an arm."""

    def stream(m: Messages) -> Iterable[tuple[str, int, Any]]:
        yield "/camera_info", START, m.camera_info(START, WIDTH, HEIGHT)
        if tf:
            edge = [("camera", "lidar", (0.1, 0.2, 0.3), (0.5, -0.5, 0.5, 0.5))]
            yield "/tf_static", START, m.transforms(START, edge)
        for i in range(pairs):
            stamp = START + i * 100 * MS
            yield "/points", stamp, m.cloud(stamp, records(i, 1, 100))
            yield "/image/compressed", stamp, m.compressed(stamp, jpeg(i), "jpeg")

    return stream


def changed(stream: Any, change: Change) -> Any:
    def new(m: Messages) -> Iterable[tuple[str, int, Any]]:
        numbers: dict[str, int] = {}
        for topic, stamp, message in stream(m):
            number = numbers.get(topic, 0)
            numbers[topic] = number + 1
            kept = change(topic, number, message)
            if kept is not None:
                yield topic, stamp, kept

    return new


def recordings(folder: Path, rig: str = RIG, **streams: Any) -> Path:
    """A folder of MCAP recordings by name, with a rig."""
    folder.mkdir()
    (folder / "rig.yaml").write_text(rig)
    for name, stream in streams.items():
        write(folder, name, "mcap", stream)
    return folder


BUILD = """
import sys
from pathlib import Path
from lcdata.dataset import build
from lcdata.errors import LcdataError
{setup}
try:
    build(Path(sys.argv[1]), Path(sys.argv[2]))
except LcdataError as error:
    print(error)
    sys.exit(1)
"""


def start_build(source: Path, out: Path, setup: str = "") -> subprocess.Popen[str]:
    """Build in a process of its own."""
    return subprocess.Popen(
        [sys.executable, "-c", BUILD.format(setup=setup), str(source), str(out)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": str(Path(lcdata.__file__).parents[1])},
    )


def contents(folder: Path) -> dict[str, bytes]:
    """All files below a folder by relative name."""
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }
