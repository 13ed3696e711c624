"""Hand-eye refinement from recording to refined ground truth, on simulated recordings.

    python benchmarks/handeye_recording.py WORK --poses 15

Simulates, builds and calibrates one recording for each scenario and seed into WORK (what is there
already is used again; some minutes each), then refines both links from the stored estimates and
from the lines of all poses, and holds the extrinsics against truth.json. True mounts are off the
rig's by its standard deviations. Encoders are off by 0.02 deg a joint anew at each pose, which no
refinement of the links can take out: about 0.03 deg and 0.5 mm.
"""

from __future__ import annotations

import argparse
import json
import os
import time
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

from lcdata.dataset import Dataset, build
from lcdata.evaluation import run_trials
from lcdata.evaluation.handeye import refine
from lcdata.geometry import se3
from lcdata.simulation import simulate

RECORDINGS = (
    ("gym", 3),
    ("yard", 4),
    ("gym", 5),
    ("parking_lot", 6),
    ("gym+yard+parking_lot", 7),
    ("gym+yard+parking_lot", 8),
)


def errors(T, true):
    """Median (mm, deg)."""
    each = [
        (1e3 * se3.translation_error(a, b), np.rad2deg(se3.rotation_error(a, b)))
        for a, b in zip(T, true, strict=True)
    ]
    return np.median(each, axis=0)


def normalised(T, true, covariances):
    """Mean squared error in the covariances that were predicted; 1 is right."""
    twists = [se3.log(b @ se3.inverse(a)) for a, b in zip(T, true, strict=True)]
    return np.mean(
        [x @ np.linalg.solve(C, x) / 6 for x, C in zip(twists, covariances, strict=True)]
    )


def prepare(folder, scenario, seed, poses):
    """Simulate, build and calibrate, unless that was done already."""
    recordings, dataset = folder / "recordings", folder / "dataset"
    if not (dataset / "dataset.json").exists():
        simulate(
            recordings,
            scenario=scenario.split("+"),
            poses=poses // len(scenario.split("+")),
            pairs=1,
            seed=seed,
            azimuth_window_deg=140,
            force=True,
        )
        build(recordings, dataset, force=True)
    opened = Dataset.open(dataset)
    run_trials(opened, ["projection"], jobs=1)
    poses_true = json.loads((recordings / "truth.json").read_text())["poses"]
    return opened, np.array([poses_true[p.pose_id]["T_camera_lidar"] for p in opened.poses])


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("work", type=Path)
    parser.add_argument("--poses", type=int, default=15)
    options = parser.parse_args()
    table = []
    for scenario, seed in RECORDINGS:
        folder = options.work / f"{scenario}-{seed}-{options.poses}"
        dataset, true = prepare(folder, scenario, seed, options.poses)
        row = [errors([pose.T_camera_lidar for pose in dataset.poses], true)]
        line = f"{scenario:<20} seed {seed}: by hand {row[0][0]:5.1f} mm {row[0][1]:.3f} deg"
        for name, direct in (("estimates", False), ("direct", True)):
            started = time.process_time()
            found = refine(dataset, direct=direct)
            seconds = time.process_time() - started
            row.append(errors(found.extrinsics(), true))
            squared = normalised(found.extrinsics(), true, found.covariances())
            line += (
                f"; {name} {row[-1][0]:5.1f} mm {row[-1][1]:.3f} deg (normalised squared error "
                f"{squared:.2f}, {seconds:.1f} s)"
            )
        print(line, flush=True)
        table.append(row)
    mean = np.sqrt(np.square(table).mean(axis=0))
    for name, (mm, deg) in zip(("by hand", "estimates", "direct"), mean, strict=True):
        third = (mm <= mean[0, 0] / 3, deg <= mean[0, 1] / 3)
        aim = (mm <= 2.0, deg <= 0.05)
        print(
            f"{name:<10} RMS over recordings {mm:5.1f} mm {deg:.3f} deg; a third: "
            f"{third[0]}, {third[1]}; aim of 2 mm, 0.05 deg: {aim[0]}, {aim[1]}"
        )


if __name__ == "__main__":
    main()
