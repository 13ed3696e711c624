"""How far off a guess may be for `wide`, on how many frames, and whether it knows.

    python benchmarks/wide.py                    # five frames from 1 deg / 0.1 m and 5 deg / 0.5 m
    python benchmarks/wide.py --frames 1 3 10    # other numbers of frames
    python benchmarks/wide.py --simulated gym    # pairs of one simulated rig in several scenes

Real frames are those of ../shared/data/kitti_road beside the checkout; where they are missing the
part is skipped, and said so. Five frames are the first and the last five of the ten; other numbers
are drawn by seed. Guesses are wrong by the given error on each axis with random signs. Times are
processor time of one thread, after the kernels are compiled: `prepare` of all frames, and the rest.
`wrong` counts results that are called converged and are not within 0.5 deg and 0.1 m; `sigmas` is
the root mean square of the errors in predicted standard deviations over all six components, 2.4 if
the covariance is right.
"""

from __future__ import annotations

import argparse
import os
import time

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import cv2
import numpy as np
from nid import SHARED, real_pair, there

from lcdata.calibrators import create
from lcdata.evaluation.protocol import perturb
from lcdata.geometry import se3

STARTS = {"1/0.1": (1.0, 0.1), "5/0.5": (5.0, 0.5), "10/1": (10.0, 1.0)}


def trial(calibrator, pairs, prepared, start, seed):
    """One joint estimate."""
    T = pairs[0].T_camera_lidar
    initial = perturb(T, *start, np.random.default_rng([seed, 6]))
    started = time.process_time()
    found = calibrator.calibrate(pairs, initial, prepared)
    return {
        "seconds": time.process_time() - started,
        "degrees": np.rad2deg(se3.rotation_error(found.T_camera_lidar, T)),
        "metres": se3.translation_error(found.T_camera_lidar, T),
        "converged": found.converged,
        "sigmas": se3.sigma_distance(found.T_camera_lidar, T, found.covariance),
        "message": found.message,
    }


def report(name, rows, preparation):
    """One line."""
    values = {key: np.array([row[key] for row in rows]) for key in rows[0]}
    success = (values["degrees"] < 0.5) & (values["metres"] < 0.1)
    wrong = int((values["converged"] & ~success).sum())
    sigmas = values["sigmas"].astype(float)
    sigmas = sigmas[success & np.isfinite(sigmas)]
    print(
        f"{name:34s} success {int(success.sum())} of {len(rows)}  "
        f"median {np.median(values['degrees']):.3f} deg {np.median(values['metres']):.4f} m  "
        f"worst {values['degrees'].max():.2f} deg {values['metres'].max():.3f} m  "
        f"converged {int(values['converged'].sum())}  wrong {wrong}  "
        f"sigmas {np.sqrt(np.mean(sigmas**2)) if len(sigmas) else np.nan:.1f}  "
        f"seconds {preparation:.1f} + {np.median(values['seconds']):.1f} "
        f"(most {values['seconds'].max():.1f})",
        flush=True,
    )


def kitti(options, calibrator):
    """Real frames of one drive."""
    folder = SHARED / "kitti_road"
    if not there(folder):
        return
    pairs = [real_pair(folder, path.stem) for path in sorted(folder.glob("*.pcd"))]
    calibrator.calibrate(pairs[:5], pairs[0].T_camera_lidar)  # compiles
    started = time.process_time()
    prepared = [calibrator.prepare(pair) for pair in pairs]
    each = (time.process_time() - started) / len(pairs)
    for number in options.frames:
        for name in options.starts:
            rows = []
            for seed in options.seeds:
                for group in groups(number, len(pairs), seed):
                    chosen = [pairs[i] for i in group], [prepared[i] for i in group]
                    rows.append(trial(calibrator, *chosen, STARTS[name], seed))
                    if options.verbose:
                        show(f"{group} seed {seed}", rows[-1])
            report(f"kitti_road, {number} frames from {name}", rows, each * number)


def groups(number, total, seed):
    """Which frames are solved together."""
    if number == total:
        return [tuple(range(total))]
    if 2 * number == total:
        return [tuple(range(number)), tuple(range(number, total))]
    drawn = np.random.default_rng([seed, number]).permutation(total)[:number]
    return [tuple(sorted(drawn.tolist()))]


def simulated(options, calibrator):
    """Pairs of one extrinsic in several scenes of a simulated camera that is fixed to the LiDAR."""
    from lcdata.simulation import render_pair

    for scenario in options.simulated:
        T = render_pair(scenario, seed=3000, columns=512).T_camera_lidar
        for number in options.frames:
            for name in options.starts:
                rows = []
                for seed in options.seeds:
                    pairs = [
                        render_pair(scenario, seed=3000 + number * seed + i, T_camera_lidar=T)
                        for i in range(number)
                    ]
                    prepared = [calibrator.prepare(pair) for pair in pairs]
                    rows.append(trial(calibrator, pairs, prepared, STARTS[name], seed))
                    if options.verbose:
                        show(f"{scenario} seed {seed}", rows[-1])
                report(f"{scenario}, {number} scenes from {name}", rows, 0.0)


def show(name, row):
    place = f"{row['degrees']:.3f} deg {row['metres']:.3f} m"
    print(f"    {name:24s} {place} {row['converged']} {row['message']}", flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--frames", type=int, nargs="+", default=[5])
    parser.add_argument("--starts", nargs="+", choices=STARTS, default=["1/0.1", "5/0.5"])
    parser.add_argument("--seeds", type=int, nargs="+", default=list(range(10)))
    parser.add_argument("--simulated", nargs="+", default=[], help="scenarios, instead of KITTI")
    parser.add_argument("--verbose", action="store_true", help="each trial")
    options = parser.parse_args()
    cv2.setNumThreads(1)
    calibrator = create("wide")
    if options.simulated:
        simulated(options, calibrator)
    else:
        kitti(options, calibrator)


if __name__ == "__main__":
    main()
