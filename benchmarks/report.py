"""How long a report of many trials takes, and how large its page is.

    lcdata build recordings/ -o dataset
    python benchmarks/report.py dataset

The data set is copied 20 times over into one of as many more pairs (links to the same files), and
gets trials with made-up errors: six methods, of which one fails at times. Processor time, and how
it is spent.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np

from lcdata.calibrators.base import LineMatches
from lcdata.dataset import Dataset, schema
from lcdata.dataset.atomic import write_json, write_parquet
from lcdata.evaluation.results import TrialResult, results_path, write_run
from lcdata.geometry import se3
from lcdata.report import write_report

METHODS = ("alpha", "beta", "gamma", "delta", "epsilon", "zeta")


def enlarged(dataset: Dataset, times: int, folder: Path) -> Dataset:
    """The data set with each of its poses several times."""
    pairs, poses = [], []
    for k in range(times):
        for pose in dataset.poses:
            poses.append(replace(pose, pose_id=f"{pose.pose_id}-{k}"))
        for pair in dataset.pairs:
            scenario, pose, number = pair.pair_id.split("/")
            pose_id = f"{scenario}/{pose}-{k}"
            pairs.append(replace(pair, pair_id=f"{pose_id}/{number}", pose_id=pose_id))
    folder.mkdir()
    for scenario in dataset.scenarios:
        (folder / scenario).symlink_to((dataset.path / scenario).resolve())
    poses = schema.versioned(poses)
    info = replace(dataset.info, groundtruth_version=schema.groundtruth_version(poses))
    write_parquet(folder / schema.PAIRS, schema.pairs_table(pairs))
    write_parquet(folder / schema.POSES, schema.poses_table(poses))
    write_json(folder / schema.INFO, info.to_dict())
    return Dataset.open(folder)


def trials_of(dataset: Dataset, count: int) -> Iterator[TrialResult]:
    """Made-up trials, as many on each pair and of each method."""
    rng = np.random.default_rng(0)
    each = -(-count // (len(dataset.pairs) * len(METHODS)))
    for record in dataset.pairs:
        pose = dataset.pose(record.pose_id)
        for j, method in enumerate(METHODS):
            for number in range(each):
                start = np.concatenate([rng.choice((-0.5, 0.5), 3), rng.choice((-0.087, 0.087), 3)])
                size = 0.003 * (1 + j) * rng.lognormal(0, 0.7)
                failed = method == "zeta" and rng.random() < 0.1
                lines = int(rng.integers(5, 40)) if j < 3 and not failed else 0
                trial = TrialResult(
                    run="5deg-0.5m-seed0",
                    method=method,
                    method_version=1,
                    parameters="{}",
                    lcdata_version="benchmark",
                    pair_ids=(record.pair_id,),
                    scenario=record.scenario,
                    pose_id=record.pose_id,
                    trial=number,
                    seed=0,
                    group="pair",
                    init_rotation_deg=5.0,
                    init_translation_m=0.5,
                    T_camera_lidar_initial=se3.exp(start) @ pose.T_camera_lidar,
                    groundtruth_version=pose.pose_version,
                    T_camera_lidar_estimated=None
                    if failed
                    else se3.exp(rng.normal(0, size, 6)) @ pose.T_camera_lidar,
                    converged=not failed,
                    failed=failed,
                    seconds=1.0,
                    message="ValueError: made up" if failed else "",
                    matches=LineMatches(
                        np.zeros((lines, 2, 3)), np.zeros((lines, 2, 2)), np.zeros(lines, np.int64)
                    ),
                )
                yield trial.against(pose)


@contextmanager
def profiled(top: int) -> Iterator[None]:
    """Print where the time goes, if asked for."""
    if not top:
        yield
        return
    import cProfile
    import pstats

    profile = cProfile.Profile()
    with profile:
        yield
    pstats.Stats(profile).sort_stats("cumtime").print_stats(top)


def timed(name: str, action: Callable[[], Path]) -> Path:
    """Do it, print its processor time."""
    start = time.process_time()
    result = action()
    print(f"{name:28} {time.process_time() - start:6.1f} s processor time")
    return result


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("dataset", type=Path)
    parser.add_argument("--trials", type=int, default=10_000)
    parser.add_argument("--times", type=int, default=20, help="the data set's poses so many times")
    parser.add_argument("--profile", type=int, default=0, metavar="LINES")
    arguments = parser.parse_args()
    dataset = Dataset.open(arguments.dataset)
    with tempfile.TemporaryDirectory() as folder:
        large = enlarged(dataset, arguments.times, Path(folder) / "large")
        trials = list(trials_of(large, arguments.trials))
        write_run(results_path(large, trials[0].run), trials)
        print(f"{len(trials)} trials of {len(METHODS)} methods on {len(large)} pairs")
        small = [t for t in trials if t.pair_ids[0].split("/")[1].endswith("-0")][:90]
        write_run(results_path(large, trials[0].run), small)
        timed("first page (imports, kernels)", lambda: write_report(large))
        write_run(results_path(large, trials[0].run), trials)
        with profiled(arguments.profile):
            page = timed("page of all trials", lambda: write_report(large))
        print(f"page {page.stat().st_size / 1e6:.2f} MB")


if __name__ == "__main__":
    sys.exit(main())
