"""Windows in which the arm stands still."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Stamps = NDArray[np.int64]

HALF_WINDOW_S = 0.25
"""The velocity at a time is the difference of the mean positions in the 0.25 s after and before
it. At 100 Hz this divides encoder noise by 5 before it is divided by 0.25 s: 0.02 deg of noise
is 0.02 deg/s. A difference of neighbouring samples would be 3 deg/s, well over any threshold."""

GAP_S = 0.5
"""Nobody knows what the arm did while joint states were missing for longer."""


class DwellRules(Protocol):
    """What `rig.dwells` has."""

    @property
    def max_velocity_deg_s(self) -> float:
        """Joints that move faster than this do not stand still."""
        ...

    @property
    def min_duration_s(self) -> float:
        """Shortest dwell, after settling."""
        ...

    @property
    def settle_s(self) -> float:
        """What is cut off at a dwell's beginning."""
        ...


@dataclass(frozen=True, eq=False)
class Dwell:
    """One window in which all joints stand still.

    Args:
        index: Number within the recording, from 0.
        start_ns: First stamp, after settling.
        end_ns: Last stamp.
        positions_mean: (n,) radians, in the arm's joint order.
        positions_std: (n,) scatter of the samples, radians.
        samples: Joint states in the window.
    """

    index: int
    start_ns: int
    end_ns: int
    positions_mean: Array
    positions_std: Array
    samples: int

    @property
    def duration_s(self) -> float:
        """Length in seconds."""
        return (self.end_ns - self.start_ns) * 1e-9


def find_dwells(stamps_ns: Stamps, positions: Array, rules: DwellRules) -> list[Dwell]:
    """Dwells in the order of time.

    A dwell begins when the joints have been still for `settle_s` and lasts `min_duration_s` or
    longer.

    Args:
        stamps_ns: (N,) stamps of the joint states, in any order.
        positions: (N, n) radians.
        rules: Thresholds, `rig.dwells`.
    """
    stamps, q = np.asarray(stamps_ns, np.int64), np.asarray(positions, float)
    usable = np.flatnonzero(np.isfinite(q).all(axis=1))
    stamps, first = np.unique(stamps[usable], return_index=True)
    if not len(stamps):
        return []
    # Continuous joints jump by a turn; no joint moves half a turn between two samples.
    q = np.unwrap(q[usable][first], axis=0)
    seconds = (stamps - stamps[0]) * 1e-9
    still = np.rad2deg(speed(seconds, q, rules.min_duration_s)) <= rules.max_velocity_deg_s
    dwells: list[Dwell] = []
    for begin, end in _runs(still, seconds):
        start = np.searchsorted(seconds, seconds[begin] + rules.settle_s - 1e-9)
        if start > end or seconds[end] - seconds[start] < rules.min_duration_s - 1e-9:
            continue
        window = q[start : end + 1]
        dwells.append(
            Dwell(
                len(dwells),
                int(stamps[start]),
                int(stamps[end]),
                window.mean(axis=0),
                window.std(axis=0),
                len(window),
            )
        )
    return dwells


def speed(seconds: Array, positions: Array, min_duration_s: float = np.inf) -> Array:
    """Speed of the fastest joint, robust to encoder noise.

    Args:
        seconds: (N,) increasing.
        positions: (N, n) radians, finite.
        min_duration_s: The window gets narrower where dwells may be shorter than it.

    Returns:
        (N,) radians a second; infinite where there are too few samples to tell.
    """
    result = np.full(len(seconds), np.inf)
    for begin, end in _segments(seconds):
        t, q = seconds[begin:end], positions[begin:end]
        if len(t) < 3:
            continue
        half = min(HALF_WINDOW_S, min_duration_s / 2)
        half = max(half, 2.5 * float(np.median(np.diff(t))))
        if t[-1] - t[0] < 2 * half:
            half = (t[-1] - t[0]) / 2
        # At the ends, the speed of the first and last full window.
        centre = np.clip(t, t[0] + half, t[-1] - half)
        low = np.searchsorted(t, centre - half - 1e-9)
        middle = np.searchsorted(t, centre)
        high = np.searchsorted(t, centre + half + 1e-9)
        summed = np.vstack([np.zeros((1, q.shape[1] + 1)), np.cumsum(np.c_[t, q - q[0]], axis=0)])
        before = (summed[middle] - summed[low]) / (middle - low)[:, None]
        after = (summed[high] - summed[middle]) / (high - middle)[:, None]
        change = after - before
        result[begin:end] = np.abs(change[:, 1:] / change[:, :1]).max(axis=1)
    return result


def _segments(seconds: Array) -> list[tuple[int, int]]:
    """Ranges [begin, end) of samples without a gap between them."""
    if not len(seconds):
        return []
    steps = np.diff(seconds)
    limit = max(GAP_S, 5 * float(np.median(steps))) if len(steps) else GAP_S
    cuts = np.flatnonzero(steps > limit) + 1
    edges = [0, *cuts.tolist(), len(seconds)]
    return list(pairwise(edges))


def _runs(still: NDArray[np.bool_], seconds: Array) -> list[tuple[int, int]]:
    """First and last index of each run of still samples, gaps ending a run."""
    runs = []
    for begin, end in _segments(seconds):
        flags = np.concatenate([[False], still[begin:end], [False]]).astype(np.int8)
        steps = np.diff(flags)
        starts, stops = np.flatnonzero(steps == 1) + begin, np.flatnonzero(steps == -1) + begin - 1
        runs += list(zip(starts.tolist(), stops.tolist(), strict=True))
    return runs
