"""Accuracy and speed of the line methods on full-size simulated pairs, against exact truth.

    python benchmarks/line_calibration.py --seeds 1 2 3 --poses 5 --pairs 2

Every pair starts from 5 degrees and 0.5 m on each axis with random signs. Times are processor
time of one thread, features included, after the kernels are compiled. `wrong` counts results that
are called converged and are not a success; `sigmas` is the root mean square of the successes'
errors in predicted standard deviations over all six components, 2.4 if the covariance is right.
"""

from __future__ import annotations

import argparse
import itertools
import os
import time

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import cv2
import numpy as np

from lcdata.calibrators import create
from lcdata.geometry import se3
from lcdata.simulation import render_pair

SCENARIOS = ("gym", "parking_lot", "yard")
TARGETS = {"projection": (0.95, 0.1, 0.015), "plk": (0.90, 0.25, 0.04)}


def wrong_guess(T, rng, degrees, metres):
    """Errors of one size on each axis with random signs (PLK-Calib, section V-C)."""
    T = T.copy()
    twist = np.deg2rad(degrees) * rng.choice([-1.0, 1.0], 3)
    T[:3, :3] = se3.exp([0, 0, 0, *twist])[:3, :3] @ T[:3, :3]
    T[:3, 3] += metres * rng.choice([-1.0, 1.0], 3)
    return T


def trial(calibrator, pair, initial):
    started = time.process_time()
    result = calibrator.calibrate([pair], initial)
    seconds = time.process_time() - started
    T = pair.T_camera_lidar
    rotation = np.rad2deg(se3.rotation_error(result.T_camera_lidar, T))
    translation = se3.translation_error(result.T_camera_lidar, T)
    return {
        "degrees": rotation,
        "metres": translation,
        "success": rotation < 0.5 and translation < 0.1,
        "converged": result.converged,
        "sigmas": se3.sigma_distance(result.T_camera_lidar, T, result.covariance),
        "seconds": seconds,
        "message": result.message,
    }


def report(label, rows):
    def column(key):
        return np.array([row[key] for row in rows])

    success, converged, seconds = column("success"), column("converged"), column("seconds")
    squared = column("sigmas")[success] ** 2
    print(
        f"{label:24s} n {len(rows):3d}  success {success.mean():6.1%}  "
        f"median {np.median(column('degrees')):.3f} deg {np.median(column('metres')):.4f} m  "
        f"converged {converged.mean():6.1%}  wrong {int((converged & ~success).sum())}  "
        f"sigmas {np.sqrt(squared.mean()) if len(squared) else np.nan:.1f}  "
        f"seconds {np.median(seconds):.2f} (max {seconds.max():.2f})"
    )
    return success.mean(), np.median(column("degrees")), np.median(column("metres"))


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, nargs="+", default=[1, 2, 3])
    parser.add_argument("--scenarios", nargs="+", default=SCENARIOS)
    parser.add_argument("--poses", type=int, default=5)
    parser.add_argument("--pairs", type=int, default=2)
    parser.add_argument("--columns", type=int, default=2048)
    parser.add_argument("--rotation", type=float, default=5.0, help="degrees on each axis")
    parser.add_argument("--translation", type=float, default=0.5, help="metres on each axis")
    parser.add_argument("--methods", nargs="+", default=list(TARGETS))
    parser.add_argument(
        "--as-published", action="store_true", help="also Method II decoupled, shape edges only"
    )
    options = parser.parse_args()
    cv2.setNumThreads(1)
    rows = {}
    calibrators = {name: create(name) for name in options.methods}
    if options.as_published:
        calibrators["plk as published"] = create("plk", decoupled=True, paint=False)
    warm = False
    for seed, scenario in itertools.product(options.seeds, options.scenarios):
        for pose, index in itertools.product(range(options.poses), range(options.pairs)):
            pair = render_pair(
                scenario, pose_index=pose, pair_index=index, seed=seed, columns=options.columns
            )
            rng = np.random.default_rng([seed, SCENARIOS.index(scenario), pose, index])
            initial = wrong_guess(pair.T_camera_lidar, rng, options.rotation, options.translation)
            for name, calibrator in calibrators.items():
                if not warm:
                    calibrator.calibrate([pair], initial)
                    warm = True
                rows.setdefault((name, scenario), []).append(trial(calibrator, pair, initial))
    for (name, scenario), found in sorted(rows.items()):
        report(f"{name} {scenario}", found)
    for name in calibrators:
        everything = [row for (method, _), found in rows.items() if method == name for row in found]
        success, degrees, metres = report(f"{name} all", everything)
        if name in TARGETS:
            share, target_degrees, target_metres = TARGETS[name]
            reached = success >= share and degrees <= target_degrees and metres <= target_metres
            print(
                f"  target {share:.0%}, {target_degrees} deg, {target_metres} m: "
                f"{'reached' if reached else 'missed'}"
            )


if __name__ == "__main__":
    main()
