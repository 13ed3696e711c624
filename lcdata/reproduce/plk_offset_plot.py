"""Errors over offsets of the initial guess, as in PLK-Calib's Figure 6."""

from __future__ import annotations

import io
import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from lcdata.report.theme import LIGHT, PANELS, Quantity, label_ticks, plain_axes
from lcdata.reproduce.plk_tests import TESTS
from lcdata.reproduce.plk_trials import Row

if TYPE_CHECKING:
    from matplotlib.axes import Axes

ENDS = {"deg": (1e-3, 180.0), "m": (1e-3, 20.0)}
"""Ends of the axes; what is beyond, and what has no estimate, is drawn at the end."""


def offset_plot(by_test: Mapping[str, Sequence[Row]]) -> bytes:
    """Two panels a test, one where the other is held: a dot a trial, lines through medians.

    Args:
        by_test: Trials by the name of their test.

    Returns:
        A PNG file.
    """
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

    theme = LIGHT
    labels = list(dict.fromkeys(row.label for rows in by_test.values() for row in rows))
    shown = [(name, quantity) for name in by_test for quantity in _free(name)]
    lines = math.ceil(len(shown) / 2)
    height = 2.6 * lines + 0.7
    figure = Figure(figsize=(12.0, height), dpi=130)
    figure.patch.set_facecolor(theme.background)
    panels = figure.subplots(lines, 2, squeeze=False).ravel()
    for axes in panels[len(shown) :]:
        axes.set_axis_off()
    for (name, quantity), axes in zip(shown, panels, strict=False):
        for j, label in enumerate(labels):
            mine = [row for row in by_test[name] if row.label == label]
            shift = (j - (len(labels) - 1) / 2) * 0.12
            _panel(axes, name, mine, quantity, theme.method(j), shift)
        axes.axhline(quantity.limit, color=theme.muted, lw=0.9, ls=(0, (5, 3)), zorder=1)
        text = f"{TESTS[name].title}: {quantity.label.lower()} ({quantity.unit})"
        axes.set_title(text[0].upper() + text[1:], loc="left", size=10, color=theme.ink)
        label_ticks(axes, axes.yaxis)
        plain_axes(axes, theme)
        axes.tick_params(axis="x", length=3, labelsize=9)
    handles = [Line2D([], [], color=theme.method(j), lw=2, label=m) for j, m in enumerate(labels)]
    handles.append(Line2D([], [], color=theme.muted, lw=0.9, ls=(0, (5, 3)), label="success below"))
    figure.subplots_adjust(
        left=0.06,
        right=0.985,
        top=1 - 0.35 / height,
        bottom=0.75 / height,
        wspace=0.14,
        hspace=0.45,
    )
    figure.legend(
        handles=handles,
        loc="lower center",
        ncols=6,
        frameon=False,
        fontsize=9,
        labelcolor=theme.ink,
    )
    out = io.BytesIO()
    figure.savefig(out, format="png")
    return out.getvalue()


def _free(name: str) -> list[Quantity]:
    """What a test estimates."""
    held = {"rotation": PANELS[0], "translation": PANELS[1]}.get(TESTS[name].hold)
    return [quantity for quantity in PANELS if quantity is not held]


def _panel(
    axes: Axes, name: str, rows: Sequence[Row], quantity: Quantity, colour: str, shift: float
) -> None:
    """Errors of one method in one panel."""
    test = TESTS[name]
    ends = ENDS[quantity.unit]
    offsets = np.array([row.metres if test.moves else row.degrees for row in rows])
    errors = np.array([getattr(row, quantity.error) for row in rows])
    places = np.unique(offsets)
    shift *= float(np.diff(places).min()) if len(places) > 1 else 1.0
    axes.plot(
        offsets + shift, np.clip(errors, *ends), "o", ms=3.5, mfc=colour, mec="none", alpha=0.45
    )
    medians = [float(np.median(errors[offsets == place])) for place in places]
    axes.plot(places + shift, np.clip(medians, *ends), color=colour, lw=1.4)
    axes.set_yscale("log")
    axes.set_ylim(ends[0] * 0.8, ends[1] * 1.3)
    axes.set_xticks(places, [f"{place:+g}" for place in places])
    unit = "m" if test.moves else "deg"
    if test.moves and test.turns:
        unit += f", and up to ±{max(abs(row.degrees) for row in rows):g} deg"
    axes.set_xlabel(f"offset ({unit})", size=9)
