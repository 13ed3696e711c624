"""The text beside the pictures: which method fails where, and how far the ground truth goes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from lcdata.evaluation import metrics
from lcdata.review import uncertainty
from lcdata.review.errors import LINES_UP_TO
from lcdata.review.selection import trial_badness
from lcdata.review.shown import Comparison, Shown
from lcdata.review.text import count_text, error_text, number_text, uncertainty_text
from lcdata.review.trials import (
    NO_ESTIMATE,
    SIGMA_LIMIT,
    UNDECIDED,
    WRONG,
    WRONG_FLAGGED,
    Trials,
    outcome,
)

if TYPE_CHECKING:
    from lcdata.dataset.reader import Dataset
    from lcdata.dataset.schema import PairRecord

WORST = 5
"""How many of a method's worst pairs are named."""


def summary(shown: Shown, arm_is_missing: bool = False, scale: int = 0, note: str = "") -> str:
    """Markdown summary of a data set and of the trials that are shown.

    Args:
        shown: What the review shows.
        arm_is_missing: Whether the data set has an arm that could not be shown.
        scale: How much larger than life the ground truth's uncertainty is drawn; 0 if not at all.
        note: What was thinned; empty for nothing.
    """
    dataset, trials = shown.dataset, shown.trials
    parts = [f"# {dataset.path.resolve().name}", _about(dataset), shown.note]
    if note:
        parts.append(f"To keep the file small, {note}.")
    if shown.comparison is not None:
        parts.append(_compared(shown.comparison))
    if trials.methods:
        parts += [_protocol(shown), _table(trials), _failures(dataset.pairs, trials)]
    elif trials.run:
        parts.append(f"Run `{trials.run}` has no trial on them. Shown is the ground truth.")
    else:
        parts.append("No results yet: `lcdata calibrate` makes them. Shown is the ground truth.")
    if arm_is_missing:
        parts.append(
            f"The arm is not shown: its model {dataset.rig.arm.model} is not on this machine."
        )
    if dataset.info.failures:
        lines = "\n".join(f"- {failure}" for failure in dataset.info.failures)
        parts.append(f"## Left out by the build\n\n{lines}")
    parts.append(_legend(bool(trials.methods), scale, len(dataset) > LINES_UP_TO))
    return "\n\n".join(filter(None, parts)) + "\n"


def pair_text(number: int, record: PairRecord, shown: Shown) -> str:
    """Markdown on one pair.

    Args:
        number: Its place on the timeline `pair`, from 0.
        record: Row of the pair.
        shown: What the review shows.
    """
    count, trials = len(shown.dataset), shown.trials
    pose = shown.dataset.pose(record.pose_id)
    truth = metrics.groundtruth_sigma(pose.T_camera_lidar, pose.covariance)
    lines = [
        f"## {record.pair_id}",
        f"Pair {number} of 0 to {count - 1}. Image {record.dt_ns / 1e6:+.1f} ms after the scan. "
        f"{record.points:,} points. Ground truth: {uncertainty_text(truth)}.",
    ]
    if origin := uncertainty.budget_text(pose):
        lines.append(origin)
    found = trials.of_pair(record.pair_id)
    if not found:
        lines.append("No trial on this pair." if trials.methods else "")
        return "\n\n".join(filter(None, lines)) + "\n"
    first = next(iter(found.values()))
    start = error_text(first.initial_rotation_error_deg, first.initial_translation_error_m)
    if first.T_camera_lidar_initial is None:
        start = "nothing"
    lines.append(f"From {start} (trial {first.trial}):")
    table = [
        "| method | outcome | rotation (deg) | translation (m) | sigmas | lines | seconds |",
        "|---|---|---|---|---|---|---|",
    ]
    for method, trial in found.items():
        matched = int((trial.matches.pair_index == trial.pair_ids.index(record.pair_id)).sum())
        cells = [
            method,
            f"**{outcome(trial)}**",
            number_text(trial.rotation_error_deg),
            number_text(trial.translation_error_m),
            number_text(trial.sigma_distance),
            str(matched),
            number_text(trial.seconds),
        ]
        table.append(f"| {' | '.join(cells)} |")
    lines.append("\n".join(table))
    lines += [f"{method}: {t.message}" for method, t in found.items() if t.message]
    return "\n\n".join(lines) + "\n"


def _compared(comparison: Comparison) -> str:
    parts = [
        f"**A** (orange) is {comparison.a}, **B** (blue) is {comparison.b}. On the images that "
        "have both, clouds have these colours. Series of B minus A are below zero where B is "
        "nearer to the ground truth."
    ]
    if comparison.former:
        parts.append(
            "Errors are against B; the series `moved` is how far B is from A, and of a method how "
            "much larger its error is against B than against A."
        )
    return " ".join(parts)


def _about(dataset: Dataset) -> str:
    info = dataset.info
    origin = (
        "**Simulated** recordings: nothing here was measured in the real world."
        if info.simulated
        else "Real recordings."
    )
    sigmas = np.array(
        [metrics.groundtruth_sigma(p.T_camera_lidar, p.covariance) for p in dataset.poses]
    )
    typical = metrics.Sigma(*np.median(sigmas, axis=0)) if len(sigmas) else metrics.Sigma(0, 0)
    before = len(info.groundtruth_history)
    earlier = f" ({count_text(before, 'version')} before it)" if before else ""
    source = "arm's chain" if dataset.rig.ground_truth == "arm" else "static extrinsic"
    return (
        f"{origin} {count_text(len(dataset.pairs), 'pair')} in "
        f"{count_text(len(dataset.poses), 'pose')} of "
        f"{count_text(len(dataset.scenarios), 'scenario')} ({', '.join(dataset.scenarios)}).\n\n"
        f"Ground truth: {source}, version {info.groundtruth_version}{earlier}, "
        f"{uncertainty_text(typical)} "
        f"(root mean square of a pose, median over the poses)."
    )


def _protocol(shown: Shown) -> str:
    trials = shown.trials
    first = trials.all[0]
    start = f"from {first.init_rotation_deg:g} deg and {first.init_translation_m:g} m on each axis"
    if math.isnan(first.init_rotation_deg):
        start = "from initial guesses that were given"
    if first.T_camera_lidar_initial is None:
        start = "from nothing"
    count = count_text(len(trials.all), "trial")
    if shown.comparison is not None and any(t.run != first.run for t in trials.all):
        count += " of both runs"
    text = f"Run `{trials.run}`: {start}, {count}. "
    if trials.per_pair > 1:
        text += (
            f"A pair has up to {trials.per_pair} trials: pictures and series show the first of "
            "them, the table counts all. "
        )
    if trials.stale:
        text += (
            f"\n\n**{trials.stale} trials were made against another ground truth**; their errors "
            "are computed anew against the present one. "
        )
    if trials.other_runs:
        text += f"Not shown: {', '.join(trials.other_runs)}."
    return text.strip()


def _table(trials: Trials) -> str:
    lines = [
        "## Which method fails where",
        "",
        "| scenario | method | right | undecided | median rotation (deg) | median translation (m) "
        "| sigmas | flagged | no estimate |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for row in metrics.summarise(trials.all):
        here = [t for t in trials.all if t.method == row.method]
        if row.scenario != metrics.ALL_SCENARIOS:
            here = [t for t in here if t.scenario == row.scenario]
        flagged = sum((t.degenerate or not t.converged) and not t.failed for t in here)
        cells = [
            row.scenario,
            row.method,
            f"**{row.successes}/{row.trials}**",
            str(sum(outcome(t) == UNDECIDED for t in here)),
            number_text(row.rotation_deg.median),
            number_text(row.translation_m.median),
            number_text(row.sigma_distance),
            str(flagged),
            str(row.failed),
        ]
        lines.append(f"| {' | '.join(cells)} |")
    lines += [
        "",
        f"Right: below {metrics.SUCCESS_ROTATION_DEG:g} deg and "
        f"{metrics.SUCCESS_TRANSLATION_M:g} m. Flagged: the method itself says that its estimate "
        "is degenerate or has not converged. Sigmas: median error in standard deviations of the "
        f"ground truth; up to {SIGMA_LIMIT:g} say nothing against an estimate, so one that is "
        "beyond the limits by no more than that is called undecided.",
    ]
    return "\n".join(lines)


def _failures(records: Sequence[PairRecord], trials: Trials) -> str:
    """For each method the pairs that it does worst on, by their place on the timeline."""
    lines = ["## Worst pairs"]
    for method in trials.methods:
        wrong = []
        for number, record in enumerate(records):
            trial = trials.of_pair(record.pair_id).get(method)
            if trial and outcome(trial) in (WRONG, WRONG_FLAGGED, NO_ESTIMATE):
                wrong.append((trial_badness(trial), number, record.pair_id, trial))
        if not wrong:
            lines.append(f"**{method}**: wrong on no pair that is shown.")
            continue
        wrong.sort(key=lambda item: item[0], reverse=True)
        items = [
            f"- pair {number} `{pair_id}`: {outcome(t)}, "
            f"{error_text(t.rotation_error_deg, t.translation_error_m)}"
            for _, number, pair_id, t in wrong[:WORST]
        ]
        count = f"wrong on {len(wrong)} of {len(records)} pairs"
        more = f", the worst {WORST}" if len(wrong) > WORST else ""
        lines.append("\n".join([f"**{method}**: {count}{more}:", "", *items]))
    return "\n\n".join(lines)


def _legend(with_methods: bool, scale: int, many: bool) -> str:
    text = (
        "## How to read it\n\n"
        "Step through the timeline `pair`. The cloud on the images is coloured by distance, near "
        "is red, far is blue: where the extrinsic is right, colours change at the edges of things. "
        "The green camera in 3D is the ground truth's."
    )
    if scale:
        text += f" {uncertainty.legend(scale)}"
    if many:
        text += (
            " Pairs are many, so errors are dots; a triangle near the upper edge stands for an "
            "error beyond it."
        )
    if with_methods:
        text += (
            " The frustum of a method has the method's colour, as have its series and the cloud "
            "lines that it matched; the image lines that it matched them to are white. The "
            "initial guess is grey."
        )
    return text
