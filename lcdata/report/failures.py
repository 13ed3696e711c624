"""Trials without an estimate: how many, of which methods, why, and one of each kind by name."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from html import escape

from lcdata.evaluation.results import TrialResult
from lcdata.report.html import Cell, Group, table

EACH_NAMED = 12
"""So many failures are listed one by one; more are counted by method and reason."""

MOST_KINDS = 40
"""Methods and reasons that are listed; the most frequent ones."""


def kinds(trials: Sequence[TrialResult]) -> dict[tuple[str, str], list[TrialResult]]:
    """Failed trials by method and reason, the most frequent first."""
    found: dict[tuple[str, str], list[TrialResult]] = {}
    for t in trials:
        if t.failed:
            found.setdefault((t.method, t.message), []).append(t)
    return dict(sorted(found.items(), key=lambda kind: -len(kind[1])))


def section(trials: Sequence[TrialResult], dot: Callable[[str], str]) -> str:
    """Part of the page; empty where every trial has an estimate.

    Args:
        trials: Of one run.
        dot: Coloured mark of a method, HTML.
    """
    failed = [t for t in trials if t.failed]
    if not failed:
        return ""
    title = f"<h3>Trials without an estimate: {len(failed)} of {len(trials)}</h3>"
    if len(failed) <= EACH_NAMED:
        lines = (escape(f"{t.name}: {t.message}") for t in failed)
        return f"{title}<ul>{''.join(f'<li>{line}</li>' for line in lines)}</ul>"
    rows = [
        [
            Cell(f"{dot(method)}{escape(method)}"),
            Cell(str(len(mine)), len(mine)),
            Cell(escape(message)),
            Cell(f"{escape(mine[0].pair_ids[0])}, trial {mine[0].trial}"),
        ]
        for (method, message), mine in list(kinds(failed).items())[:MOST_KINDS]
    ]
    rest = len(kinds(failed)) - len(rows)
    more = f" {rest} more reasons are not listed." if rest > 0 else ""
    body = table(("Method", "Trials", "Reason", "The first"), [Group("", rows)], "worded")
    return f'{title}{body}<p class="note">results.csv has every one of them.{more}</p>'
