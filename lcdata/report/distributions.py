"""Plots of whole distributions: shares of trials below an error, errors over initial errors."""

from __future__ import annotations

import io
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lcdata.evaluation.metrics import quartiles
from lcdata.evaluation.results import TrialResult
from lcdata.report.plots import (
    PANELS,
    Quantity,
    Theme,
    axis_limits,
    label_ticks,
    names,
    plain_axes,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

SPREAD = 1.2
"""Initial errors are worth an axis where the largest is this many times the smallest."""

BINS = 6
"""Of initial errors, each with as many trials, where they are not a few fixed sizes."""


def ecdf_plot(trials: Sequence[TrialResult], theme: Theme) -> bytes:
    """Share of all trials whose error is below a value; failed ones never are.

    Args:
        trials: Trials of one run.
        theme: Colours.

    Returns:
        A PNG file.
    """
    figure, both = _figure(theme)
    _, methods = names(trials)
    for axes, quantity in zip(both, PANELS, strict=True):
        low, high = axis_limits(trials, quantity)
        low, high = low / 1.8, high * 1.3
        for j, method in enumerate(methods):
            errors = _errors(trials, method, quantity)
            x, share = ecdf(errors)
            axes.step(
                [low, *x, high],
                [0, *share, share[-1] if share.size else 0],
                where="post",
                color=theme.method(j),
                lw=1.8,
            )
        axes.set_xscale("log")
        axes.set_xlim(low, high)
        axes.set_ylim(0, 1.02)
        label_ticks(axes, axes.xaxis)
        sigma = _sigma(trials, quantity)
        if math.isfinite(sigma):
            axes.axvspan(low, sigma, color=theme.band, lw=0, zorder=0)
        axes.axvline(quantity.limit, color=theme.muted, lw=0.9, ls=(0, (5, 3)), zorder=1)
        _title(axes, f"Share of trials below a {quantity.label.lower()} ({quantity.unit})", theme)
    _method_legend(figure, methods, theme)
    return _png(figure)


def ecdf(errors: Array) -> tuple[Array, Array]:
    """Sorted finite values, and the share of all values, infinite ones too, up to each."""
    finite = np.sort(errors[np.isfinite(errors)])
    return finite, np.arange(1, finite.size + 1) / max(1, errors.size)


def start_varies(trials: Sequence[TrialResult]) -> bool:
    """Whether trials started from errors of different sizes."""
    for quantity in PANELS:
        starts = np.array([getattr(t, quantity.start) for t in trials], float)
        starts = starts[np.isfinite(starts) & (starts > 0)]
        if starts.size and starts.max() > SPREAD * starts.min():
            return True
    return False


def start_plot(trials: Sequence[TrialResult], theme: Theme) -> bytes:
    """Errors over initial errors: a dot a trial, lines through medians.

    Args:
        trials: Trials of any runs.
        theme: Colours.

    Returns:
        A PNG file.
    """
    figure, both = _figure(theme)
    _, methods = names(trials)
    for axes, quantity in zip(both, PANELS, strict=True):
        low, high = axis_limits(trials, quantity)
        low, high = low / 1.8, high * 1.3
        for j, method in enumerate(methods):
            mine = [t for t in trials if t.method == method]
            errors = _errors(trials, method, quantity)
            starts = np.array([getattr(t, quantity.start) for t in mine], float)
            shown = np.clip(np.where(np.isfinite(errors), errors, high), low, high)
            colour = theme.method(j)
            axes.plot(starts, shown, "o", ms=3, mfc=colour, mec="none", alpha=0.35)
            x, medians = binned_medians(starts, errors)
            axes.plot(x, np.clip(medians, low, high), "-o", ms=4.5, color=colour, lw=1.6)
        axes.set_yscale("log")
        axes.set_ylim(low, high * 1.15)
        label_ticks(axes, axes.yaxis)
        sigma = _sigma(trials, quantity)
        if math.isfinite(sigma):
            axes.axhspan(low, sigma, color=theme.band, lw=0, zorder=0)
        axes.axhline(quantity.limit, color=theme.muted, lw=0.9, ls=(0, (5, 3)), zorder=1)
        _title(axes, f"{quantity.label} over its initial size ({quantity.unit})", theme)
    _method_legend(figure, methods, theme)
    return _png(figure)


def binned_medians(starts: Array, errors: Array) -> tuple[Array, Array]:
    """Median error by initial error: at each size where these are few, else in equal shares.

    Args:
        starts: (N,) initial errors.
        errors: (N,) errors, infinite without an estimate.

    Returns:
        (B,) median initial error of each bin and (B,) median error.
    """
    known = np.isfinite(starts)
    starts, errors = starts[known], errors[known]
    order = np.argsort(starts, kind="stable")
    starts, errors = starts[order], errors[order]
    if not starts.size:
        return np.zeros(0), np.zeros(0)
    jumps = np.flatnonzero(np.diff(starts) > 1e-6 * starts[1:]) + 1
    if jumps.size >= BINS:
        jumps = np.unique(np.linspace(0, starts.size, BINS + 1).astype(int)[1:-1])
    parts = zip(np.split(starts, jumps), np.split(errors, jumps), strict=True)
    middles = [(np.median(x), quartiles(y).median) for x, y in parts if x.size]
    return np.array(middles)[:, 0], np.array(middles)[:, 1]


def _errors(trials: Sequence[TrialResult], method: str, quantity: Quantity) -> Array:
    errors = np.array([getattr(t, quantity.error) for t in trials if t.method == method], float)
    return np.where(np.isfinite(errors), errors, np.inf)


def _sigma(trials: Sequence[TrialResult], quantity: Quantity) -> float:
    return float(np.sqrt(np.mean([getattr(t, quantity.sigma) ** 2 for t in trials])))


def _figure(theme: Theme) -> tuple[Figure, Any]:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(12.0, 3.8), dpi=130)
    figure.patch.set_facecolor(theme.background)
    figure.subplots_adjust(left=0.06, right=0.985, top=0.87, bottom=0.2, wspace=0.16)
    return figure, figure.subplots(1, 2)


def _title(axes: Axes, text: str, theme: Theme) -> None:
    axes.set_title(text, loc="left", size=10.5, color=theme.ink, pad=10)
    plain_axes(axes, theme)
    axes.tick_params(axis="x", length=3, labelsize=9)
    axes.tick_params(axis="x", which="minor", length=1.5, width=0.5)


def _method_legend(figure: Figure, methods: Sequence[str], theme: Theme) -> None:
    from matplotlib.lines import Line2D

    figure.legend(
        handles=[
            Line2D([], [], color=theme.method(j), lw=2, label=m) for j, m in enumerate(methods)
        ]
        + [Line2D([], [], color=theme.muted, lw=0.9, ls=(0, (5, 3)), label="success below")],
        loc="lower center",
        ncols=min(7, len(methods) + 1),
        frameon=False,
        fontsize=9,
        labelcolor=theme.ink,
    )


def _png(figure: Figure) -> bytes:
    out = io.BytesIO()
    figure.savefig(out, format="png")
    return out.getvalue()
