"""Speed and accuracy of `edge`, on simulated pairs and on real ones beside the checkout.

    python benchmarks/edge.py                  # everything
    python benchmarks/edge.py --only simulated # also: paper, crossing, kitti

`paper` runs the variant that takes only edges where planes meet, as the paper does. Times are
processor time of one thread, features included, after the kernels are compiled. Real data is read
from ../shared/data; what is not there is skipped, and said so. Guesses are wrong on each axis by
what a line says, with random signs. `wrong` counts results that are called converged and are not
within 0.5 deg and 0.1 m; `sigmas` is the root mean square of the successes' errors in predicted
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
from nid import SCENARIOS, SENSORS, SHARED, real_pair, report, there

from lcdata.calibrators import create
from lcdata.evaluation.protocol import perturb
from lcdata.geometry import se3

GUESSES = ((1.0, 0.1), (2.0, 0.2))


def trial(calibrator, pairs, guess, seed, prepared=None):
    """One estimate."""
    T = pairs[0].T_camera_lidar
    initial = perturb(T, *guess, np.random.default_rng([seed, 4]))
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


def on_simulated(options, **parameters):
    """Single shots of simulated pairs, one line a LiDAR and guess."""
    from lcdata.simulation import render_pair

    calibrator = create("edge", **parameters)
    for lidar in options.lidars:
        rows = {guess: [] for guess in GUESSES}
        for number in range(options.scenes):
            scenario, seed = SCENARIOS[number % 3], options.first_scene + number
            pair = render_pair(scenario, seed=seed, lidar=lidar, moving=lidar == "os1_64")
            for guess in GUESSES:
                if not rows[guess]:
                    trial(calibrator, [pair], guess, seed)
                rows[guess].append(trial(calibrator, [pair], guess, seed))
                show(options, f"{scenario} {seed}", rows[guess][-1])
        for guess, found in rows.items():
            report(f"{lidar} from {guess[0]:g} deg {guess[1]:g} m", found)


def show(options, name, row):
    """One trial."""
    if options.verbose:
        place = f"{row['degrees']:.3f} deg {row['metres']:.3f} m"
        print(f"    {name} {place} {row['converged']} {row['message']}", flush=True)


def simulated(options):
    """The defaults."""
    print("simulated pairs, single shot")
    on_simulated(options)


def paper(options):
    """The paper's edges alone."""
    print("simulated pairs, single shot, only where planes meet")
    on_simulated(options, variant="continuous", borders=False)


def crossing(options):
    """A single real sweep."""
    folder = SHARED / "opencalib_crossing"
    if not there(folder):
        return
    print("opencalib_crossing, one sweep")
    pair = real_pair(folder, "calib")
    for variant in ("auto", "discontinuity"):
        calibrator = create("edge", variant=variant)
        prepared = [calibrator.prepare(pair)]
        for guess in GUESSES:
            rows = [trial(calibrator, [pair], guess, s, prepared) for s in options.seeds]
            for seed, row in zip(options.seeds, rows, strict=True):
                show(options, f"{variant} {seed}", row)
            report(f"{variant} from {guess[0]:g} deg {guess[1]:g} m", rows)


def kitti(options):
    """Real sweeps singly and five jointly; each seed draws its own of the ten."""
    folder = SHARED / "kitti_road"
    if not there(folder):
        return
    pairs = [real_pair(folder, path.stem) for path in sorted(folder.glob("*.pcd"))]
    for variant in ("auto", "discontinuity"):
        calibrator = create("edge", variant=variant)
        prepared = [calibrator.prepare(pair) for pair in pairs]
        for count in (1, 5):
            print(f"kitti_road, {count} frames, {variant}")
            for guess in GUESSES:
                rows = []
                for seed in options.seeds:
                    group = np.sort(
                        np.random.default_rng([seed, 5]).permutation(len(pairs))[:count]
                    )
                    chosen, ready = [pairs[i] for i in group], [prepared[i] for i in group]
                    rows.append(trial(calibrator, chosen, guess, seed, ready))
                    show(options, str(group), rows[-1])
                report(f"from {guess[0]:g} deg {guess[1]:g} m", rows)


PARTS = {"simulated": simulated, "paper": paper, "crossing": crossing, "kitti": kitti}


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", nargs="+", choices=PARTS, default=list(PARTS))
    parser.add_argument("--seeds", type=int, nargs="+", default=list(range(10)))
    parser.add_argument("--lidars", nargs="+", default=list(SENSORS))
    parser.add_argument("--scenes", type=int, default=9, help="simulated scenes a LiDAR")
    parser.add_argument("--first-scene", type=int, default=2000, help="seed of the first scene")
    parser.add_argument("--verbose", action="store_true", help="each trial")
    options = parser.parse_args()
    cv2.setNumThreads(1)
    for part in options.only:
        PARTS[part](options)


if __name__ == "__main__":
    main()
