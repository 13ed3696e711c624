"""Box plots of errors, as in Fig. 5 of PLK-Calib, with the ground truth's own uncertainty."""

from __future__ import annotations

import io
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lcdata.evaluation import metrics
from lcdata.evaluation.results import TrialResult
from lcdata.evaluation.text import not_ranked

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array = NDArray[np.float64]

NOT_RANKED = "≈"
"""Stands over methods that the ground truth cannot tell apart, as in the tables."""

LINEAR_SPAN = 30.0
"""Axes are logarithmic where errors span more than a decade and a half."""


@dataclass(frozen=True)
class Theme:
    """Colours of a plot; `methods` are told apart by the colour-blind too."""

    ink: str
    muted: str
    band: str
    background: str
    methods: tuple[str, ...]

    def method(self, index: int) -> str:
        """Colour of a method."""
        return self.methods[index % len(self.methods)]


LIGHT = Theme(
    ink="#24272b",
    muted="#8b8f96",
    band="#d9d5cc",
    background="#fcfbf9",
    methods=("#2f6db3", "#d5762a", "#3f8f68", "#8a63b5", "#b8434e", "#7a6a53"),
)
DARK = Theme(
    ink="#e6e4df",
    muted="#8f949c",
    band="#3a3d42",
    background="#17191c",
    methods=("#6fa8e6", "#eea060", "#6cc197", "#b896e0", "#e57f88", "#bfae94"),
)


@dataclass(frozen=True)
class Quantity:
    """One panel of the figure."""

    error: str
    median: str
    start: str
    sigma: str
    label: str
    unit: str
    limit: float


PANELS = (
    Quantity(
        "rotation_error_deg",
        "rotation_deg",
        "initial_rotation_error_deg",
        "groundtruth_rotation_sigma_deg",
        "Rotation error",
        "deg",
        metrics.SUCCESS_ROTATION_DEG,
    ),
    Quantity(
        "translation_error_m",
        "translation_m",
        "initial_translation_error_m",
        "groundtruth_translation_sigma_m",
        "Translation error",
        "m",
        metrics.SUCCESS_TRANSLATION_M,
    ),
)


def box_plots(trials: Sequence[TrialResult], theme: Theme) -> bytes:
    """Rotation and translation errors by scenario and method.

    Args:
        trials: Trials of one run.
        theme: Colours.

    Returns:
        A PNG file.
    """
    from matplotlib.figure import Figure

    scenarios, methods = names(trials)
    columns = len(scenarios) * (len(methods) + 1)
    figure = Figure(figsize=(min(18.0, max(12.0, 3.0 + 0.75 * columns)), 4.4), dpi=150)
    figure.patch.set_facecolor(theme.background)
    limits = [axis_limits(trials, quantity) for quantity in PANELS]
    log = any(top / bottom > LINEAR_SPAN for bottom, top in limits)
    for axes, quantity, ends in zip(figure.subplots(1, 2), PANELS, limits, strict=True):
        if log:
            axes.set_yscale("log")
            axes.set_ylim(ends[0] / 1.8, ends[1] * 1.3)
            label_ticks(axes, axes.yaxis)
        else:
            axes.set_ylim(0, ends[1] * 1.1)
        _panel(axes, trials, quantity, theme)
    known = any(math.isfinite(t.groundtruth_rotation_sigma_deg) for t in trials)
    _legend(figure, methods, theme, known, len(methods) > 1)
    out = io.BytesIO()
    figure.savefig(out, format="png")
    return out.getvalue()


def names(trials: Sequence[TrialResult]) -> tuple[list[str], list[str]]:
    """Scenarios and methods in the order in which they are drawn."""
    return sorted({t.scenario for t in trials}), list(dict.fromkeys(t.method for t in trials))


def _panel(axes: Axes, trials: Sequence[TrialResult], quantity: Quantity, theme: Theme) -> None:
    scenarios, methods = names(trials)
    summaries = metrics.summarise(trials)
    errors = np.array([getattr(t, quantity.error) for t in trials], float)
    starts = np.array([getattr(t, quantity.start) for t in trials], float)
    sigmas = np.array([getattr(t, quantity.sigma) for t in trials], float)
    low, high = axes.get_ylim()
    for i, scenario in enumerate(scenarios):
        here = np.array([t.scenario == scenario for t in trials])
        sigma = float(np.sqrt(np.mean(sigmas[here] ** 2)))
        rows = {s.method: s for s in summaries if s.scenario == scenario}
        if math.isfinite(sigma):
            axes.fill_between([i - 0.46, i + 0.46], low, sigma, color=theme.band, lw=0, zorder=0)
        for j, method in enumerate(methods):
            mine = here & np.array([t.method == method for t in trials])
            width = 0.8 / len(methods)
            position = i + (j - (len(methods) - 1) / 2) * width
            made = np.maximum(errors[mine & np.isfinite(errors)], low)  # zero has no logarithm
            if made.size:
                _box(axes, made, position, min(0.28, 0.62 * width), colour=theme.method(j))
            notes = []
            if method in rows and not_ranked(rows[method], list(rows.values()), quantity.median):
                notes.append(NOT_RANKED)
            if missing := int(np.isnan(errors[mine]).sum()):
                notes.append(f"{missing} failed")
            if text := " ".join(notes):
                axes.text(position, high, text, ha="center", va="bottom", size=8, color=theme.ink)
    axes.axhline(quantity.limit, color=theme.muted, lw=0.9, ls=(0, (5, 3)), zorder=1)
    start = math.nan if np.isnan(starts).all() else float(np.nanmedian(starts))
    if low < start < high:
        axes.axhline(start, color=theme.muted, lw=0.9, ls=(0, (1, 2)), zorder=1)
    axes.set_xticks(range(len(scenarios)), [s.replace("_", " ") for s in scenarios])
    axes.set_xlim(-0.55, len(scenarios) - 0.45)
    axes.set_title(
        f"{quantity.label} ({quantity.unit})", loc="left", size=10.5, color=theme.ink, pad=14
    )
    plain_axes(axes, theme)


def _box(axes: Axes, errors: Array, position: float, width: float, *, colour: str) -> None:
    """A box over its trials as dots, spread sideways in a fixed pattern."""
    spread = ((np.arange(len(errors)) * 0.618) % 1 - 0.5) * width * 0.8
    axes.plot(position + spread, errors, "o", ms=3, mfc=colour, mec="none", alpha=0.45, zorder=2.5)
    line = {"color": colour, "linewidth": 1.2}
    axes.boxplot(
        [errors],
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


def axis_limits(trials: Sequence[TrialResult], quantity: Quantity) -> tuple[float, float]:
    """Smallest and largest value that an axis must show; both above zero."""
    errors = np.array([getattr(t, quantity.error) for t in trials], float)
    sigmas = np.array([getattr(t, quantity.sigma) for t in trials], float)
    values = [v for v in (*errors, *sigmas, quantity.limit) if 0 < v < math.inf]
    made = errors[errors > 0]
    low = [float(np.percentile(made, 2))] if made.size else []  # not down to the luckiest trial
    low += [v for v in sigmas if v > 0]
    return min([*low, quantity.limit]), max(values)


def label_ticks(axes: Axes, axis: Any) -> None:
    """Plain numbers on a logarithmic axis (one of the two of `axes`), more on a short one."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    low, high = axes.get_xlim() if axis is axes.xaxis else axes.get_ylim()
    axis.set_major_locator(LogLocator(10, subs=(1.0,) if high / low > 500 else (1, 2, 5)))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())


def plain_axes(axes: Axes, theme: Theme) -> None:
    """No frame but the left side, the theme's colours."""
    axes.set_facecolor("none")
    for side in ("top", "right", "bottom"):
        axes.spines[side].set_visible(False)
    axes.spines["left"].set_color(theme.muted)
    axes.tick_params(axis="both", which="both", colors=theme.muted, labelcolor=theme.ink, size=9)
    axes.tick_params(axis="x", length=0, labelsize=10)
    axes.tick_params(axis="y", length=3, labelsize=9)
    axes.tick_params(axis="y", which="minor", length=1.5, width=0.5)


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
        Line2D([], [], color=theme.muted, lw=0.9, ls=(0, (5, 3)), label="success below"),
        Line2D([], [], color=theme.muted, lw=0.9, ls=(0, (1, 2)), label="initial guess"),
    ]
    if not_ranked_too:
        handles.append(
            Line2D([], [], marker=f"${NOT_RANKED}$", ls="", color=theme.ink, label="not ranked")
        )
    figure.subplots_adjust(left=0.06, right=0.985, top=0.86, bottom=0.19, wspace=0.16)
    figure.legend(
        handles=handles,
        loc="lower center",
        ncols=min(7, len(handles)),
        frameon=False,
        fontsize=9,
        labelcolor=theme.ink,
        handlelength=1.8,
        columnspacing=1.8,
    )


def budget_bars(
    shares: Array, sources: Sequence[str], scenarios: Sequence[str], theme: Theme
) -> bytes:
    """Shares of a ground truth's variances as stacked bars, one a pose.

    Args:
        shares: (N, S, 2) of translation and rotation, by pose and source.
        sources: S names.
        scenarios: N names, those of one scenario next to each other.
        theme: Colours.

    Returns:
        A PNG file.
    """
    from matplotlib.figure import Figure
    from matplotlib.patches import Patch

    names = list(dict.fromkeys(scenarios))
    # a gap between scenarios
    x = np.arange(len(scenarios)) + np.array([names.index(s) for s in scenarios])
    figure = Figure(figsize=(12.0, 3.6), dpi=150)
    figure.patch.set_facecolor(theme.background)
    width = 0.86 if len(scenarios) <= 120 else 1.0  # gaps between many bars look like a pattern
    for axes, label, k in zip(
        figure.subplots(1, 2), ("Rotation", "Translation"), (1, 0), strict=True
    ):
        bottom = np.zeros(len(scenarios))
        for j in range(len(sources)):
            part = 100 * shares[:, j, k]
            axes.bar(x, part, width, bottom=bottom, color=theme.method(j), lw=0)
            bottom += part
        middles = [x[[s == name for s in scenarios]].mean() for name in names]
        axes.set_xticks(middles, [name.replace("_", " ") for name in names])
        axes.set_ylim(0, 100)
        axes.set_xlim(-0.7, x[-1] + 0.7)
        title = f"{label}: share of the ground truth's variance (%)"
        axes.set_title(title, loc="left", size=10.5, color=theme.ink, pad=10)
        plain_axes(axes, theme)
    figure.subplots_adjust(left=0.06, right=0.985, top=0.88, bottom=0.22, wspace=0.16)
    figure.legend(
        handles=[Patch(facecolor=theme.method(j), label=s) for j, s in enumerate(sources)],
        loc="lower center",
        ncols=6,
        frameon=False,
        fontsize=9,
        labelcolor=theme.ink,
        handlelength=1.2,
    )
    out = io.BytesIO()
    figure.savefig(out, format="png")
    return out.getvalue()
