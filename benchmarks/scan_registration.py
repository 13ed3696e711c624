"""How well the motion of a simulated LiDAR that a hand moves is found from its scans, one core.

Three scenes a seed, three seconds of motion. Errors are of the pose at every 0.05 s against the
true one, both in the frame of the first moment. Seeds 31 and 32: nothing was chosen on them.
Beside it KISS-ICP on the same scans, where it is installed (`pip install kiss-icp`): errors of its
poses at the ends of the scans, which is what they are of.

Run with: python benchmarks/scan_registration.py [--seeds 31 32] [--lidar os1_64 avia]
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Callable

for library in ("OMP", "OPENBLAS", "MKL", "NUMBA"):
    os.environ[f"{library}_NUM_THREADS"] = "1"

import numpy as np  # noqa: E402 - the limits above come first
from numpy.typing import NDArray  # noqa: E402

from lcdata.errors import IntegrationError  # noqa: E402
from lcdata.geometry import se3  # noqa: E402
from lcdata.recording import fields  # noqa: E402
from lcdata.recording.odometry import cell_size, register, thin  # noqa: E402
from lcdata.simulation.lidars import make_lidar  # noqa: E402
from lcdata.simulation.mounts import default_rig  # noqa: E402
from lcdata.simulation.world import World  # noqa: E402

Array = NDArray[np.float64]
SCENARIOS = ("parking_lot", "gym", "yard")
SCANS, SCAN_S = 30, 0.1
VOXELS_M = (0.5, 1.0)
"""KISS-ICP's; by default a hundredth of the largest range, 1 m. At 0.2 m a scan takes seconds."""


def scans_of(world: World, name: str) -> tuple[list[Array], list[Array]]:
    """Points of each scan, and their seconds since its start."""
    lidar, around, motion = make_lidar(name), world.surroundings(0, 0), world.hand_motion(0, 0)
    clouds, times = [], []
    for number in range(SCANS):
        records = world.scan(around, lidar, 0, 0, number, motion)
        points = fields.points(records)
        there = np.isfinite(points[:, 0])
        time_field = fields.point_time(records, unit="ns")
        assert time_field is not None
        clouds.append(points[there].astype(float))
        times.append(time_field.since(records, 0)[there])
    return clouds, times


def errors(found: Array, true: Array) -> str:
    """Largest and median error of poses, each in the frame of the first one."""
    off = se3.inverse(se3.inverse(true[0]) @ true) @ (se3.inverse(found[0]) @ found)
    way = 1000 * np.linalg.norm(off[:, :3, 3], axis=1)
    cosine = (np.trace(off[:, :3, :3], axis1=1, axis2=2) - 1) / 2
    turn = np.rad2deg(np.arccos(np.clip(cosine, -1, 1)))
    return f"{np.median(way):6.1f} {way.max():6.1f} mm  {np.median(turn):.3f} {turn.max():.3f} deg"


def report(label: str, task: Callable[[], tuple[Array, Array]]) -> None:
    start = time.process_time()
    try:
        result = errors(*task())
    except IntegrationError as error:
        result = f"refused: {error}"
    seconds = (time.process_time() - start) / SCANS
    print(f"  {label:16} median, largest {result}  {1000 * seconds:5.0f} ms a scan", flush=True)


def ours(clouds: list[Array], times: list[Array], motion: Callable[[Array], Array]) -> None:
    def run() -> tuple[Array, Array]:
        cell = cell_size(clouds[0])
        thinned = [
            thin(round(k * SCAN_S * 1e9), points, seconds, cell)
            for k, (points, seconds) in enumerate(zip(clouds, times, strict=True))
        ]
        grid = np.arange(0.0, SCANS * SCAN_S, 0.05)
        return register(thinned, cell).at(0, grid), motion(grid)

    report("lcdata", run)


def theirs(clouds: list[Array], times: list[Array], motion: Callable[[Array], Array]) -> None:
    try:
        from kiss_icp.config import KISSConfig
        from kiss_icp.kiss_icp import KissICP
    except ImportError:
        return
    for voxel_m in VOXELS_M:

        def run(voxel_m: float = voxel_m) -> tuple[Array, Array]:
            config = KISSConfig()
            config.mapping.voxel_size = voxel_m
            config.data.min_range = 1.0
            config.registration.max_num_threads = 1
            odometry = KissICP(config)
            poses = []
            for points, seconds in zip(clouds, times, strict=True):
                odometry.register_frame(points, seconds / SCAN_S)
                poses.append(odometry.last_pose.copy())
            return np.array(poses), motion(SCAN_S * np.arange(1, SCANS + 1))

        report(f"kiss-icp {voxel_m:g} m", run)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, nargs="+", default=[31, 32])
    parser.add_argument("--lidar", nargs="+", default=["os1_64", "avia"])
    options = parser.parse_args()
    for name in options.lidar:
        for seed in options.seeds:
            for scenario in SCENARIOS:
                world = World(scenario, seed, default_rig())
                clouds, times = scans_of(world, name)
                motion = world.hand_motion(0, 0)
                print(f"{name} {scenario} seed {seed}: {len(clouds[0])} points a scan (simulated)")
                ours(clouds, times, motion)
                theirs(clouds, times, motion)


if __name__ == "__main__":
    main()
