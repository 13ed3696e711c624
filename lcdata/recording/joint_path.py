"""The joints' path between their stamps, and which images show it in motion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lcdata.recording.dwells import speed
from lcdata.recording.survey import Survey

Array = NDArray[np.float64]
Stamps = NDArray[np.int64]

MOVING_RAD_S = np.deg2rad(5.0)
"""Slower than this, an image says little of clocks: 0.05 deg are then 10 ms."""

AROUND_NS = 300_000_000
"""So much before and after a motion its images are looked at as well."""

NEAREST_NS = 60_000_000
"""Images nearer to each other are skipped."""


@dataclass(frozen=True, eq=False)
class JointPath:
    """What the joints did.

    Args:
        start_ns: Where its seconds begin.
        seconds: (J,) increasing.
        positions: (J, n) radians, without jumps of a turn.
    """

    start_ns: int
    seconds: Array
    positions: Array

    @classmethod
    def of(cls, surveyed: Survey) -> JointPath:
        """The finite positions of a survey in the order of time."""
        finite = np.flatnonzero(np.isfinite(surveyed.positions).all(axis=1))
        stamps, first = np.unique(surveyed.joint_ns[finite], return_index=True)
        start = int(stamps[0]) if len(stamps) else 0
        positions = np.unwrap(surveyed.positions[finite][first], axis=0)
        return cls(start, np.asarray((stamps - start) * 1e-9), np.asarray(positions, np.float64))

    def at(self, seconds: Array) -> Array:
        """(..., n) positions at seconds (...)."""
        columns = [np.interp(seconds, self.seconds, column) for column in self.positions.T]
        return np.stack(columns, axis=-1)

    def images(self, stamps: Stamps, most: int) -> Stamps:
        """Images of the first of the fast motions, not too near to each other."""
        if len(self.seconds) < 3 or not len(stamps):
            return stamps[:0]
        speeds = speed(self.seconds, self.positions)
        speeds[~np.isfinite(speeds)] = 0.0
        flags = np.concatenate([[False], speeds > MOVING_RAD_S, [False]]).astype(np.int8)
        starts, ends = np.flatnonzero(np.diff(flags) == 1), np.flatnonzero(np.diff(flags) == -1)
        peaks = [float(speeds[a:b].max()) for a, b in zip(starts, ends, strict=True)]
        chosen: list[int] = []
        for a, b, peak in zip(starts, ends, peaks, strict=True):
            if peak < 0.5 * max(peaks):
                continue
            begin, end = (self.start_ns + round(1e9 * self.seconds[k]) for k in (a, b - 1))
            low, high = np.searchsorted(stamps, [begin - AROUND_NS, end + AROUND_NS])
            for stamp in stamps[low:high].tolist():
                if not chosen or stamp >= chosen[-1] + NEAREST_NS:
                    chosen.append(stamp)
        return np.array(chosen[:most], np.int64)
