"""What a pixel looks like, in 32 labels: k-means of lightness, colour and gradients."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numba import njit
from numpy.typing import NDArray

from lcdata.features.nid_views import equalised

Floats = NDArray[np.float32]
Bytes = NDArray[np.uint8]
Halves = NDArray[np.float16]

LABELS = 32

LEVELS = ((0.0083, 4), (0.0021, 2))
"""Blur (radians) and pixels a cell of each level, coarse first: 6 and 1.5 px at 720 px."""

LIGHTNESS, GRADIENT = 5.1, 0.7
"""What the rank of lightness and the gradients count beside colour."""

TRAINING = 20_000
"""Cells of all frames together that the labels are learned from."""

ROUNDS = 12


def descriptors(image: Bytes, focal: float) -> list[Halves]:
    """What each cell of an image looks like, for each of `LEVELS`.

    Args:
        image: (H, W) or (H, W, 3) uint8 RGB.
        focal: Pixels a radian.

    Returns:
        (h, w, 5) float16: rank of lightness, a, b, and logarithms of the gradient across and
        down, all but the first of mean 0 and deviation 1, weighted.
    """
    import cv2

    colour = image if image.ndim == 3 else np.repeat(image[..., None], 3, axis=2)
    lab = cv2.cvtColor(colour.astype(np.float32) * np.float32(1 / 255), cv2.COLOR_RGB2LAB)
    result = []
    for blur, stride in LEVELS:
        sigma = blur * focal
        smooth = cv2.GaussianBlur(lab, (0, 0), sigma)
        light = np.ascontiguousarray(smooth[..., 0])
        wide = 1.5 * max(sigma, 2.0)
        layers = [smooth[stride // 2 :: stride, stride // 2 :: stride]]
        for dx in (1, 0):
            slope = np.abs(cv2.Sobel(light, cv2.CV_32F, dx, 1 - dx, scale=0.125))
            slope = cv2.GaussianBlur(slope, (0, 0), wide)
            layers.append(slope[stride // 2 :: stride, stride // 2 :: stride, None])
        cells = np.concatenate(layers, axis=2)
        # Gradients are small against their own mean where nothing is, whatever the contrast.
        cells[..., 3:] = np.log1p(cells[..., 3:] / max(float(cells[..., 3:].mean()), 1e-6) * 2.0)
        cells[..., 0] = LIGHTNESS * equalised(cells[..., 0])
        rest = cells[..., 1:].reshape(-1, 4)
        rest = (rest - rest.mean(axis=0)) / np.maximum(rest.std(axis=0), 1e-3)
        rest *= np.array([1.0, 1.0, GRADIENT, GRADIENT], np.float32)
        cells[..., 1:] = rest.reshape(*cells.shape[:2], 4)
        result.append(cells.astype(np.float16))
    return result


def label_maps(frames: Sequence[Halves], rng: np.random.Generator) -> list[Bytes]:
    """Labels of the cells of all frames, learned from all of them.

    Args:
        frames: (h, w, 5) descriptors of one level of each frame.
        rng: Of the cells that are learned from.

    Returns:
        (h + 2, w + 2) of each frame, below `LABELS`; the border is `LABELS`.
    """
    share = TRAINING / max(sum(f.shape[0] * f.shape[1] for f in frames), 1)
    training = []
    for frame in frames:
        cells = frame.reshape(-1, frame.shape[2])
        count = min(len(cells), max(1, round(share * len(cells))))
        training.append(cells[rng.choice(len(cells), count, replace=False)])
    centres = k_means(np.concatenate(training).astype(np.float32), LABELS, rng)
    result = []
    for frame in frames:
        height, width = frame.shape[:2]
        padded = np.full((height + 2, width + 2), LABELS, np.uint8)
        cells = np.ascontiguousarray(frame.reshape(height * width, -1).T, np.float32)
        padded[1:-1, 1:-1] = nearest(cells, centres).reshape(height, width)
        result.append(padded)
    return result


def k_means(values: Floats, number: int, rng: np.random.Generator) -> Floats:
    """Centres of clusters: k-means++ (Arthur and Vassilvitskii 2007), then Lloyd's rounds.

    Args:
        values: (N, D).
        number: Of clusters, at most.
        rng: Of the first centres.

    Returns:
        (K, D) float32.
    """
    centres = np.empty((number, values.shape[1]), np.float32)
    centres[0] = values[rng.integers(len(values))]
    gap = ((values - centres[0]) ** 2).sum(axis=1)
    for k in range(1, number):
        total = float(gap.sum())
        if total <= 0.0:
            return np.ascontiguousarray(centres[:k])
        place = int(np.searchsorted(np.cumsum(gap, dtype=float), rng.random() * total))
        centres[k] = values[min(place, len(values) - 1)]
        gap = np.minimum(gap, ((values - centres[k]) ** 2).sum(axis=1))
    columns = np.ascontiguousarray(values.T)
    for _ in range(ROUNDS):
        owner = nearest(columns, centres)
        size = np.bincount(owner, minlength=number)
        for d in range(values.shape[1]):
            mean = np.bincount(owner, values[:, d], minlength=number) / np.maximum(size, 1)
            centres[:, d] = np.where(size > 0, mean, centres[:, d])
    return centres


@njit(cache=True, nogil=True, fastmath=True)
def nearest(values, centres):  # type: ignore[no-untyped-def]
    """Nearest centre of each of (D, N) values: (N,) uint8."""
    dimensions, number = values.shape
    result = np.empty(number, np.uint8)
    block = 512
    gap = np.empty(block, np.float32)
    best = np.empty(block, np.float32)
    owner = np.empty(block, np.int32)
    for start in range(0, number, block):
        n = min(block, number - start)
        best[:] = np.float32(np.inf)
        owner[:] = 0
        for k in range(centres.shape[0]):
            gap[:] = np.float32(0.0)
            for d in range(dimensions):
                c = centres[k, d]
                for i in range(n):
                    e = values[d, start + i] - c
                    gap[i] += e * e
            for i in range(n):
                closer = gap[i] < best[i]
                best[i] = gap[i] if closer else best[i]
                owner[i] = k if closer else owner[i]
        for i in range(n):
            result[start + i] = owner[i]
    return result
