"""What is compared: two runs, two methods of a run, or two versions of the ground truth."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from lcdata.dataset.groundtruth_versions import poses_of, versions
from lcdata.errors import ReportError
from lcdata.evaluation import metrics
from lcdata.review import names
from lcdata.review.selection import select_methods, suggestion, trial_badness
from lcdata.review.shown import Comparison, Together
from lcdata.review.trials import Trials, trials_of_file

if TYPE_CHECKING:
    from lcdata.dataset.reader import Dataset
    from lcdata.dataset.schema import PairRecord, PoseRecord
    from lcdata.evaluation.results import TrialResult

FIRST, PRESENT = "first", "present"
"""Names of two versions of the ground truth that every data set has."""

SUFFIXES = ".A", ".B"


def compare_runs(
    dataset: Dataset, trials: Trials, other: str, methods: Sequence[str]
) -> tuple[Trials, Comparison]:
    """The shown run (A) beside another run, or a method of it beside another method (B).

    Args:
        dataset: The data set.
        trials: Trials of A.
        other: Name of a stored run, path of a results file, or a method of A.
        methods: Methods to compare; none for all that both have.

    Returns:
        Trials of both, and what is compared.

    Raises:
        ReportError: There is no such run, file or method, or nothing in common.
    """
    if not trials.all:
        raise ReportError(
            f"{dataset.path} has no results to compare with {other!r}",
            "`lcdata calibrate` makes some",
        )
    stored = {path.stem: path for path in dataset.result_files()}
    path = stored.get(other) or Path(other)
    if other not in stored and not path.is_file():
        if other in trials.methods:
            return _methods(trials, other, methods)
        known = [*stored, *trials.methods]
        raise ReportError(
            f"no run, results file or method {other!r} to compare with",
            suggestion(other, known),
        )
    if other == trials.run:
        raise ReportError(f"{other!r} is compared with itself", "--run names the other one")
    second = trials_of_file(dataset, path)
    common = [name for name in trials.methods if name in second.methods]
    if not common:
        raise ReportError(
            f"{trials.run} and {other} have no method in common on these pairs",
            f"the first has {', '.join(trials.methods)}, the second "
            f"{', '.join(second.methods) or 'none'}; --method A --compare B compares two methods",
        )
    wanted = select_methods(replace(trials, all=_of(trials, common)), methods) or common
    both = [
        tuple(replace(t, method=t.method + suffix) for t in _of(side, wanted))
        for side, suffix in zip((trials, second), SUFFIXES, strict=True)
    ]
    a, b = SUFFIXES
    together = tuple(Together(name, name + a, name + b) for name in common if name in wanted)
    merged = replace(
        trials,
        all=both[0] + both[1],
        stale=trials.stale + second.stale,
        other_runs=tuple(run for run in trials.other_runs if run != second.run),
    )
    left_out = sorted({*trials.methods, *second.methods} - set(common))
    note = f" (not in both: {', '.join(left_out)})" if left_out else ""
    return merged, Comparison(f"run {trials.run}", f"run {second.run}{note}", together)


def _methods(trials: Trials, other: str, methods: Sequence[str]) -> tuple[Trials, Comparison]:
    left = [name for name in methods if name != other] or (
        [name for name in trials.methods if name != other] if len(trials.methods) == 2 else []
    )
    if len(left) != 1:
        raise ReportError(
            f"method {other!r} is compared with one other method", "--method names that one"
        )
    select_methods(trials, left)
    (first,) = left
    kept = replace(trials, all=_of(trials, (first, other)))
    together = Together(f"{first} and {other}", first, other)
    return kept, Comparison(f"method {first}", f"method {other}", (together,))


def _of(trials: Trials, methods: Collection[str]) -> tuple[TrialResult, ...]:
    return tuple(t for t in trials.all if t.method in methods)


def compare_truths(
    dataset: Dataset, trials: Trials, a: str, b: str
) -> tuple[Dataset, Trials, Comparison]:
    """Two versions of the ground truth; B is the one that errors are measured against.

    Args:
        dataset: The data set.
        trials: Trials that are shown.
        a: A version, or enough of its first digits; `first` or `present`.
        b: Another one.

    Returns:
        The data set with the poses of B, the trials against B, and what is compared.

    Raises:
        ReportError: No such version, or twice the same one.
        DatasetError: Poses of that version that cannot be read.
    """
    all_versions = versions(dataset)
    if len(all_versions) < 2:
        raise ReportError(
            f"{dataset.path} has one version of its ground truth, {all_versions[0]}",
            "`lcdata groundtruth` makes another from a changed rig",
        )
    first, second = (_version(name, all_versions, dataset) for name in (a, b))
    if first == second:
        raise ReportError(
            f"{a} and {b} are one version of the ground truth, {first}",
            f"there are {', '.join(all_versions)}",
        )
    former = {pose.pose_id: pose for pose in poses_of(dataset, first)}
    of_b = replace(dataset, poses=tuple(poses_of(dataset, second)))
    known = {pose.pose_id for pose in of_b.poses}
    against_a = replace(
        trials,
        all=tuple(t.against(former[t.pose_id]) for t in trials.all if t.pose_id in former),
    )
    against_b = replace(
        trials,
        all=tuple(t.against(of_b.pose(t.pose_id)) for t in trials.all if t.pose_id in known),
    )
    comparison = Comparison(
        f"ground truth {first}{_age(first, all_versions)}",
        f"ground truth {second}{_age(second, all_versions)}",
        (Together("ground truth", names.FORMER, names.GROUND_TRUTH),),
        former=former,
        errors_a=against_a,
    )
    return of_b, against_b, comparison


def _version(name: str, known: Sequence[str], dataset: Dataset) -> str:
    if name in (FIRST, PRESENT):
        return known[0 if name == FIRST else -1]
    found = [version for version in dict.fromkeys(known) if version.startswith(name)]
    if len(found) == 1:
        return found[0]
    what = "is the start of several versions" if found else "is no version"
    raise ReportError(
        f"{name!r} {what} of the ground truth of {dataset.path}",
        f"there are {', '.join(known)}; `{FIRST}` and `{PRESENT}` do as well",
    )


def _age(version: str, known: Sequence[str]) -> str:
    return " (the present one)" if version == known[-1] else ""


def of_comparison(
    dataset: Dataset, trials: Trials, comparison: Comparison
) -> Callable[[PairRecord], float]:
    """How far the two sides differ on a pair; NaN where one of them is not there."""
    if comparison.former:

        def moved(record: PairRecord) -> float:
            former = comparison.former.get(record.pose_id)
            if former is None:
                return math.nan
            return _apart(former, dataset.pose(record.pose_id))

        return moved

    def differ(record: PairRecord) -> float:
        shown = trials.of_pair(record.pair_id)
        found = [
            _gap(trial_badness(shown[t.a]), trial_badness(shown[t.b]))
            for t in comparison.together
            if t.a in shown and t.b in shown
        ]
        return max(found, default=math.nan)

    return differ


def _gap(a: float, b: float) -> float:
    return 0.0 if a == b else abs(a - b)  # two infinities: neither has an estimate


def _apart(a: PoseRecord, b: PoseRecord) -> float:
    """How far two ground truths are apart, in units of the limits."""
    T_a, T_b = a.T_camera_lidar, b.T_camera_lidar
    return max(
        metrics.rotation_error_deg(T_b, T_a) / metrics.SUCCESS_ROTATION_DEG,
        metrics.translation_error_m(T_b, T_a) / metrics.SUCCESS_TRANSLATION_M,
    )
