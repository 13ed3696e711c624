"""Methods two by two on the same trials: as Markdown, LaTeX, CSV and part of the page."""

from __future__ import annotations

import csv
import dataclasses
import io
from collections.abc import Callable, Iterator, Sequence
from html import escape
from itertools import groupby

from lcdata.evaluation.comparison import QUANTITIES, Comparison
from lcdata.evaluation.metrics import ALL_SCENARIOS
from lcdata.evaluation.text import number, p_text, verdicts
from lcdata.report.html import Cell, Group, copies, items, table
from lcdata.report.tables import (
    error_text,
    interval_text,
    latex_table,
    markdown_table,
    tex,
)

HEADER = (
    "Scenario",
    "Error",
    "Methods",
    "Trials (pairs)",
    "Smaller error",
    "Median difference",
    "Ground truth",
    "p",
    "Better",
)
NOTE = (
    "Paired comparison: both methods from the same initial guesses on the same pairs. Smaller "
    "error: in how many trials the first one's is smaller, equal (or both without an estimate), "
    "the second one's. Median difference: first minus second, trial by trial, with its 95 % "
    "bootstrap interval; a trial without an estimate is infinitely wrong. p: Wilcoxon's signed "
    "rank test, one value a pair, corrected (Holm) for all comparisons of the scenario. Better: "
    "only where p is below 0.05 and both the medians and the single trials differ by more than "
    "the ground truth's own uncertainty."
)
NOBODY = "not ranked"
SENTENCES_SHOWN = 6
"""A longer list waits to be opened."""


def by_scenario(comparisons: Sequence[Comparison]) -> Iterator[list[Comparison]]:
    """Comparisons of one run and scenario at a time."""
    for _, rows in groupby(comparisons, key=lambda c: (c.run, c.scenario)):
        yield list(rows)


def cells(c: Comparison) -> list[str]:
    """One line of the table, in the order of `HEADER`."""
    unit = QUANTITIES[c.quantity]
    left_out = f", {c.left_out} unpaired" if c.left_out else ""
    interval = interval_text(c.difference_interval)
    return [
        c.scenario,
        c.quantity.partition("_")[0],
        f"{c.first} – {c.second}",
        f"{c.trials} ({c.units}){left_out}",
        f"{c.first_smaller} / {c.equal} / {c.second_smaller}",
        f"{error_text(c.difference)} {unit} {interval}".rstrip(),
        f"{number(c.sigma, 3)} {unit}",
        p_text(c.p_corrected).removeprefix("p ").removeprefix("= "),
        c.better or NOBODY,
    ]


def markdown(comparisons: Sequence[Comparison]) -> dict[str, str]:
    """Part of table.md, by run; runs with one method have none."""
    return {
        run: f"\n### Paired comparison\n\n{markdown_table(HEADER, map(cells, rows))}\n\n{NOTE}\n"
        for run, rows in groupby(comparisons, key=lambda c: c.run)
    }


def latex(comparisons: Sequence[Comparison]) -> str:
    """Part of table.tex: a booktabs table a run."""
    parts = []
    for run, rows in groupby(comparisons, key=lambda c: c.run):
        groups = [
            "\n".join(f"{' & '.join(map(tex, cells(c)))} \\\\" for c in group)
            for group in by_scenario(list(rows))
        ]
        parts.append(f"% run {run}, paired comparison\n{latex_table(HEADER, groups)}\n")
    return "\n".join(parts)


def table_csv(comparisons: Sequence[Comparison]) -> str:
    """comparisons.csv: one line a comparison."""
    out = io.StringIO()
    names = [f.name for f in dataclasses.fields(Comparison)]
    writer = csv.writer(out, lineterminator="\n")
    split = {"medians": ("median_first", "median_second")}
    split["difference_interval"] = ("difference_low", "difference_high")
    writer.writerow([column for name in names for column in split.get(name, (name,))] + ["better"])
    for c in comparisons:
        values = [(getattr(c, name) if name in split else (getattr(c, name),)) for name in names]
        writer.writerow([value for part in values for value in part] + [c.better])
    return out.getvalue()


def html(comparisons: Sequence[Comparison], dot: Callable[[str], str]) -> str:
    """Section of the page on one run.

    Args:
        comparisons: Of that run.
        dot: Coloured mark of a method, HTML.

    Returns:
        Empty where there are no two methods.
    """
    if not comparisons:
        return ""
    whole = [c for c in comparisons if c.scenario == ALL_SCENARIOS]
    single = [c for c in comparisons if c.scenario != ALL_SCENARIOS]
    sentences = verdicts(whole or single)
    opened = " open" if len(sentences) <= SENTENCES_SHOWN else ""
    by_scenario_too = ""
    if whole:
        by_scenario_too = (
            "<details><summary>Paired comparison, scenario by scenario</summary>"
            f"{_table(single, dot)}{items(verdicts(single))}</details>"
        )
    notations = copies(
        LaTeX=latex(comparisons),
        Markdown=markdown_table(HEADER, map(cells, comparisons)),
        CSV=table_csv(comparisons),
    )
    return (
        f'<h3>Paired comparison</h3>{_table(whole or single, dot)}<p class="note">{escape(NOTE)}'
        f"</p><details{opened}><summary>Which method is better, as far as chance and the ground "
        f"truth let one tell</summary>{items(sentences)}</details>{by_scenario_too}{notations}"
    )


def _table(comparisons: Sequence[Comparison], dot: Callable[[str], str]) -> str:
    groups = []
    for rows in by_scenario(comparisons):
        title = "All scenarios" if rows[0].scenario == ALL_SCENARIOS else rows[0].scenario
        groups.append(Group(escape(title), [_line(c, dot) for c in rows]))
    return table(HEADER[1:], groups, "pairwise")


def _line(c: Comparison, dot: Callable[[str], str]) -> list[Cell]:
    _, *texts = map(escape, cells(c))
    texts[1] = f"{dot(c.first)}{escape(c.first)} – {dot(c.second)}{escape(c.second)}"
    if c.better:
        texts[-1] = f'<span class="best">{texts[-1]}</span>'
    keys = (None, None, c.trials, c.first_smaller, c.difference, c.sigma, c.p_corrected, None)
    return [Cell(text, key) for text, key in zip(texts, keys, strict=True)]
