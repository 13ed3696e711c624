"""How much of a cloud the camera sees: what a calibration has to go by."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lcdata.dataset import Dataset, cloud_file
from lcdata.errors import DatasetError, MessageError
from lcdata.geometry import se3
from lcdata.recording import fields

POINTS = 6000
"""Of a cloud, taken evenly: the share is then right to a per cent."""

MOST_PAIRS = 300
"""Of more pairs these many are read, taken evenly."""


def shares_in_view(dataset: Dataset, pair_ids: Sequence[str]) -> dict[str, float]:
    """Share of each cloud's returns that lie inside the image, at the ground truth.

    Args:
        dataset: The data set.
        pair_ids: Its pairs; of more than `MOST_PAIRS` those are taken evenly.

    Returns:
        0 to 1 by pair, of those whose cloud can be read.
    """
    chosen = np.linspace(0, len(pair_ids) - 1, min(len(pair_ids), MOST_PAIRS)).round().astype(int)
    found = {}
    for pair_id in (pair_ids[i] for i in chosen):
        try:
            found[pair_id] = _share(dataset, pair_id)
        except (DatasetError, MessageError):
            continue  # `lcdata validate` names it; the page has one dot less
    return {pair_id: share for pair_id, share in found.items() if np.isfinite(share)}


def _share(dataset: Dataset, pair_id: str) -> float:
    record = dataset.pair(pair_id)
    records, _, _ = cloud_file.read(dataset.path / record.cloud)
    points = fields.points(records[:: max(1, len(records) // POINTS)])
    points = points[np.isfinite(points).all(axis=1) & points.any(axis=1)]
    if not len(points):
        return np.nan
    T = dataset.pose(record.pose_id).T_camera_lidar
    _, inside = dataset.camera(record.scenario).project(se3.apply(T, points))
    return float(inside.mean())
