"""Matches that a person picked, and the extrinsic that they give: `picks/<pair_id>.json`.

They are work by hand: nothing but `lcdata pick` writes them, and a new build leaves them alone.
"""

from __future__ import annotations

import csv
import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lcdata import __version__
from lcdata.dataset import schema
from lcdata.dataset.atomic import write_json
from lcdata.dataset.reader import Dataset
from lcdata.errors import CalibrationError, DatasetError
from lcdata.features.point_pose import PointPose, point_pose
from lcdata.geometry import se3

Array = NDArray[np.float64]

COLUMNS = ("u", "v", "x", "y", "z")
"""Of a match: pixel of the raw image, and point in the LiDAR frame (m)."""


@dataclass(frozen=True, eq=False)
class Picks:
    """Matches of one pair.

    Args:
        pair_id: The pair.
        matches: (N, 5) `COLUMNS`.
        T_camera_lidar: 4x4 that they give.
    """

    pair_id: str
    matches: Array
    T_camera_lidar: Array


def picks_path(dataset: Dataset, pair_id: str) -> Path:
    """Where the picks of a pair are kept."""
    return dataset.path / schema.PICKS / f"{pair_id}.json"


def write_picks(dataset: Dataset, pair_id: str, matches: Array, pose: PointPose) -> Path:
    """Write the picks of a pair atomically; former ones are replaced.

    Raises:
        DatasetError: Unknown pair, or a disk that cannot be written.
    """
    record, path = dataset.pair(pair_id), picks_path(dataset, pair_id)
    content = {
        "lcdata": __version__,
        "pair_id": pair_id,
        "image_sha256": record.image_sha256,
        "cloud_sha256": record.cloud_sha256,
        "columns": list(COLUMNS),
        "matches": np.asarray(matches, float).round(6).tolist(),
        "T_camera_lidar": pose.T_camera_lidar.tolist(),
        "covariance": pose.covariance.tolist(),
        "residuals_px": [round(float(r), 3) for r in pose.residuals_px],
        "warnings": list(pose.warnings),
    }
    write_json(path, content)
    return path


def read_picks(dataset: Dataset, pair_id: str) -> Picks | None:
    """Picks of a pair; None without any.

    Raises:
        DatasetError: Damaged, or of another image or cloud than the pair has now.
    """
    record, path = dataset.pair(pair_id), picks_path(dataset, pair_id)
    try:
        content = json.loads(path.read_bytes())
        matches = np.array(content["matches"], float).reshape(-1, len(COLUMNS))
        T = se3.check_transform(content["T_camera_lidar"], f"T_camera_lidar of {path}")
        known = content["image_sha256"], content["cloud_sha256"]
    except FileNotFoundError:
        return None
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise DatasetError(f"{path}: damaged ({error})", "pick again, or remove it") from error
    if known != (record.image_sha256, record.cloud_sha256):
        raise DatasetError(
            f"{path} was picked on another image or cloud", "pick again, or remove it"
        )
    return Picks(pair_id, matches, T)


def picked_extrinsics(dataset: Dataset) -> dict[str, Array]:
    """4x4 `T_camera_lidar` by pair_id: a pair's own picks, or those of a pair of its pose.

    Raises:
        CalibrationError: There are no picks.
        DatasetError: Damaged ones, or of another image or cloud.
    """
    own = {r.pair_id: picks for r in dataset.pairs if (picks := read_picks(dataset, r.pair_id))}
    if not own:
        raise CalibrationError(
            f"{dataset.path} has no picks", "`lcdata pick DATASET PAIR` makes them"
        )
    of_pose: dict[str, Array] = {}
    for pair_id, picks in own.items():
        of_pose.setdefault(dataset.pair(pair_id).pose_id, picks.T_camera_lidar)
    found = {r.pair_id: of_pose[r.pose_id] for r in dataset.pairs if r.pose_id in of_pose}
    return found | {pair_id: picks.T_camera_lidar for pair_id, picks in own.items()}


def matched_extrinsics(dataset: Dataset, path: Path) -> dict[str, Array]:
    """4x4 `T_camera_lidar` by pair_id from a CSV of matches: `u,v,x,y,z`, or `pair_id` before.

    Without a `pair_id` column the matches are of all pairs, which must share one pose.

    Raises:
        CalibrationError: Not such a file, or matches that give no pose.
    """
    rows = read_matches(path)
    if "" in rows:
        if len(poses := {record.pose_id for record in dataset.pairs}) > 1:
            raise CalibrationError(
                f"{path} does not say which of {len(poses)} poses its matches are of",
                "add a column pair_id",
            )
        rows = {dataset.pairs[0].pair_id: rows[""]}
    found: dict[str, Array] = {}
    for pair_id, matches in rows.items():
        record = dataset.pair(pair_id)
        try:
            pose = point_pose(matches[:, 2:], matches[:, :2], dataset.camera(record.scenario))
        except CalibrationError as error:
            raise CalibrationError(f"{path}: {pair_id}: {error.message}", error.remedy) from error
        for other in dataset.pairs:
            if other.pose_id == record.pose_id:
                found.setdefault(other.pair_id, pose.T_camera_lidar)
        found[pair_id] = pose.T_camera_lidar
    return found


def read_matches(path: Path) -> dict[str, Array]:
    """(N, 5) matches of a CSV with the columns u v x y z, by pair_id ("" without that column).

    Raises:
        CalibrationError: Not readable, a column missing, or a value that is no number.
    """
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "it is no text file"
        raise CalibrationError(f"{path}: cannot be read ({reason})", "check the file") from error
    lines = csv.DictReader(line for line in text.splitlines() if line.strip())
    names = [name.strip() for name in lines.fieldnames or ()]
    lines.fieldnames = names
    if missing := [name for name in COLUMNS if name not in names]:
        raise CalibrationError(
            f"{path}: no column {', '.join(missing)}", f"its first line names {','.join(COLUMNS)}"
        )
    found: dict[str, list[list[float]]] = {}
    for number, line in enumerate(lines, 2):
        try:
            row = [float(line[name]) for name in COLUMNS]
        except (TypeError, ValueError) as error:
            raise CalibrationError(f"{path}:{number}: a value is no number", "mend it") from error
        found.setdefault((line.get("pair_id") or "").strip(), []).append(row)
    if not found:
        raise CalibrationError(f"{path} has no matches", "give 3 or more")
    return {pair_id: np.array(rows) for pair_id, rows in found.items()}
