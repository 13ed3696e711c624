"""truth.json: what only tests and the evaluation of the ground truth may read."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lcdata.errors import SimulationError
from lcdata.rig import Rig, load_rig
from lcdata.simulation.mounts import Mounts
from lcdata.simulation.world import World

Array = NDArray[np.float64]

TRUTH, RIG = "truth.json", "rig.yaml"


def check_same_tower(
    folder: Path, rig: Rig, mounts: Mounts, offsets: Array, force: bool = False
) -> None:
    """Refuse a folder whose recordings were made with another tower.

    Raises:
        SimulationError: Its truth has other mounts or joint offsets, or its rig differs.
    """
    truth = read_truth(folder)
    if truth is not None:
        same = (
            np.allclose(truth["T_camera_effector"], mounts.T_camera_effector, atol=1e-9)
            and np.allclose(truth["T_base_lidar"], mounts.T_base_lidar, atol=1e-9)
            and np.allclose(truth.get("joint_offsets_rad", 0.0), offsets, atol=1e-12)
        )
        if not same:
            raise SimulationError(
                f"{folder / TRUTH} is of other mounts (seed {truth.get('seed')})",
                "use its seed and rig, or another folder",
            )
    path = folder / RIG
    if path.exists() and not force and load_rig(path).to_dict() != rig.to_dict():
        raise SimulationError(
            f"{path} is another rig than the simulated one",
            f"use it (--rig {path}), another folder, or --force",
        )


def read_truth(folder: Path) -> dict[str, Any] | None:
    """Content of a folder's truth.json; None if there is none.

    Raises:
        SimulationError: Not the truth of a simulation.
    """
    path = folder / TRUTH
    if not path.exists():
        return None
    try:
        truth = json.loads(path.read_text(encoding="utf-8"))
        complete = {"T_camera_effector", "T_base_lidar", "poses"} <= set(truth)
    except (ValueError, TypeError):
        complete = False
    if not complete:
        raise SimulationError(f"{path} is not a simulation's truth", "give another folder")
    result: dict[str, Any] = truth
    return result


def write_truth(
    folder: Path, world: World, positions: Array, offsets: Array, clock_offset_s: float
) -> None:
    """Add a recording's poses to truth.json, replacing those of an older one of its name.

    Args:
        folder: Where the recordings are.
        world: What was recorded.
        positions: (P, n) true joint positions of its poses, radians.
        offsets: (n,) zero-point errors of the joints, radians.
        clock_offset_s: Clock of the arm minus clock of the camera as the recording begins.
    """
    old = read_truth(folder) or {"poses": {}}
    prefix = f"{world.scenario}/"
    poses = {name: pose for name, pose in old["poses"].items() if not name.startswith(prefix)}
    for k, q in enumerate(positions):
        poses[f"{prefix}pose_{k:03d}"] = {
            "T_camera_lidar": world.T_camera_lidar(q).tolist(),
            "joint_positions": q.tolist(),
        }
    truth = {
        "simulated": True,
        "seed": world.seed,
        "T_camera_effector": world.mounts.T_camera_effector.tolist(),
        "T_base_lidar": world.mounts.T_base_lidar.tolist(),
        "joint_offsets_rad": offsets.tolist(),
        "clock_offset_s": old.get("clock_offset_s", {}) | {world.scenario: clock_offset_s},
        "poses": dict(sorted(poses.items())),
    }
    replace_file(folder / TRUTH, json.dumps(truth, indent=1) + "\n")


def write_rig(folder: Path, rig: Rig) -> None:
    """Write rig.yaml, as it was measured by hand."""
    replace_file(folder / RIG, rig.to_yaml())


def replace_file(path: Path, text: str) -> None:
    """Write a file that is there in full or not at all."""
    temporary = path.with_name(f".{path.name}-{os.getpid()}")
    try:
        temporary.write_text(text, encoding="utf-8")
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)
