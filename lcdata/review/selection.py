"""Filters: which pairs and methods a review shows."""

from __future__ import annotations

import difflib
import math
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from lcdata.errors import ReportError
from lcdata.evaluation import metrics
from lcdata.review.text import count_text
from lcdata.review.trials import Trials

if TYPE_CHECKING:
    from lcdata.dataset.reader import Dataset
    from lcdata.dataset.schema import PairRecord
    from lcdata.evaluation.results import TrialResult


@dataclass(frozen=True)
class Selection:
    """What to show; what is empty leaves out nothing.

    Args:
        scenarios: Names of scenarios.
        poses: Names of poses, with or without their scenario.
        pairs: Names of pairs.
        methods: Names of methods.
        worst: How many pairs, those that the methods do worst on; None for all.
    """

    scenarios: tuple[str, ...] = ()
    poses: tuple[str, ...] = ()
    pairs: tuple[str, ...] = ()
    methods: tuple[str, ...] = ()
    worst: int | None = None

    def text(self) -> str:
        """The filters as they are typed."""
        given = {
            "--scenario": self.scenarios,
            "--pose": self.poses,
            "--pair": self.pairs,
            "--method": self.methods,
        }
        parts = [f"{option} {','.join(names)}" for option, names in given.items() if names]
        return " ".join([*parts, *([f"--worst {self.worst}"] if self.worst else [])])


def select_pairs(dataset: Dataset, selection: Selection) -> Dataset:
    """The data set with the chosen pairs alone, `worst` aside.

    Raises:
        ReportError: An unknown scenario, pose or pair, or no pair that is of all of them.
    """
    scenarios = {name: name for name in dataset.scenarios}
    poses = {p: p for p in dict.fromkeys(record.pose_id for record in dataset.pairs)}
    pairs = {record.pair_id: record.pair_id for record in dataset.pairs}
    wanted = (
        chosen("scenario", selection.scenarios, scenarios),
        chosen("pose", selection.poses, poses),
        chosen("pair", selection.pairs, pairs),
    )
    kept = tuple(
        record
        for record in dataset.pairs
        if all(
            not names or name in names
            for names, name in zip(
                wanted, (record.scenario, record.pose_id, record.pair_id), strict=True
            )
        )
    )
    if dataset.pairs and not kept:
        raise ReportError(
            f"no pair of {dataset.path} is left by {selection.text()}",
            "leave one of these filters out",
        )
    return replace(dataset, pairs=kept)


def select_methods(trials: Trials, methods: Sequence[str]) -> frozenset[str] | None:
    """Names of the chosen methods; None for all.

    Raises:
        ReportError: A method that has no trial.
    """
    if not methods:
        return None
    if not trials.methods:
        raise ReportError(
            f"there are no results of {', '.join(methods)}", "`lcdata calibrate` makes some"
        )
    return chosen("method", methods, {name: name for name in trials.methods})


def worst_pairs(
    dataset: Dataset, trials: Trials, count: int, badness: Callable[[PairRecord], float]
) -> Dataset:
    """The data set with its worst pairs alone, the worst first.

    Args:
        dataset: The data set.
        trials: The trials that are shown.
        count: How many pairs.
        badness: How bad a pair is; NaN for one that there is nothing to say of.

    Raises:
        ReportError: No results, or none on these pairs.
    """
    if count < 1:
        raise ReportError(f"--worst {count} shows no pair", "give 1 or more")
    ranked = [(badness(record), record) for record in dataset.pairs]
    ranked = [item for item in ranked if not math.isnan(item[0])]
    if not ranked:
        where = f"run {trials.run!r} has none on these pairs" if trials.run else "there are none"
        raise ReportError(
            f"--worst {count} needs results, and {where}", "`lcdata calibrate` makes some"
        )
    ranked.sort(key=lambda item: item[0], reverse=True)  # stable: pairs in their order else
    return replace(dataset, pairs=tuple(record for _, record in ranked[:count]))


def of_trials(trials: Trials) -> Callable[[PairRecord], float]:
    """How badly the worst of the shown trials on a pair did."""

    def badness(record: PairRecord) -> float:
        found = trials.of_pair(record.pair_id).values()
        return max((trial_badness(trial) for trial in found), default=math.nan)

    return badness


def trial_badness(trial: TrialResult) -> float:
    """How wrong: errors in units of the limits; no estimate is the worst."""
    if trial.failed:
        return math.inf
    return max(
        trial.rotation_error_deg / metrics.SUCCESS_ROTATION_DEG,
        trial.translation_error_m / metrics.SUCCESS_TRANSLATION_M,
    )


def chosen(kind: str, asked: Sequence[str], known: dict[str, str]) -> frozenset[str]:
    """The known names that are asked for: in full, or by the end after a slash.

    Raises:
        ReportError: A name that is not known.
    """
    found: set[str] = set()
    for name in asked:
        hits = {known[k] for k in known if k == name or k.endswith(f"/{name}")}
        if not hits:
            raise ReportError(f"no {kind} {name!r} to show", suggestion(name, known))
        found |= hits
    return frozenset(found)


def suggestion(name: str, known: Collection[str]) -> str:
    """What a user may have meant, or a few of what there is."""
    close = difflib.get_close_matches(name, known, n=3, cutoff=0.6)
    if close:
        return f"did you mean {' or '.join(close)}?"
    some = sorted(known)
    if not some:
        return "there is none"
    more = f" and {len(some) - 4} more" if len(some) > 4 else ""
    return f"there is {', '.join(some[:4])}{more}"


def order_text(selection: Selection, of: int, shown: int, compared: bool) -> str:
    """What a reader should know of what is left out and how pairs are ordered."""
    parts = []
    if shown < of:
        parts.append(f"Shown are {count_text(shown, 'pair')} of {of}: `{selection.text()}`.")
    elif selection.methods and not compared:
        parts.append(f"Filter: `{selection.text()}`.")
    if selection.worst:
        what = "where the two differ most" if compared else "where the methods do worst"
        parts.append(f"They are those {what}, in this order, the worst first.")
    return " ".join(parts)
