"""Where an edge of an image truly is, to a fraction of a pixel.

A lens blurs light; the camera then stores about the 2.2nd root of it. After that root the steepest
place of a blurred edge lies on its dark side: by 0.15 to 0.4 px at strong contrast, the same in
every image, so that no number of images averages it out. The middle of the step in light is the
edge.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

GAMMA = 2.2
"""Exponent from pixel values to light."""

STATIONS = 16
"""Profiles across a line, averaged by halves of it."""

REACH, STEP = 2.5, 0.25
"""Half length of a profile and its spacing, pixels."""

WINDOW = 1.5
"""Half width of what belongs to the edge, pixels; other edges may be near."""

LIMIT = 1.0
"""Largest shift of a line, pixels."""

TURNS = 4
"""Of the window towards the edge."""


def centre_lines(lines: Array, image: NDArray[Any]) -> Array:
    """Shift and turn lines onto the middles of their edges' steps in light.

    Args:
        lines: (M, 4) x1 y1 x2 y2 in pixels, within a pixel of edges.
        image: (H, W) uint8.

    Returns:
        (M, 4) the same lines, moved across themselves.
    """
    import cv2

    if not len(lines):
        return lines
    ends = lines.reshape(-1, 2, 2)
    delta = ends[:, 1] - ends[:, 0]
    normal = np.stack([-delta[:, 1], delta[:, 0]], 1)
    normal /= np.maximum(np.linalg.norm(delta, axis=1, keepdims=True), 1e-9)
    along = (np.arange(STATIONS) + 0.5) / STATIONS
    across = np.arange(-REACH, REACH + STEP / 2, STEP)
    place = (
        ends[:, 0, None, None]
        + along[:, None, None] * delta[:, None, None]
        + across[:, None] * normal[:, None, None]
    ).astype(np.float32)
    # One row of the map a line: OpenCV's maps are limited to 32767 rows and columns.
    place = place.reshape(len(lines), -1, 2)
    light = ((np.arange(256) / 255.0) ** GAMMA).astype(np.float32)[image]
    profiles = np.concatenate(
        [
            cv2.remap(light, rows, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
            for rows in np.array_split(place, len(place) // 8192 + 1)
        ]
    )
    profiles = profiles.reshape(len(lines), 2, STATIONS // 2, len(across)).mean(axis=2)
    slope, where = np.diff(profiles, axis=2), 0.5 * (across[1:] + across[:-1])
    rising = np.sign(slope[..., np.abs(where) < 1.0].sum(axis=(1, 2)))
    slope = np.maximum(slope * rising[:, None, None], 0.0)
    shift = np.zeros((len(lines), 2))
    for _ in range(TURNS):
        weight = slope * (np.abs(where - shift[..., None]) < WINDOW)
        total = weight.sum(axis=2)
        middle = (weight * where).sum(axis=2) / np.maximum(total, 1e-12)
        shift = np.clip(np.where(total > 1e-12, middle, shift), -LIMIT, LIMIT)
    # The halves' middles are a quarter from the ends.
    tilt = 0.5 * (shift[:, 1] - shift[:, 0])
    at_ends = np.stack([shift[:, 0] - tilt, shift[:, 1] + tilt], 1)
    return np.asarray((ends + at_ends[..., None] * normal[:, None]).reshape(-1, 4))
