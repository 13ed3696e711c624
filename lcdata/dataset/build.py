"""Recordings to a data set: the main path, in the order of the method.

    recordings -> topics -> stamps and joints -> dwells -> pairs -> ground truth -> files

Each recording is read twice: once for all stamps and joint positions, once for the clouds and
images that were chosen, so neither its length nor its order of messages costs memory.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from lcdata.arm import Arm
from lcdata.dataset import schema
from lcdata.dataset.journal import NAME, Journal
from lcdata.dataset.packing import write_pairs
from lcdata.dataset.reader import Dataset, read_info
from lcdata.dataset.schema import DatasetInfo, PairRecord, PoseRecord, Scenario
from lcdata.dataset.sources import check_names, describe_arm, describe_source, find_rig
from lcdata.dataset.writer import write_index
from lcdata.errors import ArmError, DatasetError, GeometryError, LcdataError, RecordingError
from lcdata.geometry.camera import Camera
from lcdata.groundtruth.chain import PoseTruth, arm_truth, static_truth
from lcdata.recording.dwells import Dwell, find_dwells
from lcdata.recording.plan import PosePlan, plan_poses
from lcdata.recording.source import Recording, find_recordings, open_recording
from lcdata.recording.survey import Survey, survey
from lcdata.recording.topics import Topics, choose_topics
from lcdata.recording.transforms import static_extrinsic
from lcdata.rig import Rig, load_rig

Progress = Callable[[str, int, int], None]
"""Called with what is being done, how much of it is, and of how much."""

RESERVED = (schema.RESULTS, schema.REPORT, schema.REVIEW, NAME)


@dataclass(frozen=True)
class BuildSummary:
    """What a build made.

    Args:
        dataset: The data set, opened.
        pairs: Number of its pairs.
        poses: Number of its arm poses.
        failures: Recordings, poses and pairs that could not be used, a line each.
    """

    dataset: Dataset
    pairs: int
    poses: int
    failures: list[str]


@dataclass
class _Part:
    """What one recording gives."""

    scenario: Scenario
    poses: list[PoseRecord]
    pairs: list[PairRecord]
    failures: list[str] = field(default_factory=list)


def build(
    recordings: Path,
    out: Path,
    rig: Path | None = None,
    *,
    pairs_per_pose: int | None = None,
    force: bool = False,
    progress: Progress | None = None,
) -> BuildSummary:
    """Package recordings into a data set with ground truth.

    A build that was interrupted goes on where it stopped; one that is complete is left as it is.

    Args:
        recordings: A recording or a folder of them.
        out: Folder of the data set.
        rig: Rig file; by default rig.yaml in the recordings' folder or beside the recording.
        pairs_per_pose: At most so many pairs of each pose, evenly spread; None for all.
        force: Replace a data set of other recordings or of another rig.
        progress: See `Progress`.

    Raises:
        DatasetError: `out` holds something else, or cannot be written.
        RigError: No rig, or a wrong one.
        LcdataError: No recording can be used; the first one's reason.
    """
    recordings, out = Path(recordings), Path(out)
    paths = find_recordings(recordings)
    check_names(paths, RESERVED)
    used = load_rig(Path(rig) if rig else find_rig(recordings, paths))
    arm = used.load_arm() if used.ground_truth == "arm" else None
    what: dict[str, Any] = {
        "sources": [describe_source(path) for path in paths],
        "rig": used.to_dict(),
        "arm": describe_arm(used.arm.model, arm) if arm else None,
        "pairs_per_pose": pairs_per_pose,
    }
    if not force and (complete := _already_built(out, what)):
        return complete
    with Journal.open(out, what, force=force) as journal:
        parts: dict[str, _Part] = {}
        failures: list[str] = []
        errors: list[LcdataError] = []
        for path in paths:
            try:
                with open_recording(path, used.stamps) as recording:
                    part = _package(
                        recording,
                        used,
                        arm,
                        journal=journal,
                        pairs_per_pose=pairs_per_pose,
                        progress=progress,
                    )
                parts[recording.scenario] = part
                failures += part.failures
            except DatasetError:
                raise
            except LcdataError as error:
                errors.append(error)
                failures.append(str(error))
        pairs = [pair for part in parts.values() for pair in part.pairs]
        if not pairs:
            journal.abandon()
            raise _nothing(recordings, errors, failures)
        taken = {pair.pose_id for pair in pairs}
        poses = [p for part in parts.values() for p in part.poses if p.pose_id in taken]
        info = DatasetInfo(
            rig=what["rig"],
            arm=what["arm"],
            sources=tuple(what["sources"]),
            scenarios={name: part.scenario for name, part in parts.items() if part.pairs},
            simulated=used.simulated,
            pairs_per_pose=pairs_per_pose,
            failures=tuple(failures),
        )
        write_index(out, info, pairs, poses)
        journal.close_build()
    return BuildSummary(Dataset.open(out), len(pairs), len(poses), failures)


def _package(
    recording: Recording,
    rig: Rig,
    arm: Arm | None,
    *,
    journal: Journal,
    pairs_per_pose: int | None,
    progress: Progress | None,
) -> _Part:
    """One recording into the data set."""
    topics = choose_topics(recording, rig)
    surveyed = survey(recording, topics, arm)
    camera = _camera(recording, rig, topics, surveyed)
    dwells = find_dwells(surveyed.joint_ns, surveyed.positions, rig.dwells) if arm else None
    plans = plan_poses(
        recording.scenario,
        surveyed,
        dwells,
        tolerance_ms=rig.pairing.tolerance_ms,
        pairs_per_pose=pairs_per_pose,
    )
    if not any(len(plan.lidar_ns) for plan in plans):
        raise RecordingError(f"{recording.path}: {_no_pairs(plans, rig)}", _remedy(plans))
    lidar_frame, camera_frame = (_frame(recording, name) for name in (topics.lidar, topics.image))
    failures = [f"{recording.path}: {p.pose_id}: {p.reason}" for p in plans if p.reason]
    poses: list[PoseRecord] = []
    extrinsic = None
    if arm is None and rig.T_camera_lidar is None:
        extrinsic = static_extrinsic(recording, camera_frame, lidar_frame)
    for plan in plans:
        try:
            if arm is None:
                truth = static_truth(rig, extrinsic)
            else:
                truth = _arm_truth(rig, arm, plan.dwell)
        except ArmError as error:
            failures.append(f"{recording.path}: {plan.pose_id}: {error}")
            continue
        poses.append(_pose_record(recording.scenario, plan, truth))
    known = {pose.pose_id for pose in poses}
    plans = [plan for plan in plans if plan.pose_id in known]
    pairs, unusable = write_pairs(
        recording, topics, plans, camera=camera, journal=journal, progress=progress
    )
    return _Part(
        Scenario(
            camera=camera,
            topics={role: getattr(topics, role) for role in Topics.__dataclass_fields__},
            lidar_frame=lidar_frame,
            camera_frame=camera_frame,
        ),
        poses,
        pairs,
        [*recording.problems, *failures, *unusable],
    )


def _camera(recording: Recording, rig: Rig, topics: Topics, surveyed: Survey) -> Camera:
    """The rig's camera, else the one of CameraInfo."""
    if given := rig.camera_model():
        return given
    if surveyed.camera_info is None:
        raise RecordingError(
            f"{recording.path}: topic {topics.camera_info} has no message that can be read",
            "give the camera in the rig",
        )
    try:
        return surveyed.camera_info.camera()
    except GeometryError as error:
        raise RecordingError(
            f"{recording.path}: topic {topics.camera_info}: {error.message}",
            "give the camera in the rig",
        ) from error


def _frame(recording: Recording, topic: str) -> str:
    """Frame of a topic's messages; empty if none can be read."""
    return next((message.frame_id for _, message in recording.messages([topic])), "")


def _arm_truth(rig: Rig, arm: Arm, dwell: Dwell | None) -> PoseTruth:
    assert dwell is not None
    return arm_truth(rig, arm, dwell.positions_mean, dwell.positions_std, dwell.samples)


def _pose_record(scenario: str, plan: PosePlan, truth: PoseTruth) -> PoseRecord:
    dwell = plan.dwell
    return PoseRecord(
        pose_id=plan.pose_id,
        scenario=scenario,
        start_ns=plan.start_ns,
        end_ns=plan.end_ns,
        joint_positions=dwell.positions_mean if dwell else np.empty(0),
        joint_positions_std=dwell.positions_std if dwell else np.empty(0),
        samples=dwell.samples if dwell else 0,
        T_camera_lidar=truth.T_camera_lidar,
        covariance=truth.covariance,
        T_camera_effector=truth.T_camera_effector,
        T_effector_base=truth.T_effector_base,
        T_base_lidar=truth.T_base_lidar,
    )


def _no_pairs(plans: Sequence[PosePlan], rig: Rig) -> str:
    if plans:
        reasons = dict.fromkeys(plan.reason for plan in plans)
        return f"no pair at {len(plans)} poses: {'; '.join(reasons)}"
    if rig.ground_truth == "static":
        return "no scan and no image"
    return (
        f"no dwell: the joints never stay below {rig.dwells.max_velocity_deg_s:g} deg/s for "
        f"{rig.dwells.settle_s + rig.dwells.min_duration_s:g} s"
    )


def _remedy(plans: Sequence[PosePlan]) -> str:
    key = "pairing.tolerance_ms or stamps" if plans else "dwells"
    return f"`lcdata info` shows clocks, rates and dwells; set {key} in the rig"


def _already_built(out: Path, what: dict[str, Any]) -> BuildSummary | None:
    """The data set in `out`, if it is complete and of the same recordings, rig and options."""
    if not (out / schema.INFO).is_file():
        return None
    info = read_info(out)
    plain = info.to_dict()
    if any(schema.plain(plain[key]) != schema.plain(what[key]) for key in what):
        return None
    dataset = Dataset.open(out)
    files = [name for pair in dataset.pairs for name in (pair.image, pair.cloud)]
    missing = [name for name in files if not (out / name).is_file()]
    if missing:
        raise DatasetError(
            f"{out}: {len(missing)} files are missing, among them {missing[0]}",
            "build it again with --force",
        )
    return BuildSummary(dataset, len(dataset.pairs), len(dataset.poses), list(info.failures))


def _nothing(
    recordings: Path, errors: Sequence[LcdataError], failures: Sequence[str]
) -> LcdataError:
    """Why there is no data set: the only recording's error, or all of them."""
    if len(errors) == len(failures) == 1:
        return errors[0]
    return DatasetError(f"no pair could be taken from {recordings}", "; ".join(failures))
