"""Normalised information distance of LiDAR and image intensities, and what it costs to leave.

Koide et al. 2023, eqs. (2)-(4); (2) lacks its minus sign in print: H = -sum p log p. With
I = H_L + H_I - H_LI

    NID = (H_LI - I) / H_LI = 2 - (H_L + H_I) / H_LI,   cost = 1 - sqrt(f) (1 - NID)

where f is the number of points in the image over that of the sample. NID alone, over the points
that are inside, rewards a pose that pushes hard points out of the image.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def nid(counts: NDArray[Any]) -> Array:
    """Normalised information distance, 0 (each determines the other) .. 1 (independent).

    Args:
        counts: (..., n, m) joint histograms, LiDAR by image.

    Returns:
        (...) distances; 1 where a histogram is empty or both intensities are constant.
    """
    counts = np.asarray(counts, float)
    total = np.maximum(counts.sum(axis=(-2, -1)), 1e-300)

    def entropy(h: Array, axis: int | tuple[int, int]) -> Array:
        return np.asarray(np.log(total) - (h * np.log(np.maximum(h, 1e-300))).sum(axis) / total)

    joint = entropy(counts, (-2, -1))
    single = entropy(counts.sum(-1), -1) + entropy(counts.sum(-2), -1)
    return np.where(joint > 1e-12, 2.0 - single / np.maximum(joint, 1e-12), 1.0)


def cost_of(counts: NDArray[Any], sample: float) -> Array:
    """Cost of (..., n, m) histograms of a sample of so many points; see the module."""
    share = np.minimum(np.asarray(counts, float).sum(axis=(-2, -1)) / max(sample, 1.0), 1.0)
    return np.asarray(1.0 - np.sqrt(share) * (1.0 - nid(counts)))


def cost_slopes(counts: Array, sample: float) -> tuple[float, Array]:
    """Cost of one histogram and its derivative by each count.

    With S = sum h log h over the joint counts and W their sum, H_LI = log W - S / W, so
    dH_LI / dh = (S / W - log h) / W; the same for the marginals.
    """
    W = max(float(counts.sum()), 1e-12)
    rows, columns = counts.sum(1), counts.sum(0)
    log, log_rows, log_columns = (np.log(np.maximum(h, 1e-9)) for h in (counts, rows, columns))
    S, S_rows, S_columns = counts.ravel() @ log.ravel(), rows @ log_rows, columns @ log_columns
    joint = max(np.log(W) - S / W, 1e-9)
    single = 2 * np.log(W) - (S_rows + S_columns) / W
    shared = single / joint - 1.0
    d_joint = (S / W - log) / W
    d_single = (S_rows / W - log_rows)[:, None] / W + (S_columns / W - log_columns)[None] / W
    share = W / max(sample, 1.0)
    d_shared = d_single / joint - single / joint**2 * d_joint
    slopes = -np.sqrt(share) * (d_shared + 0.5 * shared / W)
    return float(1.0 - np.sqrt(share) * shared), np.ascontiguousarray(slopes)
