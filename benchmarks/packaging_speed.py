"""Packaging a recording: time against reading and writing its raw bytes, and peak memory.

    python benchmarks/packaging_speed.py [--format mcap ros1] [--gigabytes 1.5] [--folder /tmp]

Writes a simulated recording of full-size scans (128x2048 points in the Ouster driver's 48-byte
layout, JPEGs of 1280x720, joint states at 100 Hz) whose dwells cover nearly all of it: the hard
case, as nearly every byte ends in the data set. Then, each in a process of its own, on one core
unless `--cores` says otherwise:

    base     rosbags reads every raw message, and the bytes that the data set will hold are
             written to files, one a message, each forced to the disk
    package  `lcdata.dataset.build`

and prints package / base (to reach: 2 or less) and the peak memory of `package` (to reach: under
1.5 GB). The recording is in the page cache in both.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import shutil
import statistics
import subprocess
import sys
import time
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).parents[1]
RINGS, COLUMNS, WIDTH, HEIGHT = 128, 2048, 1280, 720
RIG = """\
ground_truth: arm
simulated: true
T_camera_effector: {translation_m: [0.01, -0.02, 0.05], rotation_rpy_deg: [-90, 0, -90]}
T_base_lidar: {translation_m: [0.1, 0.2, 0.3], rotation_rpy_deg: [0, 1, 90]}
"""


def record(folder: Path, kind: str, gigabytes: float) -> None:
    """Write the recording and its rig."""
    import cv2

    sys.path.insert(0, str(ROOT / "tests" / "recording"))
    from bags import JOINTS, MS, OUSTER, START, write

    rng = np.random.default_rng(0)
    scan = np.zeros(RINGS * COLUMNS, OUSTER)
    azimuth = np.tile(np.linspace(0, 2 * np.pi, COLUMNS, endpoint=False), RINGS)
    height = np.repeat(np.tan(np.deg2rad(np.linspace(22.5, -22.5, RINGS))), COLUMNS)
    distance = 10 + 3 * np.sin(5 * azimuth) + rng.normal(0, 0.02, len(scan))
    scan["x"], scan["y"] = distance * np.cos(azimuth), distance * np.sin(azimuth)
    scan["z"] = distance * height
    scan["intensity"] = rng.integers(0, 200, len(scan))
    scan["t"] = np.tile(np.arange(COLUMNS, dtype=np.uint32) * (100 * MS // COLUMNS), RINGS)
    scan["reflectivity"], scan["ring"] = scan["intensity"], np.repeat(np.arange(RINGS), COLUMNS)
    scan["range"] = (distance * 1000).astype(np.uint32)
    smooth = cv2.GaussianBlur(rng.normal(128, 200, (HEIGHT, WIDTH, 3)), (0, 0), 4)
    jpeg = cv2.imencode(".jpg", np.clip(smooth, 0, 255).astype(np.uint8))[1].tobytes()
    scans = round(gigabytes * 1e9 / scan.nbytes)
    dwell, move = 20.0, 0.5

    def stream(m: Any) -> Iterable[tuple[str, int, Any]]:
        yield "/camera_info", START, m.camera_info(START, WIDTH, HEIGHT)
        for i in range(10 * scans):
            t, stamp = i / 100, START + i * 10 * MS
            pose, since = divmod(t, dwell + move)
            share = np.clip((since - dwell) / move, 0, 1)
            a, b = (np.random.default_rng(int(pose) + k).uniform(-1, 1, 6) for k in (0, 1))
            yield "/joint_states", stamp, m.joints(stamp, JOINTS, a + share * (b - a))
            if i % 10 == 0:
                scan["intensity"] = np.roll(scan["intensity"], 1)
                yield "/points", stamp, m.cloud(stamp, scan, height=RINGS)
                yield "/image/compressed", stamp, m.compressed(stamp, jpeg, "jpeg")

    folder.mkdir()
    (folder / "rig.yaml").write_text(RIG)
    write(folder, "run", kind, stream)


def base(folder: Path, out: Path) -> None:
    """Read every raw message with rosbags; write the bytes of a data set of them."""
    from rosbags.rosbag1 import Reader as Reader1
    from rosbags.rosbag2 import Reader as Reader2

    sizes = [int(size) for size in (folder / "sizes.txt").read_text().split()]
    out.mkdir()
    bag = folder / "run.bag"
    content = os.urandom(max(sizes))
    with Reader1(bag) if bag.exists() else Reader2(folder / "run") as reader:
        for _ in reader.messages():
            if sizes:
                write_to_disk(out / f"{len(sizes)}", memoryview(content)[: sizes.pop()])
    assert not sizes


def write_to_disk(path: Path, data: memoryview) -> None:
    with path.open("wb", buffering=0) as file:
        file.write(data)
        os.fsync(file.fileno())


def package(folder: Path, out: Path) -> None:
    """What is measured."""
    from lcdata.dataset import build

    build(folder, out)


def measure(what: str, folder: Path, out: Path, cores: int) -> tuple[float, float]:
    """Seconds (imports left out) and peak memory in GB of a step in a process of its own."""
    shutil.rmtree(out, ignore_errors=True)
    os.sync()
    done = subprocess.run(
        [sys.executable, __file__, "--step", what, "--folder", str(folder), "--out", str(out)],
        check=True,
        stdout=subprocess.PIPE,
        preexec_fn=lambda: os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[:cores]),
    )
    result = json.loads(done.stdout)
    return result["seconds"], result["peak"]


def step(what: str, folder: Path, out: Path) -> None:
    import pinocchio
    import pyarrow.parquet
    import pypcd4
    import rosbags.rosbag1
    import rosbags.rosbag2

    import lcdata.dataset

    assert pinocchio and pyarrow and pypcd4 and rosbags and lcdata
    start = time.perf_counter()
    {"base": base, "package": package}[what](folder, out)
    seconds = time.perf_counter() - start
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e9
    print(json.dumps({"seconds": seconds, "peak": peak}))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    kinds = ["mcap", "mcap-chunk", "ros1", "sqlite3"]
    parser.add_argument("--format", nargs="+", default=kinds, dest="formats")
    parser.add_argument("--gigabytes", type=float, default=1.5)
    parser.add_argument("--cores", type=int, default=1)
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--folder", type=Path, default=Path("/tmp"))
    parser.add_argument("--step", help=argparse.SUPPRESS)
    parser.add_argument("--out", type=Path, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.step:
        step(options.step, options.folder, options.out)
        return
    work = options.folder / f"lcdata-packaging-{os.getpid()}"
    print("simulated recording, medians of", options.repeats, "runs on", options.cores, "core(s)")
    print(f"{'format':<12}{'raw GB':>8}{'pairs':>7}{'base s':>8}{'package s':>11}", end="")
    print(f"{'ratio':>7}{'peak GB':>9}")
    try:
        for kind in options.formats:
            work.mkdir()
            recording, out = work / "recordings", work / "out"
            record(recording, kind, options.gigabytes)
            measure("package", recording, out, options.cores)  # warm up, and learn the sizes
            files = [file for file in (out / "run").rglob("*") if file.is_file()]
            sizes = sorted(file.stat().st_size for file in files)
            (recording / "sizes.txt").write_text(" ".join(map(str, sizes)))
            runs = [
                (
                    measure("base", recording, out, options.cores)[0],
                    *measure("package", recording, out, options.cores),
                )
                for _ in range(options.repeats)
            ]
            base_s, package_s, _ = (statistics.median(column) for column in zip(*runs, strict=True))
            ratio = statistics.median(run[1] / run[0] for run in runs)
            raw = sum(f.stat().st_size for f in recording.rglob("*") if f.is_file()) / 1e9
            peak = max(run[2] for run in runs)
            line = f"{kind:<12}{raw:>8.2f}{len(files) // 2:>7}{base_s:>8.2f}{package_s:>11.2f}"
            print(f"{line}{ratio:>7.2f}{peak:>9.2f}", flush=True)
            shutil.rmtree(work)
    finally:
        shutil.rmtree(work, ignore_errors=True)


if __name__ == "__main__":
    main()
