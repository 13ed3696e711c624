"""The main table of the page: methods by scenario, all scenarios first."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from html import escape

from lcdata.evaluation.comparison import Comparison
from lcdata.evaluation.metrics import ALL_SCENARIOS, Quartiles, Summary
from lcdata.evaluation.text import MISSING, not_ranked, number, rate_interval_text
from lcdata.report import tables, words
from lcdata.report.html import Cell, Group, copies, table
from lcdata.report.tables import error_text, interval_text, percent

COLUMNS = (
    "Method",
    "Trials",
    "Success",
    "Explained",
    "Rotation",
    "Translation",
    "Sigma distance",
    "Converged",
    "Degenerate",
    "Seconds",
)
NOTE = (
    "Success: 95 % interval in small. Errors: median, its 95 % interval in brackets, and 25 % to "
    "75 % in small; failed trials count as infinitely wrong. Bold: better than every other method "
    "of the scenario, by the paired comparison. ≈ not ranked."
)

Dot = Callable[[str], str]
"""Coloured mark of a method, HTML."""


def summary_table(summaries: Sequence[Summary], comparisons: Sequence[Comparison], dot: Dot) -> str:
    """The table of one run, with its note and its other notations.

    Args:
        summaries: Of that run.
        comparisons: Of that run.
        dot: Mark of a method.
    """
    groups = []
    in_order = list(tables.by_scenario(summaries))
    for rows in sorted(in_order, key=lambda rows: rows[0].scenario != ALL_SCENARIOS):
        title = "All scenarios" if rows[0].scenario == ALL_SCENARIOS else rows[0].scenario
        truth = words.uncertainty(rows)
        groups.append(
            Group(
                f"{escape(title)}<span>ground truth: {escape(truth)}</span>",
                [_row(row, rows, comparisons, dot) for row in rows],
            )
        )
    notations = copies(
        LaTeX=tables.latex(summaries),
        Markdown=tables.run_markdown(summaries),
        CSV=tables.summary_csv(summaries),
    )
    return f'{table(COLUMNS, groups)}<p class="note">{NOTE}</p>{notations}'


def _row(
    row: Summary, rows: Sequence[Summary], comparisons: Sequence[Comparison], dot: Dot
) -> list[Cell]:
    failed = f' <small class="bad">{row.failed} failed</small>' if row.failed else ""
    wrongly = f'<br><small class="bad">{row.misled} wrongly</small>' if row.misled else ""
    interval = rate_interval_text(row.success_interval).removesuffix(" %")
    return [
        Cell(f"{dot(row.method)}{escape(row.method)}"),
        Cell(f"{row.trials}{failed}", row.trials),
        Cell(f"{percent(row.success_rate)} <small>{interval}</small>", row.success_rate),
        Cell(percent(row.explained_rate), row.explained_rate),
        _error(row, rows, comparisons, "rotation_deg", "°"),
        _error(row, rows, comparisons, "translation_m", " m"),
        Cell(number(row.sigma_distance, 1), row.sigma_distance),
        Cell(f"{row.converged}{wrongly}", row.converged),
        Cell(str(row.degenerate), row.degenerate),
        Cell(number(row.seconds, 2), row.seconds),
    ]


def _error(
    row: Summary,
    rows: Sequence[Summary],
    comparisons: Sequence[Comparison],
    quantity: str,
    unit: str,
) -> Cell:
    q: Quartiles = getattr(row, quantity)
    if not math.isfinite(q.q1):
        return Cell(MISSING, q.median)
    middle = f"{error_text(q.median)}{unit if math.isfinite(q.median) else ''}"
    tied = not_ranked(row, rows, quantity)
    if tied:
        why = f"not ranked against {words.listing(tied)}: the ground truth cannot tell them apart"
        middle = f'<abbr title="{escape(why)}">≈</abbr> {middle}'
    elif _better_than(row, comparisons, quantity) == len(rows) - 1 > 0:
        middle = f'<span class="best">{middle}</span>'
    interval = interval_text(getattr(row, f"{quantity}_interval"))
    small = [part for part in (interval, f"{error_text(q.q1)}–{error_text(q.q3)}") if part]
    return Cell("".join([middle, *(f"<br><small>{part}</small>" for part in small)]), q.median)


def _better_than(row: Summary, comparisons: Sequence[Comparison], quantity: str) -> int:
    """How many other methods of the scenario one is better than."""
    return sum(
        c.better == row.method and (c.scenario, c.quantity) == (row.scenario, quantity)
        for c in comparisons
    )
