"""Share of trials below an error."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from lcdata.evaluation.results import TrialResult
from lcdata.report.theme import (
    DASHED,
    PANELS,
    Theme,
    axis_limits,
    errors_of,
    label_ticks,
    method_legend,
    names,
    panels,
    png,
    sigma_of,
    titled,
)

Array = NDArray[np.float64]


def ecdf_plot(trials: Sequence[TrialResult], theme: Theme) -> bytes:
    """Share of all trials whose error is below a value; failed ones never are.

    Args:
        trials: Trials of one run.
        theme: Colours.

    Returns:
        A PNG file.
    """
    figure, both = panels(theme)
    _, methods = names(trials)
    for axes, quantity in zip(both, PANELS, strict=True):
        low, high = axis_limits(trials, quantity)
        low, high = low / 1.8, high * 1.3
        for j, method in enumerate(methods):
            errors = errors_of([t for t in trials if t.method == method], quantity)
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
        sigma = sigma_of(trials, quantity)
        if math.isfinite(sigma):
            axes.axvspan(low, sigma, color=theme.band, lw=0, zorder=0)
        axes.axvline(quantity.limit, color=theme.muted, lw=0.9, ls=DASHED, zorder=1)
        titled(axes, f"Share of trials below a {quantity.label.lower()} ({quantity.unit})", theme)
    method_legend(figure, methods, theme, sigma_known=math.isfinite(sigma))
    return png(figure)


def ecdf(errors: Array) -> tuple[Array, Array]:
    """Sorted finite values, and the share of all values, infinite ones too, up to each."""
    finite = np.sort(errors[np.isfinite(errors)])
    return finite, np.arange(1, finite.size + 1) / max(1, errors.size)
