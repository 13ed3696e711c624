"""Lane and pole masks without masks: bright thin marks on the ground, long upright line pairs.

Needs a guess of the pose: the ground plane of the cloud, seen from there, is the map on which marks
have their widths in metres. Ours; for images of which no masks are at hand.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lcdata.features.road_cloud import RoadCloud
from lcdata.features.road_image import RoadImage, road_image, worked, working_camera
from lcdata.pair import Pair

Array = NDArray[np.float64]
Bytes = NDArray[np.uint8]
Mask = NDArray[np.bool_]

CELL_M = 0.05
"""Of the map of the ground."""

FAR_M, ASIDE_M, NEAR_M = 40.0, 12.0, 3.0
"""Extent of the map along and across the road, and its start ahead of the camera."""

MARK_M = 0.7
"""Marks are narrower across the road."""

BRIGHT, DEVIATIONS = 15.0, 2.5
"""Marks are brighter than the road beside them by so many grey values, and by so many of the
standard deviations of that difference."""

SHORTEST_M, ELONGATED = 0.8, 2.0
"""Least length of a mark along the road, and least ratio to its width."""

TILT_DEG = 4.0
"""Largest angle of a pole's borders to the vertical, seen from the guess."""

POLE_LENGTH, POLE_WIDTH = 0.06, 0.03
"""Least length and largest width of a pole, radians."""

OVERLAP = 0.6
"""Share of the shorter border that lies beside the other."""


def classical_masks(pair: Pair, cloud: RoadCloud, T: Array) -> RoadImage:
    """Marks and poles of an image, as seen from a guess of the pose.

    Args:
        pair: The pair.
        cloud: Its ground.
        T: 4x4 guess of `T_camera_lidar`.
    """
    import cv2

    camera = working_camera(pair.camera)
    grey = worked(
        pair.image if pair.image.ndim == 2 else cv2.cvtColor(pair.image, cv2.COLOR_RGB2GRAY), camera
    )
    pinhole = camera.undistorted()
    K, R = pinhole.K, T[:3, :3] @ cloud.R_ground_lidar.T
    lane = _marks(grey, K, R, T[:3, 3], cloud.height)
    pole = _poles(grey, K, R[:, 2], max(pinhole.pixels_per_radian))
    return road_image(lane, pole, pinhole)


def _marks(grey: Bytes, K: Array, R_camera_ground: Array, t: Array, height: float) -> Mask:
    """(h, w) marks: what is brighter than the road on both sides, and long."""
    import cv2

    forward = 1.0 if R_camera_ground[2, 0] >= 0 else -1.0
    along = np.arange(NEAR_M, FAR_M, CELL_M) * forward
    across = np.arange(-ASIDE_M, ASIDE_M, CELL_M)
    x, y = np.meshgrid(along, across, indexing="ij")
    # Pixel of a place on the ground: a homography.
    H = K @ np.column_stack(
        [R_camera_ground[:, 0], R_camera_ground[:, 1], t - height * R_camera_ground[:, 2]]
    )
    place = np.stack([x, y, np.ones_like(x)], -1) @ H.T
    ahead = place[..., 2] > 0.1
    pixel = np.where(
        ahead[..., None], place[..., :2] / np.where(ahead, place[..., 2], 1)[..., None], -9
    )
    pixel = np.clip(pixel, -9.0, 30_000.0).astype(np.float32)
    ground = cv2.remap(grey, pixel[..., 0], pixel[..., 1], cv2.INTER_LINEAR).astype(np.float32)
    seen = ahead & (pixel >= 0).all(-1)
    seen &= (pixel[..., 0] < grey.shape[1] - 1) & (pixel[..., 1] < grey.shape[0] - 1)
    width = 2 * round(0.5 * MARK_M / CELL_M) + 1
    top = cv2.morphologyEx(ground, cv2.MORPH_TOPHAT, np.ones((1, width), np.uint8))
    limit = max(BRIGHT, DEVIATIONS * float(top[seen].std())) if seen.any() else np.inf
    bright = ((top > limit) & seen).astype(np.uint8)
    _, labels, stats, _ = cv2.connectedComponentsWithStats(bright)
    tall = stats[:, cv2.CC_STAT_HEIGHT] * CELL_M
    wide = stats[:, cv2.CC_STAT_AREA] / np.maximum(stats[:, cv2.CC_STAT_HEIGHT], 1) * CELL_M
    kept = (tall > SHORTEST_M) & (tall > ELONGATED * wide)
    kept[0] = False
    marks = kept[labels].astype(np.uint8)
    # Back into the image.
    v, u = np.mgrid[: grey.shape[0], : grey.shape[1]]
    back = np.stack([u, v, np.ones_like(u)], -1) @ np.linalg.inv(H).T
    scale = np.where(np.abs(back[..., 2]) < 1e-12, 1e-12, back[..., 2])
    gx, gy = back[..., 0] / scale, back[..., 1] / scale
    row = ((gx * forward - NEAR_M) / CELL_M).clip(-9, 30_000).astype(np.float32)
    column = ((gy + ASIDE_M) / CELL_M).clip(-9, 30_000).astype(np.float32)
    # Behind the horizon the ground is behind the camera.
    depth = H[2, 0] * gx + H[2, 1] * gy + H[2, 2]
    found = cv2.remap(marks, column, row, cv2.INTER_NEAREST)
    return np.asarray((found > 0) & (depth > 0.1))


def _poles(grey: Bytes, K: Array, up: Array, focal: float) -> Mask:
    """(h, w) what lies between two long upright lines of opposite contrast."""
    import cv2

    mask = np.zeros(grey.shape, np.uint8)
    lines = cv2.createLineSegmentDetector().detect(grey)[0]
    if lines is None:
        return mask > 0
    lines = lines.reshape(-1, 4).astype(float)
    start, end = lines[:, :2], lines[:, 2:]
    run, middle = end - start, 0.5 * (start + end)
    length = np.linalg.norm(run, axis=1)
    # Direction of the vertical in the image, at the line: towards K up.
    vanishing = K @ up
    towards = vanishing[:2] - vanishing[2] * middle
    towards /= np.maximum(np.linalg.norm(towards, axis=1, keepdims=True), 1e-9)
    sine = np.abs(run[:, 0] * towards[:, 1] - run[:, 1] * towards[:, 0]) / np.maximum(length, 1e-9)
    steep = np.flatnonzero((sine < np.sin(np.deg2rad(TILT_DEG))) & (length > POLE_LENGTH * focal))
    sign = np.sign((run * towards).sum(1))
    for k, i in enumerate(steep):
        for j in steep[:k]:
            if sign[i] == sign[j]:
                continue
            across = np.array([-towards[i, 1], towards[i, 0]])
            apart = abs(float((middle[j] - middle[i]) @ across))
            if not 1.0 < apart < POLE_WIDTH * focal:
                continue
            spans = [np.sort([start[n] @ towards[i], end[n] @ towards[i]]) for n in (i, j)]
            low, high = max(s[0] for s in spans), min(s[1] for s in spans)
            if high - low < OVERLAP * min(length[i], length[j]):
                continue
            corners = [_along(start[n], run[n], towards[i], s) for n, s in ((i, low), (i, high))]
            corners += [_along(start[n], run[n], towards[i], s) for n, s in ((j, high), (j, low))]
            cv2.fillConvexPoly(mask, np.rint(corners).astype(np.int32), 1)
    return mask > 0


def _along(start: Array, run: Array, towards: Array, place: float) -> Array:
    """Point of a line at a place along a direction."""
    return np.asarray(start + run * ((place - start @ towards) / (run @ towards)))
