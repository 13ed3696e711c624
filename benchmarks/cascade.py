"""How often `cascade` is right, how right, and whether it ever trusts a wrong answer.

    python benchmarks/cascade.py                       # simulated and real
    python benchmarks/cascade.py --only simulated --scenarios road --seeds 500 510
    python benchmarks/cascade.py --only kitti --seeds 0 10

Guesses are wrong by 5 degrees and 0.5 m on each axis with random signs (of real frames also by what
`--from` says). Errors of simulated pairs
are against their exact truth; each seed is another layout, rig and noise. Each protocol is a row of
a Markdown table: what (of real frames method, frames and start), successes (within 0.5
deg and 0.1 m), medians, worst, called converged, and wrongly so, median of the seconds (processor
time of one thread, features included). `sigmas` is the root mean square of the errors in predicted
standard deviations over all six components, 2.4 if the covariance is right.
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
from wide import STARTS, report, started_from

from lcdata.calibrators import create
from lcdata.evaluation.protocol import perturb
from lcdata.geometry import se3


def trial(calibrator, pairs, degrees, metres, seed):
    """One estimate."""
    T = pairs[0].T_camera_lidar
    initial = perturb(T, degrees, metres, np.random.default_rng([seed, 6]))
    started = time.process_time()
    found = calibrator.calibrate(pairs, initial)
    return {
        "seconds": time.process_time() - started,
        "degrees": np.rad2deg(se3.rotation_error(found.T_camera_lidar, T)),
        "metres": se3.translation_error(found.T_camera_lidar, T),
        "converged": found.converged,
        "sigmas": se3.sigma_distance(found.T_camera_lidar, T, found.covariance),
        "message": found.message,
    }


def shown(options, name, row):
    """With --verbose, a line a trial."""
    if options.verbose:
        place = f"{row['degrees']:.3f} deg {1e3 * row['metres']:.1f} mm"
        print(f"    {name} {place} {row['converged']} {row['message']}", flush=True)
    return row


def simulated(options):
    """Single full-size pairs, one a seed, two starts each."""
    from lcdata.simulation import render_pair

    print("simulated, single pairs (target: success 99 %, median 0.06 deg / 8 mm, 0.2 deg / 30 mm)")
    everything = {name: [] for name in options.methods}
    for scenario in options.scenarios:
        rows = {name: [] for name in options.methods}
        for seed in range(*options.seeds):
            pair = render_pair(scenario, seed=seed, pose_index=seed % 5)
            for name in options.methods:
                for start in range(options.starts):
                    row = trial(create(name), [pair], 5.0, 0.5, 10 * seed + start)
                    rows[name].append(shown(options, f"{name} {scenario} {seed}", row))
        for name, found in rows.items():
            report((f"{name}, {scenario}",), found)
            everything[name] += found
    for name, found in everything.items():
        report((f"{name}, all",), found)


def kitti(options):
    """Real frames: the disjoint groups of five (or other sizes) in the order of their files."""
    folder = SHARED / "kitti_road"
    if not there(folder):
        return
    pairs = [real_pair(folder, path.stem) for path in sorted(folder.glob("*.pcd"))]
    create("cascade").calibrate(pairs[:1], pairs[0].T_camera_lidar)  # compiles
    print("kitti_road (target of five frames: all within 0.5 deg / 0.1 m; 0.15 deg / 25 mm)")
    count = min(options.seeds[1] - options.seeds[0], 10)
    for size in options.frames:
        groups = [pairs[i : i + size] for i in range(0, len(pairs) - size + 1, size)]
        for start in options.from_:
            for name in options.methods:
                rows = [
                    shown(options, f"{name} {k}", trial(create(name), group, *STARTS[start], seed))
                    for seed in range(count)
                    for k, group in enumerate(groups)
                ]
                script = f"`cascade.py --only kitti --frames {size}`"
                report((f"`{name}`", str(size), started_from(start)), rows, last=(script,))


def crossing(options):
    """One real sweep."""
    folder = SHARED / "opencalib_crossing"
    if not there(folder):
        return
    pair = real_pair(folder, "calib")
    print("opencalib_crossing, one sweep")
    for start in options.from_:
        for name in options.methods:
            rows = [
                shown(options, name, trial(create(name), [pair], *STARTS[start], seed))
                for seed in range(5)
            ]
            report((f"`{name}`", "1", started_from(start)), rows)


PARTS = {"simulated": simulated, "kitti": kitti, "crossing": crossing}


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", nargs="+", choices=PARTS, default=list(PARTS))
    parser.add_argument("--methods", nargs="+", default=["cascade"])
    parser.add_argument("--scenarios", nargs="+", default=["gym", "parking_lot", "yard", "road"])
    parser.add_argument("--seeds", type=int, nargs=2, default=[500, 513], help="first, last + 1")
    parser.add_argument("--starts", type=int, default=2, help="initial guesses a simulated pair")
    parser.add_argument("--frames", type=int, nargs="+", default=[1, 5, 10])
    parser.add_argument(
        "--from", dest="from_", nargs="+", choices=STARTS, default=["1/0.1", "5/0.5"]
    )
    parser.add_argument("--verbose", action="store_true", help="each trial")
    options = parser.parse_args()
    cv2.setNumThreads(1)
    for part in options.only:
        PARTS[part](options)


if __name__ == "__main__":
    main()
