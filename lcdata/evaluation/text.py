"""Summaries in words, for terminals and pages."""

from __future__ import annotations

import math
from collections.abc import Sequence

from lcdata.evaluation.comparison import QUANTITIES, Comparison
from lcdata.evaluation.metrics import Summary, indistinguishable
from lcdata.evaluation.results import Results
from lcdata.evaluation.statistics import Interval

MISSING = "–"
"""Stands for a number that there is none of."""


def number(value: float, digits: int) -> str:
    """A number with fixed digits; a dash where there is none, or no estimate (infinite)."""
    return f"{value:.{digits}f}" if math.isfinite(value) else MISSING


def rate_interval_text(interval: Interval) -> str:
    """An interval of a rate in whole per cent, rounded outwards; empty where there is none."""
    if math.isnan(interval.low):
        return ""
    low, high = math.floor(100 * interval.low + 1e-9), math.ceil(100 * interval.high - 1e-9)
    return f"{low}–{high} %"


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
        interval = rate_interval_text(s.success_interval)
        median = f"{number(s.rotation_deg.median, 3)} deg {number(s.translation_m.median, 3)} m"
        lines.append(
            f"{f'{s.scenario} {s.method}':<{width}}  {s.successes}/{s.trials} succeeded "
            f"({interval}), median {median}{sigma}, {number(s.seconds, 2)} s{failed}"
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


def p_text(p: float) -> str:
    """A p-value as papers write it."""
    if p < 0.001:
        return "p < 0.001"
    return f"p = {p:.3f}" if p < 0.1 else f"p = {p:.2f}"


def verdicts(comparisons: Sequence[Comparison]) -> list[str]:
    """What comparisons may and may not say, in sentences."""
    return [_verdict(c) for c in comparisons]


def _verdict(c: Comparison) -> str:
    unit = QUANTITIES[c.quantity]
    where = f"{c.scenario}, {c.quantity.partition('_')[0]}"
    truth = f"the ground truth's own {c.sigma:.3f} {unit}"
    if doubt := _doubt(c, unit, truth):
        return f"{where}: {c.first} and {c.second} {doubt}."
    apart = abs(c.medians[0] - c.medians[1])
    by = f"by {apart:.3f} {unit}" if math.isfinite(apart) else "(the other fails)"
    lead = f"{where}: {c.smaller} has the smaller median {by}, more than {truth}"
    against = c.second if c.smaller == c.first else c.first
    wins = c.first_smaller if c.smaller == c.first else c.second_smaller
    if c.better:
        return (
            f"{lead}, and the smaller error in {wins} of {c.trials} trials against {against} "
            f"({p_text(c.p_corrected)})."
        )
    if c.too_few:
        units = "1 pair or group is" if c.units == 1 else f"{c.units} pairs or groups are"
        return f"{lead}, but {units} too few to rank it above {against}."
    return f"{lead}, but chance may do that too ({p_text(c.p_corrected)}): not above {against}."


def _doubt(c: Comparison, unit: str, truth: str) -> str:
    """Why two methods are not ranked, whatever chance may do; empty where they could be."""
    if all(map(math.isinf, c.medians)):
        return (
            "have no estimate in half of their trials or more "
            f"({c.first_failed} and {c.second_failed} of {c.trials} failed)"
        )
    reason = ""
    if math.isnan(c.sigma):
        reason = "the ground truth has no known uncertainty"
    elif indistinguishable(*c.medians, c.sigma):
        apart = abs(c.medians[0] - c.medians[1])
        reason = f"their medians differ by {apart:.3f} {unit}, less than {truth}"
    elif c.indistinguishable:
        apart = abs(c.difference)
        reason = f"trial by trial they differ by {apart:.3f} {unit} (median), less than {truth}"
    elif not c.smaller:
        reason = "medians and single trials speak for different ones"
    return f"are not ranked: {reason}" if reason else ""
