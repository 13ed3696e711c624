"""What all plots share: colours, the two errors, axes without ornament."""

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

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

DASHED = (0, (5, 3))
"""Line of the limit of success."""

LINE, HANDLE = 185, 9
"""Letters that a line of a legend has room for, and the room of a coloured mark in letters."""

PALETTE = 160
"""Colours of a plot's file."""


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
    methods=(
        "#2f6db3",
        "#d5762a",
        "#3f8f68",
        "#8a63b5",
        "#b8434e",
        "#7a6a53",
        "#2497a8",
        "#c765a0",
        "#8f8f2c",
        "#5b6b80",
    ),
)
DARK = Theme(
    ink="#e6e4df",
    muted="#8f949c",
    band="#3a3d42",
    background="#17191c",
    methods=(
        "#6fa8e6",
        "#eea060",
        "#6cc197",
        "#b896e0",
        "#e57f88",
        "#bfae94",
        "#5cc3d3",
        "#e596c6",
        "#c3c25c",
        "#a3b1c6",
    ),
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


def names(trials: Sequence[TrialResult]) -> tuple[list[str], list[str]]:
    """Scenarios and methods in the order in which they are drawn."""
    return sorted({t.scenario for t in trials}), list(dict.fromkeys(t.method for t in trials))


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


def panels(theme: Theme, height: float = 3.8, rows: int = 1) -> tuple[Figure, Any]:
    """A figure with the two errors beside each other, or one over the other.

    Args:
        theme: Colours.
        height: Inches; 12 are its width.
        rows: 1 for panels beside each other, 2 for one over the other.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(12.0, height), dpi=130)
    figure.patch.set_facecolor(theme.background)
    margin = 0.76 / height  # of title and legend
    figure.subplots_adjust(
        left=0.06, right=0.985, top=1 - 0.65 * margin, bottom=margin, wspace=0.16, hspace=0.42
    )
    return figure, figure.subplots(rows, 2 // rows)


def titled(axes: Axes, text: str, theme: Theme) -> None:
    """Plain axes under a title."""
    axes.set_title(text, loc="left", size=10.5, color=theme.ink, pad=10)
    plain_axes(axes, theme)
    axes.tick_params(axis="x", length=3, labelsize=9)
    axes.tick_params(axis="x", which="minor", length=1.5, width=0.5)


def error_axis(
    axes: Axes, trials: Sequence[TrialResult], quantity: Quantity
) -> tuple[float, float]:
    """A logarithmic vertical axis of errors; its ends, where what is beyond them is drawn."""
    low, high = axis_limits(trials, quantity)
    low, high = low / 1.8, high * 1.3
    axes.set_yscale("log")
    axes.set_ylim(low, high * 1.15)
    label_ticks(axes, axes.yaxis)
    return low, high


def method_legend(
    figure: Figure, methods: Sequence[str], theme: Theme, *, sigma_known: bool = False
) -> None:
    """Colours of the methods, the limit of success, the ground truth's band."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    handles: list[Any] = [
        Line2D([], [], color=theme.method(j), lw=2, label=m) for j, m in enumerate(methods)
    ]
    if sigma_known:
        handles.append(
            Patch(facecolor=theme.band, label="ground truth's own uncertainty (1 sigma)")
        )
    handles.append(Line2D([], [], color=theme.muted, lw=0.9, ls=DASHED, label="success below"))
    bottom_legend(figure, handles, theme)


def bottom_legend(figure: Figure, handles: Sequence[Any], theme: Theme) -> None:
    """A legend under the panels, in as few lines as there is room for."""
    letters = sum(len(handle.get_label()) + HANDLE for handle in handles)
    lines = -(-letters // LINE)
    figure.legend(
        handles=handles,
        loc="lower center",
        ncols=-(-len(handles) // lines),
        frameon=False,
        fontsize=9,
        labelcolor=theme.ink,
        handlelength=1.8,
        columnspacing=1.8,
    )


def columns(axes: Axes, x: Array, bottom: Array, top: Array, width: float, colour: str) -> None:
    """Filled columns, one shape for all of them: a bar each is slow to draw of hundreds.

    Args:
        axes: Where.
        x: (N,) their middles.
        bottom: (N,) lower ends.
        top: (N,) upper ends.
        width: Of each.
        colour: Of all.
    """
    from matplotlib.collections import PolyCollection

    left, right = x - width / 2, x + width / 2
    corners = [(left, bottom), (left, top), (right, top), (right, bottom)]
    shapes = np.stack([np.stack(corner, axis=-1) for corner in corners], axis=1)
    axes.add_collection(PolyCollection(list(shapes), facecolors=colour, lw=0, zorder=0))


def errors_of(trials: Sequence[TrialResult], quantity: Quantity) -> Array:
    """(N,) errors, infinite without an estimate."""
    errors = np.array([getattr(t, quantity.error) for t in trials], float)
    return np.where(np.isfinite(errors), errors, np.inf)


def sigma_of(trials: Sequence[TrialResult], quantity: Quantity) -> float:
    """The ground truth's own uncertainty, root mean square; NaN where unknown."""
    return metrics.rms([getattr(t, quantity.sigma) for t in trials])


def png(figure: Figure) -> bytes:
    """A figure as a PNG file with a palette: a third of the size, for few colours are in it."""
    from PIL import Image

    drawn = io.BytesIO()
    figure.savefig(drawn, format="raw")
    width, height = figure.canvas.get_width_height()
    rgba = np.frombuffer(drawn.getvalue(), np.uint8).reshape(height, width, 4)
    out = io.BytesIO()
    full = Image.fromarray(np.ascontiguousarray(rgba[..., :3]))
    full.quantize(PALETTE, dither=Image.Dither.NONE).save(out, format="png", optimize=True)
    return out.getvalue()
