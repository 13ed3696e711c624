"""Where the ground truth's uncertainty comes from, as stacked bars."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from lcdata.report.theme import Theme, bottom_legend, columns, plain_axes, png

Array = NDArray[np.float64]


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
            columns(axes, x, bottom, bottom + part, width, theme.method(j))
            bottom = bottom + part
        middles = [x[[s == name for s in scenarios]].mean() for name in names]
        axes.set_xticks(middles, [name.replace("_", " ") for name in names])
        axes.set_ylim(0, 100)
        axes.set_xlim(-0.7, x[-1] + 0.7)
        title = f"{label}: share of the ground truth's variance (%)"
        axes.set_title(title, loc="left", size=10.5, color=theme.ink, pad=10)
        plain_axes(axes, theme)
    figure.subplots_adjust(left=0.06, right=0.985, top=0.88, bottom=0.22, wspace=0.16)
    handles = [Patch(facecolor=theme.method(j), label=s) for j, s in enumerate(sources)]
    bottom_legend(figure, handles, theme)
    return png(figure)
