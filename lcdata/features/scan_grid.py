"""A LiDAR scan as an image of rings x columns, so that neighbours come from the grid.

Rows are rings in order of elevation, columns are steps of azimuth. A ring comes from the
sensor's own image, its ring field, the order of the points, or from elevations that form clear
clusters, never from rounding a point's own elevation: that draws false lines along every ring.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float32]
Array = NDArray[np.float64]
Indices = NDArray[np.intp]

TURN = 2 * np.pi
FEWEST_RINGS, MOST_RINGS = 4, 256
FEWEST_COLUMNS, MOST_COLUMNS = 16, 4096
FEWEST_IN_RING = 8
"""Returns a ring needs for its elevation to be known."""


@dataclass(frozen=True, eq=False)
class ScanGrid:
    """A scan whose neighbours in the array are neighbours in the world.

    Args:
        points: (rings, columns, 3) float32, metres; zeros where nothing came back.
        elevation: (rings,) radians, ascending or descending: the mean of each ring.
        column_step: Azimuth from a column to the next, radians, signed.
        full_turn: The last column is a neighbour of the first.
    """

    points: Floats
    elevation: Array
    column_step: float
    full_turn: bool

    @property
    def ring_step(self) -> float:
        """Typical elevation between neighbouring rings, radians."""
        return float(np.median(np.abs(np.diff(self.elevation))))


def scan_grid(
    points: NDArray[np.floating[Any]],
    organised: tuple[int, int] | None = None,
    ring: NDArray[np.integer[Any]] | None = None,
) -> ScanGrid | None:
    """Arrange a scan as rings x columns.

    Args:
        points: (N, 3) in the LiDAR frame, metres, z along the axis of rotation; NaN or zeros
            where nothing came back.
        organised: (rings, columns) if the points are a row-major image of the scan.
        ring: (N,) ring numbers of an unorganised cloud, in any order of elevation.

    Returns:
        The grid; None where the points do not form one.
    """
    with np.errstate(over="ignore"):  # what is too large for float32 is no return
        cloud = np.array(points, np.float32, order="C")
    cloud[~np.isfinite(cloud).all(axis=1)] = 0
    if organised is not None and organised[0] >= FEWEST_RINGS and organised[1] >= FEWEST_COLUMNS:
        return _from_image(cloud.reshape(*organised, 3))
    valid = cloud.any(axis=1)
    cloud = cloud[valid]
    if ring is not None and len(np.unique(ring)) >= FEWEST_RINGS:
        return _from_rings(cloud, np.unique(np.asarray(ring)[valid], return_inverse=True)[1])
    rank = ring_from_scan_order(cloud)
    if rank is None:
        rank = ring_from_elevation(cloud)
    return None if rank is None else _from_rings(cloud, rank)


def _wrap(angle: Array) -> Array:
    """Angles brought into -pi .. pi."""
    return np.asarray((angle + np.pi) % TURN - np.pi)


def _from_image(image: Floats) -> ScanGrid | None:
    """An organised scan, its rings put in order of elevation and its columns aligned."""
    rings, columns = image.shape[:2]
    chosen = np.arange(0, columns - 1, max(1, columns // 256))
    here, there = image[:, chosen].astype(float), image[:, chosen + 1].astype(float)
    seen, both = here.any(axis=2), here.any(axis=2) & there.any(axis=2)
    known = seen.sum(axis=1) >= FEWEST_IN_RING
    if known.sum() < FEWEST_RINGS or both.sum() < FEWEST_IN_RING:
        return None
    azimuth = np.arctan2(here[..., 1], here[..., 0])
    step = float(np.median(_wrap(np.arctan2(there[..., 1], there[..., 0]) - azimuth)[both]))
    if abs(step) * columns < 0.1:
        return None
    full_turn = abs(abs(step) * columns - TURN) < 0.02 * TURN
    if full_turn:
        step = np.copysign(TURN / columns, step)
    # A driver may send columns as they were fired, with each ring's azimuth offset still in.
    turned = np.where(seen, np.exp(1j * (azimuth - chosen * step)), 0).sum(axis=1)
    offset = np.angle(turned * np.conj(turned[known].sum()))
    shift = np.where(known, np.rint(offset / step), 0).astype(int)
    if shift.any():
        place = np.arange(columns) - shift[:, None]
        aligned = np.take_along_axis(image, (place % columns)[..., None], axis=1)
        inside = full_turn | ((place >= 0) & (place < columns))
        image = np.where(np.broadcast_to(inside, place.shape)[..., None], aligned, np.float32(0))
    slope = here[..., 2] / np.maximum(np.hypot(here[..., 0], here[..., 1]), 1e-6)
    elevation = np.arctan((slope * seen).sum(axis=1) / np.maximum(seen.sum(axis=1), 1))
    steps = np.diff(elevation[known])
    # Rings without a return keep their place.
    rows = np.arange(rings)
    spacing = float(np.median(steps / np.diff(rows[known])))
    first, last = rows[known][[0, -1]]
    elevation = np.interp(rows, rows[known], elevation[known])
    elevation += spacing * (np.minimum(rows - first, 0) + np.maximum(rows - last, 0))
    if not ((steps > 0).all() or (steps < 0).all()):
        order = np.argsort(elevation)
        image, elevation = np.ascontiguousarray(image[order]), elevation[order]
    return ScanGrid(image, elevation, step, full_turn)


def _from_rings(cloud: Floats, rank: Indices) -> ScanGrid | None:
    """A grid of points whose rings are known: columns from azimuth."""
    count = np.bincount(rank)
    keep = count[rank] >= FEWEST_IN_RING
    cloud, rank = cloud[keep], np.unique(rank[keep], return_inverse=True)[1]
    if not len(cloud) or rank.max() + 1 < FEWEST_RINGS or rank.max() >= MOST_RINGS:
        return None
    azimuth = np.arctan2(cloud[:, 1], cloud[:, 0]).astype(float) % TURN
    slope = cloud[:, 2] / np.maximum(np.hypot(cloud[:, 0], cloud[:, 1]), 1e-6)
    elevation = np.arctan(np.bincount(rank, slope) / np.bincount(rank))
    order = np.argsort(elevation)
    elevation, rank = elevation[order], np.argsort(order)[rank]

    order = np.lexsort((azimuth, rank))
    steps = np.diff(azimuth[order])[np.diff(rank[order]) == 0]
    steps = steps[steps > TURN / MOST_COLUMNS / 2]
    if not len(steps):
        return None
    columns = int(np.clip(np.rint(TURN / np.median(steps)), FEWEST_COLUMNS, MOST_COLUMNS))
    step = TURN / columns
    # Each ring has its own phase: without it, points on a column's border fall to either side.
    phase = np.zeros(len(elevation), complex)
    np.add.at(phase, rank, np.exp(1j * columns * azimuth))
    column = np.rint((azimuth - step * np.angle(phase)[rank] / TURN) / step).astype(int) % columns
    near_last = np.argsort(-np.linalg.norm(cloud, axis=1), kind="stable")
    image = np.zeros((len(elevation), columns, 3), np.float32)
    image[rank[near_last], column[near_last]] = cloud[near_last]

    # A crop has an empty sector: it becomes the seam between last and first column.
    filled = np.unique(column)
    gaps = np.diff(filled, append=filled[0] + columns)
    widest = int(np.argmax(gaps))
    full_turn = bool(gaps[widest] * step < np.radians(5))
    if not full_turn:
        first = (filled[widest] + gaps[widest]) % columns
        image = np.roll(image, -first, axis=1)[:, : columns - gaps[widest] + 1]
        if image.shape[1] < FEWEST_COLUMNS:
            return None
    return ScanGrid(np.ascontiguousarray(image), elevation, step, full_turn)


def ring_from_scan_order(cloud: Floats) -> Indices | None:
    """Ring of each point of a cloud that is stored ring after ring (as KITTI's HDL-64).

    A wrap of the azimuth starts a new ring.

    Args:
        cloud: (N, 3) metres.

    Returns:
        (N,) ring numbers; None if the cloud is not stored that way.
    """
    if len(cloud) < FEWEST_RINGS * FEWEST_IN_RING:
        return None
    azimuth = np.arctan2(cloud[:, 1], cloud[:, 0]).astype(float) % TURN
    steps = np.diff(azimuth)
    sense = np.sign(np.median(_wrap(steps)))
    # Jitter at the seam crosses it back and forth: only a new highest count is a new ring.
    crossings = np.where(sense * steps < -np.pi, 1, 0) - np.where(sense * steps > np.pi, 1, 0)
    rank = np.maximum.accumulate(np.concatenate([[0], np.cumsum(crossings)]))
    rings = int(rank[-1]) + 1
    if not FEWEST_RINGS <= rings <= MOST_RINGS:
        return None
    # Along a ring the elevation hardly changes from point to point; between rings it does.
    elevation = np.arctan2(cloud[:, 2], np.hypot(cloud[:, 0], cloud[:, 1])).astype(float)
    mean = np.bincount(rank, elevation, minlength=rings) / np.maximum(np.bincount(rank), 1)
    smooth = np.median(np.abs(np.diff(elevation))) < 0.25 * np.median(np.abs(np.diff(mean)))
    return rank if smooth else None


def ring_from_elevation(cloud: Floats) -> Indices | None:
    """Ring of each point from elevations that form clear clusters, one a ring.

    Args:
        cloud: (N, 3) metres.

    Returns:
        (N,) ring numbers; None if the clusters run into each other (a moved or merged cloud).
    """
    if len(cloud) < FEWEST_RINGS * FEWEST_IN_RING:
        return None
    bin_size = np.radians(0.01)
    elevation = np.arctan2(cloud[:, 2], np.hypot(cloud[:, 0], cloud[:, 1])).astype(float)
    bins = ((elevation - elevation.min()) / bin_size).astype(int) + 8
    count = np.bincount(bins, minlength=bins.max() + 9).astype(float)
    kernel = np.exp(-0.5 * (np.arange(-6, 7) / 2.0) ** 2)
    smooth = np.convolve(count, kernel / kernel.sum(), mode="same")
    rising = np.diff(smooth) > 0
    peaks = np.flatnonzero(rising[:-1] & ~rising[1:]) + 1
    peaks = peaks[smooth[peaks] > 0.1 * np.median(smooth[peaks])]
    if not FEWEST_RINGS <= len(peaks) <= MOST_RINGS:
        return None
    valleys = np.array([a + np.argmin(smooth[a:b]) for a, b in pairwise(peaks)])
    if np.median(smooth[valleys] / np.minimum(smooth[peaks[:-1]], smooth[peaks[1:]])) > 0.3:
        return None
    return np.asarray(np.searchsorted(valleys, bins, side="right"))
