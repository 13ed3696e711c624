"""Speed and accuracy of the NID methods, on simulated pairs and on real ones beside the checkout.

    python benchmarks/nid.py                  # everything
    python benchmarks/nid.py --only speed     # also: simulated, crossing, kitti

Times are processor time of one thread, after the kernels are compiled. Real data is read from
../shared/data; what is not there is skipped, and said so. Guesses are wrong by 1 degree and 0.1 m
on each axis with random signs. `wrong` counts results that are called converged and are not
within 0.5 deg and 0.1 m; `sigmas` is the root mean square of the successes' errors in predicted
standard deviations over all six components, 2.4 if the covariance is right.
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

from lcdata.calibrators import create
from lcdata.evaluation.protocol import perturb
from lcdata.geometry import se3
from lcdata.geometry.camera import Camera
from lcdata.pair import Pair

SHARED = Path(__file__).parents[2] / "shared" / "data"
SCENARIOS = ("gym", "parking_lot", "yard")
SENSORS = ("os1_128", "os1_64", "avia")


def clock(function, repeats):
    """Seconds of processor time of one call, the least of three rounds."""
    function()
    rounds = []
    for _ in range(3):
        started = time.process_time()
        for _ in range(repeats):
            function()
        rounds.append((time.process_time() - started) / repeats)
    return min(rounds)


def speed(_options):
    """Cost of a pose a visible point, as a ratio to NumPy's histogram of the same intensities."""
    from lcdata.features.nid_objective import nid_features, objective
    from lcdata.simulation import render_pair

    pair = render_pair("gym", seed=50)
    T = pair.T_camera_lidar
    cost = objective([nid_features(pair, False)], T, False)
    (view,) = cost.views
    pixels, inside = view.image.camera.project(se3.apply(T, view.cloud.points))
    column, row = np.rint(pixels[inside]).astype(int).T
    light, pixel = view.cloud.bins[inside].astype(float), view.image.hard[row, column].astype(float)
    count = int(inside.sum())
    poses = np.repeat(T[None], 20, 0)
    reference = clock(lambda: np.histogram2d(light, pixel, 16, [[0, 16], [0, 16]]), 10)
    rows = (
        ("numpy.histogram2d, already projected", reference, None),
        ("hard histogram and cost", clock(lambda: cost.hard(poses), 3) / 20, 0.04),
        ("soft histogram, cost and gradient", clock(lambda: cost.slope(T), 20), 0.15),
    )
    print(f"speed, {count} visible points")
    for name, seconds, target in rows:
        ratio = f"{seconds / reference:5.2f} of numpy.histogram2d"
        aim = f"  target {target} us" if target else ""
        print(f"  {name:38s} {1e6 * seconds / count:.3f} us a point  {ratio}{aim}")


def trial(calibrator, pairs, seed, prepared=None):
    """One estimate from 1 degree and 0.1 m on each axis."""
    T = pairs[0].T_camera_lidar
    initial = perturb(T, 1.0, 0.1, np.random.default_rng([seed, 4]))
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


def report(name, rows, degrees=None, metres=None):
    """One line; with targets, how many rows reach both."""
    values = {key: np.array([row[key] for row in rows]) for key in rows[0]}
    success = (values["degrees"] < 0.5) & (values["metres"] < 0.1)
    wrong = int((values["converged"] & ~success).sum())
    sigmas = values["sigmas"][success & np.isfinite(values["sigmas"].astype(float))]
    reached = ""
    if degrees is not None:
        good = (values["degrees"] <= degrees) & (values["metres"] <= metres)
        reached = f"  within {degrees} deg / {metres} m: {int(good.sum())} of {len(rows)}"
    print(
        f"  {name:30s} n {len(rows):2d}  success {success.mean():4.0%}  "
        f"median {np.median(values['degrees']):.3f} deg {np.median(values['metres']):.4f} m  "
        f"converged {values['converged'].mean():4.0%}  wrong {wrong}  "
        f"sigmas {np.sqrt(np.mean(sigmas**2)) if len(sigmas) else np.nan:.1f}  "
        f"seconds {np.median(values['seconds']):.1f}{reached}",
        flush=True,
    )


def simulated(options):
    """Single shots of dense simulated pairs."""
    from lcdata.simulation import render_pair

    print("simulated pairs, single shot (target: median 0.15 deg / 0.02 m; 2 s at 262,144 points)")
    for lidar in SENSORS:
        rows = {name: [] for name in options.methods}
        for seed in options.seeds[: options.scenes]:
            scenario = SCENARIOS[seed % 3]
            pair = render_pair(scenario, seed=2000 + seed, lidar=lidar, moving=lidar == "os1_64")
            for name in options.methods:
                calibrator = create(name)
                if not rows[name]:
                    trial(calibrator, [pair], seed)
                rows[name].append(trial(calibrator, [pair], seed))
        for name, found in rows.items():
            report(f"{name} {lidar}", found, 0.15, 0.02)


def real_pair(folder, stem):
    """A pair of the shared data with its reference."""
    from pypcd4 import PointCloud

    reference = json.loads((folder / "reference.json").read_text())
    cloud = PointCloud.from_path(folder / f"{stem}.pcd")
    image = cv2.imread(str(folder / f"{stem}.png"))[:, :, ::-1].copy()
    lens = tuple(reference["D"]) if any(reference["D"]) else ()
    camera = Camera("pinhole", image.shape[1], image.shape[0], tuple(reference["K"]), lens)
    return Pair(
        image,
        cloud.numpy(("x", "y", "z")).astype(np.float32),
        cloud.numpy(("intensity",))[:, 0].astype(np.float32),
        camera,
        ring=cloud.numpy(("ring",))[:, 0].astype(int) if "ring" in cloud.fields else None,
        T_camera_lidar=se3.check_transform(reference["T_camera_lidar"]),
    )


def there(folder):
    """Whether real data is beside the checkout."""
    if not folder.is_dir():
        print(f"skipped: no {folder.name} in ../shared/data")
    return folder.is_dir()


def crossing(options):
    """A single real sweep."""
    folder = SHARED / "opencalib_crossing"
    if not there(folder):
        return
    print("opencalib_crossing, one sweep (target: 0.2 deg / 0.05 m in 9 of 10 seeds)")
    pair = real_pair(folder, "calib")
    for name in options.methods:
        calibrator = create(name)
        prepared = [calibrator.prepare(pair)]
        report(name, [trial(calibrator, [pair], s, prepared) for s in options.seeds], 0.2, 0.05)


def kitti(options):
    """Five real sweeps jointly; each seed draws its own five of the ten."""
    folder = SHARED / "kitti_road"
    if not there(folder):
        return
    print("kitti_road, five frames jointly (target: 0.25 deg / 0.04 m in 9 of 10)")
    pairs = [real_pair(folder, path.stem) for path in sorted(folder.glob("*.pcd"))]
    for name in options.methods:
        calibrator = create(name)
        prepared = [calibrator.prepare(pair) for pair in pairs]
        rows = []
        for seed in options.seeds:
            group = np.sort(np.random.default_rng([seed, 5]).permutation(len(pairs))[:5])
            chosen = [pairs[i] for i in group]
            rows.append(trial(calibrator, chosen, seed, [prepared[i] for i in group]))
            if options.verbose:
                row = rows[-1]
                place = f"{row['degrees']:.3f} deg {row['metres']:.3f} m"
                print(f"    {group} {place} {row['converged']} {row['message']}")
        report(name, rows, 0.25, 0.04)


PARTS = {"speed": speed, "simulated": simulated, "crossing": crossing, "kitti": kitti}


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", nargs="+", choices=PARTS, default=list(PARTS))
    parser.add_argument("--methods", nargs="+", default=["nid", "nid_edge"])
    parser.add_argument("--seeds", type=int, nargs="+", default=list(range(10)))
    parser.add_argument("--scenes", type=int, default=6, help="simulated scenes a LiDAR")
    parser.add_argument("--verbose", action="store_true", help="each trial of kitti")
    options = parser.parse_args()
    cv2.setNumThreads(1)
    for part in options.only:
        PARTS[part](options)


if __name__ == "__main__":
    main()
