"""Matches between the image and the cloud's intensity images, and the pose that they give."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lcdata.errors import CalibrationError
from lcdata.features.image_faces import image_faces
from lcdata.features.image_matching import Matcher, match_turned
from lcdata.features.lidar_view import lidar_view, views_around
from lcdata.features.point_pose import point_pose
from lcdata.features.rotation_ransac import rotation_ransac
from lcdata.pair import Pair

Array = NDArray[np.float64]

FOCAL = 400.0
SIZE = 900
"""Virtual cameras of the cloud, pixels: about as fine as the image's faces."""

MIN_INLIERS = 15
MIN_SHARE = 0.05
"""Matches that must agree for a pose to be trusted, and their share: 3 degrees about a rotation
are 0.07 % of all bearings, but matches crowd where there is structure."""


@dataclass(frozen=True, eq=False)
class MatchedPose:
    """What matches gave.

    Args:
        T_camera_lidar: 4x4.
        matches: Number of matches.
        inliers: Those that agree with the pose.
        doubts: Why it is not to be trusted; empty if it is.
    """

    T_camera_lidar: Array
    matches: int
    inliers: int
    doubts: tuple[str, ...]


def pose_from_matching(
    pairs: Sequence[Pair],
    matcher: Matcher,
    turn_camera: int = 0,
    turn_lidar: int = 0,
    one_view: bool = False,
) -> MatchedPose:
    """Match every face of the images with every view of the clouds.

    Args:
        pairs: With the same extrinsic and the same camera.
        matcher: What matches two images.
        turn_camera: See `match_turned`.
        turn_lidar: See `match_turned`.
        one_view: Draw a cloud by the paper's one virtual camera (`lidar_view`) and not by six.

    Raises:
        CalibrationError: Too few matches, or matches that no pose fits.
    """
    found = [_matches(pair, matcher, turn_camera, turn_lidar, one_view) for pair in pairs]
    pixels, points, bearings = (np.concatenate(part) for part in zip(*found, strict=True))
    # A key point may have two orientations; its place counts once.
    once = np.unique(np.rint(pixels / 2.0), axis=0, return_index=True)[1]
    once = once[np.unique(np.rint(points[once] / 0.02), axis=0, return_index=True)[1]]
    pixels, points, bearings = pixels[once], points[once], bearings[once]
    away = points / np.linalg.norm(points, axis=1, keepdims=True)
    _, agree = rotation_ransac(bearings, away)
    if agree.sum() < 4:
        raise CalibrationError(
            f"{agree.sum()} of {len(pixels)} matched points agree on a rotation",
            "pick matches by hand: lcdata pick",
        )
    pose = point_pose(points[agree], pixels[agree], pairs[0].camera)
    inliers = int(pose.inliers.sum())
    doubts = []
    if inliers < MIN_INLIERS or inliers < MIN_SHARE * len(pixels):
        doubts.append(f"only {inliers} of {len(pixels)} matched points agree")
    return MatchedPose(pose.T_camera_lidar, len(pixels), inliers, tuple(doubts))


def _matches(
    pair: Pair, matcher: Matcher, turn_camera: int, turn_lidar: int, one_view: bool
) -> tuple[Array, Array, Array]:
    """(M, 2) raw pixels, (M, 3) points and (M, 3) bearings in the camera frame."""
    pixels, points, bearings = [np.zeros((0, 2))], [np.zeros((0, 3))], [np.zeros((0, 3))]
    if one_view:
        views = [lidar_view(pair.points, pair.intensity)]
    else:
        views = views_around(pair.points, pair.intensity, focal=FOCAL, size=SIZE)
    for face in image_faces(pair.image, pair.camera):
        for view in views:
            found = match_turned(matcher, face.image, view.intensity, turn_camera, turn_lidar)
            u, v = np.rint(found.points_b).astype(np.int64).reshape(-1, 2).T
            rows = view.index[v, u]
            rays = face.camera.unproject(found.points_a) @ face.R_face_camera
            raw, inside = pair.camera.project(rays)
            good = (rows >= 0) & inside
            pixels.append(raw[good])
            bearings.append(rays[good])
            points.append(np.asarray(pair.points[rows[good]], float))
    return np.concatenate(pixels), np.concatenate(points), np.concatenate(bearings)
