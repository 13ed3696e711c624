"""Errors pose by pose as a picture: which places are hard, and for whom."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lcdata.evaluation.metrics import quartiles
from lcdata.evaluation.results import TrialResult
from lcdata.report.theme import (
    DASHED,
    PANELS,
    Theme,
    columns,
    error_axis,
    errors_of,
    method_legend,
    panels,
    png,
    titled,
)

MOST_POSES = 120
"""More do not fit side by side."""

SPREAD = 0.5
"""Of the methods of one pose, in the distance of poses."""


def pose_names(trials: Sequence[TrialResult]) -> list[str]:
    """Poses in the order in which they are drawn."""
    return sorted({t.pose_id for t in trials})


def pose_plot(trials: Sequence[TrialResult], theme: Theme) -> bytes:
    """Median error at each pose, a line from quartile to quartile.

    Args:
        trials: Trials of one run.
        theme: Colours.

    Returns:
        A PNG file.
    """
    poses = pose_names(trials)
    methods = list(dict.fromkeys(t.method for t in trials))
    groups: dict[tuple[str, str], list[TrialResult]] = {}
    for t in trials:
        groups.setdefault((t.pose_id, t.method), []).append(t)
    first = {pose: next(t for t in trials if t.pose_id == pose) for pose in poses}
    scenarios = [first[pose].scenario for pose in poses]
    order = list(dict.fromkeys(scenarios))
    x = np.array([i + order.index(s) for i, s in enumerate(scenarios)], float)  # a gap between
    figure, both = panels(theme, 6.4, 2)
    known = False
    size = 5.0 if len(poses) * len(methods) <= 150 else 3.2
    for axes, quantity in zip(both, PANELS, strict=True):
        low, high = error_axis(axes, trials, quantity)
        sigmas = np.array([getattr(first[pose], quantity.sigma) for pose in poses], float)
        here = np.isfinite(sigmas)
        known |= bool(here.any())
        columns(axes, x[here], np.full(here.sum(), low), sigmas[here], 1.0, theme.band)
        for j, method in enumerate(methods):
            shift = SPREAD * ((j + 0.5) / len(methods) - 0.5)
            rows = [
                (place + shift, *quartiles(errors))
                for place, pose in zip(x, poses, strict=True)
                if (errors := errors_of(groups.get((pose, method), []), quantity)).size
            ]
            at, *ends = np.array(rows).T
            least, middle, most = (np.clip(end, low, high) for end in ends)
            colour = theme.method(j)
            axes.vlines(at, least, most, colors=colour, lw=1.1, alpha=0.6, zorder=2)
            axes.plot(at, middle, "o", ms=size, mfc=colour, mec="none", zorder=3)
        axes.axhline(quantity.limit, color=theme.muted, lw=0.9, ls=DASHED, zorder=1)
        titled(axes, f"{quantity.label} at each pose ({quantity.unit})", theme)
        middles = [x[[s == name for s in scenarios]].mean() for name in order]
        axes.set_xticks(middles, [name.replace("_", " ") for name in order])
        axes.set_xlim(-0.8, x[-1] + 0.8)
        axes.tick_params(axis="x", length=0, labelsize=10)
    method_legend(figure, methods, theme, sigma_known=known)
    return png(figure)
