"""Which trials a review shows: one run, and of each pair and method the first trial."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from lcdata.errors import ReportError
from lcdata.evaluation.results import Results, TrialResult, read_run
from lcdata.review.colours import RGB

if TYPE_CHECKING:
    from lcdata.calibrators.base import LineMatches
    from lcdata.dataset.reader import Dataset

Array = NDArray[np.float64]

RIGHT = "right"
RIGHT_FLAGGED = "right, but flagged"
UNDECIDED = "undecided"
WRONG_FLAGGED = "wrong, flagged"
WRONG = "wrong, not flagged"
NO_ESTIMATE = "no estimate"
SIGMA_LIMIT = 3.5
"""An error of up to so many of the ground truth's standard deviations says nothing: it is the
95 % quantile of chi with six degrees of freedom."""

OUTCOME_COLOURS: dict[str, RGB] = {
    RIGHT: (46, 160, 92),
    RIGHT_FLAGGED: (150, 190, 80),
    UNDECIDED: (96, 130, 176),
    WRONG_FLAGGED: (222, 200, 50),
    WRONG: (214, 62, 62),
    NO_ESTIMATE: (120, 60, 130),
}


@dataclass(frozen=True, eq=False)
class Trials:
    """The trials of one run, errors against the data set's present ground truth.

    Args:
        run: Name of the run; empty if there are no results.
        all: Every trial of the run.
        stale: How many of them were measured against another ground truth, and recomputed.
        other_runs: Runs that are stored and not shown, by the time they were written.
    """

    run: str = ""
    all: tuple[TrialResult, ...] = ()
    stale: int = 0
    other_runs: tuple[str, ...] = ()

    @cached_property
    def methods(self) -> tuple[str, ...]:
        """Names of the methods, sorted, so that a method's colour does not depend on chance."""
        return tuple(sorted({trial.method for trial in self.all}))

    @cached_property
    def per_pair(self) -> int:
        """Most trials that a pair and method have."""
        counts: dict[tuple[str, str], int] = {}
        for trial in self.all:
            for pair_id in trial.pair_ids:
                key = pair_id, trial.method
                counts[key] = counts.get(key, 0) + 1
        return max(counts.values(), default=0)

    def on(self, pair_ids: Collection[str], methods: Collection[str] | None = None) -> Trials:
        """Those on some of the pairs, and of some of the methods."""
        kept = tuple(
            t
            for t in self.all
            if (methods is None or t.method in methods) and not set(t.pair_ids).isdisjoint(pair_ids)
        )
        return replace(self, all=kept)

    @cached_property
    def _shown(self) -> dict[tuple[str, str], TrialResult]:
        first: dict[tuple[str, str], TrialResult] = {}
        for trial in self.all:
            for pair_id in trial.pair_ids:
                known = first.get((pair_id, trial.method))
                if known is None or trial.trial < known.trial:
                    first[pair_id, trial.method] = trial
        return first

    def of_pair(self, pair_id: str) -> dict[str, TrialResult]:
        """The shown trial of each method that has one on this pair, by the method's name."""
        found = ((m, self._shown.get((pair_id, m))) for m in self.methods)
        return {method: trial for method, trial in found if trial is not None}


def choose_trials(dataset: Dataset, run: str | None = None) -> Trials:
    """The trials to show.

    Args:
        dataset: The data set.
        run: Name of the run; None for the one that was written last.

    Raises:
        ReportError: A results file that cannot be read.
    """
    paths = {path.stem: path for path in dataset.result_files()}
    if run is None:
        run = max(paths, key=lambda name: (paths[name].stat().st_mtime_ns, name), default="")
    if run not in paths:
        return Trials(other_runs=tuple(paths))
    by_age = sorted(paths, key=lambda name: (paths[name].stat().st_mtime_ns, name))
    others = tuple(name for name in by_age if name != run)
    return replace(trials_of_file(dataset, paths[run]), other_runs=others)


def trials_of_file(dataset: Dataset, path: Path) -> Trials:
    """The trials of a results file, errors against the data set's present ground truth.

    Trials on poses or pairs that the data set does not have are left out.

    Raises:
        ReportError: A results file that cannot be read.
    """
    pairs = {record.pair_id for record in dataset.pairs}
    poses = {pose.pose_id for pose in dataset.poses}
    known = Results(
        tuple(
            t
            for t in read_run(path).trials
            if t.pose_id in poses and not pairs.isdisjoint(t.pair_ids)
        )
    )
    current, stale = known.split_stale(dataset)
    renewed = stale.recomputed(dataset).trials
    return Trials(run=path.stem, all=current.trials + renewed, stale=len(renewed))


def trials_of_pair(dataset: Dataset, pair_id: str, method: str | None = None) -> Trials:
    """The last written run that has a trial on a pair.

    Args:
        dataset: The data set.
        pair_id: The pair.
        method: A method that it must be of; None for any.

    Returns:
        No trials if no method is asked for and none has one.

    Raises:
        ReportError: No trial of the method, or a results file that cannot be read.
    """
    paths = sorted(dataset.result_files(), key=lambda path: path.stat().st_mtime_ns, reverse=True)
    known: set[str] = set()
    for path in paths:
        trials = choose_trials(dataset, path.stem)
        methods = trials.of_pair(pair_id).keys()
        if method in methods or (method is None and methods):
            return trials
        known |= methods
    if method is not None:
        raise ReportError(
            f"{dataset.path} has no result of {method!r} on {pair_id}",
            f"there are results of {', '.join(sorted(known)) or 'no method'}",
        )
    return Trials()


def outcome(trial: TrialResult) -> str:
    """A key of `OUTCOME_COLOURS`: is the trial right, and does its method say so?

    Beyond the limits, yet no farther from the ground truth than that may itself be from the
    truth: then nobody can say.
    """
    if trial.failed:
        return NO_ESTIMATE
    flagged = trial.degenerate or not trial.converged
    if trial.success:
        return RIGHT_FLAGGED if flagged else RIGHT
    if trial.sigma_distance <= SIGMA_LIMIT:
        return UNDECIDED
    return WRONG_FLAGGED if flagged else WRONG


def matches_of(trial: TrialResult, pair_id: str) -> tuple[Array, Array]:
    """The lines that a trial matched on one of its pairs.

    Returns:
        (M, 2, 3) segments in the LiDAR frame, metres, and (M, 2, 2) segments in the undistorted
        image, pixels.
    """
    matches: LineMatches = trial.matches
    here = matches.pair_index == trial.pair_ids.index(pair_id)
    return matches.points_lidar[here], matches.points_image[here]
