"""Line segments of an undistorted image: LSD, merged and filtered as in PLK-Calib, section V."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from lcdata.features.edge_centres import centre_lines

Array = NDArray[np.float64]

LSD_OFFSET = 0.125
"""OpenCV's LSD works on an image scaled by 0.8 and forgets half a pixel of it: (1/0.8 - 1)/2."""

PAPER_WIDTH = 1280
"""Image width that the paper's thresholds in pixels belong to."""


def extract_image_lines(
    image: NDArray[Any],
    *,
    valid: NDArray[np.bool_] | None = None,
    join_distance: float = 5.0,
    join_angle_deg: float = 2.0,
    join_offset: float = 2.0,
    min_length: float = 20.0,
) -> Array:
    """Detect straight edges.

    Two segments are joined when end points are closer than `join_distance`, directions differ by
    less than `join_angle_deg` and the shorter one's ends lie within `join_offset` of the longer
    one's line; the last is ours: without it neighbours on parallel edges melt together.

    Args:
        image: (H, W) or (H, W, 3 as RGB) uint8, undistorted.
        valid: (H, W) False where undistortion found no pixel; lines on its border are dropped.
        join_distance: Pixels at an image width of 1280, like all lengths here.
        join_angle_deg: Degrees.
        join_offset: Pixels.
        min_length: Shorter segments are dropped, pixels.

    Returns:
        (M, 4) x1 y1 x2 y2 in pixels, longest first; pixel centres have integer coordinates. The
        brighter side is the same for all directed segments, so opposite edges of a thin thing
        have opposite directions.
    """
    import cv2

    if image.ndim == 3:
        image = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
    if min(image.shape) < 8:
        return np.zeros((0, 4))
    found = cv2.createLineSegmentDetector(cv2.LSD_REFINE_STD).detect(np.ascontiguousarray(image))[0]
    if found is None:
        return np.zeros((0, 4))
    found = found.reshape(-1, 4).astype(float) + LSD_OFFSET
    if valid is not None and not valid.all():
        inside = cv2.erode(valid.astype(np.uint8), np.ones((7, 7), np.uint8))
        middle = np.rint(found.reshape(-1, 2, 2).mean(1)).astype(int)
        x, y = np.clip(middle, 0, [image.shape[1] - 1, image.shape[0] - 1]).T
        found = found[inside[y, x] > 0]
    scale = image.shape[1] / PAPER_WIDTH
    lines = merge_lines(
        found,
        join_distance * scale,
        np.deg2rad(join_angle_deg),
        join_offset * scale,
    )
    length = np.hypot(lines[:, 2] - lines[:, 0], lines[:, 3] - lines[:, 1])
    order = np.argsort(-length, kind="stable")
    return centre_lines(lines[order[length[order] >= min_length * scale]], image)


def merge_lines(lines: Array, distance: float, angle: float, offset: float) -> Array:
    """Join collinear neighbours until none is left.

    Args:
        lines: (M, 4) directed segments.
        distance: Largest gap between end points, in the unit of `lines`.
        angle: Largest difference of direction, radians.
        offset: Largest distance of the shorter segment's ends from the longer one's line.

    Returns:
        (M', 4) segments with M' <= M.
    """
    from scipy.spatial import cKDTree

    while len(lines) > 1:
        ends = lines.reshape(-1, 2)
        delta = lines[:, 2:] - lines[:, :2]
        length = np.maximum(np.hypot(delta[:, 0], delta[:, 1]), 1e-9)
        direction = delta / length[:, None]
        pairs = np.unique(cKDTree(ends).query_pairs(distance, output_type="ndarray") // 2, axis=0)
        first, second = pairs.T
        long_first = length[first] >= length[second]
        longer, shorter = np.where(long_first, first, second), np.where(long_first, second, first)
        cosine = np.einsum("nc,nc->n", direction[longer], direction[shorter])
        normal = np.stack([-direction[longer, 1], direction[longer, 0]], 1)
        away = np.einsum(
            "nkc,nc->nk",
            lines[shorter].reshape(-1, 2, 2) - lines[longer, None, :2],
            normal,
        )
        good = (longer != shorter) & (cosine > np.cos(angle)) & (np.abs(away).max(1) <= offset)
        longer, shorter = longer[good], shorter[good]
        if not len(longer):
            break
        order = np.lexsort((shorter, longer, -length[shorter], -length[longer]))
        taken = np.zeros(len(lines), bool)
        joined = []
        for i, j in zip(longer[order].tolist(), shorter[order].tolist(), strict=True):
            if not (taken[i] or taken[j]):
                taken[i] = taken[j] = True
                joined.append((i, j))
        chosen = np.array(joined)
        lines = np.concatenate([lines[~taken], _join(lines[chosen], length[chosen])])
    return lines


def _join(groups: Array, length: Array) -> Array:
    """One segment for each (2, 4) pair of segments: mean line by length, extreme ends."""
    points = groups.reshape(-1, 2, 2, 2)
    weight = length / length.sum(1, keepdims=True)
    centre = np.einsum("nk,nkc->nc", weight, points.mean(2))
    # Moments of two uniformly covered segments: ends count a third of their square, so a joint
    # line follows the gap between centres as well as the directions.
    away = points - centre[:, None, None]
    mean = points.mean(2) - centre[:, None]
    half = 0.5 * (points[:, :, 1] - points[:, :, 0])
    moment = np.einsum("nk,nkc,nkd->ncd", weight, mean, mean)
    moment += np.einsum("nk,nkc,nkd->ncd", weight / 3, half, half)
    direction = np.linalg.eigh(moment)[1][:, :, 1]
    direction *= np.where(np.einsum("nc,nc->n", direction, half[:, 0]) < 0, -1.0, 1.0)[:, None]
    along = np.einsum("nkec,nc->nke", away, direction).reshape(len(groups), 4)
    low = centre + along.min(1)[:, None] * direction
    high = centre + along.max(1)[:, None] * direction
    return np.concatenate([low, high], 1)
