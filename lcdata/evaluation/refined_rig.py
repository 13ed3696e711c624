"""A refinement as a rig file, which `lcdata groundtruth --rig` takes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import yaml

from lcdata.arm import Arm
from lcdata.dataset.atomic import write_bytes
from lcdata.errors import RigError
from lcdata.evaluation.refinement import Refinement
from lcdata.rig import Rig


def check_target(path: Path, force: bool) -> None:
    """Refuse to replace files unasked.

    Raises:
        RigError: The rig file, or the offsets file beside it, exists.
    """
    for target in (path, offsets_path(path)):
        if target.exists() and not force:
            raise RigError(f"{target} exists", "give another file, or --force")


def offsets_path(path: Path) -> Path:
    """The joint-offsets file beside a refined rig."""
    return path.with_name(f"{path.stem}_joint_offsets.yaml")


def write_refined_rig(refinement: Refinement, path: Path) -> None:
    """Write the rig with the refined links, and its arm's joint offsets where there are any.

    `lcdata groundtruth --rig` makes of it the ground truth and the covariance of
    `Refinement.truths`.

    Raises:
        DatasetError: The file cannot be written.
    """
    rig, arm = refinement.rig, refinement.refined_arm
    if arm.joint_offsets:
        content = rig.to_dict()
        content["arm"]["joint_offsets"] = offsets_path(path).name
        rig = Rig.from_dict(content)
        write_bytes(offsets_path(path), _offsets(arm).encode())
    write_bytes(path, (_head(refinement) + rig.to_yaml()).encode())


def _head(refinement: Refinement) -> str:
    """What a person wants to know of the numbers below it."""
    std = np.sqrt(np.diag(refinement.found.covariance))
    lines = [
        f"Links refined by `lcdata handeye` from {refinement.source} at "
        f"{len(refinement.poses)} poses of {refinement.dataset.path.resolve().name}.",
        "Standard deviations of each link alone, along and about x, y, z:",
    ]
    for name, part in (("T_camera_effector", std[:6]), ("T_base_lidar", std[6:])):
        millimetres = ", ".join(f"{1e3 * x:.2f}" for x in part[:3])
        degrees = ", ".join(f"{x:.4f}" for x in np.rad2deg(part[3:]))
        lines.append(f"  {name}: {millimetres} mm; {degrees} deg")
    lines.append("Their errors belong together: links_covariance, in m and rad.")
    return "".join(f"# {line}\n" for line in lines)


def _offsets(arm: Arm) -> str:
    named = {
        name: round(float(np.rad2deg(arm.joint_offsets.get(name, 0.0))), 12)
        for name in arm.joint_names
    }
    content: dict[str, Any] = {
        **({"serial": arm.serial} if arm.serial else {}),
        "model": arm.urdf.stem,
        "model_sha256": arm.sha256,
        "offsets_deg": named,
    }
    if arm.offset_covariance is not None and np.isfinite(arm.offset_covariance).all():
        degrees = np.rad2deg(np.rad2deg(arm.offset_covariance))
        content["offsets_covariance_deg2"] = [[float(f"{x:.12g}") for x in row] for row in degrees]
    head = "# Joint offsets of the arm of the rig beside it (`lcdata handeye`).\n"
    return head + yaml.safe_dump(content, sort_keys=False, default_flow_style=None)
