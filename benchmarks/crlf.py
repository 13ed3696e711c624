"""Accuracy and speed of CRLF, on simulated roads and on real pairs beside the checkout.

    python benchmarks/crlf.py                  # everything
    python benchmarks/crlf.py --only crossing  # also: road, kitti

Times are processor time of one thread, after the kernels are compiled; the mask's file is read
before the clock starts on `features`. Real data is read from ../shared/data; what is not there is
skipped, and said so. "from 1/0.1" is a guess that is wrong by 1 degree and 0.1 m on each axis with
random signs. `wrong` counts results that are called converged and are not within 0.5 deg and 0.1 m.
"""

from __future__ import annotations

import argparse
import os
import tempfile
import time
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import cv2
import numpy as np
from nid import SHARED, real_pair, there

from lcdata.calibrators import create
from lcdata.errors import CalibrationError
from lcdata.evaluation.protocol import perturb
from lcdata.geometry import se3


def trial(method, pairs, initial, prepared=None):
    """One estimate, its errors and its processor time."""
    T = pairs[0].T_camera_lidar
    started = time.process_time()
    prepared = prepared or [method.prepare(pair) for pair in pairs]
    features = time.process_time()
    try:
        found = method.calibrate(pairs, initial, prepared)
    except CalibrationError as error:
        return {"refused": str(error)}
    return {
        "degrees": np.rad2deg(se3.rotation_error(found.T_camera_lidar, T)),
        "metres": se3.translation_error(found.T_camera_lidar, T),
        "converged": found.converged,
        "features": features - started,
        "seconds": time.process_time() - features,
        "message": found.message,
    }


def guess(pair, seed):
    """From 1 degree and 0.1 m on each axis."""
    return perturb(pair.T_camera_lidar, 1.0, 0.1, np.random.default_rng([seed, 4]))


def report(name, rows, degrees, metres):
    """One line of all trials; how many are within the target."""
    done = [row for row in rows if "refused" not in row]
    refused = f"  refused {len(rows) - len(done)}" if len(done) < len(rows) else ""
    if not done:
        print(f"  {name:34s} n {len(rows):2d}{refused}: {rows[0]['refused']}")
        return
    e = np.array([(row["degrees"], row["metres"]) for row in done])
    converged = np.array([row["converged"] for row in done])
    good = (e < [degrees, metres]).all(1)
    wrong = converged & ~(e < [0.5, 0.1]).all(1)
    seconds = np.median([(row["features"], row["seconds"]) for row in done], 0)
    middle, worst = np.median(e, 0), e.max(0)
    print(
        f"  {name:34s} n {len(rows):2d}{refused}  median {middle[0]:.3f} deg {middle[1]:.3f} m  "
        f"worst {worst[0]:.2f} deg {worst[1]:.2f} m  "
        f"within {degrees} deg / {metres} m: {int(good.sum())}  "
        f"converged {int(converged.sum())}  wrong {int(wrong.sum())}  "
        f"seconds {seconds[0]:.2f} + {seconds[1]:.2f}",
        flush=True,
    )


def crossing(options):
    """One real scene with its publishers' mask."""
    folder = SHARED / "opencalib_crossing"
    if not there(folder):
        return
    print("opencalib_crossing with its mask (seconds: features + estimate)")
    pair, masks = real_pair(folder, "calib"), str(folder / "mask.jpg")
    seeds = options.seeds
    for contours in ("auto", "never", "always"):
        kept = {"masks": masks, "contours": contours}
        coarse, search = create("crlf", refine="none", **kept), create("crlf", **kept)
        random = create("crlf", refine="random", **kept)
        label = f", contours {contours}"
        trial(coarse, [pair], None)
        report(f"coarse, from nothing{label}", [trial(coarse, [pair], None)], 3.0, 0.5)
        trial(search, [pair], None)
        report(f"refined, from nothing{label}", [trial(search, [pair], None)], 0.5, 0.12)
        rows = [trial(search, [pair], guess(pair, seed)) for seed in seeds]
        report(f"refined, from 1/0.1{label}", rows, 0.2, 0.08)
        rows = [trial(random, [pair], guess(pair, seed)) for seed in seeds]
        report(f"Algorithm 1, from 1/0.1{label}", rows, 0.2, 0.08)


def road(options):
    """Simulated roads with true masks: single frames and several places of one car."""
    from lcdata.simulation import render_pair, semantic_masks

    print(f"simulated road, {options.lidar}, true masks in one image")
    seeds, places = [100 + seed for seed in options.seeds], options.places
    with tempfile.TemporaryDirectory() as folder:
        pairs = {}
        for seed in seeds:
            for place in range(places):
                pair = render_pair("road", seed=seed, pose_index=place, lidar=options.lidar)
                seen = semantic_masks("road", seed=seed, pose_index=place)
                path = Path(folder) / str(seed) / f"{pair.pair_id}.png"
                path.parent.mkdir(parents=True, exist_ok=True)
                cv2.imwrite(str(path), 255 * (seen.lane | seen.pole).astype(np.uint8))
                pairs[seed, place] = pair
        for refine in ("none", "search", "random"):
            rows = {"nothing": [], "1/0.1": []}
            for seed in seeds:
                method = create("crlf", masks=f"{folder}/{seed}", refine=refine)
                one = [pairs[seed, 0]]
                rows["nothing"].append(trial(method, one, None))
                if refine != "none":
                    rows["1/0.1"].append(trial(method, one, guess(one[0], seed)))
            for start, found in rows.items():
                if found:
                    report(f"{refine}, one frame, from {start}", found, 0.5, 0.1)
        rows = {"nothing": [], "1/0.1": []}
        for seed in seeds:
            method = create("crlf", masks=f"{folder}/{seed}")
            many = [pairs[seed, place] for place in range(places)]
            prepared = [method.prepare(pair) for pair in many]
            for start, found in rows.items():
                initial = None if start == "nothing" else guess(many[0], seed)
                found.append(trial(method, many, initial, prepared))
        for start, found in rows.items():
            report(f"search, {places} frames, from {start}", found, 0.5, 0.1)


def kitti(options):
    """Real frames without masks: the classical default, from a guess."""
    folder = SHARED / "kitti_road"
    if not there(folder):
        return
    print("kitti_road, no masks: marks and poles found in the image, from 1/0.1")
    pairs = [real_pair(folder, path.stem) for path in sorted(folder.glob("*.pcd"))]
    method = create("crlf")
    prepared = [method.prepare(pair) for pair in pairs]
    rows = [
        trial(method, [pair], guess(pair, k), [features])
        for k, (pair, features) in enumerate(zip(pairs, prepared, strict=True))
    ]
    report("one frame", rows, 0.5, 0.1)
    rows = []
    for seed in options.seeds[:4]:
        group = np.sort(np.random.default_rng([seed, 5]).permutation(len(pairs))[:5])
        chosen = [pairs[i] for i in group]
        rows.append(trial(method, chosen, guess(pairs[0], seed), [prepared[i] for i in group]))
    report("five frames", rows, 0.5, 0.1)


PARTS = {"crossing": crossing, "road": road, "kitti": kitti}


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", nargs="+", choices=PARTS, default=list(PARTS))
    parser.add_argument("--seeds", type=int, nargs="+", default=list(range(10)))
    parser.add_argument("--lidar", default="pandar_64")
    parser.add_argument("--places", type=int, default=3, help="frames of a car solved jointly")
    options = parser.parse_args()
    cv2.setNumThreads(1)
    for part in options.only:
        PARTS[part](options)


if __name__ == "__main__":
    main()
