"""Summaries in words, for terminals and pages."""

from __future__ import annotations

import math
from collections.abc import Sequence

from lcdata.evaluation.metrics import Summary, indistinguishable
from lcdata.evaluation.results import Results

MISSING = "–"
"""Stands for a number that there is none of."""


def number(value: float, digits: int) -> str:
    """A number with fixed digits; a dash where there is none, or no estimate (infinite)."""
    return f"{value:.{digits}f}" if math.isfinite(value) else MISSING


def summary_lines(results: Results) -> list[str]:
    """One line a scenario and method, for a terminal."""
    rows = results.summaries
    if not rows:
        return ["no results"]
    width = max(len(f"{s.scenario} {s.method}") for s in rows)
    lines = []
    for s in rows:
        sigma = ""
        if math.isfinite(s.sigma_distance):
            sigma = f", {s.sigma_distance:.1f} sigma ({s.explained} explained)"
        failed = f", {s.failed} failed" if s.failed else ""
        lines.append(
            f"{f'{s.scenario} {s.method}':<{width}}  {s.successes}/{s.trials} succeeded, median "
            f"{number(s.rotation_deg.median, 3)} deg {number(s.translation_m.median, 3)} m"
            f"{sigma}, {number(s.seconds, 2)} s{failed}"
        )
    return lines


def not_ranked(summary: Summary, others: Sequence[Summary], quantity: str) -> list[str]:
    """Methods from which one cannot be told apart by a median error.

    Args:
        summary: The method.
        others: Summaries of the same run and scenario.
        quantity: "rotation_deg" or "translation_m".

    Returns:
        Names of the methods whose medians differ from this one's by less than the ground
        truth's own uncertainty, or by anything where that is unknown.
    """
    mine = getattr(summary, quantity).median
    return [
        other.method
        for other in others
        if other.method != summary.method
        and indistinguishable(
            mine, getattr(other, quantity).median, getattr(summary.groundtruth, quantity)
        )
    ]


def verdicts(rows: Sequence[Summary]) -> list[str]:
    """What a comparison of the methods of one scenario may and may not say, in sentences."""
    sentences = []
    for i, a in enumerate(rows):
        for b in rows[i + 1 :]:
            sentences.append(_verdict(a, b, "rotation_deg", "deg"))
            sentences.append(_verdict(a, b, "translation_m", "m"))
    return sentences


def _verdict(a: Summary, b: Summary, quantity: str, unit: str) -> str:
    first, second = getattr(a, quantity).median, getattr(b, quantity).median
    sigma = getattr(a.groundtruth, quantity)
    word = quantity.partition("_")[0]
    pair = f"{a.scenario}, {word}: {a.method} and {b.method}"
    if math.isinf(first) and math.isinf(second):
        return f"{pair} have no estimate in half of their trials or more."
    if math.isnan(sigma):
        return f"{pair} are not ranked: the ground truth has no known uncertainty."
    difference = abs(first - second)
    truth = f"the ground truth's own {sigma:.3f} {unit}"
    if indistinguishable(first, second, sigma):
        return (
            f"{pair} are not ranked: their medians differ by {difference:.3f} {unit}, "
            f"less than {truth}."
        )
    better = a.method if first < second else b.method
    by = f"by {difference:.3f} {unit}" if math.isfinite(difference) else "(the other fails)"
    return f"{pair}: {better} has the smaller median {by}, more than {truth}."
