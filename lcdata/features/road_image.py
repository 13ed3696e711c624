"""Lane and pole masks of an image, and the lines in them (Ma et al. 2021, *CRLF*, III-B2).

All is done on the undistorted image, at `FINEST` pixels a radian at most. Where lanes and poles
come in one mask, they are told apart by shape and direction: lanes lie below the horizon, which is
where most lines of the mask meet; poles are steep and reach above it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lcdata.features.ransac_fits import ransac_lines
from lcdata.geometry.camera import Camera

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Bytes = NDArray[np.uint8]

FINEST = 1000.0
"""Pixels a radian: a lane mark and the spot of a beam are wider than one such pixel."""

LINE_NEAR, LINE_CLEAR = 0.002, 0.005
"""Distance of the middles that form a line, and of those not used again, radians."""

LINE_POINTS, LINE_LENGTH, LINES = 12, 0.025, 24
"""A line's least number of middles and least length in radians, and lines at most."""

GAP = 0.03
"""Longest gap in a pole, radians: a sign or a lamp that is not in the mask."""

POLE_WIDTH = 0.02
"""Width about a pole's line that belongs to it, radians."""

STEEP_DEG = 15.0
"""Largest angle of a pole to the image's vertical."""

MEET_DEG = 2.5
"""Lines whose directions miss the vanishing point by less meet in it."""

SMALLEST = 12
"""Parts of a mask with fewer pixels are noise."""


@dataclass(frozen=True, eq=False)
class RoadImage:
    """Lanes and poles of one image, undistorted and reduced.

    Args:
        camera: Pinhole camera without distortion, of the masks' size.
        focal: Its pixels a radian in the middle.
        lane: (h, w) bool.
        pole: (h, w) bool.
        lane_lines: (L, 4) x1 y1 x2 y2 of lanes, pixels, largest area first.
        pole_lines: (P, 4) the same of poles.
    """

    camera: Camera
    focal: float
    lane: Mask
    pole: Mask
    lane_lines: Array
    pole_lines: Array


def working_camera(camera: Camera) -> Camera:
    """The camera of an image reduced to `FINEST` pixels a radian, not undistorted."""
    across, down = camera.pixels_per_radian
    focal = max(across, down)
    if focal <= 1.25 * FINEST:
        return camera
    share = FINEST / focal
    return camera.resized(round(camera.width * share), round(camera.height * share))


def worked(image: Bytes, camera: Camera) -> Bytes:
    """An image or mask, reduced and undistorted.

    Args:
        image: (H, W) or (H, W, 3) uint8 as recorded.
        camera: See `working_camera`.
    """
    import cv2

    size = (camera.width, camera.height)
    if image.shape[1::-1] != size:
        image = np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.uint8)
    return np.asarray(camera.undistort(image), np.uint8)


def road_image(lane: Mask, pole: Mask | None, camera: Camera) -> RoadImage:
    """Lines of lanes and poles.

    Args:
        lane: (h, w) lane mask, undistorted; that of both where `pole` is None.
        pole: (h, w) pole mask.
        camera: Pinhole without distortion of the masks.
    """
    focal = max(camera.pixels_per_radian)
    if pole is None:
        lane, pole, lane_lines, pole_lines = split(without_specks(lane), focal)
    else:
        lane, pole = without_specks(lane), without_specks(pole)
        lane_lines, pole_lines = mask_lines(lane, focal), mask_lines(pole, focal, gaps=False)
        pole_lines = pole_lines[_steep(pole_lines)]
    return RoadImage(camera, focal, lane, pole, lane_lines, pole_lines)


def without_specks(mask: Mask) -> Mask:
    """The mask without its smallest parts."""
    import cv2

    count, labels, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8))
    large = stats[:, cv2.CC_STAT_AREA] >= SMALLEST
    large[0] = False
    return np.asarray(large[labels]) if count > 1 else mask


def middles(mask: Mask) -> tuple[Array, Array]:
    """Pixels of a mask's middle line, where distances to the edge on both sides are equal.

    Args:
        mask: (h, w).

    Returns:
        (N, 2) x y, and (N,) distances to the edge, pixels.
    """
    import cv2

    padded = cv2.copyMakeBorder(mask.astype(np.uint8), 1, 1, 1, 1, cv2.BORDER_REPLICATE)
    far = cv2.distanceTransform(padded, cv2.DIST_L2, 3)
    # Towards the middle the distance grows by 1 a pixel from either side and cancels there.
    slope_x, slope_y = (
        cv2.Sobel(far, cv2.CV_32F, *d, ksize=3, scale=0.125) for d in ((1, 0), (0, 1))
    )
    flat = slope_x * slope_x + slope_y * slope_y < 0.3
    y, x = np.nonzero((flat & (padded > 0))[1:-1, 1:-1])
    return np.column_stack([x, y]).astype(float), far[1:-1, 1:-1][y, x].astype(float)


def mask_lines(mask: Mask, focal: float, gaps: bool = True, seed: int = 0) -> Array:
    """Straight lines along the middles of a mask.

    Args:
        mask: (h, w).
        focal: Pixels a radian.
        gaps: Whether a line goes on behind gaps, as dashed lanes do.
        seed: Of RANSAC.

    Returns:
        (L, 4) x1 y1 x2 y2, pixels, those of the largest area first.
    """
    points, half = middles(mask)
    if len(points) < LINE_POINTS:
        return np.zeros((0, 4))
    rng = np.random.default_rng(seed)
    near, shortest = max(1.2, LINE_NEAR * focal), LINE_LENGTH * focal
    clear = max(2.5, LINE_CLEAR * focal)
    segments, _ = ransac_lines(points, near, clear, LINE_POINTS, shortest, LINES, rng)
    found, area = [], []
    for start, end in segments:
        run = (end - start) / np.linalg.norm(end - start)
        offset = points - start
        on = np.abs(offset[:, 0] * run[1] - offset[:, 1] * run[0]) < near
        along, width = offset[on] @ run, 2.0 * half[on]
        if not gaps:
            order = np.argsort(along)
            pieces = np.split(order, np.flatnonzero(np.diff(along[order]) > GAP * focal) + 1)
            longest = max(pieces, key=lambda piece: float(np.ptp(along[piece])))
            along, width = along[longest], width[longest]
        if np.ptp(along) >= shortest:
            found.append([*(start + along.min() * run), *(start + along.max() * run)])
            area.append(width.sum())
    return np.array(found).reshape(-1, 4)[np.argsort(-np.array(area), kind="stable")]


def _steep(lines: Array, degrees: float = STEEP_DEG) -> Mask:
    """Which lines are near the image's vertical."""
    run = np.abs(lines[:, 2:] - lines[:, :2])
    return np.asarray(run[:, 0] < np.tan(np.deg2rad(degrees)) * run[:, 1])


def horizon(lines: Array, width: int, height: int) -> float | None:
    """Row in which most lines that are not upright meet; None where they do not meet.

    Args:
        lines: (L, 4) pixels.
        width: Of the image.
        height: Of the image.
    """
    slanted = lines[~_steep(lines)]
    if len(slanted) < 2:
        return None
    start, end = slanted[:, :2], slanted[:, 2:]
    run = end - start
    length = np.linalg.norm(run, axis=1)
    run /= length[:, None]
    middle = 0.5 * (start + end)
    i, j = np.triu_indices(len(slanted), 1)
    cross = run[i, 0] * run[j, 1] - run[i, 1] * run[j, 0]
    offset = middle[j] - middle[i]
    with np.errstate(divide="ignore", invalid="ignore"):
        t = (offset[:, 0] * run[j, 1] - offset[:, 1] * run[j, 0]) / cross
    meet = middle[i] + t[:, None] * run[i]
    inside = np.abs(cross) > np.sin(np.deg2rad(4.0))
    inside &= np.abs(meet - [width / 2, height / 2]).max(1) < max(width, height)
    meet = meet[inside]
    if not len(meet):
        return None
    towards = meet[:, None] - middle
    away = np.linalg.norm(towards, axis=2)
    miss = np.abs(towards[..., 0] * run[:, 1] - towards[..., 1] * run[:, 0])
    hit = miss < np.sin(np.deg2rad(MEET_DEG)) * away
    # Lanes end where they meet; a stop line is crossed by them.
    hit &= np.abs(np.einsum("mlk,lk->ml", towards, run)) > 0.45 * length
    best = int((hit * length).sum(1).argmax())
    point, chosen = meet[best], hit[best]
    if np.count_nonzero(chosen) < 2:
        return None
    normal = np.column_stack([run[chosen, 1], -run[chosen, 0]])
    weight = length[chosen] / away[best][chosen]
    point, *_ = np.linalg.lstsq(
        weight[:, None] * normal, weight * (normal * middle[chosen]).sum(1), rcond=None
    )
    return float(point[1])


def split(mask: Mask, focal: float) -> tuple[Mask, Mask, Array, Array]:
    """Tell lanes from poles in one mask.

    Args:
        mask: (h, w) both.
        focal: Pixels a radian.

    Returns:
        (h, w) lanes, (h, w) poles, (L, 4) lines of lanes and (P, 4) of poles.
    """
    import cv2

    height, width = mask.shape
    pieces = mask_lines(mask, focal, gaps=False)
    row = horizon(pieces, width, height)
    steep = _steep(pieces)
    if row is not None:
        # A pole at the roadside stands out over the horizon; a lane ahead ends below it.
        steep &= np.minimum(pieces[:, 1], pieces[:, 3]) < row - 0.01 * focal
    poles = pieces[steep]
    near = np.zeros(mask.shape, np.uint8)
    reach = max(3, round(POLE_WIDTH * focal))
    for x1, y1, x2, y2 in np.rint(poles).astype(int):
        cv2.line(near, (int(x1), int(y1)), (int(x2), int(y2)), 1, reach)
    pole = mask & (near > 0)
    lane = mask & ~pole
    if row is not None:
        lane &= np.arange(height)[:, None] > row + 0.003 * focal
    return lane, pole, mask_lines(lane, focal), poles
