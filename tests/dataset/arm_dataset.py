"""The small data set with poses that an arm's chain gives, as a build makes them."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from lcdata.dataset import Dataset, schema, writer
from lcdata.dataset.arms import describe_arm, store_urdf
from lcdata.groundtruth.chain import arm_truth
from lcdata.rig import Rig

from . import small_dataset as small

RIG: dict[str, Any] = {
    "arm": {"joint_offset_std_deg": 0.1},
    "T_camera_effector": {
        "translation_m": [0.01, 0.02, 0.03],
        "rotation_rpy_deg": [1, 2, 3],
        "translation_std_m": 0.003,
        "rotation_std_deg": 0.2,
    },
    "T_base_lidar": {
        "translation_m": [0.1, 0.2, 0.3],
        "rotation_rpy_deg": [4, 5, 6],
        "translation_std_m": 0.003,
        "rotation_std_deg": 0.2,
    },
}


def write(folder: Path, rig: Rig | None = None) -> Dataset:
    """Two scenarios, two poses each, with the ground truth of a rig."""
    small.write(folder)
    rig = rig or Rig.from_dict(RIG)
    arm, dataset = rig.load_arm(), Dataset.open(folder)
    poses = []
    for number, pose in enumerate(dataset.poses):
        q = np.array([0.1, -0.4, 0.9, 0.2, -0.5, 0.3]) * (1 + 0.2 * number)
        scatter = pose.joint_positions_std
        truth = arm_truth(rig, arm, q, scatter, pose.samples, 1.0)
        values = {name: getattr(truth, name) for name in ("T_camera_lidar", *schema.LINKS)}
        poses.append(
            replace(
                pose,
                joint_positions=q,
                covariance=truth.covariance,
                budget=truth.budget,
                **values,
            )
        )
    info = replace(
        dataset.info,
        rig=schema.plain(rig.to_dict()),
        arm=schema.plain(describe_arm(rig.arm.model, arm)),
    )
    store_urdf(folder, arm)
    writer.write_index(folder, info, dataset.pairs, poses)
    return Dataset.open(folder)


def edit_info(folder: Path, **values: Any) -> None:
    """Change dataset.json by hand."""
    content = json.loads((folder / schema.INFO).read_text())
    (folder / schema.INFO).write_text(json.dumps(content | values))
