"""The rig and the arm that a new ground truth is of, and what of them must be as at the build."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

from lcdata.arm import Arm, find_urdf
from lcdata.dataset.groundtruth_change import shown
from lcdata.dataset.reader import Dataset
from lcdata.errors import ArmError, RigError
from lcdata.rig import Rig
from lcdata.rig_links import LINKS

OF_THE_PAIRS = ("topics", "joint_log", "pairing", "dwells", "stamps", "point_time")
"""Parts of a rig that chose the pairs, which stay as they are."""

OF_THE_TRUTH = (
    "arm",
    "note",
    "T_camera_effector",
    "T_base_lidar",
    "T_camera_lidar",
    "links_covariance",
    "links_refined_from",
    "clock_offset_std_s",
)


def check_mode(dataset: Dataset, rig: Rig) -> None:
    """Refuse a rig of another kind of ground truth."""
    stored = dataset.rig.ground_truth
    if rig.ground_truth != stored:
        raise RigError(
            f"the rig has ground_truth: {rig.ground_truth}, {dataset.path} has {stored}",
            "build the data set again from its recordings",
        )


def check_camera(dataset: Dataset, rig: Rig) -> None:
    """Refuse a rig of another camera: methods have used the intrinsics that the pairs have."""
    camera, remedy = rig.camera_model(), "build the data set again from its recordings"
    if camera is None:
        if dataset.rig.camera is not None:
            raise RigError(
                f"the rig gives no camera, {dataset.path} was built with the rig's own",
                "give the same camera, or build the data set again",
            )
        return
    for name, scenario in dataset.info.scenarios.items():
        if camera != scenario.camera:
            raise RigError(
                f"the rig's camera is not the one that {name} was built with: "
                f"{', '.join(_camera_differences(camera, scenario.camera))}",
                remedy,
            )


def check_clock(dataset: Dataset, rig: Rig) -> None:
    """An offset moves the joints' stamps, so the dwells and the means over them: all are stored."""
    stored = dataset.rig.clock_offset_s
    if (rig.clock_offset_s or 0.0) != (stored or 0.0):
        shown = ["none" if x is None else f"{x}" for x in (rig.clock_offset_s, stored)]
        raise RigError(
            f"the rig has clock_offset_s: {shown[0]}, {dataset.path} was built with {shown[1]}, "
            "and its joint positions are means over dwells of those stamps",
            "give the same one, or build the data set again from its recordings",
        )


def _camera_differences(new: Any, old: Any) -> Iterator[str]:
    for key in ("model", "width", "height", "intrinsics", "distortion"):
        a, b = getattr(new, key), getattr(old, key)
        if a != b:
            yield f"{key} {shown(a)}, not {shown(b)}"


def merged(
    dataset: Dataset, given: Rig | None, arm_offsets: Path | None
) -> tuple[Rig, tuple[str, ...]]:
    """The stored rig with the given one's ground truth, and which other parts differ."""
    stored = dataset.rig.to_dict()
    content, ignored = dict(stored), []
    if given is not None:
        new = given.to_dict()
        content = {k: v for k, v in stored.items() if k not in OF_THE_TRUTH}
        content |= {k: v for k, v in new.items() if k in OF_THE_TRUTH}
        ignored = [name for name in OF_THE_PAIRS if stored.get(name) != new.get(name)]
    if arm_offsets is not None:
        if len(content.get("links_covariance", ())) > LINKS:
            raise RigError(
                "the rig's links_covariance is of links refined with its own joint offsets",
                "leave --arm-offsets out, or refine again with those offsets",
            )
        content["arm"] = content["arm"] | {"joint_offsets": Path(arm_offsets).name}
    return Rig.from_dict(content), tuple(ignored)


def arm_of(dataset: Dataset, given: Rig | None, arm_offsets: Path | None) -> Arm:
    """The arm of the new ground truth; what the rig names as before and is gone, is stored."""
    if given is None:
        arm = dataset.load_arm()
    else:
        section, before = given.arm, dataset.rig.arm
        folder = given.folder or Path()
        try:
            with given.naming_arm("model"):
                urdf = find_urdf(section.model, given.folder)
        except ArmError:
            if section.model != before.model:
                raise
            urdf = dataset.load_arm().urdf
        with given.naming_arm("base_frame", "effector_frame"):
            arm = Arm(urdf, section.base_frame, section.effector_frame, serial=section.serial or "")
        if section.joint_offsets is not None and arm_offsets is None:
            file = folder / section.joint_offsets
            if section.joint_offsets == before.joint_offsets and not file.is_file():
                stored = dataset.load_arm()
                arm = replace(
                    arm,
                    joint_offsets=stored.joint_offsets,
                    offset_covariance=stored.offset_covariance,
                    serial=arm.serial or stored.serial,
                )
            else:
                with given.naming_arm("joint_offsets"):
                    arm = arm.with_offsets_of(file)
    if arm_offsets is not None:
        arm = arm.with_offsets_of(Path(arm_offsets))
    names = tuple((dataset.info.arm or {})["joint_names"])
    if arm.joint_names != names:
        raise ArmError(
            f"the rig's arm moves {', '.join(arm.joint_names)}, {dataset.path} has positions of "
            f"{', '.join(names)}",
            "build the data set again from its recordings",
        )
    return arm
