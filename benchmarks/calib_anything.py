"""Accuracy, honesty and speed of calib_anything, on real pairs beside the checkout and simulated.

    python benchmarks/calib_anything.py                    # everything
    python benchmarks/calib_anything.py --only crossing    # also: speed, kitti, single, simulated
    python benchmarks/calib_anything.py --masks FOLDER     # masks from files for the crossing

Segments come from the embedded segmenter unless `--masks` says otherwise. Guesses are wrong by
3 degrees on each axis with random signs, and by 0, or 0.1 m with random signs, along each axis.
Times are processor time of one thread, after the kernels are compiled; `prepare` is the segments
and attributes of one pair, `seconds` all of it. `wrong` counts results that are called converged
and are not within 0.5 deg and 0.1 m; `sigmas` is the root mean square of the successes' errors in
predicted standard deviations over all six components, 2.4 if the covariance is right. Real data is
read from ../shared/data; what is not there is skipped, and said so.
"""

from __future__ import annotations

import argparse
import os
import time
from dataclasses import replace

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import cv2
import numpy as np
from nid import SHARED, real_pair, there

from lcdata.calibrators import create
from lcdata.evaluation.protocol import perturb
from lcdata.geometry import se3


def trial(calibrator, pairs, seed, degrees, metres, prepared):
    """One estimate from a guess that is off by so much on each axis."""
    T = pairs[0].T_camera_lidar
    initial = perturb(T, degrees, metres, np.random.default_rng([seed, 4]))
    started = time.process_time()
    found = replace(calibrator, seed=seed).calibrate(pairs, initial, prepared)
    return {
        "seconds": time.process_time() - started,
        "degrees": np.rad2deg(se3.rotation_error(found.T_camera_lidar, T)),
        "metres": se3.translation_error(found.T_camera_lidar, T),
        "converged": found.converged,
        "sigmas": se3.sigma_distance(found.T_camera_lidar, T, found.covariance),
        "message": found.message,
    }


def report(name, rows, prepare_s, target=None):
    """One line, median and worst."""
    values = {key: np.array([row[key] for row in rows]) for key in rows[0]}
    success = (values["degrees"] < 0.5) & (values["metres"] < 0.1)
    wrong = int((values["converged"] & ~success).sum())
    sigmas = values["sigmas"][success & np.isfinite(values["sigmas"].astype(float))]
    reached = ""
    if target:
        good = (values["degrees"] <= target[0]) & (values["metres"] <= target[1])
        reached = f"  within {target[0]} deg / {target[1]} m: {int(good.sum())} of {len(rows)}"
    print(
        f"  {name:22s} n {len(rows):2d}  success {success.mean():4.0%}  "
        f"median {np.median(values['degrees']):.3f} deg {np.median(values['metres']):.3f} m  "
        f"worst {values['degrees'].max():.2f} deg {values['metres'].max():.3f} m  "
        f"converged {values['converged'].mean():4.0%}  wrong {wrong}  "
        f"sigmas {np.sqrt(np.mean(sigmas**2)) if len(sigmas) else np.nan:.1f}  "
        f"prepare {prepare_s:.2f}  seconds {np.median(values['seconds']) + prepare_s:.1f}{reached}",
        flush=True,
    )


def prepared_of(calibrator, pairs):
    """Features of pairs, and the processor time of one."""
    calibrator.prepare(pairs[0])
    started = time.process_time()
    prepared = [calibrator.prepare(pair) for pair in pairs]
    return prepared, (time.process_time() - started) / len(pairs)


def run(options, name, calibrator, groups, prepared, prepare_s, guesses, target=None):
    """Trials of groups of pairs from each kind of guess."""
    for metres in guesses:
        rows = []
        for k, (group, seed) in enumerate(groups):
            chosen = [prepared[id(pair)] for pair in group]
            if not k:
                trial(calibrator, group, seed, 3.0, metres, chosen)
            rows.append(trial(calibrator, group, seed, 3.0, metres, chosen))
            if options.verbose:
                row = rows[-1]
                print(
                    f"    {k} {row['degrees']:.3f} deg {row['metres']:.3f} m  sigmas "
                    f"{row['sigmas']:.1f}  {row['converged']}  {row['message']}",
                    flush=True,
                )
        count = len(groups[0][0])
        report(f"{name} 3 deg / {metres:g} m", rows, prepare_s * count, target)


def speed(_options):
    """Cost of a pose a point."""
    from lcdata.features.segment_objective import objective
    from lcdata.simulation import render_pair

    pair = render_pair("gym", seed=50)
    calibrator = create("calib_anything")
    prepared, seconds = prepared_of(calibrator, [pair])
    cost = objective(prepared, pair.T_camera_lidar, 0.1, "explained")
    (view,) = cost.views
    poses = np.repeat(pair.T_camera_lidar[None], 20, 0)
    cost.hard(poses)
    started = time.process_time()
    cost.hard(poses)
    each = (time.process_time() - started) / 20 / len(view.points)
    print(
        f"speed, {len(view.points)} points, {view.layers.masks} masks of "
        f"{pair.camera.width}x{pair.camera.height} pixels: prepare {seconds:.2f} s, "
        f"{1e9 * each:.0f} ns a point and pose",
        flush=True,
    )


def crossing(options):
    """A single real sweep."""
    folder = SHARED / "opencalib_crossing"
    if not there(folder):
        return
    print("opencalib_crossing, one sweep (target: 0.3 deg / 0.09 m, 5 s)")
    pair = real_pair(folder, "calib")
    for score in options.scores:
        calibrator = create("calib_anything", score=score, masks=options.masks)
        prepared, prepare_s = prepared_of(calibrator, [pair])
        groups = [([pair], seed) for seed in options.seeds]
        by_pair = {id(pair): prepared[0]}
        run(options, score, calibrator, groups, by_pair, prepare_s, (0.0, 0.1), (0.3, 0.09))


def frames():
    """The pairs of kitti_road."""
    folder = SHARED / "kitti_road"
    if not there(folder):
        return []
    return [real_pair(folder, path.stem) for path in sorted(folder.glob("*.pcd"))]


def kitti(options):
    """Five real sweeps jointly; each seed draws its own five of the ten."""
    pairs = frames()
    if not pairs:
        return
    print("kitti_road, five frames jointly")
    for score in options.scores:
        calibrator = create("calib_anything", score=score)
        prepared, prepare_s = prepared_of(calibrator, pairs)
        by_pair = {id(pair): p for pair, p in zip(pairs, prepared, strict=True)}
        groups = []
        for seed in options.seeds:
            chosen = np.sort(np.random.default_rng([seed, 5]).permutation(len(pairs))[:5])
            groups.append(([pairs[i] for i in chosen], seed))
        run(options, score, calibrator, groups, by_pair, prepare_s, (0.1,))


def single(options):
    """Each real sweep by itself."""
    pairs = frames()
    if not pairs:
        return
    print("kitti_road, single frames")
    for score in options.scores:
        calibrator = create("calib_anything", score=score)
        prepared, prepare_s = prepared_of(calibrator, pairs)
        by_pair = {id(pair): p for pair, p in zip(pairs, prepared, strict=True)}
        groups = [([pair], k) for k, pair in enumerate(pairs)]
        run(options, score, calibrator, groups, by_pair, prepare_s, (0.1,))


def simulated(options):
    """Single shots of dense simulated pairs."""
    from lcdata.simulation import render_pair

    print("simulated pairs, single shot")
    calibrator = create("calib_anything")
    for scenario in ("gym", "parking_lot", "yard"):
        pairs = [render_pair(scenario, seed=3000 + s) for s in options.seeds[: options.scenes]]
        prepared, prepare_s = prepared_of(calibrator, pairs)
        by_pair = {id(pair): p for pair, p in zip(pairs, prepared, strict=True)}
        groups = [([pair], k) for k, pair in enumerate(pairs)]
        run(options, scenario, calibrator, groups, by_pair, prepare_s, (0.1,))


PARTS = {
    "speed": speed,
    "crossing": crossing,
    "kitti": kitti,
    "single": single,
    "simulated": simulated,
}


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", nargs="+", choices=PARTS, default=list(PARTS))
    parser.add_argument("--seeds", type=int, nargs="+", default=list(range(10)))
    parser.add_argument("--scores", nargs="+", default=["explained", "published"])
    parser.add_argument("--scenes", type=int, default=3, help="simulated scenes a scenario")
    parser.add_argument("--masks", default="", help="folder with masks of the crossing")
    parser.add_argument("--verbose", action="store_true", help="each trial")
    options = parser.parse_args()
    cv2.setNumThreads(1)
    for part in options.only:
        PARTS[part](options)


if __name__ == "__main__":
    main()
