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
from lcdata.features.road_view import COARSE, Road, RoadView, stack
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
    along = np.abs(run @ cloud.R_ground_lidar[0]) > np.cos(np.deg2rad(15))
    found, values = [], []
    for family in (along, ~along):
        index = np.flatnonzero(family & forward)
        if len(index) < 2 or not len(poles):
            continue
        poses, scores, count = _enumerate(
            planes,
            uprights,
            np.ascontiguousarray(lanes[index]),
            np.ascontiguousarray(run[index]),
            np.ascontiguousarray(poles),
            up,
            cloud.height,
            reach_m,
            float(np.sin(np.deg2rad(APART_DEG))),
            lane_points,
            pole_points,
            view.maps[0, 0],
            view.maps[0, 1],
            np.array(image.camera.intrinsics),
        )
        found.append(poses[:count])
        values.append(scores[:count])
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
def _enumerate(  # type: ignore[no-untyped-def]  # noqa: PLR0912, PLR0915
    planes,
    uprights,
    lanes,
    run,
    poles,
    up,
    height,
    reach,
    apart,
    lane_points,
    pole_points,
    lane_heights,
    pole_heights,
    intrinsics,
):
    """The best pose of each pair of image lanes, image pole and rotation.

    Returns:
        (C, 12) poses, (C,) costs J, and how many there are.
    """
    size = len(planes) * (len(planes) - 1) // 2 * len(uprights) * 4
    poses = np.empty((max(size, 1), 12))
    scores = np.empty(max(size, 1))
    count = 0
    pose = np.empty(12)
    N = np.empty((3, 3))
    first = run[0]
    for a in range(len(planes)):
        for b in range(a):
            cross = np.cross(planes[a], planes[b])
            if cross @ cross < apart * apart:
                continue
            for c in range(len(uprights)):
                N[0], N[1], N[2] = planes[a], planes[b], uprights[c]
                if abs(np.linalg.det(N)) < 1e-3:
                    continue
                inverse = np.linalg.inv(N)
                rotations, turned = turns(planes[a], planes[b], uprights[c], first, up)
                for k in range(turned):
                    R = rotations[k]
                    # The image shows the sky above the road: up is up, within 60 degrees.
                    if R[1] @ up > -0.5:
                        continue
                    best = 0.0
                    above = R.T.copy()
                    seen_lanes = np.empty((len(lanes), 3))
                    for i in range(len(lanes)):
                        seen_lanes[i] = R @ lanes[i]
                    for m in range(len(poles)):
                        pole = R @ poles[m]
                        r3 = -(uprights[c] @ pole)
                        for i in range(len(lanes)):
                            r1 = -(planes[a] @ seen_lanes[i])
                            for j in range(len(lanes)):
                                if i == j:
                                    continue
                                r2 = -(planes[b] @ seen_lanes[j])
                                t0 = inverse[0, 0] * r1 + inverse[0, 1] * r2 + inverse[0, 2] * r3
                                t1 = inverse[1, 0] * r1 + inverse[1, 1] * r2 + inverse[1, 2] * r3
                                t2 = inverse[2, 0] * r1 + inverse[2, 1] * r2 + inverse[2, 2] * r3
                                if t0 * t0 + t1 * t1 + t2 * t2 > reach * reach:
                                    continue
                                if pole[2] + t2 < NEAR:
                                    continue
                                # The camera's place in the LiDAR frame is -R^T t.
                                x = -(above[0, 0] * t0 + above[0, 1] * t1 + above[0, 2] * t2)
                                y = -(above[1, 0] * t0 + above[1, 1] * t1 + above[1, 2] * t2)
                                z = -(above[2, 0] * t0 + above[2, 1] * t1 + above[2, 2] * t2)
                                if up[0] * x + up[1] * y + up[2] * z + height < LOWEST_M:
                                    continue
                                for row in range(3):
                                    for column in range(3):
                                        pose[3 * row + column] = R[row, column]
                                pose[9], pose[10], pose[11] = t0, t1, t2
                                score = mean_height(pose, pole_points, pole_heights, intrinsics)
                                if score + 1.0 <= best:
                                    continue
                                score += mean_height(pose, lane_points, lane_heights, intrinsics)
                                if score > best:
                                    best = score
                                    poses[count] = pose
                                    scores[count] = score
                    if best > 0.0:
                        count += 1
    return poses, scores, count


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
