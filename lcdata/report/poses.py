"""Errors pose by pose: which places are hard, and for whom."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from html import escape

import numpy as np

from lcdata.evaluation import metrics
from lcdata.evaluation.metrics import Quartiles
from lcdata.evaluation.results import TrialResult
from lcdata.evaluation.text import MISSING
from lcdata.report.html import Cell, Group, table
from lcdata.report.tables import error_text, percent

IN_VIEW = "In view"


@dataclass(frozen=True)
class PoseRow:
    """Trials of one method at one pose, in one run.

    Args:
        run: Name of the run.
        pose_id: Name of the pose.
        method: Name of the method.
        trials: How many.
        failed: Of them without an estimate.
        successes: Of them below 0.5 deg and 0.1 m.
        rotation_deg: Quartiles of the rotation error.
        translation_m: Quartiles of the translation error.
        sigma: The ground truth's own uncertainty.
    """

    run: str
    pose_id: str
    method: str
    trials: int
    failed: int
    successes: int
    rotation_deg: Quartiles
    translation_m: Quartiles
    sigma: metrics.Sigma


def by_pose(trials: Sequence[TrialResult]) -> Iterator[PoseRow]:
    """Rows in the order of runs, poses and the methods' first appearance."""
    methods = list(dict.fromkeys(t.method for t in trials))
    groups: dict[tuple[str, str, int], list[TrialResult]] = {}
    for t in trials:
        groups.setdefault((t.run, t.pose_id, methods.index(t.method)), []).append(t)
    for (run, pose_id, method), mine in sorted(groups.items()):
        yield PoseRow(
            run=run,
            pose_id=pose_id,
            method=methods[method],
            trials=len(mine),
            failed=sum(t.failed for t in mine),
            successes=sum(t.success for t in mine),
            rotation_deg=metrics.quartiles(metrics.errors(mine, "rotation_deg")),
            translation_m=metrics.quartiles(metrics.errors(mine, "translation_m")),
            sigma=metrics.Sigma(
                mine[0].groundtruth_rotation_sigma_deg, mine[0].groundtruth_translation_sigma_m
            ),
        )


def poses_csv(trials: Sequence[TrialResult]) -> str:
    """by_pose.csv: one line a run, pose and method."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    header = ["run", "pose_id", "method", "trials", "failed", "successes"]
    for quantity in ("rotation_deg", "translation_m"):
        header += [f"{quantity}_{name}" for name in Quartiles._fields]
    writer.writerow([*header, "groundtruth_rotation_sigma_deg", "groundtruth_translation_sigma_m"])
    for row in by_pose(trials):
        counts = (row.trials, row.failed, row.successes)
        errors = (*row.rotation_deg, *row.translation_m, *row.sigma)
        writer.writerow([row.run, row.pose_id, row.method, *counts, *errors])
    return out.getvalue()


def pose_table(
    trials: Sequence[TrialResult], dot: Callable[[str], str], shares: Mapping[str, float]
) -> str:
    """Part of the page on one run: a line a pose, a column a method; to be opened.

    Args:
        trials: Of that run.
        dot: Coloured mark of a method, HTML.
        shares: Share of the cloud in view, by pair.

    Returns:
        Empty where there is but one pose.
    """
    methods = list(dict.fromkeys(t.method for t in trials))
    rows: dict[str, dict[str, PoseRow]] = {}
    for row in by_pose(trials):
        rows.setdefault(row.pose_id, {})[row.method] = row
    if len(rows) < 2:
        return ""
    seen: dict[str, list[float]] = {}
    for pair_id, pose_id in {pair: t.pose_id for t in trials for pair in t.pair_ids}.items():
        if pair_id in shares:
            seen.setdefault(pose_id, []).append(shares[pair_id])
    head = ["Pose", "Ground truth ±", *([IN_VIEW] if seen else [])]
    head += [f"{dot(method)}{escape(method)}" for method in methods]
    lines = []
    for pose_id, of_pose in rows.items():
        sigma = next(iter(of_pose.values())).sigma
        cells = [Cell(escape(pose_id)), Cell(_sigma_text(sigma), sigma.rotation_deg)]
        if seen:
            share = float(np.mean(seen[pose_id])) if pose_id in seen else math.nan
            cells.append(Cell(percent(share), share))
        lines.append(cells + [_cell(of_pose.get(method)) for method in methods])
    return (
        f"<details><summary>Pose by pose</summary>{table(head, [Group('', lines)])}"
        '<p class="note">Median rotation and translation error, failed trials infinitely wrong; '
        "successes of trials in small. A method's column is sorted by the larger of the two "
        "errors in units of its limit of success (0.5° and 0.1 m). In view: share of the cloud's "
        "returns inside the image, at the ground truth.</p></details>"
    )


def _sigma_text(sigma: metrics.Sigma) -> str:
    if math.isnan(sigma.rotation_deg):
        return MISSING
    return f"{sigma.rotation_deg:.2f}° {sigma.translation_m:.3f} m"


def _cell(row: PoseRow | None) -> Cell:
    if row is None:
        return Cell("", math.nan)
    failed = f' <small class="bad">{row.failed} failed</small>' if row.failed else ""
    worse = max(
        row.rotation_deg.median / metrics.SUCCESS_ROTATION_DEG,
        row.translation_m.median / metrics.SUCCESS_TRANSLATION_M,
    )
    return Cell(
        f"{error_text(row.rotation_deg.median)}° {error_text(row.translation_m.median)} m "
        f"<small>{row.successes}/{row.trials}</small>{failed}",
        worse,
    )
