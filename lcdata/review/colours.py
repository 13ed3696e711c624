"""Colours of methods, depths and intensities, chosen to be told apart on a dark background."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lcdata.review.names import GROUND_TRUTH, INITIAL

RGB = tuple[int, int, int]

GREEN: RGB = (64, 214, 120)
GREY: RGB = (176, 180, 188)
RED: RGB = (235, 72, 72)

# The IBM palette for colour-blind readers, continued; green and grey are taken.
_METHODS: tuple[RGB, ...] = (
    (255, 150, 40),
    (110, 160, 255),
    (240, 80, 170),
    (170, 130, 255),
    (80, 220, 220),
    (225, 225, 90),
)


SIDES: tuple[RGB, RGB] = ((255, 150, 40), (90, 170, 255))
"""Of the two sides of a comparison."""


def of_sources(methods: Sequence[str]) -> dict[str, RGB]:
    """One colour each for the initial guess, the ground truth and the methods."""
    colours = {INITIAL: GREY, GROUND_TRUTH: GREEN}
    return colours | {m: _METHODS[i % len(_METHODS)] for i, m in enumerate(methods)}


def of_sides(pairs: Sequence[tuple[str, str]]) -> dict[str, RGB]:
    """Colours of what is compared two by two: a method's own, that of its A darker."""
    if len(pairs) == 1:
        return dict(zip(pairs[0], SIDES, strict=True))
    found = {}
    for number, (a, b) in enumerate(pairs):
        red, green, blue = _METHODS[number % len(_METHODS)]
        found[b] = red, green, blue
        found[a] = int(0.55 * red), int(0.55 * green), int(0.55 * blue)
    return found


@cache
def _palette(name: str) -> NDArray[np.uint32]:
    """(256,) packed RGBA of an OpenCV colour map."""
    import cv2

    ramp = np.arange(256, dtype=np.uint8)
    bgr = cv2.applyColorMap(ramp, getattr(cv2, f"COLORMAP_{name}"))[:, 0].astype(np.uint32)
    return np.asarray((bgr[:, 2] << 24) | (bgr[:, 1] << 16) | (bgr[:, 0] << 8) | 255, np.uint32)


def by_depth(depths: NDArray[Any], span: tuple[float, float]) -> NDArray[np.uint32]:
    """Packed RGBA of depths: near is red, far is blue, on a logarithmic scale.

    Args:
        depths: (N,) metres.
        span: Depths in metres of the two ends of the scale.
    """
    near, far = np.log(span)
    with np.errstate(divide="ignore", invalid="ignore"):
        share = (far - np.log(depths)) / max(far - near, 1e-6)
    return _palette("TURBO")[_index(0.1 + 0.86 * np.clip(share, 0, 1))]  # its ends are too dark


def by_intensity(intensity: NDArray[Any]) -> NDArray[np.uint32]:
    """Packed RGBA of (N,) intensities in any unit, scaled to their own 2 % and 98 % quantiles."""
    finite = intensity[np.isfinite(intensity)]
    low, high = np.quantile(finite, [0.02, 0.98]) if finite.size else (0.0, 1.0)
    # The square root brings out what is dark, which is most of an outdoor scan.
    share = np.sqrt(np.clip((intensity - low) / max(high - low, 1e-9), 0, 1))
    return _palette("VIRIDIS")[_index(0.15 + 0.85 * share)]


def _index(share: NDArray[Any]) -> NDArray[np.uint8]:
    index: NDArray[np.uint8] = (np.nan_to_num(np.clip(share, 0, 1)) * 255).astype(np.uint8)
    return index
