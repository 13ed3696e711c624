"""Cloud lines of a full-size simulated scan beside Open3D's normals of the same cloud, one core.

Medians of CPU time, taken in turns after one run of each.

Run with: python benchmarks/cloud_lines.py
"""

from __future__ import annotations

import os
import statistics
import time
from collections.abc import Callable

for library in ("OMP", "OPENBLAS", "MKL", "NUMBA"):
    os.environ[f"{library}_NUM_THREADS"] = "1"
if hasattr(os, "sched_setaffinity"):
    os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})

import numpy as np  # noqa: E402 - the limits above come first

from lcdata.features.cloud_lines import extract_cloud_lines  # noqa: E402
from lcdata.simulation import render_pair  # noqa: E402

ROUNDS = 7
LIMIT = 0.15


def seconds(task: Callable[[], object]) -> float:
    """CPU seconds, so that other work on the machine does not count."""
    start = time.process_time()
    task()
    return time.process_time() - start


def compare(scenario: str) -> None:
    import open3d

    pair = render_pair(scenario, columns=2048)
    # Open3D's tree takes most of a minute on points that are NaN: it gets the others only.
    seen = pair.points[np.isfinite(pair.points).all(axis=1)].astype(float)
    cloud = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(seen))
    neighbours = open3d.geometry.KDTreeSearchParamKNN(30)
    lines = extract_cloud_lines(pair.points, pair.organised)
    ours, theirs = [], []
    for _ in range(ROUNDS):
        ours.append(seconds(lambda: extract_cloud_lines(pair.points, pair.organised)))
        theirs.append(seconds(lambda: cloud.estimate_normals(neighbours)))
    mine, other = statistics.median(ours), statistics.median(theirs)
    print(
        f"{scenario:12} {len(pair.points)} beams, {len(seen)} returns, {len(lines)} lines:  "
        f"cloud lines {mine * 1e3:4.0f} ms,  Open3D normals {other * 1e3:5.0f} ms,  "
        f"ratio {mine / other:.3f} (to reach: {LIMIT})"
    )


def main() -> None:
    for scenario in ("gym", "yard", "parking_lot"):
        compare(scenario)


if __name__ == "__main__":
    main()
