"""Results as CSV, Markdown and LaTeX, and how numbers are written."""

from __future__ import annotations

import csv
import dataclasses
import io
import math
from collections.abc import Iterable, Iterator, Sequence
from itertools import groupby

import numpy as np
from numpy.typing import NDArray

from lcdata.evaluation.metrics import Quartiles, Summary
from lcdata.evaluation.results import Results
from lcdata.evaluation.statistics import Interval
from lcdata.evaluation.text import MISSING, not_ranked, number, rate_interval_text
from lcdata.geometry import se3

POSE = ("x_m", "y_m", "z_m", "qx", "qy", "qz", "qw")
HEADER = (
    "Scenario",
    "Method",
    "Trials",
    "Success",
    "Explained",
    "Rotation (deg)",
    "Translation (m)",
    "Sigma distance",
    "Converged",
    "Degenerate",
    "Seconds",
)
NOTE = (
    "Success: below 0.5 deg and 0.1 m. Explained: not farther from the ground truth than 95 % of "
    "exact estimates (3.55 of its standard deviations). Errors: median [95 % confidence interval] "
    "(25 %, 75 %); a trial without an estimate (failed) counts as infinitely wrong. Intervals: "
    "Wilson's of the success rate, bootstrap of the median (6 pairs or more); trials on the same "
    "pair do not count as independent. ~ not ranked: another method of the "
    "scenario differs by less than the ground truth's own uncertainty, or that is unknown. Sigma "
    "distance: median error in standard deviations of the ground truth; an exact estimate has "
    "about 2.3. Converged: the method's own verdict; wrongly where the trial is neither a success "
    "nor explained. Seconds: one calibration, features included."
)


def by_scenario(summaries: Iterable[Summary]) -> Iterator[list[Summary]]:
    """Summaries of one run and scenario at a time."""
    for _, rows in groupby(summaries, key=lambda s: (s.run, s.scenario)):
        yield list(rows)


def error_text(value: float) -> str:
    """An error or a difference with three decimals; infinite where there is no estimate."""
    if math.isinf(value):
        return "∞" if value > 0 else "-∞"
    return number(value, 3)


def quartile_text(q: Quartiles, interval: Interval) -> str:
    """Median, its confidence interval and quartiles; a dash where there is no estimate."""
    if not math.isfinite(q.q1):
        return MISSING
    low, middle, high = map(error_text, (q.q1, q.median, q.q3))
    return " ".join(filter(None, (middle, interval_text(interval), f"({low}, {high})")))


def interval_text(interval: Interval) -> str:
    """A confidence interval in brackets; empty where too few pairs give none."""
    if math.isnan(interval.low):
        return ""
    return f"[{error_text(interval.low)}, {error_text(interval.high)}]"


def rate_text(rate: float, interval: Interval) -> str:
    """A rate with its confidence interval."""
    inside = rate_interval_text(interval).removesuffix(" %").replace("–", ", ")
    return f"{percent(rate)} [{inside}]" if inside else percent(rate)


def percent(share: float) -> str:
    """A share in whole per cent that says 100 only if it is all and 0 only if it is none."""
    if math.isnan(share):
        return MISSING
    whole = round(100 * share)
    if (whole == 100 and share < 1) or (whole == 0 and share > 0):
        return f"{100 * share:.1f} %"
    return f"{whole} %"


def cells(row: Summary, rows: Sequence[Summary]) -> list[str]:
    """One line of the table, in the order of `HEADER`."""
    rotation = "~ " if not_ranked(row, rows, "rotation_deg") else ""
    translation = "~ " if not_ranked(row, rows, "translation_m") else ""
    return [
        row.scenario,
        row.method,
        trials_text(row),
        rate_text(row.success_rate, row.success_interval),
        percent(row.explained_rate),
        rotation + quartile_text(row.rotation_deg, row.rotation_deg_interval),
        translation + quartile_text(row.translation_m, row.translation_m_interval),
        number(row.sigma_distance, 1),
        converged_text(row),
        str(row.degenerate),
        number(row.seconds, 2),
    ]


def trials_text(row: Summary) -> str:
    """How many trials, and how many of them gave no estimate."""
    return f"{row.trials} ({row.failed} failed)" if row.failed else str(row.trials)


def converged_text(row: Summary) -> str:
    """How often a method trusted its estimate, and how often wrongly."""
    return f"{row.converged} ({row.misled} wrongly)" if row.misled else str(row.converged)


def truth_text(row: Summary) -> str:
    """Uncertainty of the ground truth, in words."""
    if math.isnan(row.groundtruth.rotation_deg):
        return "no uncertainty known"
    return f"{row.groundtruth.rotation_deg:.2f} deg / {row.groundtruth.translation_m:.3f} m"


def markdown(summaries: Sequence[Summary], titles: dict[str, str], compared: dict[str, str]) -> str:
    """table.md: one table a run.

    Args:
        summaries: Rows.
        titles: Title of each run.
        compared: What follows on the comparison of methods, by run.
    """
    parts = []
    for run, rows in groupby(summaries, key=lambda s: s.run):
        of_run = list(rows)
        table = run_markdown(of_run)
        truth = "; ".join(f"{g[0].scenario} {truth_text(g[0])}" for g in by_scenario(of_run))
        parts.append(
            f"## {titles[run]}\n\n{table}\n\nGround truth's own uncertainty (1 sigma): {truth}.\n"
            + compared.get(run, "")
        )
    return "\n".join([*parts, NOTE, ""])


def run_markdown(summaries: Sequence[Summary]) -> str:
    """The table of one run."""
    rows = (cells(row, group) for group in by_scenario(summaries) for row in group)
    return markdown_table(HEADER, rows)


def markdown_table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table whose first two columns are words."""
    lines = [list(header), ["---"] * 2 + ["---:"] * (len(header) - 2), *rows]
    return "\n".join(f"| {' | '.join(_pipe(cell) for cell in line)} |" for line in lines)


def latex(summaries: Sequence[Summary]) -> str:
    """table.tex: a booktabs table a run, to be put into a paper."""
    parts = ["% \\usepackage{booktabs}"]
    for run, rows in groupby(summaries, key=lambda s: s.run):
        groups = [
            "\n".join(f"{' & '.join(tex(c) for c in cells(row, group))} \\\\" for row in group)
            for group in by_scenario(list(rows))
        ]
        parts.append(f"% run {run}\n{latex_table(HEADER, groups)}")
    return "\n\n".join(parts) + "\n"


def latex_table(header: Sequence[str], groups: Sequence[str]) -> str:
    """A booktabs table whose first two columns are words, groups of lines set apart."""
    body = "\n\\midrule\n".join(groups)
    return (
        f"\\begin{{tabular}}{{ll{'r' * (len(header) - 2)}}}\n\\toprule\n"
        f"{' & '.join(tex(h) for h in header)} \\\\\n\\midrule\n{body}\n"
        "\\bottomrule\n\\end{tabular}"
    )


def summary_csv(summaries: Iterable[Summary]) -> str:
    """summary.csv: the numbers of the table, one line a run, scenario and method."""
    out = io.StringIO()
    writer: csv.DictWriter[str] | None = None
    for summary in summaries:
        row: dict[str, object] = {}
        for f in dataclasses.fields(summary):
            value = getattr(summary, f.name)
            if isinstance(value, tuple):
                parts = zip(value._fields, value, strict=True)  # type: ignore[attr-defined]
                row |= {f"{f.name}_{name}": part for name, part in parts}
            else:
                row[f.name] = value
        row |= {"success_rate": summary.success_rate, "explained_rate": summary.explained_rate}
        if writer is None:
            writer = csv.DictWriter(out, list(row), lineterminator="\n")
            writer.writeheader()
        writer.writerow(row)
    return out.getvalue()


def trials_csv(results: Results) -> str:
    """results.csv: one line a trial."""
    skipped = {"matches", "covariance", "T_camera_lidar_initial", "T_camera_lidar_estimated"}
    out = io.StringIO()
    writer: csv.DictWriter[str] | None = None
    trials = results.trials
    initials = _xyz_xyzw([t.T_camera_lidar_initial for t in trials])
    estimates = _xyz_xyzw([t.T_camera_lidar_estimated for t in trials])
    for trial, initial, estimate in zip(trials, initials.tolist(), estimates.tolist(), strict=True):
        row = {
            f.name: getattr(trial, f.name)
            for f in dataclasses.fields(trial)
            if f.name not in skipped
        }
        row["pair_ids"] = " ".join(trial.pair_ids)
        row |= {"success": trial.success, "rebased": trial.rebased}
        row |= {f"initial_{name}": value for name, value in zip(POSE, initial, strict=True)}
        row |= {f"estimated_{name}": value for name, value in zip(POSE, estimate, strict=True)}
        row["matched_lines"] = len(trial.matches.pair_index)
        if writer is None:
            writer = csv.DictWriter(out, list(row), lineterminator="\n")
            writer.writeheader()
        writer.writerow(row)
    return out.getvalue()


def _pipe(text: str) -> str:
    return text.replace("|", "\\|")


def tex(text: str) -> str:
    """A cell as LaTeX takes it."""
    for plain, escaped in (
        ("\\", "\\textbackslash "),
        ("%", "\\%"),
        ("_", "\\_"),
        ("&", "\\&"),
        ("#", "\\#"),
        ("~", "$\\approx$"),
        ("<", "$<$"),
        ("-∞", "$-\\infty$"),
        ("∞", "$\\infty$"),
        (MISSING, "--"),
    ):
        text = text.replace(plain, escaped)
    return text


def _xyz_xyzw(poses: Sequence[NDArray[np.float64] | None]) -> NDArray[np.float64]:
    """Position and quaternion of each pose (N, 7), NaN where there is none."""
    rows = np.full((len(poses), 7), np.nan)
    there = [T is not None for T in poses]
    if any(there):
        rows[there] = se3.to_xyz_xyzw([T for T in poses if T is not None])
    return rows
