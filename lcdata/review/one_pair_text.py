"""What the review of one pair says beside its pictures."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lcdata.features.nid_landscape import Landscape
from lcdata.review import names

UNITS = np.array([1e3, 1e3, 1e3, *[180 / np.pi] * 3])


def landscape_text(landscape: Landscape | None, middle: str, reason: str) -> str:
    """Markdown tables of a landscape, or why there is none.

    Args:
        landscape: Slices through the poses; None if there is none.
        middle: Name of the pose in the middle.
        reason: Why there is none.
    """
    if landscape is None:
        return f"**No NID landscape**: {reason}.\n"
    cost = "NID / 0.01 + edges / 0.05" if landscape.with_edges else "NID"
    head = f"| pose | {cost} | x, y, z (mm) | about x, y, z (deg) |\n|---|---|---|---|"
    where, lowest = [head], [head.replace("pose", "lines through")]
    for name, one in landscape.slices.items():
        where.append(_row(name, f"{one.cost:.4f}", one.at))
        lowest.append(_row(name, f"{one.soft.min():.4f}", landscape.lowest(name)))
    return "\n\n".join(
        [
            f"## NID landscape\n\nWhere the poses are, from {names.title(middle)}, in the camera "
            "frame (x to the right, y downwards, z forward):",
            "\n".join(where),
            "Where the line along each axis through a pose is lowest:",
            "\n".join(lowest) + "\n",
        ]
    )


def reading_text(*, has_intensity: bool) -> str:
    """Markdown on how to look at it."""
    what = "intensities" if has_intensity else "**ranges, for the cloud has no intensities**"
    return f"""
## How to look at it

- The tabs change the pose. Dark points of a cloud are those that the camera does not see.
- The timeline `{names.BLEND}` goes from the image (0) to the LiDAR (100): drag it, or press space.
  The LiDAR's picture shows {what}, each grey as often as any other.
- Each line of the landscape varies one coordinate of a pose and keeps the other five. The dot on
  it is the pose; small dots count with hard bins. What is hidden was decided in the middle.
"""


def _row(name: str, cost: str, at: NDArray[np.float64]) -> str:
    values = np.round(at * UNITS, 2) + 0.0  # no negative zeros
    translation = ", ".join(f"{round(v) + 0:+d}" for v in values[:3])
    rotation = ", ".join(f"{v:+.2f}" for v in values[3:])
    return f"| {names.title(name)} | {cost} | {translation} | {rotation} |"
