"""The text beside the pictures: which method fails where, and how far the ground truth goes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from lcdata.evaluation import metrics
from lcdata.review import uncertainty
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
    from lcdata.dataset.schema import PairRecord, PoseRecord
    from lcdata.evaluation.results import TrialResult

WORST = 5
"""How many of a method's worst pairs are named."""


def summary(dataset: Dataset, trials: Trials, arm_is_missing: bool = False, scale: int = 0) -> str:
    """Markdown summary of a data set and of the trials that are shown.

    Args:
        dataset: The data set.
        trials: What is shown.
        arm_is_missing: Whether the data set has an arm that could not be shown.
        scale: How much larger than life the ground truth's uncertainty is drawn; 0 if not at all.
    """
    parts = [f"# {dataset.path.resolve().name}", _about(dataset)]
    if trials.methods:
        parts += [_protocol(trials), _table(trials), _failures(dataset.pairs, trials)]
    else:
        parts.append("No results yet: `lcdata calibrate` makes them. Shown is the ground truth.")
    if arm_is_missing:
        parts.append(
            f"The arm is not shown: its model {dataset.rig.arm.model} is not on this machine."
        )
    if dataset.info.failures:
        lines = "\n".join(f"- {failure}" for failure in dataset.info.failures)
        parts.append(f"## Left out by the build\n\n{lines}")
    parts.append(_legend(bool(trials.methods), scale))
    return "\n\n".join(parts) + "\n"


def pair_text(number: int, count: int, record: PairRecord, pose: PoseRecord, trials: Trials) -> str:
    """Markdown on one pair.

    Args:
        number: Its place on the timeline `pair`, from 0.
        count: Number of pairs.
        record: Row of the pair.
        pose: Its pose.
        trials: What is shown.
    """
    truth = metrics.groundtruth_sigma(pose.T_camera_lidar, pose.covariance)
    lines = [
        f"## {record.pair_id}",
        f"Pair {number} of 0 to {count - 1}. Image {record.dt_ns / 1e6:+.1f} ms after the scan. "
        f"{record.points:,} points. Ground truth: {uncertainty_text(truth)}.",
    ]
    if origin := uncertainty.budget_text(pose):
        lines.append(origin)
    shown = trials.of_pair(record.pair_id)
    if not shown:
        return "\n\n".join(lines) + "\n"
    first = next(iter(shown.values()))
    start = error_text(first.initial_rotation_error_deg, first.initial_translation_error_m)
    if first.T_camera_lidar_initial is None:
        start = "nothing"
    lines.append(f"From {start} (trial {first.trial}):")
    table = [
        "| method | outcome | rotation (deg) | translation (m) | sigmas | lines | seconds |",
        "|---|---|---|---|---|---|---|",
    ]
    for method, trial in shown.items():
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
    lines += [f"{method}: {t.message}" for method, t in shown.items() if t.message]
    return "\n\n".join(lines) + "\n"


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


def _protocol(trials: Trials) -> str:
    first = trials.all[0]
    start = f"from {first.init_rotation_deg:g} deg and {first.init_translation_m:g} m on each axis"
    if math.isnan(first.init_rotation_deg):
        start = "from initial guesses that were given"
    if first.T_camera_lidar_initial is None:
        start = "from nothing"
    text = f"Run `{trials.run}`: {start}, {count_text(len(trials.all), 'trial')}. "
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
                wrong.append((_badness(trial), number, record.pair_id, trial))
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


def _badness(trial: TrialResult) -> float:
    """How wrong: errors in units of the limits; no estimate is the worst."""
    if trial.failed:
        return math.inf
    return max(
        trial.rotation_error_deg / metrics.SUCCESS_ROTATION_DEG,
        trial.translation_error_m / metrics.SUCCESS_TRANSLATION_M,
    )


def _legend(with_methods: bool, scale: int) -> str:
    text = (
        "## How to read it\n\n"
        "Step through the timeline `pair`. The cloud on the images is coloured by depth, near is "
        "red, far is blue: where the extrinsic is right, colours change at the edges of things. "
        "The green camera in 3D is the ground truth's."
    )
    if scale:
        text += f" {uncertainty.legend(scale)}"
    if with_methods:
        text += (
            " The frustum of a method has the method's colour, as have its series and the cloud "
            "lines that it matched; the image lines that it matched them to are white. The "
            "initial guess is grey."
        )
    return text
