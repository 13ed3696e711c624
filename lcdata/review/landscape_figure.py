"""A drawing of slices of the NID: one panel an axis, with the poses marked."""

from __future__ import annotations

import io
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from lcdata.features.nid_landscape import Landscape
from lcdata.review import colours, names

if TYPE_CHECKING:
    from matplotlib.axes import Axes

INK, MUTED, GROUND, PANEL = "#e6e4df", "#8f949c", "#17191c", "#1f2226"
PANELS = (
    ("x, to the right", "m", 1.0),
    ("y, downwards", "m", 1.0),
    ("z, forward", "m", 1.0),
    ("about x, pitch", "deg", 180 / np.pi),
    ("about y, yaw", "deg", 180 / np.pi),
    ("about z, roll", "deg", 180 / np.pi),
)
"""Title, unit and factor to it of each axis, in the camera frame."""

BOLD, THIN = 2.2, 1.2
SIZE_PX = 1755, 780
DPI = 130


def draw(landscape: Landscape, middle: str, palette: Mapping[str, colours.RGB]) -> bytes:
    """Draw a landscape, on the viewer's dark ground.

    Args:
        landscape: Slices through the poses that are to be shown.
        middle: Name of the pose in the middle, whose slices stand out.
        palette: A colour for each pose.

    Returns:
        A PNG file.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(SIZE_PX[0] / DPI, SIZE_PX[1] / DPI), dpi=DPI)
    figure.patch.set_facecolor(GROUND)
    grid = figure.subplots(2, 3, sharey=True)
    for axis, axes in enumerate(grid.flat):
        _panel(axes, axis, landscape, middle, palette)
    label = "NID / 0.01 + edges / 0.05" if landscape.with_edges else "NID"
    for axes in grid[:, 0]:
        axes.set_ylabel(label, color=INK)
    handles, labels = grid[0, 0].get_legend_handles_labels()
    figure.legend(
        handles, labels, loc="upper center", ncols=len(labels), frameon=False, labelcolor=INK
    )
    figure.subplots_adjust(0.065, 0.085, 0.99, 0.88, hspace=0.42, wspace=0.06)
    file = io.BytesIO()
    figure.savefig(file, facecolor=GROUND)
    return file.getvalue()


def _panel(
    axes: Axes,
    axis: int,
    landscape: Landscape,
    middle: str,
    palette: Mapping[str, colours.RGB],
) -> None:
    from matplotlib.ticker import MaxNLocator

    title, unit, factor = PANELS[axis]
    x = landscape.offsets[axis] * factor
    axes.set_facecolor(PANEL)
    axes.set_title(title, color=INK, fontsize=11, loc="left")
    axes.set_xlabel(f"{unit} from {names.title(middle)}", color=MUTED, fontsize=9, labelpad=2)
    axes.set_xlim(x[0], x[-1])
    axes.xaxis.set_major_locator(MaxNLocator(5, steps=[1, 2, 5, 10], prune="both"))
    axes.tick_params(colors=MUTED, labelsize=9)
    axes.grid(color="#2d3035", linewidth=0.7)
    for spine in axes.spines.values():
        spine.set_visible(False)
    hard = landscape.slices[middle].hard[axis]
    kept = np.isfinite(hard)
    axes.plot(x[kept], hard[kept], ".", color=MUTED, markersize=2.5, label="hard bins")
    ordered = sorted(landscape.slices.items(), key=lambda item: item[0] == middle)
    for row, (name, one) in enumerate(ordered):
        colour = tuple(c / 255 for c in palette[name])
        own = name == middle
        axes.plot(
            x,
            one.soft[axis],
            color=colour,
            linewidth=BOLD if own else THIN,
            label=f"through {names.title(name)}",
        )
        at = one.at[axis] * factor
        if x[0] <= at <= x[-1]:
            axes.axvline(at, color=colour, linewidth=1.0, linestyle=(0, (4, 3)))
            axes.plot([at], [one.cost], "o", color=colour, markersize=6.5, zorder=5)
        else:  # beyond the border: an arrow, and how far
            side = 1.0 if at > 0 else 0.0
            axes.annotate(
                f"{at:+.2g} {unit} →" if side else f"← {at:+.2g} {unit}",
                (side, 0.96 - 0.1 * row),
                xycoords="axes fraction",
                ha="right" if side else "left",
                va="top",
                color=colour,
                fontsize=9,
                bbox={"facecolor": PANEL, "edgecolor": "none", "pad": 1.5},
            )
