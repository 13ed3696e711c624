"""How well a pose makes a cloud's intensities go with an image's: a witness besides edges."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from lcdata.features.lidar_view import usable_points
from lcdata.geometry import se3
from lcdata.pair import Pair

Array = NDArray[np.float64]

BINS = 12
POINTS = 15_000
FEWEST = 500
"""Points in view, below which there is no telling."""

BLUR = 0.004
"""Smoothing of the image, radians: about what a LiDAR's beam covers."""


def intensity_agreement(pair: Pair, poses: Array) -> Array:
    """Normalised mutual information of intensity and grey value under poses.

    Ranks, so that neither unit nor exposure matters; less what chance gives; times the root of
    the share of points in view, so that few points do not win by luck. Occlusion is ignored.

    Args:
        pair: Its intensity may be None: then nothing agrees.
        poses: (P, 4, 4) `T_camera_lidar`.

    Returns:
        (P,) per cent: 2 to 10 of right poses of simulated pairs, 0 to 5 of wrong ones.
    """
    import cv2

    result = np.zeros(len(poses))
    rows = np.flatnonzero(usable_points(pair.points))
    if pair.intensity is None or len(rows) < FEWEST:
        return result
    rows = np.random.default_rng(0).choice(rows, min(POINTS, len(rows)), replace=False)
    points, intensity = np.asarray(pair.points[rows], float), pair.intensity[rows]
    grey = pair.image if pair.image.ndim == 2 else cv2.cvtColor(pair.image, cv2.COLOR_RGB2GRAY)
    grey = cv2.GaussianBlur(grey, (0, 0), max(0.5, BLUR * pair.camera.pixels_per_radian[0]))
    for k, T in enumerate(poses):
        pixels, inside = pair.camera.project(se3.apply(T, points))
        count = int(inside.sum())
        if count < FEWEST:
            continue
        u, v = np.rint(pixels[inside]).astype(np.int64).T
        joint = np.zeros((BINS, BINS))
        columns, lines = np.clip(u, 0, grey.shape[1] - 1), np.clip(v, 0, grey.shape[0] - 1)
        np.add.at(joint, (_ranked(intensity[inside]), _ranked(grey[lines, columns])), 1.0)
        chance = (BINS - 1) ** 2 / (2 * count)
        entropy, information = _entropy_and_information(joint / count)
        share = count / len(rows)
        result[k] = 100.0 * max(0.0, information - chance) / max(entropy, 1e-9) * np.sqrt(share)
    return result


def _ranked(values: NDArray[Any]) -> NDArray[np.int64]:
    """Bin of the rank of each value; equal values have one bin."""
    ordered = np.sort(values)
    rank = np.searchsorted(ordered, values, "left") + np.searchsorted(ordered, values, "right")
    return np.asarray(np.minimum(rank * BINS // (2 * len(values)), BINS - 1), np.int64)


def _entropy_and_information(joint: Array) -> tuple[float, float]:
    """Of a joint distribution, nats."""
    full = joint > 0
    independent = np.outer(joint.sum(1), joint.sum(0))[full]
    log = np.log(joint[full])
    entropy = -float((joint[full] * log).sum())
    return entropy, float((joint[full] * (log - np.log(independent))).sum())
