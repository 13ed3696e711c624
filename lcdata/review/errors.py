"""Errors and outcomes of each method over the pairs, in columns."""

from __future__ import annotations

from collections.abc import Callable, Container, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lcdata.evaluation import metrics
from lcdata.review import colours, names
from lcdata.review.trials import OUTCOME_COLOURS, SIGMA_LIMIT, Trials, outcome

if TYPE_CHECKING:
    import rerun as rr

    from lcdata.dataset.schema import PairRecord, PoseRecord
    from lcdata.evaluation.results import TrialResult


@dataclass(frozen=True)
class Measure:
    """One kind of error.

    Args:
        name: Entity below `errors/`.
        title: What its plot is called.
        limit: Above this an estimate counts as wrong.
        of_trial: The error of a trial.
        of_truth: The error that the ground truth itself may have at a pose; None if that makes
            no sense.
    """

    name: str
    title: str
    limit: float
    of_trial: Callable[[TrialResult], float]
    of_truth: Callable[[PoseRecord], float] | None


MEASURES = (
    Measure(
        "rotation_deg",
        "rotation error (deg)",
        metrics.SUCCESS_ROTATION_DEG,
        lambda trial: trial.rotation_error_deg,
        lambda pose: metrics.groundtruth_sigma(pose.T_camera_lidar, pose.covariance).rotation_deg,
    ),
    Measure(
        "translation_m",
        "translation error (m)",
        metrics.SUCCESS_TRANSLATION_M,
        lambda trial: trial.translation_error_m,
        lambda pose: metrics.groundtruth_sigma(pose.T_camera_lidar, pose.covariance).translation_m,
    ),
    Measure(
        "sigma_distance",
        "error / ground-truth sigma",
        SIGMA_LIMIT,
        lambda trial: trial.sigma_distance,
        None,
    ),
)


LINES_UP_TO = 150
"""Pairs whose values are joined by lines; more are dots."""

SCENARIO_COLOURS: tuple[colours.RGB, ...] = ((62, 80, 108), (92, 112, 142))


def send_errors(
    recording: rr.RecordingStream,
    trials: Trials,
    colour: Mapping[str, colours.RGB],
    pair_ids: Sequence[str],
    poses: Sequence[PoseRecord],
    time: Callable[[Sequence[int]], list[Any]],
) -> dict[str, float]:
    """Series of every measure.

    Args:
        recording: Where to send them.
        trials: What to show.
        colour: Of each method.
        pair_ids: Names of the pairs in the order of the timeline.
        poses: The pose of each pair.
        time: Makes the time columns of some of the pairs, by their numbers.

    Returns:
        Upper end of a sensible axis for each measure that has values, by its name.
    """
    send_curves(recording, trials, colour, pair_ids, range(len(pair_ids)), time)
    tops = axis_tops(trials, pair_ids)
    send_beyond(recording, trials, colour, pair_ids, tops, time)
    send_references(recording, tops, poses, time)
    return tops


def send_curves(
    recording: rr.RecordingStream,
    trials: Trials,
    colour: Mapping[str, colours.RGB],
    pair_ids: Sequence[str],
    numbers: Sequence[int],
    time: Callable[[Sequence[int]], list[Any]],
) -> None:
    """The methods' curves, on the pairs of some numbers."""
    for measure in MEASURES:
        for method in trials.methods:
            values = _values(measure, trials, method, [pair_ids[number] for number in numbers])
            there = np.flatnonzero(np.isfinite(values))
            if len(there):
                path = names.series(names.ERRORS, measure.name, method)
                rows = [numbers[i] for i in there.tolist()]
                send_series(recording, path, time(rows), values[there].tolist())
                style_series(recording, path, method, colour[method], of=len(pair_ids))


def send_beyond(
    recording: rr.RecordingStream,
    trials: Trials,
    colour: Mapping[str, colours.RGB],
    pair_ids: Sequence[str],
    tops: Mapping[str, float],
    time: Callable[[Sequence[int]], list[Any]],
) -> None:
    """Marks at the upper edge of the plots where an error lies beyond it.

    Where pairs are few, lines that leave the plot show that; dots that do would be lost.
    """
    import rerun as rr

    if len(pair_ids) <= LINES_UP_TO:
        return
    for measure in MEASURES:
        top = tops.get(measure.name, np.inf)
        for rank, method in enumerate(trials.methods):
            height = top * (0.97 - 0.055 * rank)  # one row a method
            values = _values(measure, trials, method, pair_ids)
            beyond = np.flatnonzero(values > top)
            if not len(beyond):
                continue
            path = f"{names.series(names.ERRORS, measure.name, method)}/{names.BEYOND}"
            send_series(recording, path, time(beyond.tolist()), [height] * len(beyond))
            style = rr.SeriesPoints(
                colors=[colour[method]],
                markers=["up"],
                marker_sizes=[2.5],
                names=[method],
            )
            recording.log(path, style, static=True)


def axis_tops(trials: Trials, pair_ids: Sequence[str]) -> dict[str, float]:
    """Upper end of a sensible axis for each measure that has values, by its name."""
    tops = {}
    for measure in MEASURES:
        found = [_values(measure, trials, method, pair_ids) for method in trials.methods]
        values = np.concatenate([*found, []])
        if np.isfinite(values).any():
            tops[measure.name] = axis_top(values[np.isfinite(values)].tolist(), measure.limit)
    return tops


def send_references(
    recording: rr.RecordingStream,
    measures: Container[str],
    poses: Sequence[PoseRecord],
    time: Callable[[Sequence[int]], list[Any]],
) -> None:
    """What the methods' curves are to be seen against: limits, the ground truth's own error."""
    everywhere = range(len(poses))
    for measure in MEASURES:
        if measure.name not in measures:
            continue
        path = names.series(names.ERRORS, measure.name, names.LIMIT)
        send_series(recording, path, time(everywhere), [measure.limit] * len(poses))
        style_series(recording, path, "limit", colours.RED, marked=False)
        if measure.of_truth:
            sigma = [measure.of_truth(pose) for pose in poses]
            if np.isfinite(sigma).all():
                path = names.series(names.ERRORS, measure.name, names.GROUND_TRUTH)
                send_series(recording, path, time(everywhere), sigma)
                style_series(recording, path, "ground truth's own", colours.GREEN, marked=False)


def _values(
    measure: Measure, trials: Trials, method: str, pair_ids: Sequence[str]
) -> NDArray[np.float64]:
    """(N,) errors of a method's shown trials; NaN where it has none."""
    shown = [trials.of_pair(pair_id).get(method) for pair_id in pair_ids]
    return np.array([measure.of_trial(trial) if trial else np.nan for trial in shown], float)


def axis_top(values: Sequence[float], limit: float) -> float:
    """Upper end of an axis on which small errors can be told apart.

    Four trials out of five fit, but it stays between 1.5 and 6 times the limit: an error beyond
    that is simply wrong, and its line leaves the plot. Where hardly any is right, the axis is
    long enough for one in five.
    """
    low, high = 1.15 * np.quantile(values, [0.2, 0.8])
    return float(np.clip(high, 1.5 * limit, max(6 * limit, low)))


def send_series(
    recording: rr.RecordingStream, path: str, indexes: list[Any], values: Sequence[float]
) -> None:
    """Send a curve."""
    import rerun as rr

    recording.send_columns(path, indexes, rr.Scalars.columns(scalars=list(values)))


def style_series(
    recording: rr.RecordingStream,
    path: str,
    name: str,
    colour: colours.RGB,
    marked: bool = True,
    of: int = 0,
) -> None:
    """Name and colour of a curve.

    Args:
        recording: Where to send them.
        path: Of the curve.
        name: What the legend calls it.
        colour: Its colour.
        marked: Whether its values are marked; else it is a thin line.
        of: Number of pairs: of many, lines up and down would only fill the plot.
    """
    import rerun as rr

    if not marked or of <= LINES_UP_TO:
        line = rr.SeriesLines(colors=[colour], widths=[2.0 if marked else 1.0], names=[name])
        recording.log(path, line, static=True)
    if marked:  # a method that succeeded on a single pair would otherwise be invisible
        size = 3.0 if of <= LINES_UP_TO else 1.5
        point = rr.SeriesPoints(colors=[colour], marker_sizes=[size], names=[name])
        recording.log(path, point, static=True)


def send_outcomes(
    recording: rr.RecordingStream,
    trials: Trials,
    records: Sequence[PairRecord],
    time: Callable[[Sequence[int]], list[Any]],
    numbers: Sequence[int] | None = None,
) -> None:
    """Lanes of the scenario and of every method's outcome.

    Args:
        recording: Where to send them.
        trials: What to show.
        records: The pairs in the order of the timeline.
        time: Makes the time columns of some of the pairs, by their numbers; the number after
            the last is that of the end of the lanes.
        numbers: Send these pairs' outcomes alone; None for all pairs and the scenarios.
    """
    import rerun as rr

    def send(path: str, rows: Sequence[int], states: list[str]) -> None:
        recording.send_columns(path, time(rows), rr.StateChange.columns(state=states))

    end = len(records)
    if numbers is None:
        scenarios = sorted({record.scenario for record in records})
        shades = [SCENARIO_COLOURS[i % len(SCENARIO_COLOURS)] for i in range(len(scenarios))]
        style = rr.StateConfiguration(values=scenarios, colors=shades)
        recording.log(names.SCENARIO, style, static=True)
        lane = [*(record.scenario for record in records), ""]
        send(names.SCENARIO, range(end + 1), lane)
    style = rr.StateConfiguration(
        values=list(OUTCOME_COLOURS), colors=list(OUTCOME_COLOURS.values())
    )
    for method in trials.methods:
        path = f"{names.OUTCOMES}/{names.part(method)}"
        recording.log(path, style, static=True)
        # A state lasts until the next: one after each ends it.
        rows = range(end) if numbers is None else numbers
        ends = {end} | {row + 1 for row in rows}
        wanted = sorted({*rows, *ends})
        shown = [
            None if n == end else trials.of_pair(records[n].pair_id).get(method) for n in wanted
        ]
        send(path, wanted, [outcome(trial) if trial else "" for trial in shown])
