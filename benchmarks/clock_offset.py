"""Offset between the clocks of arm and camera on simulated recordings whose clocks are known.

    python benchmarks/clock_offset.py WORK

Recordings are simulated into WORK, where they are not there already; each has three or four images
of the moving arm. Each is measured as recorded and with 30 ms added to the joints' stamps.
"""

from __future__ import annotations

import argparse
import os
from dataclasses import replace
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from lcdata.errors import GroundTruthError
from lcdata.evaluation import clock_offset as module
from lcdata.recording.source import find_recordings
from lcdata.rig import load_rig
from lcdata.simulation import simulate
from lcdata.simulation.record import _CLOCKS
from lcdata.simulation.scenes import scenario_rng
from lcdata.simulation.schedule import clocks

ADDED_S = 0.03


def true_offset(scenario, seed):
    """Clock of the arm minus that of the camera, as the simulator drew them."""
    rng = scenario_rng(seed, scenario, _CLOCKS, 1)
    rng.integers(10**6), rng.integers(10**9)
    _, camera, arm = clocks(rng)
    return arm.offset_s - camera.offset_s


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("work", type=Path)
    options = parser.parse_args()
    survey = module.survey
    for scenario, seed in (("gym", 3), ("yard", 4), ("gym", 5), ("parking_lot", 6)):
        folder = options.work / f"{scenario}-{seed}-15" / "recordings"
        if not (folder / "rig.yaml").exists():
            simulate(
                folder, scenario=scenario, poses=15, pairs=1, seed=seed, azimuth_window_deg=140
            )
        path, rig = find_recordings(folder)[0], load_rig(folder / "rig.yaml")
        for added in (0.0, ADDED_S):
            shift = int(added * 1e9)

            def shifted(*arguments, shift=shift, **keywords):
                read = survey(*arguments, **keywords)
                return replace(read, joint_ns=read.joint_ns + shift)

            module.survey = shifted
            true = 1e3 * (true_offset(scenario, seed) + added)
            try:
                found = module.clock_offset(path, rig, images=6)
            except GroundTruthError as error:
                print(f"{scenario} seed {seed}: {true:+.1f} ms true, not measured ({error})")
                continue
            print(
                f"{scenario} seed {seed}: {true:+.1f} ms true, {1e3 * found.offset_s:+.1f} +- "
                f"{1e3 * found.std_s:.1f} ms from {found.moving} images in motion",
                flush=True,
            )


if __name__ == "__main__":
    main()
