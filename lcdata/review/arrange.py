"""From what a user asks for to what a review shows."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from lcdata.errors import ReportError
from lcdata.review.comparing import compare_runs, compare_truths, of_comparison
from lcdata.review.selection import (
    Selection,
    of_trials,
    order_text,
    select_methods,
    select_pairs,
    suggestion,
    worst_pairs,
)
from lcdata.review.shown import Comparison, Shown
from lcdata.review.trials import Trials, choose_trials

if TYPE_CHECKING:
    from lcdata.dataset.reader import Dataset


@dataclass(frozen=True)
class Wanted:
    """What a user asks to see.

    Args:
        selection: Which pairs and methods.
        run: Name of the run; None for the one that was written last.
        compare: A run, results file or method to compare with; None for nothing.
        truths: Two versions of the ground truth to compare; None for the present one.
    """

    selection: Selection = field(default_factory=Selection)
    run: str | None = None
    compare: str | None = None
    truths: tuple[str, str] | None = None


def arrange(dataset: Dataset, wanted: Wanted, *, growing: bool = False) -> Shown:
    """What to show of a data set.

    Args:
        dataset: The data set.
        wanted: What a user asks to see.
        growing: Whether results are being made: a run or method that is not there may come.

    Raises:
        ReportError: No pairs, an unknown run, version, method, pose or pair, nothing left by
            the filters, or results that cannot be read.
    """
    if not dataset.pairs:
        raise ReportError(f"{dataset.path} has no pairs", "there is nothing to review")
    if wanted.compare is not None and wanted.truths is not None:
        raise ReportError("two runs and two ground truths cannot be compared at once", "drop one")
    selection = wanted.selection
    chosen = select_pairs(dataset, selection)
    trials = choose_trials(dataset, wanted.run) if growing else _trials(dataset, wanted)
    if wanted.run is not None and trials.run != wanted.run and not growing:
        runs = trials.other_runs
        raise ReportError(
            f"{dataset.path} has no run {wanted.run!r}",
            suggestion(wanted.run, runs) if runs else "stored are none",
        )
    comparison: Comparison | None = None
    methods: Collection[str] | None
    if wanted.compare is not None:
        trials, comparison = compare_runs(dataset, trials, wanted.compare, selection.methods)
        methods = None
    else:
        methods = selection.methods or None
        if not growing:
            methods = select_methods(trials, selection.methods)
    trials = trials.on({record.pair_id for record in chosen.pairs}, methods)
    if wanted.truths is not None:
        chosen, trials, comparison = compare_truths(chosen, trials, *wanted.truths)
    if selection.worst is not None:
        badness = (
            of_trials(trials) if comparison is None else of_comparison(chosen, trials, comparison)
        )
        chosen = worst_pairs(chosen, trials, selection.worst, badness)
        pair_ids = {record.pair_id for record in chosen.pairs}
        trials = trials.on(pair_ids)
        if comparison is not None:
            comparison = replace(comparison, errors_a=comparison.errors_a.on(pair_ids))
    note = order_text(selection, len(dataset), len(chosen), comparison is not None)
    return Shown(chosen, trials, comparison, note)


def _trials(dataset: Dataset, wanted: Wanted) -> Trials:
    """Trials of the run that is asked for; else of the last that has all the methods."""
    last = choose_trials(dataset, wanted.run)
    methods = set(wanted.selection.methods)
    if wanted.run is not None or methods <= set(last.methods):
        return last
    for run in last.other_runs[::-1]:
        trials = choose_trials(dataset, run)
        if methods <= set(trials.methods):
            return trials
    return last
