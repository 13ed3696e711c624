"""A refinement as a rig file, which `lcdata groundtruth --rig` takes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from lcdata.dataset.atomic import write_bytes
from lcdata.errors import RigError
from lcdata.evaluation.handeye import Refinement
from lcdata.geometry import se3
from lcdata.rig import Rig

Array = NDArray[np.float64]


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

    A rig holds two independent links, so the correlation between them is left out: the ground
    truth that it makes is known a little better than its covariance says.

    Raises:
        DatasetError: The file cannot be written.
    """
    rig, found = refinement.dataset.rig, refinement.found
    std = np.sqrt(np.diag(found.covariance))
    content = rig.to_dict()
    content["T_camera_effector"] = _link(found.T_camera_effector, std[:6])
    content["T_base_lidar"] = _link(found.T_base_lidar, std[6:])
    arm = refinement.refined_arm
    if arm.joint_offsets:
        content["arm"]["joint_offsets"] = offsets_path(path).name
        write_bytes(offsets_path(path), _offsets(refinement).encode())
    text = (
        f"# Links refined by `lcdata handeye` from {refinement.source} at "
        f"{len(refinement.poses)} poses of {refinement.dataset.path.resolve().name}.\n"
    )
    write_bytes(path, (text + Rig.from_dict(content).to_yaml()).encode())


def _link(T: Array, std: Array) -> dict[str, Any]:
    values = se3.to_xyz_xyzw(T)
    return {
        "translation_m": [round(float(x), 6) for x in values[:3]],
        "rotation_xyzw": [round(float(x), 9) for x in values[3:]],
        "translation_std_m": [round(float(x), 6) for x in std[:3]],
        "rotation_std_deg": [round(float(x), 5) for x in np.rad2deg(std[3:])],
    }


def _offsets(refinement: Refinement) -> str:
    arm, found = refinement.refined_arm, refinement.found
    named = {
        name: round(float(np.rad2deg(arm.joint_offsets.get(name, 0.0))), 5)
        for name in arm.joint_names
    }
    content: dict[str, Any] = {
        **({"serial": arm.serial} if arm.serial else {}),
        "model": arm.urdf.stem,
        "model_sha256": arm.sha256,
        "offsets_deg": named,
    }
    n = len(found.joint_offsets)
    covariance = found.full_covariance[12 : 12 + n, 12 : 12 + n] if n else arm.offset_covariance
    if covariance is not None and np.isfinite(covariance).all():
        degrees = np.rad2deg(np.rad2deg(covariance))
        content["offsets_covariance_deg2"] = [[float(f"{x:.6g}") for x in row] for row in degrees]
    head = "# Joint offsets of the arm of the rig beside it (`lcdata handeye`).\n"
    return head + yaml.safe_dump(content, sort_keys=False, default_flow_style=None)
