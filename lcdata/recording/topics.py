"""Which topics to use: the rig's, or the only ones of the right type."""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from lcdata.errors import TopicError
from lcdata.recording.conversion import CAMERA_INFO, CLOUD, COMPRESSED_IMAGE, IMAGE, JOINT_STATE
from lcdata.recording.joint_log import JOINT_LOG
from lcdata.recording.livox import CUSTOM_CLOUDS
from lcdata.recording.source import Recording
from lcdata.recording.storage import TopicInfo

if TYPE_CHECKING:
    from lcdata.rig import Rig

TYPES: dict[str, tuple[str, ...]] = {
    "lidar": (CLOUD, *CUSTOM_CLOUDS),
    "image": (IMAGE, COMPRESSED_IMAGE),
    "camera_info": (CAMERA_INFO,),
    "joint_states": (JOINT_STATE, JOINT_LOG),
}
"""Message types of each role."""

NOT_PICTURES = ("depth", "disparity", "confidence", "mask", "label")
"""Images whose topic has one of these words are taken only if the rig names them."""


@dataclass(frozen=True)
class Topics:
    """Topics to read; `camera_info` and `joint_states` are None where they are not needed."""

    lidar: str
    image: str
    camera_info: str | None
    joint_states: str | None

    def names(self) -> list[str]:
        """All of them."""
        chosen = (self.lidar, self.image, self.camera_info, self.joint_states)
        return [name for name in chosen if name is not None]


def choose_topics(recording: Recording, rig: Rig | None = None) -> Topics:
    """Topics of a recording.

    Args:
        recording: An open recording.
        rig: Names topics, or says `auto`; without a rig all are `auto` and joint states are
            optional.

    Raises:
        TopicError: One is missing or ambiguous; it lists the candidates.
    """
    image = _choose(recording, rig, "image")
    assert image is not None
    lidar = _choose(recording, rig, "lidar")
    assert lidar is not None
    needs_arm = rig is not None and rig.ground_truth == "arm"
    joint_states = None
    if rig is None or needs_arm:
        joint_states = _choose(recording, rig, "joint_states", needed=needs_arm)
    camera_info = None
    if rig is None or rig.camera is None:
        camera_info = _choose(recording, rig, "camera_info", needed=rig is not None, beside=image)
    return Topics(lidar, image, camera_info, joint_states)


def candidates(recording: Recording, role: str) -> list[TopicInfo]:
    """Topics with messages of a role's types, by name."""
    found = [i for i in recording.topics.values() if i.type in TYPES[role] and i.count]
    return sorted(found, key=lambda info: info.name)


def _choose(
    recording: Recording, rig: Rig | None, role: str, *, needed: bool = True, beside: str = ""
) -> str | None:
    asked = getattr(rig.topics, role) if rig else "auto"
    if asked != "auto":
        return _named(recording, role, asked)
    found = candidates(recording, role)
    remedy = f"set topics.{role} in the rig"
    if not found:
        if not needed:
            return None
        if role == "camera_info":
            remedy = "give the camera's model and intrinsics in the rig (camera)"
        elif role == "joint_states":
            remedy = (
                "a recording without an arm needs ground_truth: static in the rig, one with a log "
                "of the joints joint_log.file"
            )
        else:
            remedy = "record the sensor, or is this the right recording?"
        types = " or ".join(TYPES[role])
        raise TopicError(
            f"{recording.path}: no {role} topic with messages of type {types}; topics are "
            f"{_listed(recording.topics.values())}",
            remedy,
        )
    if role == "image":
        found = _pictures(found)
    elif role == "camera_info":
        found = _siblings(found, beside)
    elif role == "joint_states":
        found = _joint_states(found, by_log=rig is not None and rig.joint_log is not None)
    if len(found) == 1:
        return found[0].name
    if rig is None and not needed:
        return None
    raise TopicError(
        f"{recording.path}: {len(found)} topics could be {role}: {_listed(found)}", remedy
    )


def _named(recording: Recording, role: str, asked: str) -> str:
    info = recording.topics.get(asked)
    if info is not None and info.type in TYPES[role] and info.count:
        return asked
    found = candidates(recording, role)
    close = difflib.get_close_matches(asked, [i.name for i in found], n=1)
    if info is None:
        problem = f"no topic {asked}"
    elif not info.count:
        problem = f"topic {asked} has no messages"
    else:
        problem = f"topic {asked} is of type {info.type}, not {' or '.join(TYPES[role])}"
    hint = f"did you mean {close[0]}?" if close else f"candidates are {_listed(found)}"
    raise TopicError(f"{recording.path}: {problem}: {hint}", f"correct topics.{role} in the rig")


def _pictures(found: list[TopicInfo]) -> list[TopicInfo]:
    """Colour or gray images, and one of each camera where it is recorded raw and compressed."""
    plain = [i for i in found if not any(word in i.name.lower() for word in NOT_PICTURES)]
    by_camera: dict[str, list[TopicInfo]] = {}
    for info in plain or found:
        by_camera.setdefault(base_topic(info.name), []).append(info)
    # The one with more messages; raw before compressed where they are equal.
    return [
        max(group, key=lambda info: (info.count, info.type == IMAGE))
        for group in by_camera.values()
    ]


def _siblings(found: list[TopicInfo], image: str) -> list[TopicInfo]:
    """CameraInfo in the image's namespace, if there is one."""
    if len(found) == 1:
        return found
    base = base_topic(image)
    names = (f"{base.rpartition('/')[0]}/camera_info", f"{base}/camera_info")
    return [i for i in found if i.name in names][:1] or found


def _joint_states(found: list[TopicInfo], by_log: bool) -> list[TopicInfo]:
    """The log where the rig speaks of one; one that merely lies there is ambiguous."""
    logs = [info for info in found if info.type == JOINT_LOG]
    if logs:
        return logs if by_log else found
    return [info for info in found if info.name == "/joint_states"] or found


def base_topic(image: str) -> str:
    """Image topic without the suffix of its transport."""
    return image.removesuffix("/compressed")


def _listed(infos: Iterable[TopicInfo]) -> str:
    shown = [f"{i.name} ({i.count} x {i.type.rpartition('/')[2]})" for i in infos]
    return ", ".join(shown) or "none"
