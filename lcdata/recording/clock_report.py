"""What the clock offset of a recording does to its pairs, and how it is taken out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from lcdata.errors import LcdataError, MotionError
from lcdata.geometry import se3
from lcdata.recording.clock_offset import ClockOffset, motion_offset
from lcdata.recording.joint_path import JointPath
from lcdata.recording.plan import PosePlan
from lcdata.recording.source import Recording
from lcdata.recording.survey import Survey
from lcdata.recording.topics import Topics

if TYPE_CHECKING:
    from lcdata.arm import Arm
    from lcdata.rig import Rig

AVERAGED_S = np.linspace(-0.05, 0.05, 11)
"""Encoder noise must not look like motion."""

MATTERS_MM, MATTERS_DEG = 1.0, 0.1
"""A camera that is farther from where the joints say spoils the ground truth of a pair."""


class Moved(NamedTuple):
    """How far the camera is from its dwell's place as images are taken, by the other clock.

    Args:
        pairs: At how many pairs it is farther away than matters.
        mm: Largest distance.
        deg: Largest angle.
    """

    pairs: int
    mm: float
    deg: float


NOWHERE = Moved(0, 0.0, 0.0)


@dataclass(frozen=True)
class ClockReport:
    """The clocks of arm and camera of one recording.

    Args:
        measured: Arm minus camera as the images of the moving arm say; None if they do not.
        applied_s: What was subtracted from the joints' stamps, because the rig says so.
        reason: Why nothing was measured.
        moved: What the rest, measured minus applied, means for the pairs.
        asked: Whether the rig asks for the measured offset to be taken out.
        contradiction: How images and joints contradict each other, whatever the offset; empty if
            they do not.
    """

    measured: ClockOffset | None
    applied_s: float = 0.0
    reason: str = ""
    moved: Moved = NOWHERE
    asked: bool = False
    contradiction: str = ""

    @property
    def remaining(self) -> ClockOffset | None:
        """Measured offset less the applied one."""
        if self.measured is None:
            return None
        return replace(self.measured, offset_s=self.measured.offset_s - self.applied_s)

    @property
    def warning(self) -> str:
        """What is wrong with pairs because of the clocks; empty if nothing is."""
        rest = self.remaining
        if self.contradiction:
            return self.contradiction
        if rest is None and self.asked:
            return (
                "the rig asks for the clock offset of arm and camera (clock_offset_s: estimate), "
                f"which cannot be measured: {self.reason}; nothing was taken out"
            )
        if rest is None or not rest.significant or not self.moved.pairs:
            return ""
        beyond = f" beyond the rig's {1e3 * self.applied_s:+.1f} ms" if self.applied_s else ""
        return (
            f"the arm's clock is {rest} off the camera's{beyond}: as {self.moved.pairs} of the "
            f"images were taken the camera was up to {self.moved.mm:.1f} mm and "
            f"{self.moved.deg:.2f} deg from where its dwell's joints say: set "
            "`clock_offset_s: estimate` in the rig"
        )

    @property
    def line(self) -> str:
        """All in one line, for people."""
        if self.measured is None:
            return f"arm against camera: {self.contradiction or f'not measured ({self.reason})'}"
        text = (
            f"arm - camera {self.measured} from {self.measured.moving} turns of the moving camera"
        )
        if self.applied_s:
            text += f", {1e3 * self.applied_s:+.1f} ms taken out"
        if self.warning:
            return f"{text}: {self.warning.rpartition(': set')[0].partition(': ')[2]}"
        return f"{text}: no pair is affected, the arm stands still by either clock"

    def to_dict(self) -> dict[str, Any]:
        """Plain values."""
        measured = asdict(self.measured) if self.measured else {"offset_s": None, "std_s": None}
        return {
            **measured,
            "significant": self.measured is not None and self.measured.significant,
            "applied_s": self.applied_s,
            "reason": self.reason,
            "moved_pairs": self.moved.pairs,
            "moved_mm": self.moved.mm,
            "moved_deg": self.moved.deg,
        }


def compare_clocks(
    recording: Recording, topics: Topics, surveyed: Survey, arm: Arm, rig: Rig
) -> tuple[Survey, ClockReport]:
    """Measure the offset between arm and camera clock, and take out what the rig says.

    Args:
        recording: Open.
        topics: Its topics.
        surveyed: Its stamps and joint positions.
        arm: The rig's arm.
        rig: Says what is to be done with the offset (`clock_offset_s`).

    Returns:
        The same stamps with those of the joints on the camera's clock, as far as the rig asks for
        it, and what was found. That nothing could be measured is no error.
    """
    measured, reason, contradiction = None, "", ""
    try:
        measured = motion_offset(recording, topics, surveyed, arm, rig)
    except LcdataError as error:
        reason = error.message.removeprefix(f"{recording.path}: ")
        if isinstance(error, MotionError):
            contradiction = f"{reason}: {error.remedy}"
    asked = isinstance(rig.clock_offset_s, str)
    applied = rig.clock_offset_s or 0.0
    if isinstance(applied, str):
        applied = measured.offset_s if measured else 0.0
    if applied:
        surveyed = replace(surveyed, joint_ns=surveyed.joint_ns - round(applied * 1e9))
    return surveyed, ClockReport(
        measured, applied, reason, asked=asked, contradiction=contradiction
    )


def with_consequence(
    report: ClockReport, surveyed: Survey, plans: Sequence[PosePlan], arm: Arm, rig: Rig
) -> ClockReport:
    """The same report with what the remaining offset does to planned pairs.

    Args:
        report: From `compare_clocks`.
        surveyed: From `compare_clocks`.
        plans: Poses with the images that are to be taken.
        arm: The rig's arm.
        rig: Where the camera is mounted.
    """
    rest, link = report.remaining, rig.T_camera_effector
    taken = [(plan.dwell, stamp) for plan in plans if plan.dwell for stamp in plan.image_ns]
    if rest is None or link is None or not taken:
        return report
    path, chain, n = JointPath.of(surveyed), arm.chain(), len(arm.joint_names)
    seconds = np.array([(stamp - path.start_ns) * 1e-9 for _, stamp in taken]) + rest.offset_s
    then = path.at(seconds[:, None] + AVERAGED_S).mean(axis=1)
    dwelling = np.array([dwell.positions_mean for dwell, _ in taken])
    effector = [chain.forward(arm.with_offsets(q.reshape(-1, n))) for q in (then, dwelling)]
    a, b = (T @ se3.inverse(link.T) for T in effector)
    mm = [1e3 * se3.translation_error(x, y) for x, y in zip(a, b, strict=True)]
    deg = [float(np.rad2deg(se3.rotation_error(x, y))) for x, y in zip(a, b, strict=True)]
    bad = sum(x > MATTERS_MM or y > MATTERS_DEG for x, y in zip(mm, deg, strict=True))
    return replace(report, moved=Moved(bad, max(mm), max(deg)))
