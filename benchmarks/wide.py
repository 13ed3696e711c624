"""How far off a guess may be for `wide`, on how many frames, and whether it knows.

    python benchmarks/wide.py                    # five frames from 1 deg / 0.1 m and 5 deg / 0.5 m
    python benchmarks/wide.py --frames 1 3 10    # other numbers of frames
    python benchmarks/wide.py --simulated gym    # pairs of one simulated rig in several scenes
    python benchmarks/wide.py --lenses           # what a distorted lens costs

Real frames are those of ../shared/data/kitti_road beside the checkout; where they are missing the
part is skipped, and said so. Five frames are the first and the last five of the ten; other numbers
are drawn by seed. Guesses are wrong by the given error on each axis with random signs. Times are
processor time of one thread, after the kernels are compiled: `prepare` of all frames, and the rest.
Each protocol is a row of a Markdown table: method, frames, start, successes
(within 0.5 deg and 0.1 m), medians, worst, called converged, and wrongly so, median of the seconds.
`sigmas` is the root mean square of the successes' errors in predicted standard deviations over all
six components, 2.4 if the covariance is right.
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


def cells(rows):
    """Successes, medians, worst, called converged, and wrongly so; and the errors in sigmas."""
    values = {key: np.array([row[key] for row in rows]) for key in rows[0]}
    degrees, millimetres = values["degrees"], 1e3 * values["metres"]
    success = (degrees < 0.5) & (millimetres < 100.0)
    sigmas = values["sigmas"].astype(float)[success]
    sigmas = sigmas[np.isfinite(sigmas)]
    return (
        f"{int(success.sum())} of {len(rows)}",
        f"{np.median(degrees):.3f} deg / {np.median(millimetres):.0f} mm",
        f"{degrees.max():.2f} deg / {millimetres.max():.0f} mm",
        str(int(values["converged"].sum())),
        str(int((values["converged"] & ~success).sum())),
    ), float(np.sqrt(np.mean(sigmas**2))) if len(sigmas) else np.nan


def report(first, rows, preparation=0.0, last=()):
    """A row of a table, and under it what is in none."""
    middle, sigmas = cells(rows)
    seconds = preparation + np.array([row["seconds"] for row in rows])
    line = [*first, *middle, f"{np.median(seconds):.1f}", *last]
    print(f"| {' | '.join(line)} |", flush=True)
    features = f", of them features {preparation:.1f}" if preparation else ""
    print(f"    sigmas {sigmas:.1f}, most seconds {seconds.max():.1f}{features}", flush=True)


def started_from(name):
    degrees, metres = STARTS[name]
    return f"{degrees:g} deg / {metres:g} m"


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
            script = f"`wide.py --frames {number}`"
            report(("`wide`", str(number), started_from(name)), rows, each * number, (script,))


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
                first = (f"`wide`, {scenario}", str(number), started_from(name))
                report(first, rows, 0.0, (f"`wide.py --simulated {scenario} --frames {number}`",))


LENSES = {
    "pinhole": ("pinhole", (560.0, 560.0, 480.0, 270.0), ()),
    "plumb_bob": ("pinhole", (560.0, 560.0, 480.0, 270.0), (-0.1, 0.02, 5e-4, -5e-4, 0.0)),
    "fisheye": ("fisheye", (560.0, 560.0, 480.0, 270.0), (-0.02, 0.003, 0.0, 0.0)),
    "omni": ("omni", (1.2, 1230.0, 1230.0, 480.0, 270.0), (-0.05, 0.01, 0.0, 0.0)),
}
"""Of 960 x 540 pixels and 560 pixels a radian each."""


def lenses(calibrator):
    """Five places of one simulated road by different cameras, from 1 deg / 0.1 m."""
    from lcdata.geometry.camera import Camera
    from lcdata.simulation import render_pair

    for name, (model, intrinsics, distortion) in LENSES.items():
        camera = Camera(model, 960, 540, intrinsics, distortion)
        pairs = [
            render_pair("road", seed=50, pose_index=i, lidar="os1_64", camera=camera)
            for i in range(5)
        ]
        prepared = [calibrator.prepare(pair) for pair in pairs]
        trial(calibrator, pairs[:1], prepared[:1], STARTS["1/0.1"], 0)  # compiles
        rows = [trial(calibrator, pairs, prepared, STARTS["1/0.1"], seed) for seed in range(2)]
        report((f"`wide`, {name}", "5", started_from("1/0.1")), rows, 0.0, ("`wide.py --lenses`",))


def show(name, row):
    place = f"{row['degrees']:.3f} deg {row['metres']:.3f} m"
    print(f"    {name:24s} {place} {row['converged']} {row['message']}", flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--frames", type=int, nargs="+", default=[5])
    parser.add_argument("--starts", nargs="+", choices=STARTS, default=["1/0.1", "5/0.5"])
    parser.add_argument("--seeds", type=int, nargs="+", default=list(range(10)))
    parser.add_argument("--simulated", nargs="+", default=[], help="scenarios, instead of KITTI")
    parser.add_argument("--lenses", action="store_true", help="several cameras, instead of KITTI")
    parser.add_argument("--verbose", action="store_true", help="each trial")
    options = parser.parse_args()
    cv2.setNumThreads(1)
    calibrator = create("wide")
    if options.lenses:
        lenses(calibrator)
    elif options.simulated:
        simulated(options, calibrator)
    else:
        kitti(options, calibrator)


if __name__ == "__main__":
    main()
