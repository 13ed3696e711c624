"""Many scans as one cloud of bounded size: the mean of the points in each cell of a grid."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_SMALLEST, _BATCH = 2**16, 2**15
_LOAD = 0.7
_GROWTH = 2 ** (1 / 3)


class VoxelCloud:
    """A cloud that grows scan by scan, in a memory that does not.

    The mean of points and intensities that fall into one cell lies on the surface with less
    noise than any of them. Where more cells than `max_points` are filled, all become larger.

    Args:
        voxel_m: Size of a cell.
        max_points: Most points of the cloud.

    Attributes:
        voxel_m: Size of a cell by now.
        scans: How many were added.
    """

    def __init__(self, voxel_m: float, max_points: int) -> None:
        self.voxel_m = voxel_m
        self.scans = 0
        self._max_points = max_points
        self._clear(_SMALLEST)

    def add(
        self, points: NDArray[np.floating[Any]], intensity: NDArray[np.generic] | None = None
    ) -> None:
        """Add a scan.

        Args:
            points: (N, 3) metres; those that are not finite are left out.
            intensity: (N,) in the sensor's unit.
        """
        rows = np.ones((len(points), 5))
        rows[:, :3] = points
        rows[:, 3] = 0.0 if intensity is None else intensity
        self._insert(rows)
        self.scans += 1
        while self._filled > self._max_points:
            self.voxel_m *= _GROWTH
            cells = self._cells()
            self._clear(len(self._keys))
            self._insert(cells)

    def cells(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """(N, 3) points in metres and (N,) intensities by now."""
        cells = self._cells()
        return cells[:, :3].astype(np.float32), cells[:, 3].astype(np.float32)

    def _clear(self, places: int) -> None:
        self._keys = np.full(places, -1, np.int64)
        self._sums = np.zeros((places, 5))
        self._filled = 0

    def _cells(self) -> Array:
        """(N, 5) mean x, y, z, intensity of each cell, and how many points it has."""
        cells = self._sums[self._keys >= 0]
        cells[:, :4] /= cells[:, 4:]
        return cells

    def _insert(self, rows: Array) -> None:
        from lcdata.recording import voxel_kernels

        for start in range(0, len(rows), _BATCH):
            batch = rows[start : start + _BATCH]
            if self._filled + len(batch) > _LOAD * len(self._keys):
                cells = self._cells()
                self._clear(2 * len(self._keys))
                self._filled += voxel_kernels.insert(self._keys, self._sums, cells, self.voxel_m)
            self._filled += voxel_kernels.insert(self._keys, self._sums, batch, self.voxel_m)
