"""The report's sentences: what the data set is, how trials were made, how to read the numbers."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence

from lcdata.dataset import Dataset
from lcdata.evaluation.metrics import SUCCESS_ROTATION_DEG, SUCCESS_TRANSLATION_M, Summary
from lcdata.evaluation.results import TrialResult
from lcdata.report.tables import percent

UNKNOWN = "no uncertainty known"

NAMED = 4
"""Methods that a headline has room for."""


def count(n: int, thing: str) -> str:
    """A number with its noun: 1 pair, 2 pairs."""
    return f"{n} {thing}" if n == 1 else f"{n} {thing}s"


def listing(items: Sequence[str]) -> str:
    """Names as a person lists them: a, b and c."""
    return " and ".join([", ".join(items[:-1]), items[-1]]) if len(items) > 1 else "".join(items)


def data_set(dataset: Dataset) -> str:
    """What the data set is, simulated or not said first."""
    scenarios = sorted({pair.scenario for pair in dataset.pairs})
    cameras = {dataset.camera(s) for s in scenarios}
    sizes = sorted({f"{c.width}x{c.height}" for c in cameras})
    kind = "Simulated recordings, no real sensors" if dataset.info.simulated else "Recordings"
    truth = (
        "from the arm's encoders and two hand-measured links"
        if dataset.info.arm
        else "a static reference extrinsic, no arm"
    )
    return (
        f"{kind}: {count(len(dataset.pairs), 'LiDAR-camera pair')} at "
        f"{count(len({p.pose_id for p in dataset.pairs}), 'pose')} in "
        f"{count(len(scenarios), 'scenario')} ({listing(scenarios)}), images of "
        f"{listing(sizes)} pixels. Ground truth: {truth}, {version(dataset)}."
    )


def version(dataset: Dataset) -> str:
    """Which version of the ground truth is shown, and how many there were before."""
    before = len(dataset.info.groundtruth_history)
    earlier = f" ({count(before, 'version')} before it)" if before else ""
    return f"version {dataset.info.groundtruth_version}{earlier}"


def uncertainty(summaries: Sequence[Summary]) -> str:
    """The ground truth's own uncertainty, scenario by scenario where it differs."""
    known: dict[str, list[str]] = {}
    for row in summaries:
        if math.isnan(row.groundtruth.rotation_deg):
            text = UNKNOWN
        else:
            text = (
                f"{row.groundtruth.rotation_deg:.2f}° and "
                f"{1000 * row.groundtruth.translation_m:.0f} mm"
            )
        names = known.setdefault(text, [])
        if row.scenario not in names:
            names.append(row.scenario)
    if len(known) == 1:
        return next(iter(known))
    return "; ".join(f"{listing(names)} {text}" for text, names in known.items())


def own_uncertainty(summaries: Sequence[Summary]) -> str:
    """A sentence on the ground truth's own uncertainty, and what follows where it is unknown."""
    text = uncertainty(summaries)
    if text == UNKNOWN:
        return "There is no uncertainty known of it, so that no method can be ranked by it."
    return f"Its own uncertainty (root mean square, 1 sigma): {text}."


def blunt_truth(summaries: Sequence[Summary]) -> str:
    """A warning where the ground truth is less certain than the limit of success is tight."""
    blunt = {
        row.scenario: None
        for row in summaries
        if row.groundtruth.rotation_deg > SUCCESS_ROTATION_DEG
        or row.groundtruth.translation_m > SUCCESS_TRANSLATION_M
    }
    if not blunt:
        return ""
    return (
        f"In {listing(list(blunt))} the ground truth itself is less certain than the limits of "
        "success, so that exact estimates miss them too: go by the sigma distance and by what is "
        "explained, not by success."
    )


def run_title(trials: Sequence[TrialResult]) -> str:
    """What sets one run apart from others."""
    first = trials[0]
    joint = ", all pairs of a pose jointly" if first.group == "pose" else ""
    if first.T_camera_lidar_initial is None:
        return f"From nothing ({first.run}){joint}"
    if math.isnan(first.init_rotation_deg):
        return f"From initial guesses that were given ({first.run}){joint}"
    return f"From {first.init_rotation_deg:g}° and {first.init_translation_m:g} m an axis{joint}"


def protocol(trials: Sequence[TrialResult], version: str) -> str:
    """How the trials of one run were made, so that they can be made again.

    Args:
        trials: All of them.
        version: The ground truth's.
    """
    first = trials[0]
    unit = "pose (its pairs solved jointly)" if first.group == "pose" else "pair"
    per_unit = Counter((t.method, t.pair_ids) for t in trials)
    methods = sorted({f"{t.method} {t.method_version}" for t in trials})
    return (
        f"Run {first.run}: {count(max(per_unit.values()), 'trial')} a {unit} and method. Each "
        f"{_start(trials)}. "
        f"{_rebased(trials)}Seed {first.seed}, ground truth {version}, lcdata "
        f"{listing(sorted({t.lcdata_version for t in trials}))}, method versions "
        f"{listing(methods)}."
    )


def _start(trials: Sequence[TrialResult]) -> str:
    """Where the trials of a run start, as an error of the ground truth."""
    first = trials[0]
    if first.T_camera_lidar_initial is None:
        return "starts without an initial guess"
    same = "every method gets the same initial guesses"
    if math.isnan(first.init_rotation_deg):
        turned = [t.initial_rotation_error_deg for t in trials]
        moved = [t.initial_translation_error_m for t in trials]
        return (
            "starts from an initial guess that was given, "
            f"{min(turned):.2f}° to {max(turned):.2f}° and "
            f"{min(moved):.3f} m to {max(moved):.3f} m off the ground truth; {same}"
        )
    rotation = math.sqrt(3) * first.init_rotation_deg
    translation = math.sqrt(3) * first.init_translation_m
    return (
        f"starts from the ground truth turned by {first.init_rotation_deg:g}° about each axis and "
        f"moved by {first.init_translation_m:g} m along each axis, with random signs "
        f"({rotation:.2f}° and {translation:.3f} m in all); {same}"
    )


def _rebased(trials: Sequence[TrialResult]) -> str:
    """A sentence on guesses that an earlier ground truth has made; empty without them."""
    rebased = [t for t in trials if t.rebased]
    if not rebased:
        return ""
    turned = [t.initial_rotation_error_deg for t in rebased]
    moved = [t.initial_translation_error_m for t in rebased]
    return (
        f"{count(len(rebased), 'trial')} started from guesses made from an earlier ground truth: "
        f"against the present one they are {min(turned):.2f}° to {max(turned):.2f}° and "
        f"{min(moved):.3f} m to {max(moved):.3f} m off. "
    )


READING = (
    "Rotation error is the geodesic angle, translation error the L2 norm. Success is less than "
    "0.5° and 0.1 m. A trial without an estimate counts as infinitely wrong, so it moves the "
    "median and is never dropped. Sigma distance is the error in standard deviations of the "
    "ground truth itself: an exactly right estimate has a median of 2.3, and 95 % of such stay "
    "within 3.55, which is called explained. Two methods whose "
    "medians differ by less than the ground truth's own uncertainty are marked ≈ and not ranked. "
    "Intervals have 95 % confidence: Wilson's of a rate, a bootstrap of a median, both over pairs, "
    "for trials on the same pair are not independent; of fewer than 6 pairs there is no interval "
    "of a median. They tell what chance may do, not how wrong the ground truth may be. "
    "Converged and degenerate are the methods' own verdicts; a wrongly converged trial is "
    "neither a success nor explained, and gave no warning. Seconds are those of one whole "
    "calibration on one core, features included."
)


def headline(rows: Sequence[Summary]) -> str:
    """One sentence over the whole: how often each method succeeds."""
    trials = sorted({row.trials for row in rows})
    of = f"Of {listing([str(n) for n in trials])} trials" if trials != [1] else "Of one trial"
    if len(rows) > NAMED:
        rates = sorted(row.success_rate for row in rows)
        best = [row.method for row in rows if row.success_rate == rates[-1]]
        span = f"{len(rows)} methods succeed in {percent(rates[0])} to {percent(rates[-1])}"
        if len(best) > NAMED:
            return f"{of}, {span}."
        return f"{of}, {span}, {listing(best)} most often."
    first, *others = [f"{row.method} succeeds in {percent(row.success_rate)}" for row in rows]
    return f"{of}, {listing([first, *(text.replace('succeeds ', '') for text in others)])}."
