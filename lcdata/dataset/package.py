"""One recording into a data set, in the order of the method.

topics -> stamps and joints -> dwells -> pairs -> ground truth -> files
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from lcdata.arm import Arm
from lcdata.dataset.journal import Journal
from lcdata.dataset.packing import write_pairs
from lcdata.dataset.pair_jobs import grouped
from lcdata.dataset.schema import PairRecord, PoseRecord, Scenario
from lcdata.errors import ArmError, GeometryError, RecordingError
from lcdata.geometry.camera import Camera
from lcdata.groundtruth.chain import PoseTruth, arm_truth, static_truth
from lcdata.recording.clock_report import ClockReport, compare_clocks, with_consequence
from lcdata.recording.clocks import apart, clocks
from lcdata.recording.dwells import find_dwells
from lcdata.recording.inspection import no_dwell
from lcdata.recording.messages import Cloud, Message, intensity_field
from lcdata.recording.plan import PosePlan, plan_poses
from lcdata.recording.source import Recording
from lcdata.recording.survey import Survey, survey
from lcdata.recording.topics import Topics, choose_topics
from lcdata.recording.transforms import static_extrinsic
from lcdata.rig import Rig

Progress = Callable[[str, int, int], None]
"""Called with what is being done, how much of it is, and of how much."""


@dataclass(frozen=True)
class Part:
    """What one recording gives to a data set.

    Args:
        scenario: Its entry in dataset.json.
        poses: Its poses, also those of which no pair could be taken.
        pairs: Pairs whose files are complete.
        failures: Poses, pairs and parts of the file that could not be used, a line each.
    """

    scenario: Scenario
    poses: list[PoseRecord]
    pairs: list[PairRecord]
    failures: list[str]


def package(
    recording: Recording,
    rig: Rig,
    arm: Arm | None,
    *,
    journal: Journal,
    pairs_per_pose: int | None = None,
    progress: Progress | None = None,
) -> Part:
    """Write the pairs of one recording, with the ground truth of their poses.

    Args:
        recording: Open.
        rig: How it was recorded.
        arm: The rig's arm; None for a recording without one.
        journal: Of the build.
        pairs_per_pose: At most so many pairs of each pose, evenly spread; None for all.
        progress: See `Progress`.

    Raises:
        LcdataError: Nothing in it can be used.
    """
    topics = choose_topics(recording, rig)
    surveyed = survey(recording, topics, arm)
    report = None
    if arm is not None:
        surveyed, report = compare_clocks(recording, topics, surveyed, arm, rig)
    dwells = find_dwells(surveyed.joint_ns, surveyed.positions, rig.dwells) if arm else None
    plans = plan_poses(
        recording.scenario,
        surveyed,
        dwells,
        tolerance_ms=rig.pairing.tolerance_ms,
        pairs_per_pose=pairs_per_pose,
        integration=rig.integration,
    )
    if not any(len(plan.lidar_ns) for plan in plans):
        if far := apart(topics, surveyed):
            raise RecordingError(f"{recording.path}: no pair: {far}")
        raise RecordingError(
            f"{recording.path}: {_no_pairs(plans, surveyed, rig)}",
            "`lcdata info` shows clocks, rates and dwells",
        )
    if report is not None and arm is not None:
        report = with_consequence(report, surveyed, plans, arm, rig)
    cloud, image = (_first(recording, topic) for topic in (topics.lidar, topics.image))
    scenario = Scenario(
        camera=_camera(recording, rig, topics, surveyed),
        topics={role: getattr(topics, role) for role in Topics.__dataclass_fields__},
        lidar_frame=cloud.frame_id,
        camera_frame=image.frame_id,
        warnings=tuple(_warnings(recording, topics, surveyed, cloud, report)),
        clock_offset=report.to_dict() if report else None,
    )
    truths, without_truth = _ground_truth(recording, rig, arm, plans, scenario)
    if arm is not None:
        beyond = _beyond_limits(arm, [plan for plan in plans if plan.pose_id in truths])
        warnings = (*scenario.warnings, *grouped(recording.path, beyond))
        scenario = replace(scenario, warnings=warnings)
    pairs, unusable = write_pairs(
        recording,
        topics,
        [plan for plan in plans if plan.pose_id in truths],
        camera=scenario.camera,
        rig=rig,
        journal=journal,
        progress=progress,
    )
    unpaired = {plan.pose_id: plan.reason for plan in plans if plan.reason}
    return Part(
        scenario,
        [
            _pose_record(recording.scenario, p, truths[p.pose_id])
            for p in plans
            if p.pose_id in truths
        ],
        pairs,
        [*recording.problems, *grouped(recording.path, unpaired | without_truth), *unusable],
    )


def _ground_truth(
    recording: Recording,
    rig: Rig,
    arm: Arm | None,
    plans: Sequence[PosePlan],
    scenario: Scenario,
) -> tuple[dict[str, PoseTruth], dict[str, str]]:
    """Ground truth by pose_id, and why others have none."""
    if arm is None:
        extrinsic = None
        if rig.T_camera_lidar is None:
            extrinsic = static_extrinsic(recording, scenario.camera_frame, scenario.lidar_frame)
        return {plan.pose_id: static_truth(rig, extrinsic) for plan in plans}, {}
    truths: dict[str, PoseTruth] = {}
    failures: dict[str, str] = {}
    for plan in plans:
        dwell = plan.dwell
        assert dwell is not None
        try:
            truths[plan.pose_id] = arm_truth(
                rig,
                arm,
                dwell.positions_mean,
                dwell.positions_std,
                dwell.samples,
                (dwell.end_ns - dwell.start_ns) * 1e-9,
            )
        except ArmError as error:
            failures[plan.pose_id] = str(error)
    return truths, failures


def _beyond_limits(arm: Arm, plans: Sequence[PosePlan]) -> dict[str, str]:
    """What is a little outside the arm's limits, by pose_id: believed, and said."""
    lines = {
        plan.pose_id: ", ".join(arm.outside_limits(plan.dwell.positions_mean))
        for plan in plans
        if plan.dwell is not None
    }
    return {pose_id: line for pose_id, line in lines.items() if line}


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


def _first(recording: Recording, topic: str) -> Message:
    """First message of a topic that can be read."""
    message = next((message for _, message in recording.messages([topic])), None)
    if message is None:
        raise RecordingError(
            f"{recording.path}: topic {topic} has no message that can be read",
            "; ".join(recording.problems),
        )
    return message


def _warnings(
    recording: Recording,
    topics: Topics,
    surveyed: Survey,
    cloud: Message,
    report: ClockReport | None,
) -> Iterator[str]:
    """What does not stop the build, and a user should know."""
    if recording.stamps == "header":
        for clock in clocks(topics, surveyed):
            if clock.note:
                yield f"{recording.path}: topic {clock.topic}: {clock.note}"
    if report is not None and report.warning:
        yield f"{recording.path}: {report.warning}"
    log = recording.joint_log
    if log is not None and log.topic == topics.joint_states and log.note:
        yield log.note
    if isinstance(cloud, Cloud) and intensity_field(cloud) is None:
        yield (
            f"{recording.path}: topic {topics.lidar}: its clouds have no intensity: methods that "
            "compare intensities cannot use them"
        )


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
        budget=truth.budget,
    )


def _no_pairs(plans: Sequence[PosePlan], surveyed: Survey, rig: Rig) -> str:
    if plans:
        reasons = dict.fromkeys(plan.reason for plan in plans)
        return f"no pair at {len(plans)} poses: {'; '.join(reasons)}"
    if rig.ground_truth == "arm":
        return no_dwell(surveyed, rig.dwells)
    return "no scan and no image"
