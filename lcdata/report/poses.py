"""Errors pose by pose: which places are hard, and for whom."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from html import escape

from lcdata.evaluation import metrics
from lcdata.evaluation.metrics import Quartiles
from lcdata.evaluation.results import TrialResult
from lcdata.report.tables import error_text


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


def pose_table(trials: Sequence[TrialResult], dot: Callable[[str], str]) -> str:
    """Part of the page on one run: a line a pose, a column a method; to be opened.

    Args:
        trials: Of that run.
        dot: Coloured mark of a method, HTML.

    Returns:
        Empty where there is but one pose.
    """
    methods = list(dict.fromkeys(t.method for t in trials))
    rows: dict[str, dict[str, PoseRow]] = {}
    for row in by_pose(trials):
        rows.setdefault(row.pose_id, {})[row.method] = row
    if len(rows) < 2:
        return ""
    head = "".join(f"<th>{dot(method)}{escape(method)}</th>" for method in methods)
    lines = []
    for pose_id, of_pose in rows.items():
        cells = [_cell(of_pose.get(method)) for method in methods]
        inside = "".join(f"<td>{cell}</td>" for cell in (escape(pose_id), *cells))
        lines.append(f"<tr>{inside}</tr>")
    return (
        "<details><summary>Pose by pose</summary>"
        f'<div class="scroll"><table><thead><tr><th>Pose</th>{head}</tr></thead>'
        f'<tbody>{"".join(lines)}</tbody></table></div><p class="note">Median rotation and '
        "translation error; successes of trials in small.</p></details>"
    )


def _cell(row: PoseRow | None) -> str:
    if row is None:
        return ""
    return (
        f"{error_text(row.rotation_deg.median)}° {error_text(row.translation_m.median)} m "
        f"<small>{row.successes}/{row.trials}</small>"
    )
