"""Offset between the clocks of arm and camera on simulated recordings whose clocks are known.

    python benchmarks/clock_offset.py WORK [--scans]

Recordings are simulated into WORK, where they are not there already: two poses, the way between
them filmed with 10 images a second; every other arm has joints whose zero points are 0.75 deg off,
as a real one, and a rig that says so. With --scans, recordings of 15 poses with three or four
single images of the moving arm are measured against the scans instead.
"""

from __future__ import annotations

import argparse
import json
import os
import time
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import cv2
import numpy as np

from lcdata.errors import GroundTruthError
from lcdata.evaluation.clock_offset import clock_offset, scan_offset
from lcdata.recording.source import find_recordings
from lcdata.rig import load_rig
from lcdata.simulation import simulate

cv2.setNumThreads(1)

RUNS = [
    ("gym", 41, 0.0, 0.0),
    ("yard", 42, 0.03, 0.75),
    ("parking_lot", 43, -0.06, 0.0),
    ("gym", 44, 0.12, 0.75),
    ("yard", 45, -0.25, 0.0),
    ("parking_lot", 46, 0.015, 0.75),
]
"""Scenario, seed, seconds added to the arm's clock, deviation of its joints' zero points (deg)."""

SCANS = [("gym", 3, 0.0), ("yard", 4, 0.03), ("gym", 5, 0.0), ("parking_lot", 6, 0.03)]


def simulated(folder: Path, **options) -> Path:
    if not (folder / "truth.json").exists():
        simulate(folder, **options)
    return find_recordings(folder)[0]


def motion_runs(work: Path):
    for scenario, seed, added, joints in RUNS:
        folder = work / f"clock-{scenario}-{seed}"
        yield (
            clock_offset,
            simulated(
                folder,
                scenario=scenario,
                seed=seed,
                poses=2,
                pairs=1,
                columns=512,
                azimuth_window_deg=60,
                width=640,
                height=360,
                clock_offset_s=added,
                motion_hz=10,
                joint_offset_std_deg=joints,
            ),
            f"{scenario} seed {seed}, joints off by {joints:g} deg",
        )


def scan_runs(work: Path):
    for scenario, seed, added in SCANS:
        path = simulated(
            work / f"clock-scans-{scenario}-{seed}",
            scenario=scenario,
            seed=seed,
            poses=15,
            pairs=1,
            azimuth_window_deg=140,
            clock_offset_s=added,
        )
        yield scan_offset, path, f"{scenario} seed {seed}"


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("work", type=Path)
    parser.add_argument("--scans", action="store_true")
    options = parser.parse_args()
    errors = []
    for measure, path, name in (scan_runs if options.scans else motion_runs)(options.work):
        truth = json.loads((path.parent / "truth.json").read_text())
        (true,) = truth["clock_offset_s"].values()
        rig, start = load_rig(path.parent / "rig.yaml"), time.process_time()
        try:
            found = measure(path, rig)
        except GroundTruthError as error:
            print(f"{name}: {1e3 * true:+.1f} ms true, not measured ({error})")
            continue
        errors.append((found.offset_s - true, found.std_s))
        print(
            f"{name}: {1e3 * true:+.1f} ms true, {found} from {found.moving} "
            f"({time.process_time() - start:.2f} s)",
            flush=True,
        )
    if errors:
        error, std = np.transpose(errors)
        print(
            f"RMS error {1e3 * np.sqrt(np.mean(error**2)):.2f} ms, mean square of error / std "
            f"{np.mean((error / std) ** 2):.2f}"
        )


if __name__ == "__main__":
    main()
