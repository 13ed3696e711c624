"""Initial guesses of direct_visual_lidar_calibration (Koide et al. 2023): its files, read.

Two kinds. `calib.json` holds poses in `results`, as x y z qx qy qz qw that map camera points to
LiDAR points, the inverse of ours: `T_lidar_camera` (calibrated), `init_T_lidar_camera` (by hand,
or automatic in old versions), `init_T_lidar_camera_auto`. `BAG_matches.json` holds key points of
the image (`kpts0`) and of the LiDAR's intensity image (`kpts1`), u and v in turn, and for each of
the first the number of its partner or -1 (`matches`); which point a pixel of that image shows
is in `BAG_lidar_indices.png` (32-bit numbers as four channels, -1 for none), the points are in
`BAG.ply`, both beside it.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lcdata.dataset.reader import Dataset
from lcdata.errors import CalibrationError, LcdataError
from lcdata.geometry import se3

Array = NDArray[np.float64]

GUESSES = ("init_T_lidar_camera", "init_T_lidar_camera_auto", "T_lidar_camera")
"""Poses of a calib.json that may be a guess, the first that is there: what its own calibration
starts from, then what it came to."""


def read_toolbox_json(path: Path) -> dict[str, Any]:
    """A JSON file of the toolbox.

    Raises:
        CalibrationError: Not readable, or no JSON object.
    """
    try:
        content = json.loads(path.read_bytes())
    except OSError as error:
        raise CalibrationError(f"{path}: cannot be read ({error.strerror})", "check it") from error
    except ValueError as error:
        raise CalibrationError(f"{path}: no JSON ({error})", "give the toolbox's file") from error
    if not isinstance(content, dict) or not ({"results", "matches"} & content.keys()):
        raise CalibrationError(
            f"{path}: neither a calib.json with results nor matches of the toolbox",
            "give calib.json after an initial guess or calibration, or BAG_matches.json",
        )
    return content


def toolbox_pose(content: dict[str, Any], path: Path) -> tuple[str, Array]:
    """The guess of a calib.json.

    Returns:
        Its name in the file, and 4x4 `T_camera_lidar`: the inverse of what is written.

    Raises:
        CalibrationError: No pose, or one that is none.
    """
    results = content["results"]
    for name in GUESSES:
        if isinstance(results, dict) and name in results:
            try:
                return name, se3.inverse(se3.from_xyz_xyzw(results[name]))
            except (LcdataError, ValueError, TypeError) as error:
                raise CalibrationError(
                    f"{path}: results.{name} is no pose ({error})", "give x y z qx qy qz qw"
                ) from error
    raise CalibrationError(
        f"{path}: no {', '.join(GUESSES)} in its results",
        "run the toolbox's initial_guess_manual or initial_guess_auto first",
    )


def toolbox_matches(content: dict[str, Any], path: Path) -> Array:
    """(N, 5) matches u, v, x, y, z (pixel of the image; point in the LiDAR frame, m).

    Args:
        content: Of a BAG_matches.json.
        path: Where it lies, with BAG_lidar_indices.png and BAG.ply beside it.

    Raises:
        CalibrationError: A file is missing or does not fit, or no match has a point.
    """
    import cv2

    from lcdata.recording.cloud_files import read_cloud

    stem = path.stem.removesuffix("_matches")
    picture, cloud = path.with_name(f"{stem}_lidar_indices.png"), path.with_name(f"{stem}.ply")
    for needed in (picture, cloud):
        if not needed.is_file():
            raise CalibrationError(
                f"{path}: its points are not there: no {needed.name}",
                "keep the toolbox's files together in their folder",
            )
    index = cv2.imread(str(picture), cv2.IMREAD_UNCHANGED)
    if index is None or index.dtype != np.uint8 or index.ndim != 3 or index.shape[2] != 4:
        raise CalibrationError(f"{picture}: no image of four channels", "write it again")
    numbers = np.ascontiguousarray(index).view("<i4")[:, :, 0]
    records = read_cloud(cloud).records
    points = np.stack([records[name].astype(float) for name in "xyz"], axis=1)
    try:
        image, lidar = (np.array(content[k], float).reshape(-1, 2) for k in ("kpts0", "kpts1"))
        partner = np.array(content["matches"], np.int64)
        first = np.flatnonzero(partner >= 0)
        pixels, (u, v) = image[first], lidar[partner[first]].astype(np.int64).T
        shown = numbers[v, u].astype(np.int64)
        chosen = points[shown[shown >= 0]]
    except (KeyError, ValueError, TypeError, IndexError) as error:
        raise CalibrationError(
            f"{path}: does not fit {picture.name} and {cloud.name} ({error})", "write them again"
        ) from error
    if not len(chosen):
        raise CalibrationError(f"{path} has no match with a point", "pick by hand: lcdata pick")
    return np.concatenate([pixels[shown >= 0], chosen], axis=1)


def toolbox_extrinsics(dataset: Dataset, path: Path) -> tuple[dict[str, Array], str]:
    """4x4 `T_camera_lidar` by pair_id from a file of the toolbox: one guess for all pairs.

    Args:
        dataset: Whose pairs. Matches need one camera and one arm pose.
        path: calib.json, or BAG_matches.json.

    Returns:
        The guesses, and where they come from, in words.

    Raises:
        CalibrationError: Not such a file, or one that gives no pose.
    """
    content = read_toolbox_json(path)
    if "results" in content:
        name, T = toolbox_pose(content, path)
        note = f"{path.name}: results.{name} maps camera to LiDAR and was inverted"
    else:
        T, note = _matched_pose(dataset, toolbox_matches(content, path), path)
    return {record.pair_id: T for record in dataset.pairs}, note


def _matched_pose(dataset: Dataset, matches: Array, path: Path) -> tuple[Array, str]:
    """Of matches most of which may be wrong: a rotation that most agree with, then the pose."""
    from lcdata.features.point_pose import point_pose
    from lcdata.features.rotation_ransac import rotation_ransac

    if len(poses := {record.pose_id for record in dataset.pairs}) > 1:
        raise CalibrationError(
            f"{path} is of one pose, the data set has {len(poses)}", "give a data set of that pose"
        )
    camera = dataset.camera(dataset.pairs[0].scenario)
    bearings = camera.unproject(matches[:, :2])
    good = np.isfinite(bearings).all(axis=1)
    matches, bearings = matches[good], bearings[good]
    pixels, points = matches[:, :2], matches[:, 2:]
    if len(matches) > 3:
        away = points / np.linalg.norm(points, axis=1, keepdims=True)
        agree = rotation_ransac(bearings, away)[1]
        pixels, points = pixels[agree], points[agree]
    try:
        pose = point_pose(points, pixels, camera)
    except CalibrationError as error:
        raise CalibrationError(f"{path}: {error.message}", error.remedy) from error
    inliers = int(pose.inliers.sum())
    return pose.T_camera_lidar, f"{path.name}: {inliers} of {len(matches)} matches agree"
