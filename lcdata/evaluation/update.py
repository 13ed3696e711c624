"""Errors of stored estimates, measured again after the ground truth has changed."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from lcdata.dataset import Dataset
from lcdata.dataset.lock import locked
from lcdata.evaluation.results import FOLDER, read_results, read_run, write_run


class Updated(NamedTuple):
    """How many trials were measured again, and of how many the pose is gone."""

    trials: int
    lost: int


def stale_trials(dataset: Dataset) -> int:
    """How many stored trials are against another ground truth than the data set's own."""
    return len(read_results(dataset).split_stale(dataset)[1].trials)


def update_results(dataset: Dataset) -> Updated:
    """Measure stored estimates against the present ground truth, and store the errors.

    Estimates and initial guesses stay as they were: methods do not run again. All files are
    read before the first is written.

    Raises:
        ReportError: A file that cannot be read.
        DatasetError: One that cannot be written, or another process is writing the data set.
    """
    with locked(Path(dataset.path)):
        paths = sorted((Path(dataset.path) / FOLDER).glob("[!.]*.parquet"))
        stored = [(path, read_run(path)) for path in paths]
        trials = lost = 0
        for path, results in stored:
            stale = len(results.split_stale(dataset)[1].trials)
            if not stale:
                continue
            again = results.recomputed(dataset)
            left = len(again.split_stale(dataset)[1].trials)
            write_run(path, again.trials)
            trials, lost = trials + stale - left, lost + left
    return Updated(trials, lost)
