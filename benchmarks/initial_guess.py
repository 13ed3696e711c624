"""Initial guesses from nothing, on simulated pairs of four sensor combinations.

    python benchmarks/initial_guess.py --seeds 1 2 3 4 5

A hand-moved OS1-64 and a Livox Avia, with a pinhole and an equirectangular camera on an arm that
turns it about all axes: up to 0.8 m between them, no prior on the rotation. A success is within
1 deg and 0.5 m (Koide et al., section IV). `wrong` counts guesses that are called trustworthy and
are no success. Seconds are processor time of one thread, after the kernels are compiled.
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

from lcdata import Camera
from lcdata.calibrators.initial_guess import (
    SUCCESS_ROTATION_DEG,
    SUCCESS_TRANSLATION_M,
    guess,
)
from lcdata.geometry import se3
from lcdata.simulation import render_pair

SCENARIOS = ("parking_lot", "gym", "yard")
CAMERAS = {"pinhole": None, "omnidirectional": Camera("equirectangular", 2048, 1024)}
PAPER = {
    ("os1_64", "pinhole"): 12,
    ("avia", "pinhole"): 15,
    ("os1_64", "omnidirectional"): 15,
    ("avia", "omnidirectional"): 10,
}
TARGET = 13 / 15


def trial(pair, options):
    started = time.process_time()
    found = guess([pair], **options)
    seconds = time.process_time() - started
    truth = pair.T_camera_lidar
    degrees = np.rad2deg(se3.rotation_error(found.T_camera_lidar, truth))
    metres = se3.translation_error(found.T_camera_lidar, truth)
    success = degrees < SUCCESS_ROTATION_DEG and metres < SUCCESS_TRANSLATION_M
    return success, found.converged, degrees, metres, seconds, found


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, nargs="+", default=[1, 2, 3, 4, 5])
    parser.add_argument("--lidars", nargs="+", default=["os1_64", "avia"])
    parser.add_argument("--cameras", nargs="+", default=list(CAMERAS))
    parser.add_argument("--route", default="auto")
    parser.add_argument("--verbose", action="store_true")
    options = parser.parse_args()
    cv2.setNumThreads(1)
    rows = {}
    for seed, scenario in itertools.product(options.seeds, SCENARIOS):
        for lidar, camera in itertools.product(options.lidars, options.cameras):
            pair = render_pair(
                scenario,
                seed=seed,
                pose_index=seed,
                lidar=lidar,
                moving=lidar == "os1_64",
                camera=CAMERAS[camera],
            )
            row = trial(pair, {"route": options.route})
            rows.setdefault((lidar, camera), []).append(row)
            if options.verbose:
                success, trusted, degrees, metres, seconds, found = row
                print(
                    f"{lidar} {camera} {scenario} {seed}: {'ok' if success else 'FAILED'} "
                    f"{degrees:.2f} deg {metres:.3f} m, score {found.score:.1f} lead "
                    f"{found.lead:.2f} {'' if trusted else found.message} {seconds:.1f} s",
                    flush=True,
                )
    for (lidar, camera), found in rows.items():
        success, trusted, degrees, metres, seconds = (
            np.array([row[k] for row in found]) for k in range(5)
        )
        reached = "reached" if success.mean() >= TARGET else "missed"
        print(
            f"{lidar} and {camera}: success {success.sum()} of {len(found)} (paper "
            f"{PAPER[lidar, camera]} of 15; target {reached}), median {np.median(degrees):.2f} deg "
            f"{np.median(metres):.3f} m, trusted {trusted.sum()}, wrong "
            f"{(trusted & ~success).sum()}, seconds {np.median(seconds):.1f} (max "
            f"{seconds.max():.1f})"
        )


if __name__ == "__main__":
    main()
