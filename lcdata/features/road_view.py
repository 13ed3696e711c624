"""What CRLF compares: lanes and poles of a cloud, and maps of how near a pixel is to theirs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lcdata.features.road_cloud import RoadCloud
from lcdata.features.road_cost import GAMMA0, GAMMA1, NEAR, height_map, tabulate
from lcdata.features.road_image import FINEST, RoadImage
from lcdata.geometry import se3

Array = NDArray[np.float64]
Floats = NDArray[np.float32]
Mask = NDArray[np.bool_]

SOFT = 1.5, 4.0
"""Pixels at `FINEST` over which a mask's border is drawn out, fine and coarse."""

STEPS, DEEPEST = 8, 64
"""Steps a pixel, and pixels to either side of a border, of the table of maps."""

MARGIN = 0.05
"""Points so far outside the image count, radians: they may come into view."""

ROAD_REACH_M = 40.0
"""How far points of the road count that are no lane."""

SEARCH_POINTS, LAST_POINTS = (700, 700, 500), (2500, 3000, 2000)
"""Lane, road and pole points of a pair at most: in the search, and in its last steps."""

HEIGHTS, FINE, COARSE = range(3)
"""Kinds of maps."""


@dataclass(frozen=True, eq=False)
class RoadView:
    """Features of one pair.

    Args:
        cloud: Lane marks and poles.
        image: Masks and lines.
        maps: (3, 2, h, w) float32, 0..1: heights of eq. (8), and the masks with their borders
            drawn out, fine and coarse; of lanes and of poles.
    """

    cloud: RoadCloud
    image: RoadImage
    maps: Floats


def road_view(cloud: RoadCloud, image: RoadImage) -> RoadView:
    """Maps of one pair's masks."""
    maps = np.zeros((3, 2, *image.lane.shape), np.float32)
    for k, mask in enumerate((image.lane, image.pole)):
        _draw(mask, image.focal, maps[:, k])
    return RoadView(cloud, image, maps)


def _draw(mask: Mask, focal: float, maps: Floats) -> None:
    """Fill (3, h, w) maps of a mask; see `RoadView`."""
    import cv2

    if not mask.any():
        return
    scale = FINEST / focal
    maps[HEIGHTS] = height_map(mask, GAMMA0**scale, GAMMA1**scale)
    deep = cv2.distanceTransform(mask.astype(np.uint8), cv2.DIST_L2, 5)
    far = cv2.distanceTransform((~mask).astype(np.uint8), cv2.DIST_L2, 5)
    # A table spares millions of exponentials.
    steps = (np.arange(STEPS * 2 * DEEPEST + 1) / STEPS - DEEPEST) * scale
    for kind, width in zip((FINE, COARSE), SOFT, strict=True):
        table = 1.0 / (1.0 + np.exp(-np.clip(steps / width, -30, 30)))
        tabulate(deep, far, table.astype(np.float32), float(STEPS), 0.5, maps[kind])


@dataclass(frozen=True, eq=False)
class Road:
    """All pairs' views, their maps side by side.

    Args:
        views: Of each pair.
        maps: (3, M) for each kind, a pair's lanes, then its poles, then the next pair's.
        place: (V, 2) where a pair's lanes and poles start in them.
        shape: (V, 2) rows and columns.
        intrinsics: (V, 4) fx fy cx cy.
    """

    views: Sequence[RoadView]
    maps: Floats
    place: NDArray[np.int64]
    shape: NDArray[np.int64]
    intrinsics: Array


def together(views: Sequence[RoadView]) -> Road:
    """The views of pairs that share their extrinsic."""
    flat = [view.maps.reshape(3, -1) for view in views]
    first = np.concatenate([[0], np.cumsum([maps.shape[1] for maps in flat])])
    return Road(
        views,
        flat[0] if len(flat) == 1 else np.concatenate(flat, 1),
        np.column_stack([first[:-1], (first[:-1] + first[1:]) // 2]).astype(np.int64),
        np.array([view.maps.shape[2:] for view in views], np.int64),
        np.array([view.image.camera.intrinsics for view in views]),
    )


@dataclass(frozen=True, eq=False)
class Stack:
    """Points and maps of all pairs, side by side for the kernels.

    Args:
        points: (N, 3) lanes, road and poles of the first pair, then of the next, metres.
        start: (V, 4) where each pair's lanes, road and poles start, and where they end.
        road_share: (V,) share of the road's points that were kept.
        group: (N,) mark or pole that a point belongs to; errors within one go together.
        maps: See `Road`, as the rest.
        place: (V, 2).
        shape: (V, 2).
        intrinsics: (V, 4).
    """

    points: Array
    start: NDArray[np.int64]
    road_share: Array
    group: NDArray[np.int64]
    maps: Floats
    place: NDArray[np.int64]
    shape: NDArray[np.int64]
    intrinsics: Array


def stack(road: Road, poses: Array, most: tuple[int, int, int] = SEARCH_POINTS) -> Stack:
    """The points that are in view from one of the poses or nearly so.

    Args:
        road: All pairs.
        poses: (P, 4, 4).
        most: Lane, road and pole points of a pair at most; of many pairs fewer.
    """
    share = 1.0 / np.sqrt(len(road.views))
    points, start, kept, groups = [], [], [], []
    at, group = 0, 0
    for view in road.views:
        cloud = view.cloud
        lane = cloud.lanes[in_view(view, cloud.lanes, poses)]
        near = cloud.road[np.linalg.norm(cloud.road, axis=1) < ROAD_REACH_M]
        beside = near[in_view(view, near, poses)]
        seen = in_view(view, cloud.poles, poses)
        pole, pole_of = cloud.poles[seen], cloud.pole_of[seen]
        some = [
            _evenly(len(values), int(limit * share))
            for values, limit in zip((lane, beside, pole), most, strict=True)
        ]
        lane, road_kept, pole = lane[some[0]], beside[some[1]], pole[some[2]]
        kept.append(len(road_kept) / max(len(beside), 1))
        ground = np.concatenate([lane, road_kept])
        block = np.floor((ground @ cloud.R_ground_lidar.T)[:, :2] / [4.0, 1.75]).astype(np.int64)
        marks = np.unique(block @ np.array([1000, 1]), return_inverse=True)[1]
        upright = np.unique(pole_of[some[2]], return_inverse=True)[1]
        groups += [group + marks, group + 1 + marks.max(initial=-1) + upright]
        group += 2 + int(marks.max(initial=-1)) + int(upright.max(initial=-1))
        points += [lane, road_kept, pole]
        start.append(at + np.cumsum([0, len(lane), len(road_kept), len(pole)]))
        at = int(start[-1][3])
    return Stack(
        np.ascontiguousarray(np.concatenate(points), float),
        np.array(start, np.int64),
        np.array(kept),
        np.concatenate(groups),
        road.maps,
        road.place,
        road.shape,
        road.intrinsics,
    )


def in_view(view: RoadView, points: Array, poses: Array, margin: float = MARGIN) -> Mask:
    """Which (N, 3) points are in the image, or nearly so, from one of the poses."""
    camera, seen = view.image.camera, np.zeros(len(points), bool)
    fx, fy, cx, cy = camera.intrinsics
    edge = margin * view.image.focal
    for T in poses:
        x, y, z = se3.apply(T, points).T
        depth = np.maximum(z, NEAR)
        u, v = fx * x / depth + cx, fy * y / depth + cy
        inside = (z > NEAR) & (u > -edge) & (u < camera.width + edge)
        seen |= inside & (v > -edge) & (v < camera.height + edge)
    return seen


def _evenly(count: int, most: int) -> NDArray[np.int64]:
    """Indices of at most so many of them, evenly spread."""
    step = max(1.0, count / max(most, 1))
    return (np.arange(min(count, most)) * step).astype(np.int64)
