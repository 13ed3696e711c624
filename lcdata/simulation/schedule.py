"""When what happens in a simulated recording: dwells, motions, scans, images, clocks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lcdata.simulation.poses import min_jerk

Array = NDArray[np.float64]

JOINT_PERIOD_S = 0.01
LIDAR_PERIOD_S = 0.1
CAMERA_PERIOD_S = 1.0 / 15.0
_LEAD_S, _TAIL_S = 0.6, 0.5
"""A dwell before its first and after its last scan."""
_SPACING_S = 0.2
_WAYS = 4
"""On the first way and every fourth after it, a shot is taken that no reader must use."""
_FASTEST_RAD_S = 1.3
_AROUND_S = 0.2
"""Images of a motion begin so long before it and end so long after."""


@dataclass(frozen=True)
class Shot:
    """One scan and one image.

    Args:
        scan_s: True time of the scan's start, seconds since the recording's.
        image_s: True time of the image.
        pose: Number of the arm pose; of the pose that the arm leaves, if it moves.
        pair: Number of the pair in the pose.
        moving: Taken while the arm moves: the reader must not use it.
    """

    scan_s: float
    image_s: float
    pose: int
    pair: int
    moving: bool = False


@dataclass(frozen=True, eq=False)
class Schedule:
    """The arm's motion and the shots of one recording.

    Args:
        positions: (P, n) true joint positions of the poses, radians.
        dwells: (P, 2) start and end of each, seconds.
        shots: In the order of time.
        frames: Images without a scan as the arm moves: true time and the pose it leaves.
    """

    positions: Array
    dwells: Array
    shots: tuple[Shot, ...]
    frames: tuple[tuple[float, int], ...] = ()

    @property
    def end_s(self) -> float:
        """End of the recording."""
        return float(self.dwells[-1, 1])

    def blend(self, values: Array, times: Array) -> Array:
        """Values that belong to the poses, changing with the motion between them.

        Args:
            values: (P, n), such as `positions`.
            times: (T,) seconds.

        Returns:
            (T, n).
        """
        out = np.repeat(values[:1], len(times), axis=0)
        for k in range(len(values) - 1):
            begin, end = self.dwells[k, 1], self.dwells[k + 1, 0]
            later = times > begin
            share = (times[later] - begin) / (end - begin)
            out[later] = min_jerk(values[k], values[k + 1], share)
        return out


def plan(
    positions: Array, pairs: int, rng: np.random.Generator, motion_hz: float = 0.0
) -> Schedule:
    """Dwell at each pose for `pairs` shots, take one more on some of the ways.

    The sensors run at their own rates; of their scans and images only those of the shots are
    recorded, as a throttled recording has them.

    Args:
        positions: (P, n) radians.
        pairs: Shots in each dwell.
        rng: Phases of the sensors and how long the arm lingers.
        motion_hz: Rate at which images are recorded while the arm moves, the camera's or less.
    """
    lidar_phase, camera_phase = rng.uniform(0, [LIDAR_PERIOD_S, CAMERA_PERIOD_S])

    def shot(at: float, pose: int, pair: int, moving: bool = False) -> Shot:
        scan = lidar_phase + LIDAR_PERIOD_S * np.ceil((at - lidar_phase) / LIDAR_PERIOD_S)
        image = camera_phase + CAMERA_PERIOD_S * np.rint((scan - camera_phase) / CAMERA_PERIOD_S)
        return Shot(float(scan), float(image), pose, pair, moving)

    dwells, shots, now = [], [], 0.0
    for pose in range(len(positions)):
        length = _LEAD_S + _SPACING_S * pairs + _TAIL_S + rng.uniform(0, 0.3)
        dwells.append((now, now + length))
        shots += [shot(now + _LEAD_S + _SPACING_S * k, pose, k) for k in range(pairs)]
        now += length
        if pose + 1 < len(positions):
            far = np.abs(positions[pose + 1] - positions[pose]).max()
            duration = max(1.5, 1.875 * far / _FASTEST_RAD_S)
            if pose % _WAYS == 0:
                shots.append(shot(now + duration / 2, pose, pairs, moving=True))
            now += duration
    frames: list[tuple[float, int]] = []
    for pose in range(len(positions) - 1 if motion_hz > 0 else 0):
        begin, end = dwells[pose][1] - _AROUND_S, dwells[pose + 1][0] + _AROUND_S
        step = CAMERA_PERIOD_S * max(1, round(1 / (motion_hz * CAMERA_PERIOD_S)))
        first = camera_phase + step * np.ceil((begin - camera_phase) / step)
        taken = {shot.image_s for shot in shots}
        frames += [(t, pose) for t in np.arange(first, end, step).tolist() if t not in taken]
    return Schedule(positions, np.array(dwells), tuple(shots), tuple(frames))


@dataclass(frozen=True)
class Clock:
    """A sensor's own clock, and how late its messages reach the recorder.

    Args:
        offset_s: What it shows at the true time 0.
        drift: Seconds gained a second.
        jitter_s: Standard deviation of its stamps.
        latency_s: Least and greatest delay from the true time to the recorder.
    """

    offset_s: float
    drift: float
    jitter_s: float
    latency_s: tuple[float, float]

    def stamps(
        self, start_ns: int, times: Array, rng: np.random.Generator
    ) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Header stamps and recorder's stamps of events at true times, nanoseconds."""
        shown = (
            times * (1 + self.drift) + self.offset_s + rng.normal(size=len(times)) * self.jitter_s
        )
        received = np.maximum.accumulate(times + rng.uniform(*self.latency_s, len(times)))
        nanoseconds = [np.rint(1e9 * t).astype(np.int64) + start_ns for t in (shown, received)]
        return nanoseconds[0], nanoseconds[1]


def clocks(rng: np.random.Generator) -> tuple[Clock, Clock, Clock]:
    """Clocks of LiDAR, camera and arm: synchronised over the network, to some milliseconds."""
    offsets = rng.uniform(-0.004, 0.004, 3)
    drifts = rng.normal(scale=5e-6, size=3)
    return (
        Clock(offsets[0], drifts[0], 2e-5, (0.102, 0.110)),
        Clock(offsets[1], drifts[1], 3e-4, (0.025, 0.045)),
        Clock(offsets[2], drifts[2], 1e-4, (0.0005, 0.003)),
    )
