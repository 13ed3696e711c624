"""Hand-eye refinement from recording to refined ground truth, on simulated recordings.

    python benchmarks/handeye_recording.py WORK --poses 15
    python benchmarks/handeye_recording.py WORK --poses 15 --rigs 198

Simulates, builds and calibrates one recording for each scenario and seed into WORK (what is there
already is used again; some minutes each), then refines both links from the stored estimates and
from the lines of all poses, and holds the extrinsics against truth.json. True mounts are off the
rig's by its standard deviations. Encoders are off by 0.02 deg a joint anew at each pose, which no
refinement of the links can take out: about 0.03 deg and 0.5 mm.

--rigs draws that many hand measurements and encoder errors anew, shared out among the recordings,
whose estimates and lines stay: whether covariances are honest takes more rigs than can be rendered.
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
from lcdata.evaluation.handeye import (
    encoder_covariances,
    gather,
    hand_measured,
    refine,
    solve_estimates,
)
from lcdata.evaluation.handeye_direct import extract, solve_features
from lcdata.geometry import se3
from lcdata.groundtruth.handeye import Prior
from lcdata.groundtruth.handeye_problem import Problem
from lcdata.simulation import simulate

RECORDINGS = (
    ("gym", 3),
    ("yard", 4),
    ("gym", 5),
    ("parking_lot", 6),
    ("gym+yard+parking_lot", 7),
    ("gym+yard+parking_lot", 8),
)

NAMES = ("by hand", "estimates", "direct")


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


def redraw(dataset, truth, rigs, rng):
    """Squared error in predicted covariances, and errors, of rigs around one recording."""
    poses, arm = dataset.poses, dataset.load_arm()
    estimates, features = gather(dataset, poses, None, None), extract(dataset, poses)
    encoders = encoder_covariances(dataset, arm, poses)
    q = np.array([truth["poses"][pose.pose_id]["joint_positions"] for pose in poses])
    true = np.array([truth["poses"][pose.pose_id]["T_camera_lidar"] for pose in poses])
    X, Z = np.array(truth["T_camera_effector"]), np.array(truth["T_base_lidar"])
    measured = hand_measured(dataset)
    CX, CZ = measured.covariance_camera_effector, measured.covariance_base_lidar
    std = np.deg2rad(dataset.rig.arm.encoder_std_deg)
    rows = []
    for _ in range(rigs):
        A = se3.inverse(arm.chain().forward(q + rng.normal(size=q.shape) * std))
        by_hand = [
            se3.exp(rng.multivariate_normal(np.zeros(6), C)) @ T for C, T in ((CX, X), (CZ, Z))
        ]
        prior = Prior(*by_hand, CX, CZ)
        problem = Problem(A, A, prior)
        first = solve_estimates(A, estimates, prior, None, encoders)
        starts = (
            problem.start(first.T_camera_effector, first.T_base_lidar),
            problem.start(*by_hand),
        )
        row = [(*errors(by_hand[0] @ A @ by_hand[1], true), np.nan)]
        for found in (first, solve_features(features, problem, encoders, *starts)):
            T, covariances = found.extrinsic(A), found.extrinsic_covariance(A) + encoders
            row.append((*errors(T, true), normalised(T, true, covariances)))
        rows.append(row)
    return np.array(rows)


def many_rigs(work, poses, rigs):
    """Print what all the rigs of all the recordings come to."""
    rng, rows = np.random.default_rng(0), []
    for scenario, seed in RECORDINGS:
        folder = work / f"{scenario}-{seed}-{poses}"
        dataset, _ = prepare(folder, scenario, seed, poses)
        truth = json.loads((folder / "recordings/truth.json").read_text())
        rows.append(redraw(dataset, truth, rigs // len(RECORDINGS), rng))
        rms = np.sqrt(np.square(rows[-1]).mean(axis=0))
        print(
            f"{scenario:<20} seed {seed}: "
            + "; ".join(
                f"{name} {mm:.1f} mm {deg:.3f} deg"
                + (f" (normalised squared error {nees:.2f})" if np.isfinite(nees) else "")
                for name, (mm, deg, _), nees in zip(
                    NAMES, rms, rows[-1][..., 2].mean(axis=0), strict=True
                )
            ),
            flush=True,
        )
    rows = np.concatenate(rows)
    mm, deg = np.sqrt(np.square(rows[..., :2]).mean(axis=0)).T
    squared = rows[..., 2].mean(axis=0)
    for k, name in enumerate(NAMES):
        print(
            f"{name:<10} RMS over {len(rows)} rigs {mm[k]:5.1f} mm {deg[k]:.3f} deg, of the hand's "
            f"{mm[k] / mm[0]:.2f} and {deg[k] / deg[0]:.2f}"
            + (f"; mean normalised squared error {squared[k]:.2f}" if k else "")
        )


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("work", type=Path)
    parser.add_argument("--poses", type=int, default=15)
    parser.add_argument("--rigs", type=int, default=0)
    options = parser.parse_args()
    if options.rigs:
        many_rigs(options.work, options.poses, options.rigs)
        return
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
    for name, (mm, deg) in zip(NAMES, mean, strict=True):
        third = (mm <= mean[0, 0] / 3, deg <= mean[0, 1] / 3)
        aim = (mm <= 2.0, deg <= 0.05)
        print(
            f"{name:<10} RMS over recordings {mm:5.1f} mm {deg:.3f} deg; a third: "
            f"{third[0]}, {third[1]}; aim of 2 mm, 0.05 deg: {aim[0]}, {aim[1]}"
        )


if __name__ == "__main__":
    main()
