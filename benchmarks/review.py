"""Size, time and memory of the review of a large data set.

    python benchmarks/review.py                       # 600 pairs of 262,144 points
    python benchmarks/review.py --pairs 60 --keep /tmp/large

A few pairs are simulated (OS1-128, 1280x720); the data set is filled, by the package's own
writer, with copies of them that have noise of their own, and with results of two methods. It
takes about 5 MB a pair on the disk and is deleted afterwards unless `--keep` names its folder,
which is then used again. The review is written by a process of its own, whose peak of memory is
printed; processor time is that of all its threads.
"""

from __future__ import annotations

import argparse
import json
import platform
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import cv2
import numpy as np

SCENARIOS = ("gym", "parking_lot", "yard")
METHODS = ("projection", "plk")
PAIRS_PER_POSE = 10
POINT = np.dtype([(name, "<f4") for name in ("x", "y", "z", "intensity")] + [("ring", "<u2")])
LIMITS = {"seconds": 90.0, "megabytes": 400.0, "peak_mb": 1000.0}


def make(folder: Path, pairs: int, rendered: int) -> None:
    """Write a data set of copies of a few simulated pairs, and results of two methods."""
    from lcdata.dataset import Dataset, writer
    from lcdata.dataset.schema import DatasetInfo, PairRecord, PoseRecord, Scenario
    from lcdata.evaluation.results import results_path, write_run
    from lcdata.recording.messages import Cloud
    from lcdata.rig import Rig
    from lcdata.simulation import render_pair

    originals = [
        (name, render_pair(name, seed=50, pose_index=n))
        for name in SCENARIOS
        for n in range(rendered)
    ]
    records, poses = [], {}
    rng = np.random.default_rng(0)
    for number in range(pairs):
        scenario, original = originals[number // PAIRS_PER_POSE % len(originals)]
        pose_id = f"{scenario}/pose_{number // PAIRS_PER_POSE:03}"
        pair_id = f"{pose_id}/{number % PAIRS_PER_POSE:03}"
        stamp = 10**9 * (1 + number)
        poses.setdefault(pose_id, pose(PoseRecord, pose_id, original, stamp))
        rows, columns = original.organised
        cloud = np.zeros(rows * columns, POINT)
        noise = 1 + rng.normal(0, 5e-4, len(cloud)).astype("f4")
        for axis, name in enumerate("xyz"):
            cloud[name] = original.points[:, axis] * noise
        cloud["intensity"] = original.intensity
        cloud["ring"] = np.repeat(np.arange(rows), columns)
        name, digest, points = writer.write_cloud(
            folder, pair_id, Cloud(stamp, stamp, "lidar", cloud, rows, columns)
        )
        picture = cv2.cvtColor(original.image, cv2.COLOR_RGB2BGR)
        picture = cv2.add(picture, int(rng.integers(0, 12)))
        data = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, 92])[1].tobytes()
        image, image_digest = writer.write_image(folder, pair_id, data, ".jpg")
        records.append(
            PairRecord(
                pair_id=pair_id,
                scenario=scenario,
                pose_id=pose_id,
                stamp_lidar_ns=stamp,
                stamp_image_ns=stamp,
                dt_ns=0,
                image=image,
                cloud=name,
                image_sha256=image_digest,
                cloud_sha256=digest,
                points=points,
            )
        )
    info = DatasetInfo(
        rig=Rig.from_dict({"ground_truth": "static"}).to_dict(),
        arm=None,
        sources=(),
        scenarios={name: Scenario(pair.camera, {}) for name, pair in originals},
        simulated=True,
    )
    writer.write_index(folder, info, records, list(poses.values()))
    dataset = Dataset.open(folder)
    write_run(results_path(dataset, "5deg-0.5m-seed0"), trials(dataset))


def pose(kind, pose_id, pair, stamp):
    """Row of a pose, with the uncertainty of a good rig."""
    return kind(
        pose_id=pose_id,
        scenario=pose_id.partition("/")[0],
        start_ns=stamp,
        end_ns=stamp + 10**10,
        joint_positions=np.zeros(0),
        joint_positions_std=np.zeros(0),
        samples=0,
        T_camera_lidar=pair.T_camera_lidar,
        covariance=np.diag([0.003**2] * 3 + [0.0015**2] * 3),
        T_camera_effector=None,
        T_effector_base=None,
        T_base_lidar=None,
    )


def trials(dataset):
    """Made-up estimates: most are slightly off, every seventh is wrong, every 31st is none."""
    from dataclasses import replace

    from lcdata.calibrators.base import LineMatches
    from lcdata.evaluation.protocol import Protocol
    from lcdata.evaluation.results import TrialResult
    from lcdata.geometry import se3

    rng = np.random.default_rng(1)
    protocol = Protocol()
    for number, record in enumerate(dataset.pairs):
        truth = dataset.pose(record.pose_id)
        for k, method in enumerate(METHODS):
            size = 0.2 if (number + 3 * k) % 7 == 0 else 0.003
            T = se3.exp(rng.normal(0, size, 6) * [1, 1, 1, 0.2, 0.2, 0.2]) @ truth.T_camera_lidar
            ends = rng.uniform(-8, 8, (30, 2, 3)), rng.uniform(0, 700, (30, 2, 2))
            trial = TrialResult(
                run=protocol.run,
                method=method,
                method_version=1,
                parameters="{}",
                lcdata_version="0",
                pair_ids=(record.pair_id,),
                group="pair",
                scenario=record.scenario,
                pose_id=record.pose_id,
                trial=0,
                seed=0,
                init_rotation_deg=protocol.init_rotation_deg,
                init_translation_m=protocol.init_translation_m,
                T_camera_lidar_initial=protocol.initial_guess(
                    truth.T_camera_lidar, (record.pair_id,), 0
                ),
                groundtruth_version=truth.pose_version,
                T_camera_lidar_estimated=None if number % 31 == 0 else T,
                converged=size < 0.1,
                failed=number % 31 == 0,
                seconds=0.1,
                matches=LineMatches(*ends, np.zeros(30, np.int64)),
            )
            yield replace(trial).against(truth)


def measure(dataset: Path, out: Path, options: list[str]) -> dict[str, float]:
    """Write the review as the command does; seconds, processor seconds, MB and peak MB."""
    command = [sys.executable, "-m", "lcdata", "review", str(dataset), "--save", str(out)]
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    started = time.monotonic()
    subprocess.run([*command, *options], check=True, stdout=subprocess.DEVNULL)
    seconds = time.monotonic() - started
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu = sum(getattr(after, n) - getattr(before, n) for n in ("ru_utime", "ru_stime"))
    scale = 1e6 if sys.platform == "darwin" else 1e3
    return {
        "seconds": seconds,
        "processor_s": cpu,
        "megabytes": out.stat().st_size / 1e6,
        "peak_mb": after.ru_maxrss / scale,  # the largest of all children so far
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--pairs", type=int, default=600)
    parser.add_argument("--rendered", type=int, default=2, help="simulated pairs a scenario")
    parser.add_argument("--keep", type=Path, help="folder of the data set, used again if there")
    parser.add_argument("--json", action="store_true")
    options, passed = parser.parse_known_args()
    folder = options.keep or Path(tempfile.mkdtemp(prefix="lcdata-review-"))
    try:
        dataset = folder / "large"
        if not (dataset / "dataset.json").is_file():
            make(dataset, options.pairs, options.rendered)
        found = measure(dataset, folder / "review.rrd", passed)
    finally:
        if options.keep is None:
            shutil.rmtree(folder)
    if options.json:
        print(json.dumps(found))
        return
    print(f"{options.pairs} pairs, {platform.platform()}, Python {platform.python_version()}")
    for name, value in found.items():
        limit = f"  (limit {LIMITS[name]:g})" if name in LIMITS else ""
        print(f"  {name:12} {value:8.1f}{limit}")


if __name__ == "__main__":
    main()
