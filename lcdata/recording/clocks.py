"""The sensors' clocks against the recorder's, and against each other."""

from __future__ import annotations

from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from lcdata.recording.summary import ClockSummary
from lcdata.recording.survey import Survey
from lcdata.recording.topics import Topics

Stamps = NDArray[np.int64]

YEAR_2001_NS = 10**18
"""Header stamps before it come from a clock that was never set."""

CLOCK_LIMIT_S = 1.0
"""No driver and no network delays a message for longer."""

YEAR_S = 365.25 * 86400.0


def clocks(topics: Topics, surveyed: Survey) -> list[ClockSummary]:
    """How far the sensors' clocks are from the recorder's."""
    first = {topics.lidar: surveyed.lidar_ns, topics.image: surveyed.image_ns}
    if topics.joint_states:
        first[topics.joint_states] = surveyed.joint_ns
    found = []
    for topic, stamps in first.items():
        difference = surveyed.clock_ns.get(topic, np.empty(0, np.int64))
        if not len(difference) or not len(stamps):
            continue
        median, largest = np.median(difference) * 1e-9, np.abs(difference).max() * 1e-9
        note = ""
        if not stamps.any():
            note = "its header stamps are all 0: set `stamps: bag` in the rig"
        elif stamps[0] < YEAR_2001_NS:
            note = (
                f"its clock does not start in 1970, the first stamp is {stamps[0] * 1e-9:.3f} s: "
                "set `stamps: bag` in the rig unless all sensors share that clock"
            )
        elif abs(median) > CLOCK_LIMIT_S:
            note = (
                f"its clock is {median:+.3f} s off the recorder's: set `stamps: bag` in the rig "
                "unless all sensors share that clock"
            )
        found.append(ClockSummary(topic, float(median) * 1e3, float(largest) * 1e3, note))
    return found


def apart(topics: Topics, surveyed: Survey) -> str:
    """Which two sensors have clocks that are too far apart for pairs, and what to do about it.

    Args:
        topics: Of a recording.
        surveyed: Its stamps; without the recorder's stamps beside them, nothing can be told.

    Returns:
        Empty if all are within `CLOCK_LIMIT_S` of each other.
    """
    names = [topics.lidar, topics.image, *filter(None, [topics.joint_states])]
    known = {name: surveyed.clock_ns.get(name, np.empty(0, np.int64)) for name in names}
    off = {name: float(np.median(c)) * 1e-9 for name, c in known.items() if len(c)}
    worst = max(combinations(off, 2), key=lambda two: abs(off[two[0]] - off[two[1]]), default=None)
    if worst is None or abs(off[worst[0]] - off[worst[1]]) <= CLOCK_LIMIT_S:
        return ""
    right, wrong = sorted(worst, key=lambda name: abs(off[name]))
    seconds = off[wrong] - off[right]
    length = f"{abs(seconds):.1f} s"
    if abs(seconds) > YEAR_S:
        length = f"{abs(seconds) / YEAR_S:.1f} years ({length})"
    return (
        f"the clock of {wrong} is {length} {'ahead of' if seconds > 0 else 'behind'} that of "
        f"{right}: set `stamps: bag` in the rig"
    )
