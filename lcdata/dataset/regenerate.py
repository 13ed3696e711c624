"""The ground truth again, from stored joint positions: images and clouds are not touched.

`groundtruth/<version>.parquet` holds the poses of every version, poses.parquet those of the
present one. dataset.json is written last: until then the former version counts.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from lcdata import __version__
from lcdata.arm import Arm
from lcdata.arm_urdf import find_urdf
from lcdata.dataset import atomic, schema
from lcdata.dataset.arms import describe_arm, store_urdf
from lcdata.dataset.reader import Dataset, read_poses, read_table
from lcdata.dataset.schema import DatasetInfo, PoseRecord
from lcdata.errors import ArmError, DatasetError, RigError
from lcdata.geometry import se3
from lcdata.groundtruth.budget import Variances, variances
from lcdata.groundtruth.chain import PoseTruth, arm_truths, static_truth
from lcdata.rig import Rig, load_rig
from lcdata.rig_links import LINKS

OF_THE_PAIRS = ("topics", "pairing", "dwells", "stamps", "point_time")
"""Parts of a rig that chose the pairs, which stay as they are."""

OF_THE_TRUTH = (
    "arm",
    "note",
    "T_camera_effector",
    "T_base_lidar",
    "T_camera_lidar",
    "links_covariance",
    "clock_offset_std_s",
)

SAME = 1e-9
"""Metres, and relative for covariances: smaller differences make no other version."""


@dataclass(frozen=True)
class PoseChange:
    """What became of one pose.

    Args:
        pose_id: The pose.
        translation_mm: How far the extrinsic's translation moved.
        rotation_deg: How far it turned.
        before: Variances of the former ground truth, m^2 and rad^2; NaN where unknown.
        after: Of the new one.
    """

    pose_id: str
    translation_mm: float
    rotation_deg: float
    before: Variances
    after: Variances


@dataclass(frozen=True, eq=False)
class Regeneration:
    """A new ground truth, and how it differs from the former one.

    Args:
        dataset: The data set as it was.
        info: dataset.json as it will be.
        poses: Rows of poses.parquet as they will be.
        arm: The arm of the new ground truth; None without one.
        changes: What changed, pose by pose.
        inputs: Which values of rig and arm changed, a line each.
        ignored: Parts of the rig that differ and were not used: they chose the pairs.
    """

    dataset: Dataset
    info: DatasetInfo
    poses: tuple[PoseRecord, ...]
    arm: Arm | None
    changes: tuple[PoseChange, ...]
    inputs: tuple[str, ...]
    ignored: tuple[str, ...]

    @property
    def before(self) -> str:
        """The former version."""
        return self.dataset.info.groundtruth_version

    @property
    def after(self) -> str:
        """The new version; the former one if no value changed."""
        return self.info.groundtruth_version

    @cached_property
    def moved(self) -> dict[str, float]:
        """Medians and maxima over the poses, and the root mean square uncertainties."""
        table = np.array([(c.translation_mm, c.rotation_deg) for c in self.changes])
        sigma = np.array([(*c.before, *c.after) for c in self.changes]).mean(axis=0) ** 0.5
        return {
            "median_mm": float(np.median(table[:, 0])),
            "max_mm": float(table[:, 0].max()),
            "median_deg": float(np.median(table[:, 1])),
            "max_deg": float(table[:, 1].max()),
            "sigma_before_mm": float(1e3 * sigma[0]),
            "sigma_before_deg": float(np.rad2deg(sigma[1])),
            "sigma_after_mm": float(1e3 * sigma[2]),
            "sigma_after_deg": float(np.rad2deg(sigma[3])),
        }

    def to_dict(self) -> dict[str, Any]:
        """Plain values."""
        return {
            "dataset": self.dataset.path,
            "before": self.before,
            "after": self.after,
            "changed": self.before != self.after,
            "inputs": list(self.inputs),
            "ignored": list(self.ignored),
            **self.moved,
            "poses": [
                {
                    "pose_id": c.pose_id,
                    "translation_mm": c.translation_mm,
                    "rotation_deg": c.rotation_deg,
                    "sigma_before_mm": 1e3 * c.before.translation**0.5,
                    "sigma_before_deg": float(np.rad2deg(c.before.rotation**0.5)),
                    "sigma_after_mm": 1e3 * c.after.translation**0.5,
                    "sigma_after_deg": float(np.rad2deg(c.after.rotation**0.5)),
                }
                for c in self.changes
            ],
        }


def regenerate(
    dataset: Dataset,
    rig: Rig | Path | None = None,
    *,
    arm_offsets: Path | None = None,
    dry_run: bool = False,
) -> Regeneration:
    """Compute the ground truth of a data set again and store it as a new version.

    Args:
        dataset: The data set; open it again to see the new version.
        rig: Its links, arm and standard deviations; by default those stored in the data set.
        arm_offsets: A per-serial YAML in place of the rig's joint offsets.
        dry_run: Compute the change only.

    Raises:
        RigError: The rig's camera or kind of ground truth is not that of the data set.
        ArmError: Other joints, joint offsets of another arm, a pose outside the limits.
        DatasetError: Nothing can be recomputed, or it cannot be written. What was there stays.
    """
    given = rig if isinstance(rig, Rig) or rig is None else load_rig(Path(rig))
    if given is not None:
        _check_mode(dataset, given)
        _check_camera(dataset, given)
    used, ignored = _merged(dataset, given, arm_offsets)
    arm = None
    if dataset.rig.ground_truth == "arm":
        arm = _arm(dataset, given, arm_offsets)
    elif arm_offsets is not None:
        raise RigError(f"{dataset.path} has no arm", "--arm-offsets goes with ground_truth: arm")
    truths = _truths(dataset, used, arm)
    poses = [_with(pose, truth) for pose, truth in zip(dataset.poses, truths, strict=True)]
    same = list(map(_same, dataset.poses, poses))
    version = dataset.info.groundtruth_version if all(same) else schema.groundtruth_version(poses)
    poses = [
        replace(
            new,
            groundtruth_version=version,
            pose_version=old.pose_version if kept else schema.pose_version(new),
        )
        for old, new, kept in zip(dataset.poses, poses, same, strict=True)
    ]
    described = describe_arm(used.arm.model, arm) if arm else None
    changes = tuple(_change(old, new) for old, new in zip(dataset.poses, poses, strict=True))
    info = replace(
        dataset.info,
        rig=schema.plain(used.to_dict()),
        arm=schema.plain(described),
        groundtruth_version=version,
    )
    inputs = tuple(_differences(dataset.info, info))
    result = Regeneration(dataset, info, tuple(poses), arm, changes, inputs, ignored)
    if result.before != result.after:
        entry = {
            "version": result.before,
            "rig": dataset.info.rig,
            "arm": dataset.info.arm,
            "lcdata_version": dataset.info.lcdata_version,
            "replaced_by": result.after,
            "inputs": list(inputs),
            "moved": {k: v if np.isfinite(v) else None for k, v in result.moved.items()},
        }
        history = (*dataset.info.groundtruth_history, schema.plain(entry))
        info = replace(info, groundtruth_history=history, lcdata_version=__version__)
        result = replace(result, info=info)
    if not dry_run:
        _write(result)
    return result


def versions(dataset: Dataset) -> list[str]:
    """Versions of the ground truth, oldest first, the present one last."""
    history = [entry["version"] for entry in dataset.info.groundtruth_history]
    return [*history, dataset.info.groundtruth_version]


def poses_of(dataset: Dataset, version: str) -> list[PoseRecord]:
    """Poses as they were in a version of the ground truth.

    Raises:
        DatasetError: There was no such version.
    """
    if version == dataset.info.groundtruth_version:
        return list(dataset.poses)
    if version not in versions(dataset):
        raise DatasetError(
            f"{dataset.path} has no ground truth version {version!r}",
            f"it has {', '.join(versions(dataset))}",
        )
    return read_poses(dataset.path / schema.version_file(version))


def _check_mode(dataset: Dataset, rig: Rig) -> None:
    stored = dataset.rig.ground_truth
    if rig.ground_truth != stored:
        raise RigError(
            f"the rig has ground_truth: {rig.ground_truth}, {dataset.path} has {stored}",
            "build the data set again from its recordings",
        )


def _check_camera(dataset: Dataset, rig: Rig) -> None:
    """The intrinsics are part of the pairs: methods have used them."""
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


def _camera_differences(new: Any, old: Any) -> Iterator[str]:
    for key in ("model", "width", "height", "intrinsics", "distortion"):
        a, b = getattr(new, key), getattr(old, key)
        if a != b:
            yield f"{key} {_short(a)}, not {_short(b)}"


def _merged(
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


def _arm(dataset: Dataset, given: Rig | None, arm_offsets: Path | None) -> Arm:
    """The arm of the new ground truth; what the rig names as before and is gone, is stored."""
    if given is None:
        arm = dataset.load_arm()
    else:
        section, before = given.arm, dataset.rig.arm
        folder = given.folder or Path()
        try:
            urdf = find_urdf(section.model, given.folder)
        except ArmError:
            if section.model != before.model:
                raise
            urdf = dataset.load_arm().urdf
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


def _truths(dataset: Dataset, rig: Rig, arm: Arm | None) -> list[PoseTruth]:
    poses = dataset.poses
    if arm is None:
        if rig.T_camera_lidar is None:
            raise DatasetError(
                f"{dataset.path}: its extrinsics come from the recordings' /tf_static, there is "
                "nothing to recompute them from",
                "give --rig with T_camera_lidar, or build the data set again",
            )
        return [static_truth(rig)] * len(poses)
    for pose in poses:
        try:
            arm.check_limits(pose.joint_positions)
        except ArmError as error:
            raise ArmError(f"{pose.pose_id}: {error.message}", error.remedy) from error
    return arm_truths(
        rig,
        arm,
        [pose.joint_positions for pose in poses],
        [pose.joint_positions_std for pose in poses],
        [pose.samples for pose in poses],
        [(pose.end_ns - pose.start_ns) * 1e-9 for pose in poses],
    )


def _with(pose: PoseRecord, truth: PoseTruth) -> PoseRecord:
    return replace(
        pose,
        **{
            name: getattr(truth, name)
            for name in ("T_camera_lidar", "covariance", "budget", *schema.LINKS)
        },
    )


def _same(old: PoseRecord, new: PoseRecord) -> bool:
    """Whether only rounding differs, as it does from one machine to another."""
    scale = SAME * float(np.abs(old.covariance).max())
    return np.allclose(new.T_camera_lidar, old.T_camera_lidar, rtol=0, atol=SAME) and np.allclose(
        new.covariance, old.covariance, rtol=0, atol=scale, equal_nan=True
    )


def _change(old: PoseRecord, new: PoseRecord) -> PoseChange:
    return PoseChange(
        old.pose_id,
        1e3 * se3.translation_error(new.T_camera_lidar, old.T_camera_lidar),
        float(np.rad2deg(se3.rotation_error(new.T_camera_lidar, old.T_camera_lidar))),
        variances(old.T_camera_lidar, old.covariance),
        variances(new.T_camera_lidar, new.covariance),
    )


def _differences(old: DatasetInfo, new: DatasetInfo) -> Iterator[str]:
    """Values of rig and arm that are not as before: key, before, after."""
    pairs = [
        ({"rig": schema.plain(info.rig), "arm_model": schema.plain(info.arm)})
        for info in (old, new)
    ]
    before, after = (dict(_flat(content, "")) for content in pairs)
    for key in dict.fromkeys([*before, *after]):
        a, b = before.get(key), after.get(key)
        if a != b:
            yield f"{key}: {_short(a)} -> {_short(b)}"


def _flat(value: Any, prefix: str) -> Iterator[tuple[str, Any]]:
    if isinstance(value, Mapping):
        for key, item in value.items():
            yield from _flat(item, f"{prefix}.{key}" if prefix else str(key))
    else:
        yield prefix, None if value == "" else value


def _short(value: Any) -> str:
    if value is None:
        return "none"
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, Sequence) and not isinstance(value, str):
        text = f"[{', '.join(_short(item) for item in value)}]"
        return text if len(text) <= 80 else f"{text[:77]}..."
    return str(value)


def _write(result: Regeneration) -> None:
    """The new version beside the former one; dataset.json, the last file, makes it count."""
    folder, old = result.dataset.path, result.dataset
    column = read_table(folder / schema.POSES).column("groundtruth_version")
    on_disk = set(column.to_pylist())
    has_budget = all(
        a.budget.keys() == b.budget.keys() for a, b in zip(old.poses, result.poses, strict=True)
    )
    if not result.inputs and has_budget and on_disk == {result.after}:
        return
    table = schema.poses_table(result.poses)
    if result.before != result.after:
        former = folder / schema.version_file(result.before)
        if on_disk == {result.before}:
            atomic.write_bytes(former, (folder / schema.POSES).read_bytes())
        elif not former.is_file():
            atomic.write_parquet(former, schema.poses_table(old.poses))
        atomic.write_parquet(folder / schema.version_file(result.after), table)
    if result.arm is not None:
        store_urdf(folder, result.arm)
    with atomic.write_atomically(folder / schema.INFO) as info:
        info.write_text(atomic.json_text(result.info.to_dict()), encoding="utf-8")
        # Both files are complete before the first of them takes its name.
        atomic.write_parquet(folder / schema.POSES, table)
