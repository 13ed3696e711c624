"""Coarse calibration without an initial guess (Ma et al. 2021, *CRLF*, section III-C).

Two lanes and a pole of the image against all pairs of parallel lanes and all poles of the cloud:
each correspondence gives poses by `p3l`, judged by the cost J. The paper fixes the image's largest
lanes and pole; here the largest few are tried, as the largest need not be in the cloud. Poses that
cannot be are not judged: a camera under the road or farther from the LiDAR than `reach_m`, or lines
behind it, or a camera that is upside down.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numba import njit
from numpy.typing import NDArray

from lcdata.features.crlf_refine import agreement
from lcdata.features.p3l import turns
from lcdata.features.road_cloud import RoadCloud
from lcdata.features.road_cost import NEAR, mean_height
from lcdata.features.road_view import COARSE, HEIGHTS, Road, RoadView, stack
from lcdata.geometry import se3

Array = NDArray[np.float64]

IMAGE_LANES, IMAGE_POLES = 8, 5
"""Lines of the image that are tried, largest area first."""

POINTS = 200
"""Lane points, and pole points, that judge a pose."""

LOWEST_M = 0.3
"""Least height of the camera above the road."""

APART_DEG = 2.0
"""Least angle between the planes of two lanes: closer ones determine no direction."""

PARALLEL_DEG = 3.0
"""Lines whose directions differ by more are not parallel."""

BEHIND = 0.2
"""Candidates that explain so much less than the best are given up."""

SAMPLE = 6
"""Candidates whose points in view rank all."""

GLANCE = (400, 400, 400)
"""Points of each kind that rank a candidate."""

SAME_M, SAME_RAD = 0.3, np.deg2rad(2.0)
"""Poses so close are one candidate."""


def ahead(cloud: RoadCloud, points: Array) -> NDArray[np.bool_]:
    """The points on the side of the LiDAR's x axis."""
    forward = np.array([1.0, 0.0, 0.0]) @ cloud.R_ground_lidar.T
    return np.asarray((points @ cloud.R_ground_lidar[0]) * np.sign(forward[0]) > 0)


def thinned(points: Array, count: int) -> Array:
    """At most so many of the points, evenly through their order."""
    step = max(1.0, len(points) / count)
    index = (np.arange(min(count, len(points))) * step).astype(np.int64)
    return np.ascontiguousarray(points[index])


def normals(lines: Array, camera_K: Array) -> Array:
    """(L, 3) unit normals of the planes through the camera's centre and (L, 4) image lines."""
    ones = np.ones(len(lines))
    start = np.column_stack([lines[:, 0], lines[:, 1], ones])
    end = np.column_stack([lines[:, 2], lines[:, 3], ones])
    planes = np.cross(start, end) @ camera_K
    return np.asarray(planes / np.linalg.norm(planes, axis=1, keepdims=True))


def coarse(view: RoadView, reach_m: float, most: int) -> tuple[Array, Array]:
    """Candidates for the pose of one pair.

    Args:
        view: Of the pair.
        reach_m: Largest distance of the camera from the LiDAR.
        most: Candidates at most.

    Returns:
        (C, 4, 4) different poses, best first, and (C,) their costs J.
    """
    cloud, image = view.cloud, view.image
    K = image.camera.K
    lanes = cloud.lane_lines.mean(1)
    run = cloud.lane_lines[:, 1] - cloud.lane_lines[:, 0]
    run /= np.linalg.norm(run, axis=1, keepdims=True)
    forward = ahead(cloud, cloud.lane_lines[:, 0]) | ahead(cloud, cloud.lane_lines[:, 1])
    poles = cloud.pole_lines.mean(1)
    poles = poles[ahead(cloud, poles)]
    up = np.ascontiguousarray(cloud.R_ground_lidar[2])
    planes = normals(image.lane_lines[:IMAGE_LANES], K)
    uprights = normals(image.pole_lines[:IMAGE_POLES], K)
    lane_points = thinned(cloud.lanes[ahead(cloud, cloud.lanes)], POINTS)
    pole_points = thinned(cloud.poles[ahead(cloud, cloud.poles)], POINTS)
    limits = (cloud.height, reach_m, float(np.sin(np.deg2rad(APART_DEG))))
    along = np.abs(run @ cloud.R_ground_lidar[0]) > np.cos(np.deg2rad(15))
    found, values = [], []
    for family in (along, ~along):
        index = np.flatnonzero(family & forward)
        if len(index) < 2 or not len(poles):
            continue
        poses, scores = _enumerate(
            planes,
            uprights,
            np.ascontiguousarray(lanes[index]),
            run[index[0]].copy(),
            np.ascontiguousarray(poles),
            up,
            limits,
            (lane_points, pole_points),
            (view.maps[HEIGHTS, 0], view.maps[HEIGHTS, 1]),
            np.array(image.camera.intrinsics),
        )
        found.append(poses)
        values.append(scores)
    if not found:
        return np.zeros((0, 4, 4)), np.zeros(0)
    flat, score = np.concatenate(found), np.concatenate(values)
    order = np.argsort(-score, kind="stable")[:1000]
    T = np.tile(np.eye(4), (len(order), 1, 1))
    T[:, :3, :3], T[:, :3, 3] = flat[order, :9].reshape(-1, 3, 3), flat[order, 9:]
    chosen = different(T, most)
    return T[chosen], score[order][chosen]


def ranked(road: Road, poses: Array, most: int) -> Array:
    """The candidates of all pairs that explain all pairs best, best first.

    Only candidates nearly as good as the best are left: (C, 4, 4), C at most `most`.
    """
    values = agreement(stack(road, poses[:SAMPLE], GLANCE), poses, COARSE)
    order = np.argsort(-values, kind="stable")
    order = order[values[order] > values[order[0]] - BEHIND]
    return np.asarray(poses[order][different(poses[order], most)])


def different(poses: Array, most: int) -> Sequence[int]:
    """Indices of the first poses that are not near an earlier one."""
    chosen: list[int] = []
    for k, T in enumerate(poses):
        if not any(
            se3.translation_error(T, poses[i]) < SAME_M
            and se3.rotation_error(T, poses[i]) < SAME_RAD
            for i in chosen
        ):
            chosen.append(k)
            if len(chosen) == most:
                break
    return chosen


@njit(cache=True, nogil=True)
def _enumerate(  # type: ignore[no-untyped-def]
    planes, uprights, lanes, run, poles, up, limits, points, maps, intrinsics
):
    """The best pose of each pair of image lanes, image pole and rotation.

    Args:
        planes: (A, 3) normals of the image's lanes.
        uprights: (B, 3) normals of its poles.
        lanes: (L, 3) a point of each of the cloud's parallel lanes.
        run: (3,) their direction.
        poles: (P, 3) a point of each of the cloud's poles.
        up: (3,) the ground's normal.
        limits: Height of the LiDAR, reach, and least sine between two lanes' planes.
        points: (N, 3) of lanes, and of poles, that judge.
        maps: (h, w) heights of eq. (8) of lanes, and of poles.
        intrinsics: (4,).

    Returns:
        (C, 12) poses and (C,) costs J.
    """
    size = max(len(planes) * (len(planes) - 1) // 2 * len(uprights) * 4, 1)
    poses, scores = np.empty((size, 12)), np.empty(size)
    count = 0
    N = np.empty((3, 3))
    for a in range(len(planes)):
        for b in range(a):
            cross = np.cross(planes[a], planes[b])
            if cross @ cross < limits[2] * limits[2]:
                continue
            for c in range(len(uprights)):
                N[0], N[1], N[2] = planes[a], planes[b], uprights[c]
                if abs(np.linalg.det(N)) < 1e-3:
                    continue
                inverse = np.linalg.inv(N)
                rotations, turned = turns(planes[a], planes[b], uprights[c], run, up)
                for k in range(turned):
                    # The image shows the sky above the road: up is up, within 60 degrees.
                    if rotations[k, 1] @ up > -0.5:
                        continue
                    scores[count] = _best_translation(
                        rotations[k],
                        N,
                        inverse,
                        lanes,
                        poles,
                        up,
                        limits,
                        points,
                        maps,
                        intrinsics,
                        poses[count],
                    )
                    if scores[count] > 0.0:
                        count += 1
    return poses[:count], scores[:count]


@njit(cache=True, nogil=True)
def _best_translation(  # type: ignore[no-untyped-def]
    R, N, inverse, lanes, poles, up, limits, points, maps, intrinsics, best
):
    """Lay every two lanes and every pole on the image's three lines with one rotation.

    Args:
        R: 3x3.
        N: 3x3, rows the normals of two image lanes and an image pole.
        inverse: Its inverse.
        lanes: See `_enumerate`, as the rest.
        poles: (P, 3).
        up: (3,).
        limits: Three numbers.
        points: Of lanes, and of poles.
        maps: Of lanes, and of poles.
        intrinsics: (4,).
        best: (12,) the best pose; written to.

    Returns:
        Its cost J, 0 of none.
    """
    most = 0.0
    pose = np.empty(12)
    for row in range(3):
        for column in range(3):
            pose[3 * row + column] = R[row, column]
    seen, level = lanes @ R.T, R @ up
    for m in range(len(poles)):
        pole = R @ poles[m]
        r3 = -(N[2] @ pole)
        for i in range(len(lanes)):
            r1 = -(N[0] @ seen[i])
            for j in range(len(lanes)):
                if i == j:
                    continue
                r2 = -(N[1] @ seen[j])
                for k in range(3):
                    pose[9 + k] = inverse[k, 0] * r1 + inverse[k, 1] * r2 + inverse[k, 2] * r3
                x, y, z = pose[9], pose[10], pose[11]
                if x * x + y * y + z * z > limits[1] * limits[1] or pole[2] + z < NEAR:
                    continue
                # The camera's place in the LiDAR frame is -R^T t.
                if limits[0] - (level[0] * x + level[1] * y + level[2] * z) < LOWEST_M:
                    continue
                score = mean_height(pose, points[1], maps[1], intrinsics, most - 1.0)
                if score < 0.0:
                    continue
                beside = mean_height(pose, points[0], maps[0], intrinsics, most - score)
                if beside >= 0.0 and score + beside > most:
                    most = score + beside
                    best[:] = pose
    return most


def lacking(view: RoadView, parallel: bool = True) -> str:  # noqa: PLR0911
    """What a pair lacks for a coarse calibration, in words; empty if nothing.

    Args:
        view: Of the pair.
        parallel: Whether two parallel lanes are needed, and not only any lane.
    """
    cloud, image = view.cloud, view.image
    if not len(cloud.lane_lines):
        return "no lane in the cloud: no line of ground points brighter than the road"
    if not len(image.lane_lines):
        return "no lane in the image's mask"
    if not len(cloud.pole_lines):
        return "no pole in the cloud: no steep line of points that stands alone"
    if not len(image.pole_lines):
        return "no pole in the image's mask"
    if not parallel:
        return ""
    run = cloud.lane_lines[:, 1] - cloud.lane_lines[:, 0]
    along = np.abs(run @ cloud.R_ground_lidar[0]) > np.abs(run @ cloud.R_ground_lidar[1])
    if max(np.count_nonzero(along), np.count_nonzero(~along)) < 2:
        angles = np.sort(cloud.directions)
        if len(angles) > 1 and np.diff(angles).min() > PARALLEL_DEG:
            degrees = ", ".join(f"{angle:.0f}" for angle in angles)
            return f"lanes in the cloud are not parallel: directions of {degrees} deg"
        return "one lane in the cloud, two parallel ones needed"
    if len(image.lane_lines) < 2:
        return "one lane in the image's mask, two parallel ones needed"
    return ""
