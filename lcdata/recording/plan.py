"""What `build` takes from a recording: stamps first, then poses and their pairs."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from lcdata.recording.dwells import Dwell
from lcdata.recording.merging import merge_scans
from lcdata.recording.messages import Cloud, Image
from lcdata.recording.pairing import pair_stamps, select
from lcdata.recording.source import Recording
from lcdata.recording.survey import Survey
from lcdata.recording.topics import Topics

if TYPE_CHECKING:
    from lcdata.rig_integration import IntegrationSection

Stamps = NDArray[np.int64]

LONGEST_SCAN_NS = 200_000_000
"""A rotating LiDAR turns 5 times a second or faster; a lower rate is a thinned recording."""


@dataclass(frozen=True, eq=False)
class PosePlan:
    """One pose of a data set, and the pairs to take for it.

    Args:
        pose_id: `<scenario>/pose_000`.
        dwell: The arm's; None for a recording without an arm, which is one pose.
        start_ns: First stamp of the window.
        end_ns: Last stamp of the window.
        lidar_ns: (P,) stamps of the chosen scans; of merged ones that of the scan whose image it
            is.
        image_ns: (P,) stamps of their images.
        scans: Scans in the window.
        images: Images in the window.
        paired: Pairs in the window, before `pairs_per_pose`.
        reason: Why there is no pair; empty if there is one.
        merged_ns: Stamps of the scans that make the cloud of each pair, where they are merged.
    """

    pose_id: str
    dwell: Dwell | None
    start_ns: int
    end_ns: int
    lidar_ns: Stamps
    image_ns: Stamps
    scans: int
    images: int
    paired: int
    reason: str
    merged_ns: tuple[Stamps, ...] = ()

    def pair_id(self, number: int) -> str:
        """`<scenario>/pose_000/000`."""
        return f"{self.pose_id}/{number:03d}"


def plan_poses(
    scenario: str,
    survey: Survey,
    dwells: Sequence[Dwell] | None,
    *,
    tolerance_ms: float,
    pairs_per_pose: int | None = None,
    integration: IntegrationSection | None = None,
) -> list[PosePlan]:
    """Poses of a recording with their pairs.

    Args:
        scenario: The recording's name.
        survey: Its stamps.
        dwells: The arm's dwells; None for a recording without an arm.
        tolerance_ms: Largest distance of a scan to its image.
        pairs_per_pose: At most so many, evenly spread; all for None.
        integration: How scans are merged; not at all for None.

    Returns:
        One for each dwell, also for those without pairs.
    """
    windows: list[tuple[Dwell | None, int, int]] = [(d, d.start_ns, d.end_ns) for d in dwells or ()]
    if dwells is None:
        both = np.concatenate([survey.lidar_ns, survey.image_ns])
        if len(both):
            windows = [(None, int(both.min()), int(both.max()))]
    scan_ns = 0 if dwells is None else _scan_duration(survey.lidar_ns)
    poses = []
    for index, (dwell, start, end) in enumerate(windows):
        # A scan is stamped at its beginning, and must end before the arm moves.
        scans = _within(survey.lidar_ns, start, end - scan_ns)
        images = _within(survey.image_ns, start, end)
        pairing = pair_stamps(scans, images, round(tolerance_ms * 1e6))
        runs: list[Stamps] = []
        if integration is not None and integration.mode != "none":
            moving = integration.mode == "dynamic"
            pairing, runs = merge_scans(scans, pairing, integration.max_scans, moving=moving)
        chosen = select(len(pairing.lidar), pairs_per_pose)
        reason = ""
        if not len(scans):
            reason = "no scan while the arm stood still"
        elif not len(images):
            reason = "no image while the arm stood still"
        elif not len(pairing.lidar):
            reason = pairing.reason()
        poses.append(
            PosePlan(
                f"{scenario}/pose_{index:03d}",
                dwell,
                start,
                end,
                scans[pairing.lidar[chosen]],
                images[pairing.image[chosen]],
                len(scans),
                len(images),
                len(pairing.lidar),
                reason,
                tuple(runs[k] for k in chosen) if runs else (),
            )
        )
    return poses


def _scan_duration(lidar_ns: Stamps) -> int:
    if len(lidar_ns) < 2:
        return 0
    return min(int(np.median(np.diff(lidar_ns))), LONGEST_SCAN_NS)


def _within(stamps: Stamps, start: int, end: int) -> Stamps:
    low, high = np.searchsorted(stamps, start, "left"), np.searchsorted(stamps, end, "right")
    return stamps[low:high]


@dataclass(frozen=True, eq=False)
class RecordedPair:
    """A scan and its image.

    Args:
        pose: Where it belongs.
        number: Its number within the pose.
        cloud: The scan, or what several make.
        image: The image.
        scans: How many scans the cloud is of.
    """

    pose: PosePlan
    number: int
    cloud: Cloud
    image: Image
    scans: int = 1

    @property
    def pair_id(self) -> str:
        """`<scenario>/pose_000/000`."""
        return self.pose.pair_id(self.number)


def stream_pairs(
    recording: Recording, topics: Topics, poses: Sequence[PosePlan], skip: Collection[str] = ()
) -> Iterator[RecordedPair]:
    """Pairs of the plan, each as soon as both of its messages have been read.

    Only messages that wait for their partner are kept. A pair whose cloud or image cannot be
    read does not come; `recording.problems` tells.

    Args:
        recording: Open.
        topics: Its topics.
        poses: The plan.
        skip: Ids of pairs that are not needed, as an interrupted build has them already.
    """
    open_pairs = {
        int(scan): (pose, number)
        for pose in poses
        for number, scan in enumerate(pose.lidar_ns)
        if pose.pair_id(number) not in skip
    }
    partner = {int(i): int(s) for p in poses for s, i in zip(p.lidar_ns, p.image_ns, strict=True)}
    clouds: dict[int, Cloud] = {}
    images: dict[int, Image] = {}

    def wanted(topic: str, stamp_ns: int) -> bool:
        scan = stamp_ns if topic == topics.lidar else partner.get(stamp_ns)
        return scan in open_pairs

    sensors = [topics.lidar, topics.image]
    for topic, stamp_ns, bag_ns, raw in recording.serialised(sensors, wanted):
        scan = stamp_ns if topic == topics.lidar else partner[stamp_ns]
        message = recording.read(topic, raw, stamp_ns, bag_ns)
        if isinstance(message, Cloud):
            clouds[scan] = message
        elif isinstance(message, Image):
            images[scan] = message
        else:  # damaged: its partner must not wait for ever
            del open_pairs[scan]
            clouds.pop(scan, None), images.pop(scan, None)
        if scan in clouds and scan in images:
            yield RecordedPair(*open_pairs.pop(scan), clouds.pop(scan), images.pop(scan))
