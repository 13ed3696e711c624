"""What `lcdata info` shows: what is in a recording, and what build would make of it."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lcdata.errors import RecordingError
from lcdata.recording.fields import PointTimeField
from lcdata.recording.joint_log import open_joint_log
from lcdata.recording.source import open_recording

if TYPE_CHECKING:
    from lcdata.recording.clock_report import ClockReport
    from lcdata.rig import Rig


@dataclass(frozen=True)
class TopicSummary:
    """A topic; rate and gap of those that build would read, mean rate of the others."""

    name: str
    type: str
    messages: int
    role: str
    rate_hz: float | None
    longest_gap_s: float | None


@dataclass(frozen=True)
class ClockSummary:
    """Header stamps minus recorder's stamps of a topic, and what is wrong with them."""

    topic: str
    median_ms: float
    largest_ms: float
    note: str


@dataclass(frozen=True)
class CloudSummary:
    """The first cloud."""

    frame: str
    fields: list[str]
    points: int
    usable: int
    organised: list[int] | None
    intensity: str | None
    ring: str | None
    time: PointTimeField | None
    livox: bool


@dataclass(frozen=True)
class ImageSummary:
    """The first image."""

    frame: str
    encoding: str
    width: int
    height: int


@dataclass(frozen=True)
class PoseSummary:
    """One pose, what build would take from it, and why not more.

    `merged` counts the scans in clouds that are made of several.
    """

    pose_id: str
    start_s: float
    duration_s: float
    joints_deg: list[float]
    joints_std_deg: list[float]
    scans: int
    images: int
    pairs: int
    reason: str
    merged: int


@dataclass
class Summary:
    """All about a recording.

    Args:
        path: The recording.
        scenario: Its name in a data set.
        start_ns: The recorder's first stamp.
        duration_s: Length by the recorder's clock.
        ground_truth: `arm` or `static`: the rig's, or what seems to fit.
        topics: All of them.
        candidates: Names of the topics whose type fits, by role.
        clock_offset: Clock of the arm against the camera's; None without an arm or its rig.
        obstacles: Why build would take nothing, a line each.
        problems: What is wrong with the file and its messages, a line each.
        rig_yaml: A rig to start from; empty if a rig was given.
    """

    path: str
    scenario: str
    start_ns: int
    duration_s: float
    ground_truth: str
    topics: list[TopicSummary] = field(default_factory=list)
    candidates: dict[str, list[str]] = field(default_factory=dict)
    clocks: list[ClockSummary] = field(default_factory=list)
    clock_offset: ClockReport | None = None
    cloud: CloudSummary | None = None
    image: ImageSummary | None = None
    camera: dict[str, Any] | None = None
    transforms: list[str] = field(default_factory=list)
    T_camera_lidar: list[list[float]] | None = None
    arm_model: str | None = None
    joint_names: list[str] = field(default_factory=list)
    joint_log: str = ""
    joint_log_note: str = ""
    poses: list[PoseSummary] = field(default_factory=list)
    obstacles: list[str] = field(default_factory=list)
    problems: list[str] = field(default_factory=list)
    rig_yaml: str = ""

    @property
    def pairs(self) -> int:
        """How many pairs build would take."""
        return sum(pose.pairs for pose in self.poses)

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        offset = self.clock_offset and self.clock_offset.to_dict()
        return {**asdict(self), "clock_offset": offset, "pairs": self.pairs}

    def lines(self) -> list[str]:
        """Text for a terminal."""
        from lcdata.recording.summary_text import render

        return render(self)


def summarise(path: Path, rig: Rig | None = None) -> Summary:
    """Look through a recording.

    Args:
        path: The recording.
        rig: The rig that build would use; without one, everything is guessed and a rig to start
            from is suggested.

    Raises:
        RecordingError: Nothing in the file can be read.
        ArmError: The rig's arm model cannot be used.
    """
    from lcdata.recording.inspection import inspect
    from lcdata.recording.suggestion import suggest_rig

    log, no_log = None, ""
    try:
        log = open_joint_log(path, rig)
    except RecordingError as error:
        no_log = str(error)
    with open_recording(path, rig.stamps if rig else "header", log) as recording:
        summary = Summary(
            str(path),
            recording.scenario,
            recording.start_ns,
            (recording.end_ns - recording.start_ns) * 1e-9,
            rig.ground_truth if rig else "static",
        )
        if no_log:
            summary.obstacles.append(no_log)
        inspect(summary, recording, rig)
        summary.problems = recording.problems
    if rig is None:
        summary.rig_yaml = suggest_rig(summary)
    return summary
