"""The grid of `voxel_cloud`, compiled: a hash table whose rows are sums over cells."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]

EMPTY = -1
_BITS = 21
"""Bits a coordinate: cells of 1 cm reach 10 km."""


@njit(cache=True)  # type: ignore[untyped-decorator]
def insert(keys: NDArray[np.int64], sums: Array, rows: Array, voxel_m: float) -> int:
    """Add rows to the table; some of its places must stay empty.

    Args:
        keys: (C,) cell of each place, C a power of two; `EMPTY` where there is none.
        sums: (C, 5) weighted sums of x, y, z, intensity, and the weights.
        rows: (N, 5) x, y, z, intensity, weight; rows that are not finite are left out.
        voxel_m: Size of a cell, metres.

    Returns:
        How many places were filled.
    """
    places = np.uint64(len(keys) - 1)
    filled = 0
    for n in range(len(rows)):
        x, y, z, weight = rows[n, 0], rows[n, 1], rows[n, 2], rows[n, 4]
        if not np.isfinite(x + y + z):
            continue
        key = np.int64(0)
        for value in (x, y, z):
            cell = np.int64(np.floor(value / voxel_m)) & np.int64((1 << _BITS) - 1)
            key = (key << np.int64(_BITS)) | cell
        at = np.uint64(key) * np.uint64(0x9E3779B97F4A7C15)
        at = (at ^ (at >> np.uint64(29))) & places
        while keys[at] != key and keys[at] != EMPTY:
            at = (at + np.uint64(1)) & places
        if keys[at] == EMPTY:
            keys[at] = key
            filled += 1
        for k in range(4):
            sums[at, k] += weight * rows[n, k]
        sums[at, 4] += weight
    return filled
