"""Box plots of errors, as in Fig. 5 of PLK-Calib, with the ground truth's own uncertainty."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lcdata.evaluation import metrics
from lcdata.evaluation.results import TrialResult
from lcdata.report.theme import (
    DASHED,
    PANELS,
    Quantity,
    Theme,
    axis_limits,
    bottom_legend,
    errors_of,
    label_ticks,
    names,
    panels,
    plain_axes,
    png,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array = NDArray[np.float64]

NOT_RANKED = "≈"
"""Stands over methods that the ground truth cannot tell apart, as in the tables."""

LINEAR_SPAN = 30.0
"""Axes are logarithmic where errors span more than a decade and a half."""

SIDE_BY_SIDE = 26
"""Places for boxes that both errors have room for beside each other."""

NOTED = 4
"""More methods leave no room for words over each."""

CROWD = 60
"""More trials of a box are drawn smaller."""


def box_plots(trials: Sequence[TrialResult], theme: Theme) -> bytes:
    """Rotation and translation errors by scenario and method.

    Args:
        trials: Trials of one run.
        theme: Colours.

    Returns:
        A PNG file.
    """
    scenarios, methods = names(trials)
    rows = 1 if len(scenarios) * (len(methods) + 1) <= SIDE_BY_SIDE else 2
    figure, both = panels(theme, 4.4 * rows, rows)
    limits = [axis_limits(trials, quantity) for quantity in PANELS]
    log = any(top / bottom > LINEAR_SPAN for bottom, top in limits)
    for axes, quantity, ends in zip(both, PANELS, limits, strict=True):
        if log:
            axes.set_yscale("log")
            axes.set_ylim(ends[0] / 1.8, ends[1] * 1.3)
            label_ticks(axes, axes.yaxis)
        else:
            axes.set_ylim(0, ends[1] * 1.1)
        _panel(axes, trials, quantity, theme)
    known = any(math.isfinite(t.groundtruth_rotation_sigma_deg) for t in trials)
    _legend(figure, methods, theme, known, len(methods) > 1)
    return png(figure)


def _panel(axes: Axes, trials: Sequence[TrialResult], quantity: Quantity, theme: Theme) -> None:
    scenarios, methods = names(trials)
    errors = errors_of(trials, quantity)
    starts = np.array([getattr(t, quantity.start) for t in trials], float)
    sigmas = np.array([getattr(t, quantity.sigma) for t in trials], float)
    low, high = axes.get_ylim()
    for i, scenario in enumerate(scenarios):
        here = np.array([t.scenario == scenario for t in trials])
        sigma = metrics.rms(sigmas[here].tolist())
        if math.isfinite(sigma):
            axes.fill_between([i - 0.46, i + 0.46], low, sigma, color=theme.band, lw=0, zorder=0)
        of_method = {m: errors[here & np.array([t.method == m for t in trials])] for m in methods}
        medians = {m: metrics.quartiles(mine).median for m, mine in of_method.items() if mine.size}
        for j, method in enumerate(methods):
            mine = of_method[method]
            width = 0.8 / len(methods)
            position = i + (j - (len(methods) - 1) / 2) * width
            if mine.size:
                _box(axes, mine, position, min(0.28, 0.62 * width), colour=theme.method(j))
            notes = []
            if any(
                metrics.indistinguishable(medians[method], median, sigma)
                for other, median in medians.items()
                if method in medians and other != method
            ):
                notes.append(NOT_RANKED)
            if missing := int(np.isinf(mine).sum()):
                notes.append(f"{missing} failed" if len(methods) <= NOTED else f"{missing}×")
            if text := " ".join(notes):
                axes.text(position, high, text, ha="center", va="bottom", size=8, color=theme.ink)
    axes.axhline(quantity.limit, color=theme.muted, lw=0.9, ls=DASHED, zorder=1)
    known = starts[np.isfinite(starts)]
    if known.size and low < (start := float(np.median(known))) < high:
        axes.axhline(start, color=theme.muted, lw=0.9, ls=(0, (1, 2)), zorder=1)
    axes.set_xticks(range(len(scenarios)), [s.replace("_", " ") for s in scenarios])
    axes.set_xlim(-0.55, len(scenarios) - 0.45)
    axes.set_title(
        f"{quantity.label} ({quantity.unit})", loc="left", size=10.5, color=theme.ink, pad=14
    )
    plain_axes(axes, theme)


def _box(axes: Axes, errors: Array, position: float, width: float, *, colour: str) -> None:
    """A box over its trials as dots, spread sideways in a fixed pattern.

    Trials without an estimate count: they lie beyond the upper end of the axis.
    """
    low, high = axes.get_ylim()
    shown = np.clip(errors, low, high)  # zero has no logarithm, failures no place
    spread = ((np.arange(len(shown)) * 0.618) % 1 - 0.5) * width * 0.8
    few = len(shown) <= CROWD
    size, alpha = (3.0, 0.45) if few else (1.8, 0.2)
    axes.plot(
        position + spread, shown, "o", ms=size, alpha=alpha, mfc=colour, mec="none", zorder=2.5
    )
    q1, median, q3 = metrics.quartiles(errors)
    finite = errors[np.isfinite(errors)]
    reach = 1.5 * (q3 - q1) if math.isfinite(q3) else math.inf
    inside = finite[(finite >= q1 - reach) & (finite <= q3 + reach)]
    top = high if math.isinf(q3) else max(q3, inside.max(initial=q3))
    bottom = q1 if math.isinf(q1) else min(q1, inside.min(initial=q1))
    ends = {"q1": q1, "med": median, "q3": q3, "whislo": bottom, "whishi": top}
    line = {"color": colour, "linewidth": 1.2}
    axes.bxp(
        [{name: float(np.clip(value, low, high)) for name, value in ends.items()}],
        positions=[position],
        widths=width,
        showfliers=False,
        patch_artist=True,
        manage_ticks=False,
        boxprops={"facecolor": colour + "38", "edgecolor": colour, "linewidth": 1.2},
        medianprops={"color": colour, "linewidth": 2.4},
        whiskerprops=line,
        capprops=line,
        zorder=3,
    )


def _legend(
    figure: Any, methods: Sequence[str], theme: Theme, truth_known: bool, not_ranked_too: bool
) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    handles: list[Any] = [
        Patch(facecolor=theme.method(j) + "38", edgecolor=theme.method(j), label=method)
        for j, method in enumerate(methods)
    ]
    if truth_known:
        label = "ground truth's own uncertainty (1 sigma)"
        handles.append(Patch(facecolor=theme.band, label=label))
    handles += [
        Line2D([], [], color=theme.muted, lw=0.9, ls=DASHED, label="success below"),
        Line2D([], [], color=theme.muted, lw=0.9, ls=(0, (1, 2)), label="initial guess"),
    ]
    if not_ranked_too:
        handles.append(
            Line2D([], [], marker=f"${NOT_RANKED}$", ls="", color=theme.ink, label="not ranked")
        )
    bottom_legend(figure, handles, theme)
