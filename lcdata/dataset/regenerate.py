"""The ground truth again, from stored joint positions: images and clouds are not touched."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from lcdata import __version__
from lcdata.arm import Arm
from lcdata.dataset import schema
from lcdata.dataset.arms import describe_arm
from lcdata.dataset.groundtruth_change import Regeneration, change, differences, is_same
from lcdata.dataset.groundtruth_rig import arm_of, check_camera, check_clock, check_mode, merged
from lcdata.dataset.groundtruth_versions import write_version
from lcdata.dataset.reader import Dataset
from lcdata.dataset.schema import PoseRecord
from lcdata.errors import ArmError, DatasetError, RigError
from lcdata.groundtruth.chain import PoseTruth, arm_truths, static_truth
from lcdata.rig import Rig, load_rig


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
        RigError: The rig's camera, clock offset or kind of ground truth is not that of the data
            set.
        ArmError: Other joints, joint offsets of another arm, a pose outside the limits.
        DatasetError: Nothing can be recomputed, or it cannot be written. What was there stays.
    """
    given = rig if isinstance(rig, Rig) or rig is None else load_rig(Path(rig))
    if given is not None:
        check_mode(dataset, given)
        check_camera(dataset, given)
        check_clock(dataset, given)
    used, ignored = merged(dataset, given, arm_offsets)
    arm = None
    if dataset.rig.ground_truth == "arm":
        arm = arm_of(dataset, given, arm_offsets)
    elif arm_offsets is not None:
        raise RigError(f"{dataset.path} has no arm", "--arm-offsets goes with ground_truth: arm")
    truths = _truths(dataset, used, arm)
    poses = [_with(pose, truth) for pose, truth in zip(dataset.poses, truths, strict=True)]
    same = list(map(is_same, dataset.poses, poses))
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
    changes = tuple(change(old, new) for old, new in zip(dataset.poses, poses, strict=True))
    info = replace(
        dataset.info,
        rig=schema.plain(used.to_dict()),
        arm=schema.plain(described),
        groundtruth_version=version,
    )
    inputs = tuple(differences(dataset.info, info))
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
        write_version(result)
    return result


def _truths(dataset: Dataset, rig: Rig, arm: Arm | None) -> list[PoseTruth]:
    poses = dataset.poses
    if arm is None:
        if rig.T_camera_lidar is None:
            raise DatasetError(
                f"{dataset.path}: its extrinsics come from the recordings' /tf_static or were "
                "published, there is nothing to recompute them from",
                "give --rig with T_camera_lidar, or build or import the data set again",
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
