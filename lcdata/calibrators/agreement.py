"""Protocol of the verdicts: how a minimum is asked whether it can be trusted.

What is minimised differs from method to method, the questions do not: does the minimum stand out
from the poses around, do disjoint halves of the data come to it from elsewhere, and did the search
stay where it was told to look.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from lcdata.features.chamfer_search import displaced
from lcdata.geometry import se3

Array = NDArray[np.float64]

AGREE_M, AGREE_RAD = 0.1, np.deg2rad(0.5)
"""Halves of the data must come to poses this close, as far as a success may be off."""

MIN_CONTRAST = 3.0
"""Least depth of the minimum under the mean of poses around, in their standard deviations."""

REACH = 1.5
"""Largest correction of the initial guess on one axis, in half-widths of the box."""


def depth_and_contrast(costs: Array, fewest: int = 2) -> tuple[float, float]:
    """Depth of a minimum under the mean of poses around, and over their standard deviation.

    Args:
        costs: (1 + N,) of the minimum, then of the poses around; those not finite do not count.
        fewest: Poses around that must count.

    Returns:
        Zeros where it cannot be told.
    """
    rest = costs[1:][np.isfinite(costs[1:])]
    if len(rest) < fewest or not np.isfinite(costs[0]):
        return 0.0, 0.0
    depth = float(rest.mean() - costs[0])
    return depth, depth / max(float(rest.std()), 1e-12)


def contrast_doubts(contrast: float) -> list[str]:
    """What is doubtful about a minimum that does not stand out."""
    if contrast >= MIN_CONTRAST:
        return []
    return [f"poses around fit nearly as well (contrast {contrast:.1f})"]


def box_doubts(T: Array, T_initial: Array, box: Array) -> list[str]:
    """What is doubtful about an estimate far from its guess.

    Args:
        T: 4x4 estimate.
        T_initial: 4x4 initial guess.
        box: (6,) half-widths of the search, metres then radians.
    """
    turned = np.abs(se3.log(T @ se3.inverse(T_initial))[3:]) / box[3:]
    moved = np.abs((T - T_initial)[:3, 3]) / box[:3]
    return ["the estimate left the box of the search"] if max(*turned, *moved) > REACH else []


def halves_apart(
    search: Callable[[int, Array], Array],
    T: Array,
    box: Array,
    share: float,
    rng: np.random.Generator,
) -> tuple[float, float]:
    """How far halves of the data, each searched from elsewhere, come from each other and from T.

    Args:
        search: From the half's number, 0 or 1, and a 4x4 start to its 4x4 minimum.
        T: 4x4 minimum of all data.
        box: (6,) half-widths of the search, metres then radians.
        share: Of the box, in which the halves start.
        rng: Of the starts.

    Returns:
        Metres and radians, the largest.
    """
    poses = [T]
    width = np.concatenate([box[3:], box[:3]])
    for half in (0, 1):
        start = displaced(T, rng.uniform(-share, share, (1, 6)) * width)[0]
        poses.append(search(half, start))
    apart = [
        (se3.translation_error(a, b), se3.rotation_error(a, b))
        for i, a in enumerate(poses)
        for b in poses[:i]
    ]
    return max(metres for metres, _ in apart), max(radians for _, radians in apart)


def halves_doubts(
    apart: tuple[float, float], pairs: int, metres: float = AGREE_M, radians: float = AGREE_RAD
) -> list[str]:
    """What is doubtful about halves that disagree.

    Args:
        apart: See `halves_apart`.
        pairs: How many there are: of one, its image was halved.
        metres: Largest distance.
        radians: Largest angle.
    """
    if apart[0] <= metres and apart[1] <= radians:
        return []
    what = "halves of the pairs" if pairs > 1 else "halves of the image"
    return [f"{what} disagree by {np.rad2deg(apart[1]):.2g} deg, {apart[0]:.2g} m"]
