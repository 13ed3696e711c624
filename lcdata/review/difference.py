"""How far the two sides of a comparison differ, pair by pair, in columns."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from lcdata.evaluation import metrics
from lcdata.geometry import se3
from lcdata.review import colours, names
from lcdata.review.errors import MEASURES, Measure, send_series, style_series
from lcdata.review.shown import Comparison, Shown
from lcdata.review.trials import Trials

if TYPE_CHECKING:
    import rerun as rr

    from lcdata.dataset.schema import PairRecord, PoseRecord

MOVED = "moved"
"""Series of how far ground truth B is from ground truth A."""

ZERO = "zero"
TITLES = {
    "rotation_deg": "B minus A: rotation error (deg)",
    "translation_m": "B minus A: translation error (m)",
    "sigma_distance": "from A to B / sigma of A",
}


def send_differences(
    recording: rr.RecordingStream, shown: Shown, time: Callable[[Sequence[int]], list[Any]]
) -> dict[str, tuple[float, float]]:
    """Series of the differences: below zero where B is nearer to the ground truth than A.

    Of two ground truths also how far they are apart, which the series `moved` says.

    Args:
        recording: Where to send them.
        shown: What the review shows, with a comparison.
        time: Makes the time columns of some of the pairs, by their numbers.

    Returns:
        Both ends of a sensible axis for each measure that has values, by its name.
    """
    comparison = shown.comparison
    assert comparison is not None
    records = shown.dataset.pairs
    ranges = {}
    for measure in MEASURES:
        seen: list[float] = []
        for source, colour, values in _series(shown, comparison, measure, records):
            rows = np.flatnonzero(np.isfinite(values))
            if not len(rows):
                continue
            path = names.series(names.DIFFERENCE, measure.name, source)
            send_series(recording, path, time(rows.tolist()), values[rows].tolist())
            style_series(recording, path, source, colour, of=len(records))
            seen += values[rows].tolist()
        if not seen:
            continue
        path = names.series(names.DIFFERENCE, measure.name, ZERO)
        send_series(recording, path, time(range(len(records))), [0.0] * len(records))
        style_series(recording, path, ZERO, colours.GREY, marked=False)
        ranges[measure.name] = axis(seen)
    return ranges


def axis(values: Sequence[float]) -> tuple[float, float]:
    """Ends of an axis on which most differences fit, zero always: the wildest leave the plot."""
    low, high = np.quantile(values, [0.1, 0.9])
    wide = 1.3 * max(abs(low), abs(high), 1e-6)
    return (-wide if min(values) < 0 else -0.08 * wide, wide)


def difference(
    trials_a: Trials, trials_b: Trials, measure: Measure, pair_id: str, a: str, b: str
) -> float:
    """Error of B minus that of A on a pair; NaN where one of them has none."""
    first, second = trials_a.of_pair(pair_id).get(a), trials_b.of_pair(pair_id).get(b)
    if first is None or second is None:
        return np.nan
    return measure.of_trial(second) - measure.of_trial(first)


def _series(
    shown: Shown, comparison: Comparison, measure: Measure, records: Sequence[PairRecord]
) -> list[tuple[str, colours.RGB, Any]]:
    """Name, colour and (N,) values of each curve of a measure."""
    found = []
    if shown.of_truths:
        values = [
            _apart(comparison.former.get(r.pose_id), shown.dataset.pose(r.pose_id), measure)
            for r in records
        ]
        found.append((MOVED, colours.GREEN, np.array(values)))
        if measure.name == "sigma_distance":
            return found
        for method in shown.trials.methods:
            pair = comparison.errors_a, shown.trials, measure
            values = [difference(*pair, r.pair_id, method, method) for r in records]
            found.append((method, shown.colours[method], np.array(values)))
        return found
    if measure.name == "sigma_distance":
        return found
    for together in comparison.together:
        pair = shown.trials, shown.trials, measure
        values = [difference(*pair, r.pair_id, together.a, together.b) for r in records]
        found.append((together.title, shown.colours[together.b], np.array(values)))
    return found


def _apart(a: PoseRecord | None, b: PoseRecord, measure: Measure) -> float:
    """How far ground truth B is from A, in a measure's unit."""
    if a is None:
        return np.nan
    if measure.name == "rotation_deg":
        return metrics.rotation_error_deg(b.T_camera_lidar, a.T_camera_lidar)
    if measure.name == "translation_m":
        return metrics.translation_error_m(b.T_camera_lidar, a.T_camera_lidar)
    return se3.sigma_distance(b.T_camera_lidar, a.T_camera_lidar, a.covariance)
