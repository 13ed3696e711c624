"""Which scans make the cloud of a pair, where more than one does."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from lcdata.recording.pairing import Pairing

Stamps = NDArray[np.int64]


def merge_scans(
    scans: Stamps, pairing: Pairing, max_scans: int, *, moving: bool
) -> tuple[Pairing, list[Stamps]]:
    """Cut a window's scans into runs that are merged, and choose an image for each.

    A LiDAR that stands still merges every scan of a run; the image is the one that was taken
    nearest to a scan of it. One that moves merges the scans from the image on, into the frame of
    the first (Koide et al., section III-A). What is left at the end and is less than half a run
    is not used, unless it is all there is.

    Args:
        scans: (L,) sorted stamps of the window's scans.
        pairing: Of these scans.
        max_scans: Longest run.
        moving: Whether the LiDAR moves.

    Returns:
        The pairing with a scan and an image for each run, and the runs' stamps.
    """
    image = np.full(len(scans), -1, np.intp)
    distance = np.full(len(scans), np.iinfo(np.int64).max)
    image[pairing.lidar], distance[pairing.lidar] = pairing.image, np.abs(pairing.dt_ns)
    chosen: list[int] = []
    runs: list[Stamps] = []
    start = 0
    while start < len(scans):
        if moving and image[start] < 0:
            start += 1
            continue
        run = slice(start, min(start + max_scans, len(scans)))
        start = run.stop
        if runs and 2 * (run.stop - run.start) < max_scans:
            break
        best = run.start + int(np.argmin(distance[run]))
        if moving:
            best = run.start
        if image[best] >= 0:
            chosen.append(best)
            runs.append(scans[run])
    lidar = np.array(chosen, np.intp)
    keep = np.searchsorted(pairing.lidar, lidar)
    return replace(pairing, lidar=lidar, image=pairing.image[keep], dt_ns=pairing.dt_ns[keep]), runs
