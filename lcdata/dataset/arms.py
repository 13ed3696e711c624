"""The arm of a data set: described so that it can be loaded without the rig's own files."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from lcdata.arm import find_urdf, model_directory
from lcdata.dataset import schema
from lcdata.dataset.atomic import write_bytes
from lcdata.errors import DatasetError

if TYPE_CHECKING:
    from lcdata.arm import Arm
    from lcdata.dataset.schema import DatasetInfo
    from lcdata.rig import Rig


def describe_arm(model: str, arm: Arm) -> dict[str, Any]:
    """What determines an arm's kinematics and how well they are known, plain values."""
    covariance = arm.offset_covariance
    return {
        "model": model,
        "sha256": arm.sha256,
        "base_frame": arm.base_frame,
        "effector_frame": arm.effector_frame,
        "joint_names": list(arm.joint_names),
        "joint_offsets": {name: arm.joint_offsets[name] for name in sorted(arm.joint_offsets)},
        "offset_covariance": None
        if covariance is None
        else [[None if np.isnan(v) else float(v) for v in row] for row in covariance],
        "serial": arm.serial,
        "urdf": None if _in_package(arm) else _stored_urdf(arm),
    }


def store_urdf(folder: Path, arm: Arm) -> None:
    """Keep the arm's URDF in the data set, if the package does not have it."""
    if not _in_package(arm) and not (folder / _stored_urdf(arm)).is_file():
        write_bytes(folder / _stored_urdf(arm), arm.urdf.read_bytes())


def load_arm(folder: Path, info: DatasetInfo, rig: Rig) -> Arm:
    """The arm as described in dataset.json.

    Raises:
        DatasetError: There is none, or the URDF of its name is another one.
        ArmError: No URDF of its name.
    """
    from lcdata.arm import Arm

    described = info.arm
    if described is None:
        raise DatasetError(f"{folder} was made without an arm", "its ground truth is static")
    own = described.get("urdf")
    urdf = (folder / own).resolve() if own else find_urdf(described["model"])
    covariance = described.get("offset_covariance")
    arm = Arm(
        urdf,
        described.get("base_frame", rig.arm.base_frame),
        described.get("effector_frame", rig.arm.effector_frame),
        dict(described.get("joint_offsets", {})),
        None if covariance is None else np.array(covariance, float),
        described.get("serial", ""),
    )
    if described.get("sha256", arm.sha256) != arm.sha256:
        raise DatasetError(
            f"{folder} was made with a {described['model']}.urdf of sha256 "
            f"{described['sha256'][:12]}, {urdf} has {arm.sha256[:12]}",
            "give a rig whose arm.model is the URDF of then, or accept the new one by a rig",
        )
    return arm


def _stored_urdf(arm: Arm) -> str:
    """Its place in the data set: by content, for versions of the ground truth may have others."""
    return f"{schema.GROUNDTRUTH}/{arm.sha256[:12]}/{arm.urdf.name}"


def _in_package(arm: Arm) -> bool:
    return arm.urdf.resolve().is_relative_to(model_directory().resolve())
