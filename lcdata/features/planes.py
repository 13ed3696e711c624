"""The planes of a LiDAR scan, and which pixel belongs to which."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lcdata.features.plane_fits import MOST_COLUMNS_ASIDE, local_fits, window_table
from lcdata.features.plane_regions import explained, grow, merge, spread
from lcdata.features.scan_grid import ScanGrid

Array = NDArray[np.float64]
Labels = NDArray[np.int32]

WINDOW_M = 0.15
"""Half size of the window of a local fit."""
NOISE_LIMITS_M = 0.004, 0.05
NOISE_QUANTILE = 0.4
"""Most windows are flat, and their residual is the noise of the ranges."""
NOISE_STRIDE = 8


@dataclass(frozen=True, eq=False)
class Planes:
    """The planes of one scan.

    Args:
        labels: (rings, columns) int32 plane of each pixel, -1 for none.
        inverse: (P, 3) vectors a with a . p = 1, 1/m.
        covariance: (P, 3, 3) of `inverse`.
        noise_m: Standard deviation of a range, estimated from this scan.
    """

    labels: Labels
    inverse: Array
    covariance: Array
    noise_m: float


def find_planes(grid: ScanGrid) -> Planes:
    """Segment a scan into planes: fit, grow (15 deg, 3 sigma), merge (4 deg, 2 sigma), label."""
    points, turn = grid.points, grid.full_turn
    ring_step, column_step = grid.ring_step, abs(grid.column_step)
    ring_steps = np.maximum(np.abs(np.gradient(grid.elevation)), 0.3 * ring_step)
    pad = min(MOST_COLUMNS_ASIDE, points.shape[1] // 2) if turn else 0
    table = window_table(points, pad)

    coarse = local_fits(points, table, turn, ring_steps, column_step, NOISE_STRIDE, 0.0, np.inf)[1]
    coarse = coarse[np.isfinite(coarse)]
    noise = float(np.quantile(coarse, NOISE_QUANTILE)) if len(coarse) else 0.0
    noise = float(np.clip(noise, *NOISE_LIMITS_M))
    # Nodes are about as far apart in azimuth as in elevation.
    stride = 2 if ring_step > 1.5 * column_step and points.shape[1] % 2 == 0 else 1
    fits, residuals = local_fits(
        points, table, turn, ring_steps, column_step, stride, WINDOW_M, noise
    )
    nodes = np.ascontiguousarray(points[:, ::stride])
    labels, sums, vectors = grow(
        nodes, fits, residuals, turn, ring_step, stride * column_step, WINDOW_M, noise
    )
    parents = merge(nodes, labels, sums, vectors, turn, noise)
    labels, roots = _renumbered(labels, parents, parents == np.arange(len(parents)))
    kept = ~explained(nodes, labels, vectors[roots], turn, noise)
    labels, chosen = _renumbered(labels, np.arange(len(roots)), kept)
    roots = roots[chosen]
    labels = spread(points, labels, vectors[roots], stride, turn, noise)
    matrices = sums[roots][:, [[0, 1, 2], [1, 3, 4], [2, 4, 5]]]
    covariance = np.asarray(np.linalg.inv(matrices), np.float64)
    return Planes(labels, vectors[roots], covariance, noise)


def _renumbered(
    labels: Labels, parents: NDArray[np.integer[Any]], kept: NDArray[np.bool_]
) -> tuple[Labels, NDArray[np.intp]]:
    """Labels 0, 1, .. of the parents that are kept, -1 for others, and which those are."""
    new = np.where(kept, np.cumsum(kept) - 1, -1).astype(np.int32)
    return np.append(new[parents], np.int32(-1))[labels], np.flatnonzero(kept)
