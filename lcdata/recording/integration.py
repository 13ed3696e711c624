"""Several scans to one dense cloud, as a recording is streamed.

Static: the LiDAR stands still, and what its scans see is added up (Livox: they never repeat).
Dynamic: a hand moves it; where it was at each point's own time is estimated from the scans first,
in a pass of its own, and the points are brought into the frame that it had when the image was
taken, during the first scan (Koide et al., section III-A).
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from lcdata.errors import IntegrationError
from lcdata.geometry import se3
from lcdata.recording import fields
from lcdata.recording.fields import PointTimeField
from lcdata.recording.messages import Cloud, Image, intensity_field, xyz
from lcdata.recording.odometry import ThinScan, Trajectory, cell_size, register, thin
from lcdata.recording.plan import PosePlan, RecordedPair
from lcdata.recording.source import Recording
from lcdata.recording.topics import Topics
from lcdata.recording.voxel_cloud import VoxelCloud
from lcdata.rig import PointTime
from lcdata.rig_integration import IntegrationSection

LEAST_MOTION = (0.02, np.deg2rad(1.0))
"""Metres and radians: a LiDAR that moves less might as well stand still."""
_FEWEST_POINTS = 100
"""A scan with fewer is not registered; the motion of the others carries it."""
_SHORTEST_SCAN_S = 1e-3
_TICK_S = 1e-4
"""Points within a tick share a pose: 0.1 mm at 1 m/s."""


def point_times(cloud: Cloud, given: PointTime, where: str) -> PointTimeField:
    """The field of a cloud that has the time of each point.

    Args:
        cloud: The first one.
        given: The rig's `point_time`.
        where: Recording and topic, for errors.

    Raises:
        IntegrationError: There is none, or its times are all the same.
        MessageError: The rig names a field that is not there.
    """
    times = fields.point_time(cloud.records, field=given.field, unit=given.unit)
    needs = f"{where}: integration: dynamic needs a time of each point"
    remedy = "record one, name it (point_time.field), or set integration: static or none"
    if times is None:
        names = ", ".join(cloud.records.dtype.names or ())
        raise IntegrationError(f"{needs}, its clouds have only {names}", remedy)
    if times.span_s < _SHORTEST_SCAN_S and len(cloud.records):
        raise IntegrationError(
            f"{needs}, field {times.name} spans only {1e6 * times.span_s:.3g} us", remedy
        )
    return times


@dataclass(eq=False)
class _Run:
    """A pair on its way: its scans, and what has been read of them."""

    pose: PosePlan
    number: int
    waiting: set[int] = field(default_factory=set)
    motion: Trajectory | None = None
    thin: list[ThinScan] = field(default_factory=list)
    cell_m: float = 0.0
    cloud: VoxelCloud | None = None
    first: Cloud | None = None
    image: Image | None = None

    def wait(self) -> None:
        """Its scans are to come."""
        self.waiting = set(self.pose.merged_ns[self.number].tolist())

    @property
    def pair_id(self) -> str:
        return self.pose.pair_id(self.number)

    @property
    def image_ns(self) -> int:
        return int(self.pose.image_ns[self.number])


class Merger:
    """Merges the scans of a plan.

    Args:
        recording: Open.
        topics: Its topics.
        rules: The rig's `integration`, static or dynamic.
        point_time: The rig's `point_time`.

    Attributes:
        failures: Why a pair could not be made, by its id.
    """

    def __init__(
        self, recording: Recording, topics: Topics, rules: IntegrationSection, point_time: PointTime
    ) -> None:
        self.failures: dict[str, str] = {}
        self._recording, self._topics, self._rules = recording, topics, rules
        self._point_time = point_time
        self._times: PointTimeField | None = None

    def pairs(
        self,
        poses: Sequence[PosePlan],
        skip: Collection[str] = (),
        registered: Callable[[int, int], None] | None = None,
    ) -> Iterator[RecordedPair]:
        """Pairs, each as soon as all of its scans and its image have been read.

        Args:
            poses: The plan.
            skip: Ids of pairs that are not needed.
            registered: Called with how many of the pairs' motions are known, and of how many.

        Raises:
            IntegrationError: The LiDAR moves, and its points have no times.
            MissingLibraryError: The LiDAR moves, and small_gicp is not installed.
        """
        runs = [
            _Run(pose, number)
            for pose in poses
            for number in range(len(pose.merged_ns))
            if pose.pair_id(number) not in skip
        ]
        if self._rules.mode == "dynamic":
            for done, run in enumerate(self._read(runs, self._thin), 1):
                self._register(run)
                if registered:
                    registered(done, len(runs))
            runs = [run for run in runs if run.motion is not None]
        by_image = {run.image_ns: run for run in runs}
        for run in self._read(runs, self._place, by_image):
            if run.cloud is not None and run.image is not None:
                yield self._finished(run)
            run.motion = run.cloud = run.first = run.image = None  # others need the memory

    def _read(
        self,
        runs: Sequence[_Run],
        use: Callable[[_Run, Cloud], None],
        by_image: dict[int, _Run] | None = None,
    ) -> Iterator[_Run]:
        """Each run, as soon as all of its scans have been used and its image is there."""
        if not runs:
            return
        for run in runs:
            run.wait()
        by_scan = {stamp: run for run in runs for stamp in run.waiting}
        images = dict(by_image or {})
        lidar, image = self._topics.lidar, self._topics.image

        def wanted(topic: str, stamp_ns: int) -> bool:
            return stamp_ns in (by_scan if topic == lidar else images)

        sensors = [lidar, image] if images else [lidar]
        for topic, stamp_ns, bag_ns, raw in self._recording.serialised(sensors, wanted):
            message = self._recording.read(topic, raw, stamp_ns, bag_ns)
            if topic == lidar:
                run = by_scan.pop(stamp_ns)
                run.waiting.discard(stamp_ns)
                if isinstance(message, Cloud):
                    use(run, message)
            else:
                run = images.pop(stamp_ns)
                run.image = message if isinstance(message, Image) else None
            if not run.waiting and run.image_ns not in images:
                yield run

    def _thin(self, run: _Run, cloud: Cloud) -> None:
        """Keep of a scan what registration needs."""
        points = xyz(cloud)
        seconds = self._seconds(cloud)
        run.cell_m = run.cell_m or cell_size(points)
        scan = thin(cloud.stamp_ns, points, seconds, run.cell_m)
        if len(scan.points) >= _FEWEST_POINTS:
            run.thin.append(scan)

    def _register(self, run: _Run) -> None:
        """Find a run's motion, or why there is none."""
        scans = sorted(run.thin, key=lambda scan: scan.stamp_ns)
        run.thin = []
        try:
            if not scans:
                raise IntegrationError(
                    "none of them has points farther than 1 m", "see lcdata info"
                )
            motion = register(scans, run.cell_m)
            far, turn = motion.way_m, motion.turn_rad
            if far < LEAST_MOTION[0] and turn < LEAST_MOTION[1]:
                raise IntegrationError(
                    f"the LiDAR moved only {1000 * far:.0f} mm and {np.rad2deg(turn):.1f} deg over "
                    f"{len(scans)} scans, which repeat each other",
                    "move it, or set integration: none in the rig",
                )
            run.motion = motion
        except IntegrationError as error:
            self.failures[run.pair_id] = f"its scans cannot be registered: {error}"

    def _place(self, run: _Run, cloud: Cloud) -> None:
        """Add a scan to its run's cloud."""
        points: NDArray[np.floating] = xyz(cloud)
        name = intensity_field(cloud)
        strength = None if name is None else cloud.records[name]
        if run.motion is not None:
            points = self._moved(run, run.motion, points, self._seconds(cloud), cloud.stamp_ns)
        if run.cloud is None:
            run.cloud = VoxelCloud(self._rules.voxel_m, self._rules.max_points)
        run.cloud.add(points, strength)
        if run.first is None or cloud.stamp_ns < run.first.stamp_ns:
            run.first = cloud

    def _moved(
        self,
        run: _Run,
        motion: Trajectory,
        points: NDArray[np.floating],
        seconds: NDArray[np.float64],
        stamp_ns: int,
    ) -> NDArray[np.floating]:
        """(N, 3) points in the LiDAR's frame at the time of the image; NaN without a time."""
        result = np.full(points.shape, np.nan)
        known = np.isfinite(seconds) & np.isfinite(points).all(axis=1)
        ticks, index = np.unique(np.rint(seconds[known] / _TICK_S), return_inverse=True)
        T_image_map = se3.inverse(motion.at(run.image_ns))
        T = T_image_map @ motion.at(stamp_ns, ticks * _TICK_S)
        result[known] = np.einsum("nij,nj->ni", T[index, :3, :3], points[known]) + T[index, :3, 3]
        return result

    def _seconds(self, cloud: Cloud) -> NDArray[np.float64]:
        """(N,) time of each point since the cloud's stamp."""
        if self._times is None:
            where = f"{self._recording.path}: topic {self._topics.lidar}"
            self._times = point_times(cloud, self._point_time, where)
        return self._times.since(cloud.records, cloud.stamp_ns)

    def _finished(self, run: _Run) -> RecordedPair:
        """A run as a pair; its cloud has points and intensities, and no order."""
        first, image, cloud = run.first, run.image, run.cloud
        assert first is not None
        assert image is not None
        assert cloud is not None
        points, strength = cloud.cells()
        name = intensity_field(first)
        columns = [(axis, points[:, k]) for k, axis in enumerate("xyz")]
        if name is not None:
            columns.append((name, strength))
        records = np.empty(len(points), [(label, "<f4") for label, _ in columns])
        for label, values in columns:
            records[label] = values
        stamp_ns = int(run.pose.lidar_ns[run.number])
        merged = Cloud(stamp_ns, first.bag_stamp_ns, first.frame_id, records, 1, len(records))
        return RecordedPair(run.pose, run.number, merged, image, cloud.scans)
