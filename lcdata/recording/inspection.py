"""Filling in a summary, part by part."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lcdata.errors import ArmError, GeometryError, LcdataError, RecordingError, TopicError
from lcdata.recording import fields
from lcdata.recording.clock_report import ClockReport, compare_clocks, with_consequence
from lcdata.recording.clocks import apart, clocks
from lcdata.recording.dwells import find_dwells, speed
from lcdata.recording.integration import point_times
from lcdata.recording.messages import Cloud, Image
from lcdata.recording.plan import PosePlan, plan_poses
from lcdata.recording.source import Recording
from lcdata.recording.summary import (
    CloudSummary,
    ImageSummary,
    PoseSummary,
    Summary,
    TopicSummary,
)
from lcdata.recording.survey import Survey, published_joints, survey
from lcdata.recording.topics import TYPES, Topics, candidates, choose_topics
from lcdata.recording.transforms import static_extrinsic, static_transforms

if TYPE_CHECKING:
    from lcdata.arm import Arm
    from lcdata.geometry.camera import Camera
    from lcdata.rig import Rig

Stamps = NDArray[np.int64]


def inspect(summary: Summary, recording: Recording, rig: Rig | None) -> None:
    """Fill in a summary.

    Args:
        summary: With path, name, times and kind of ground truth.
        recording: Open.
        rig: The rig that build would use, or None.
    """
    summary.candidates = {role: [i.name for i in candidates(recording, role)] for role in TYPES}
    try:
        topics = choose_topics(recording, rig)
    except TopicError as error:
        summary.obstacles.append(str(error))
        summary.topics = _topics(recording, None, None)
        published = summary.candidates["joint_states"]
        if rig is None and len(published) == 1:
            _find_arm(summary, recording, published[0], None)
            summary.ground_truth = "arm" if summary.arm_model else "static"
    else:
        _look(summary, recording, topics, rig)


def _look(summary: Summary, recording: Recording, topics: Topics, rig: Rig | None) -> None:
    arm = _find_arm(summary, recording, topics.joint_states, rig)
    try:
        surveyed = survey(recording, topics, arm, joint_names=summary.joint_names)
    except (ArmError, RecordingError) as error:
        summary.obstacles.append(str(error))
        surveyed = survey(recording, topics)
        arm = None
    log = recording.joint_log
    if log is not None and log.topic == topics.joint_states and len(surveyed.joint_ns):
        summary.joint_log = log.describe()
        summary.joint_log_note = log.note
    summary.topics = _topics(recording, topics, surveyed)
    summary.clocks = clocks(topics, surveyed) if recording.stamps == "header" else []
    cloud, image = (_first(recording, name) for name in (topics.lidar, topics.image))
    if isinstance(cloud, Cloud):
        _look_at_cloud(summary, cloud, rig, topics.lidar)
    if isinstance(image, Image):
        _look_at_image(summary, image, surveyed, rig)
    for topic, first in ((topics.lidar, cloud), (topics.image, image)):
        if first is None:
            summary.obstacles.append(f"topic {topic} has no message that can be read")
    _look_at_transforms(summary, recording, rig)
    if rig is None and summary.joint_names and (summary.arm_model or not summary.T_camera_lidar):
        summary.ground_truth = "arm"
    report = None
    if arm is not None and rig is not None:
        surveyed, report = compare_clocks(recording, topics, surveyed, arm, rig)
    _plan(summary, topics, surveyed, arm, rig, report)


def _find_arm(
    summary: Summary, recording: Recording, joint_states: str | None, rig: Rig | None
) -> Arm | None:
    """The rig's arm; without a rig the known one whose joints are published."""
    if rig is not None:
        if rig.ground_truth == "static":
            return None
        arm = rig.load_arm()
        summary.arm_model, summary.joint_names = rig.arm.model, list(arm.joint_names)
        return arm
    if joint_states is None:
        return None
    from lcdata.arm import Arm, model_directory

    published = set(published_joints(recording, joint_states))
    for urdf in sorted(model_directory().glob("*/*.urdf")):
        arm = Arm(urdf)
        if any(set(arm.joint_names) <= set(names) for names in published):
            summary.arm_model, summary.joint_names = urdf.stem, list(arm.joint_names)
            return arm
    summary.joint_names = list(sorted(published, key=len)[-1]) if published else []
    return None


def _first(recording: Recording, topic: str) -> object:
    return next((message for _, message in recording.messages([topic])), None)


def _topics(
    recording: Recording, topics: Topics | None, surveyed: Survey | None
) -> list[TopicSummary]:
    stamps: dict[str, Stamps] = {}
    roles: dict[str, str] = {}
    if topics and surveyed:
        roles = {getattr(topics, role): role for role in TYPES if getattr(topics, role)}
        stamps = {topics.lidar: surveyed.lidar_ns, topics.image: surveyed.image_ns}
        if topics.joint_states and len(surveyed.joint_ns):
            stamps[topics.joint_states] = np.unique(surveyed.joint_ns)
    seconds = (recording.end_ns - recording.start_ns) * 1e-9
    found = []
    for name, info in sorted(recording.topics.items()):
        rate = (info.count - 1) / seconds if info.count > 1 and seconds > 0 else None
        gap = None
        if len(steps := np.diff(stamps.get(name, np.empty(0, np.int64)))):
            rate, gap = 1e9 / float(np.median(steps)), float(steps.max()) * 1e-9
        found.append(TopicSummary(name, info.type, info.count, roles.get(name, ""), rate, gap))
    return found


def _look_at_cloud(summary: Summary, cloud: Cloud, rig: Rig | None, topic: str) -> None:
    dtype = cloud.records.dtype
    names = dtype.names or ()
    shapes = {name: "x".join(map(str, dtype[name].shape)) for name in names}
    usable, time = 0, None
    try:
        usable = int(np.isfinite(fields.points(cloud.records)).all(axis=1).sum())
        given = {"field": rig.point_time.field, "unit": rig.point_time.unit} if rig else {}
        time = fields.point_time(cloud.records, **given)
        if rig and rig.integration and rig.integration.mode == "dynamic":
            point_times(cloud, rig.point_time, f"topic {topic}")
    except LcdataError as error:
        summary.obstacles.append(str(error))
    if not usable:
        summary.obstacles.append("the first cloud has no finite point")
    summary.cloud = CloudSummary(
        cloud.frame_id,
        [f"{n} {dtype[n].base.name}{shapes[n] and f'[{shapes[n]}]'}" for n in names],
        len(cloud.records),
        usable,
        list(cloud.organised) if cloud.organised else None,
        fields.intensity_name(dtype),
        fields.ring_name(dtype),
        time,
        fields.is_livox(dtype),
    )


def _look_at_image(summary: Summary, image: Image, surveyed: Survey, rig: Rig | None) -> None:
    summary.image = ImageSummary(image.frame_id, image.encoding, image.width, image.height)
    camera: Camera | None = rig.camera_model() if rig else None
    source = "rig" if camera else "CameraInfo"
    try:
        if camera is None and surveyed.camera_info is not None:
            camera = surveyed.camera_info.camera()
        image.decode()
    except LcdataError as error:
        summary.obstacles.append(str(error))
        if not image.width:  # not an image at all
            return
    if camera is None:
        if surveyed.camera_info is None:
            summary.obstacles.append("no CameraInfo: give the camera in the rig")
        return
    summary.camera = {
        "source": source,
        "model": camera.model,
        "width": camera.width,
        "height": camera.height,
        "intrinsics": list(camera.intrinsics),
        "distortion": list(camera.distortion),
    }
    if (image.width, image.height) != (camera.width, camera.height):
        summary.obstacles.append(
            f"images of {image.width}x{image.height}, {source} is for "
            f"{camera.width}x{camera.height}: give the camera of these images in the rig"
        )


def _look_at_transforms(summary: Summary, recording: Recording, rig: Rig | None) -> None:
    for transform in static_transforms(recording):
        summary.transforms.append(f"{transform.parent} <- {transform.child}")
    if rig is not None and rig.ground_truth == "arm":
        return
    if rig is not None and rig.T_camera_lidar is not None:
        summary.T_camera_lidar = rig.T_camera_lidar.T.tolist()
    elif summary.cloud and summary.image:
        try:
            T = static_extrinsic(recording, summary.image.frame, summary.cloud.frame)
            summary.T_camera_lidar = T.tolist()
        except (RecordingError, GeometryError) as error:
            if rig is not None:
                summary.obstacles.append(str(error))


def _plan(
    summary: Summary,
    topics: Topics,
    surveyed: Survey,
    arm: Arm | None,
    rig: Rig | None,
    report: ClockReport | None,
) -> None:
    from lcdata.rig import Dwells, Pairing

    rules, pairing = (rig.dwells, rig.pairing) if rig else (Dwells(), Pairing())
    dwells = None
    if summary.ground_truth == "arm":
        dwells = find_dwells(surveyed.joint_ns, surveyed.positions, rules)
        if not dwells:
            summary.obstacles.append(no_dwell(surveyed, rules))
    poses = plan_poses(
        summary.scenario,
        surveyed,
        dwells,
        tolerance_ms=pairing.tolerance_ms,
        integration=rig.integration if rig else None,
    )
    starts = [s[0] for s in (surveyed.lidar_ns, surveyed.image_ns, surveyed.joint_ns) if len(s)]
    summary.poses = [_pose(pose, int(min(starts)), arm) for pose in poses]
    if report is not None and arm is not None and rig is not None:
        summary.clock_offset = with_consequence(report, surveyed, poses, arm, rig)
    if poses and not summary.pairs:
        far = apart(topics, surveyed)
        reasons = [far] if far else dict.fromkeys(pose.reason for pose in summary.poses)
        summary.obstacles.append(f"no pair: {'; '.join(reasons)}")


def no_dwell(surveyed: Survey, rules: Any) -> str:
    """Why the arm never stands still, with its slowest moment."""
    if not len(surveyed.joint_ns):
        return "no dwell: no joint states of the arm"
    finite = np.isfinite(surveyed.positions).all(axis=1)
    if not finite.any():
        return f"no dwell: none of the {len(surveyed.joint_ns)} joint states has finite positions"
    stamps, first = np.unique(surveyed.joint_ns[finite], return_index=True)
    speeds = speed(stamps * 1e-9 - stamps[:1] * 1e-9, surveyed.positions[finite][first])
    slowest = np.rad2deg(np.min(speeds, initial=np.inf))
    return (
        f"no dwell: the joints never stay below {rules.max_velocity_deg_s:g} deg/s for "
        f"{rules.settle_s + rules.min_duration_s:g} s; the slowest moment is {slowest:.3g} deg/s "
        "(dwells in the rig)"
    )


def _pose(pose: PosePlan, start_ns: int, arm: Arm | None) -> PoseSummary:
    reason, dwell = pose.reason, pose.dwell
    pairs = len(pose.lidar_ns)
    if dwell is not None and arm is not None:
        try:
            arm.check_limits(dwell.positions_mean)
        except ArmError as error:
            reason, pairs = str(error), 0
    return PoseSummary(
        pose.pose_id,
        (pose.start_ns - start_ns) * 1e-9,
        (pose.end_ns - pose.start_ns) * 1e-9,
        np.rad2deg(dwell.positions_mean).tolist() if dwell else [],
        np.rad2deg(dwell.positions_std).tolist() if dwell else [],
        pose.scans,
        pose.images,
        pairs,
        reason,
        sum(map(len, pose.merged_ns)) if pairs else 0,
    )
