"""Stamps and joint positions of a recording, before any cloud or image is opened."""

from __future__ import annotations

from array import array
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import islice
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from lcdata.errors import ArmError
from lcdata.recording.messages import CameraInfo, JointState
from lcdata.recording.plain_folder import FILE
from lcdata.recording.source import Recording
from lcdata.recording.topics import Topics

if TYPE_CHECKING:
    from lcdata.arm import Arm

Array = NDArray[np.float64]
Stamps = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Survey:
    """Stamps and joint positions of a recording, read in one pass.

    Args:
        lidar_ns: (L,) stamps of scans, sorted, each once.
        image_ns: (M,) stamps of images, sorted, each once.
        joint_ns: (J,) stamps of the arm's joint states, as recorded.
        positions: (J, n) radians in the arm's joint order.
        camera_info: The first one.
        clock_ns: By topic, (N,) header stamp minus recorder's stamp of each message; empty if
            the recorder's stamps are used.
    """

    lidar_ns: Stamps
    image_ns: Stamps
    joint_ns: Stamps
    positions: Array
    camera_info: CameraInfo | None
    clock_ns: dict[str, Stamps] = field(default_factory=dict)


def survey(
    recording: Recording,
    topics: Topics,
    arm: Arm | None = None,
    *,
    joint_names: Sequence[str] = (),
) -> Survey:
    """Read all stamps and, with an arm, all joint positions. Clouds and images stay closed.

    Args:
        recording: An open recording.
        topics: What to read.
        arm: Whose joints to look for; joint states of other devices on the topic are left out.
        joint_names: Joints to look for where there is no model of the arm.

    Raises:
        ArmError: No joint state has all joints of the arm.
        RecordingError: A joint log that cannot be used, or is of another time.
    """
    joint_names = arm.joint_names if arm else joint_names
    stamps = {topic: array("q") for topic in topics.names()}
    bag = {topic: array("q") for topic in topics.names()}
    joint_ns, positions = array("q"), array("d")
    camera_info: CameraInfo | None = None
    foreign: JointState | None = None
    orders: dict[tuple[str, ...], list[int] | None] = {}
    sensors = (topics.lidar, topics.image)
    for topic, stamp_ns, bag_ns, raw in recording.serialised(topics.names(), heads=sensors):
        stamps[topic].append(stamp_ns)
        bag[topic].append(bag_ns)
        if topic == topics.camera_info and camera_info is None:
            message = recording.read(topic, raw, stamp_ns, bag_ns)
            camera_info = message if isinstance(message, CameraInfo) else None
        elif topic == topics.joint_states and joint_names:
            message = recording.read(topic, raw, stamp_ns, bag_ns)
            if not isinstance(message, JointState):
                continue
            if message.names not in orders:
                orders[message.names] = _order(joint_names, message.names)
            order = orders[message.names]
            if order is None:
                foreign = message
                continue
            joint_ns.append(stamp_ns)
            positions.extend(message.positions[order])
    if arm is not None and foreign is not None and not joint_ns:
        try:
            arm.order(foreign.names, foreign.positions)  # raises, naming the joints
        except ArmError as error:
            where = f"{recording.path}: topic {topics.joint_states}"
            raise ArmError(f"{where}: {error.message}", error.remedy) from error
    lidar_ns = np.unique(np.array(stamps[topics.lidar], np.int64))
    image_ns = np.unique(np.array(stamps[topics.image], np.int64))
    all_ns = np.array(joint_ns, np.int64)
    all_positions = np.array(positions, np.float64).reshape(len(joint_ns), len(joint_names))
    log = recording.joint_log
    if log is not None and log.topic == topics.joint_states and joint_names:
        all_ns, all_positions = log.samples(arm)
        log.check_clock(np.concatenate([lidar_ns, image_ns]))
    return Survey(
        lidar_ns,
        image_ns,
        all_ns,
        all_positions,
        camera_info,
        {
            topic: np.array(stamps[topic], np.int64) - np.array(bag[topic], np.int64)
            for topic in stamps
            if recording.topics[topic].encoding != FILE  # a folder has no recorder
        },
    )


def published_joints(recording: Recording, topic: str) -> list[tuple[str, ...]]:
    """Names of joints in the first messages of a topic, or in a joint log."""
    log = recording.joint_log
    if log is not None and log.topic == topic:
        return [log.names]
    messages = islice(recording.messages([topic]), 20)
    return [message.names for _, message in messages if isinstance(message, JointState)]


def _order(wanted: Sequence[str], names: Sequence[str]) -> list[int] | None:
    index = {name: i for i, name in enumerate(names)}
    return [index[name] for name in wanted] if all(n in index for n in wanted) else None
