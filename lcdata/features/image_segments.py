"""Segments of an image without a learned model: regions of like colour, on several scales.

Felzenszwalb and Huttenlocher, *Efficient Graph-Based Image Segmentation*, IJCV 2004: pixels are
the nodes of a graph, and two components join along the weakest edge between them unless that edge
is strong for either of them: w <= min(Int(A) + k / |A|, Int(B) + k / |B|). A large k gives large
segments. Several k share the sorted edges.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from lcdata.features.compiled import compiled

Labels = NDArray[np.int32]
Floats = NDArray[np.float32]

SCALES = (150.0, 600.0)
"""k of each scale, in CIELAB units times pixels."""

SMALLEST = 40
"""Pixels of a segment; smaller ones join their most similar neighbour."""

SMOOTHING = 0.8
"""Standard deviation of the blur before, pixels."""

WEIGHT_STEP = 0.02
"""Edge weights are sorted by so many CIELAB units."""


def segment_scales(
    image: NDArray[np.uint8], scales: Sequence[float] = SCALES, smallest: int = SMALLEST
) -> list[Labels]:
    """Partition an image on several scales.

    Args:
        image: (H, W) or (H, W, 3) uint8 RGB.
        scales: k of each.
        smallest: Pixels of the smallest segment.

    Returns:
        For each scale (H, W) int32 labels 0, 1, ..; every pixel belongs to one segment, and every
        segment is connected.
    """
    colour = _lab(image)
    height, width = colour.shape[:2]
    weights = _edge_weights(colour)
    quantised = np.minimum(weights / WEIGHT_STEP, 65535).astype(np.uint16)
    order = np.argsort(quantised, kind="stable")  # a radix sort
    result = []
    for k in scales:
        labels = _components(order, weights, height, width, np.float32(k), smallest)
        result.append(labels.reshape(height, width))
    return result


def _lab(image: NDArray[np.uint8]) -> Floats:
    """(H, W, 3) float32 CIELAB, blurred a little; lightness alone for grey images."""
    import cv2

    if image.ndim == 2:
        image = np.repeat(image[:, :, None], 3, axis=2)
    smooth = cv2.GaussianBlur(image.astype(np.float32) / 255, (0, 0), SMOOTHING)
    return np.ascontiguousarray(cv2.cvtColor(smooth, cv2.COLOR_RGB2LAB), np.float32)


def _edge_weights(colour: Floats) -> Floats:
    """Colour differences of each pixel to the right, then of each to the one below.

    Returns:
        (2 H W,) float32; infinite where there is no neighbour.
    """
    height, width = colour.shape[:2]
    weights = np.full((2, height, width), np.inf, np.float32)
    weights[0, :, :-1] = np.linalg.norm(np.diff(colour, axis=1), axis=2)
    weights[1, :-1] = np.linalg.norm(np.diff(colour, axis=0), axis=2)
    return weights.reshape(-1)


@compiled
def _root(parent: Any, i: int) -> int:
    while parent[i] != i:
        parent[i] = parent[parent[i]]
        i = parent[i]
    return i


@njit(cache=True, nogil=True)
def _components(order, weights, height, width, k, smallest):  # type: ignore[no-untyped-def]
    """Join pixels along sorted edges; see the module. Returns (H W,) labels."""
    n = height * width
    parent = np.arange(n).astype(np.int32)
    size = np.ones(n, np.int32)
    allowed = np.full(n, k, np.float32)
    for large_only in (False, True):
        for edge in order:
            w = weights[edge]
            if not np.isfinite(w):
                continue
            i = edge if edge < n else edge - n
            a = _root(parent, i)
            b = _root(parent, i + 1 if edge < n else i + width)
            if a == b:
                continue
            if large_only:
                if size[a] >= smallest and size[b] >= smallest:
                    continue
            elif w > allowed[a] or w > allowed[b]:
                continue
            if size[a] < size[b]:
                a, b = b, a
            parent[b] = a
            size[a] += size[b]
            allowed[a] = w + k / size[a]
    labels = np.empty(n, np.int32)
    number = np.full(n, -1, np.int32)
    count = 0
    for i in range(n):
        a = _root(parent, i)
        if number[a] < 0:
            number[a] = count
            count += 1
        labels[i] = number[a]
    return labels
