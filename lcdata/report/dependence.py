"""What errors depend on: the initial error, the lines that were matched, the shared view."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from lcdata.evaluation.metrics import quartiles
from lcdata.evaluation.results import TrialResult
from lcdata.report.theme import (
    DASHED,
    PANELS,
    Quantity,
    Theme,
    error_axis,
    errors_of,
    method_legend,
    names,
    panels,
    png,
    sigma_of,
    titled,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array = NDArray[np.float64]

Values = Callable[[Sequence[TrialResult], Quantity], Array]
"""(N,) what errors are drawn over, NaN where it is not known."""

SPREAD = 1.2
"""A quantity is worth an axis where the largest is this many times the smallest."""

BINS = 6
"""Each with as many trials, where values are not a few fixed ones."""

CROWD = 300
"""More dots of a method are drawn fainter."""


def initial_errors(trials: Sequence[TrialResult], quantity: Quantity) -> Array:
    """Initial errors, each of the panel's own kind."""
    return np.array([getattr(t, quantity.start) for t in trials], float)


def matched_lines(trials: Sequence[TrialResult], quantity: Quantity) -> Array:
    """Lines that estimates rest on; NaN of methods that match none in any trial, and of failures.

    A trial without an estimate has no count: nobody knows how many lines it had.
    """
    counts = np.array([np.nan if t.failed else len(t.matches.pair_index) for t in trials], float)
    for method in {t.method for t in trials}:
        mine = np.array([t.method == method for t in trials])
        if not (counts[mine] > 0).any():
            counts[mine] = np.nan
    return counts


def in_view(shares: Mapping[str, float]) -> Values:
    """Share of the cloud inside the image, over the pairs of a trial, per cent.

    Args:
        shares: By pair.
    """

    def values(trials: Sequence[TrialResult], quantity: Quantity) -> Array:
        of_trial = ([shares.get(pair, np.nan) for pair in t.pair_ids] for t in trials)
        return np.array([100 * float(np.mean(known)) for known in of_trial], float)

    return values


def varies(trials: Sequence[TrialResult], values: Values) -> bool:
    """Whether a quantity differs enough between trials to be worth an axis."""
    for quantity in PANELS:
        known = values(trials, quantity)
        known = known[np.isfinite(known)]
        if known.size and known.max() > SPREAD * max(known.min(), 0.0) and known.max() > 0:
            return True
    return False


def dependence_plot(
    trials: Sequence[TrialResult], theme: Theme, values: Values, over: str
) -> bytes:
    """Errors over another quantity: a dot a trial, lines through medians.

    Args:
        trials: Trials of any runs.
        theme: Colours.
        values: The quantity.
        over: Its name, in each panel's title; `{unit}` in it is the panel's.

    Returns:
        A PNG file.
    """
    figure, both = panels(theme)
    _, methods = names(trials)
    known = False
    for axes, quantity in zip(both, PANELS, strict=True):
        low, high = error_axis(axes, trials, quantity)
        everything = values(trials, quantity)
        for j, method in enumerate(methods):
            mine = np.array([t.method == method for t in trials])
            x = everything[mine]
            errors = errors_of([t for t in trials if t.method == method], quantity)
            _dots(axes, x, np.clip(errors, low, high), theme.method(j))
            middles, medians = binned_medians(x, errors)
            shown = np.clip(medians, low, high)
            axes.plot(middles, shown, "-o", ms=4.5, color=theme.method(j), lw=1.6)
        sigma = sigma_of(trials, quantity)
        if math.isfinite(sigma):
            known = True
            axes.axhspan(low, sigma, color=theme.band, lw=0, zorder=0)
        axes.axhline(quantity.limit, color=theme.muted, lw=0.9, ls=DASHED, zorder=1)
        finite = everything[np.isfinite(everything)]
        if finite.size and np.ptp(finite) < 1e-3 * finite.max():
            axes.set_xlim(0.9 * finite.max(), 1.1 * finite.max())  # one value: no digits of noise
        over_it = over.format(unit=quantity.unit)
        titled(axes, f"{quantity.label} ({quantity.unit}) over {over_it}", theme)
    method_legend(figure, methods, theme, sigma_known=known)
    return png(figure)


def _dots(axes: Axes, x: Array, y: Array, colour: str) -> None:
    many = len(x) > CROWD
    size, alpha = (2.0, 0.18) if many else (3.0, 0.4)
    axes.plot(x, y, "o", mfc=colour, mec="none", ms=size, alpha=alpha)


def binned_medians(starts: Array, errors: Array) -> tuple[Array, Array]:
    """Median error by another quantity: at each value where these are few, else in equal shares.

    Args:
        starts: (N,) values of the quantity; trials without one are left out.
        errors: (N,) errors, infinite without an estimate.

    Returns:
        (B,) median value of each bin and (B,) median error.
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
