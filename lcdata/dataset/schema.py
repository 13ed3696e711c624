"""What a data set holds: its three index files, column by column.

    dataset.json      how the data set was made, one entry a scenario
    pairs.parquet     one row a LiDAR-camera pair
    poses.parquet     one row an arm pose with its ground truth
    groundtruth/      poses.parquet of every version, once there is more than one; the arm's
                      URDF, where the package does not have it
    masks/            masks that an import found beside images, by pair_id

Transforms are stored as x y z (m) qx qy qz qw, covariances as 36 numbers, row by row,
translation before rotation.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from lcdata import __version__
from lcdata.errors import DatasetError
from lcdata.geometry import se3
from lcdata.geometry.camera import Camera
from lcdata.groundtruth.budget import SOURCES

Array = NDArray[np.float64]

SCHEMA_VERSION = 1
"""Raised whenever a reader of the version before would misread a data set."""

INFO, PAIRS, POSES = "dataset.json", "pairs.parquet", "poses.parquet"
RESULTS, REPORT, REVIEW = "results", "report", "review.rrd"
GROUNDTRUTH = "groundtruth"
PICKS = "picks"
MASKS = "masks"

LINKS = ("T_camera_effector", "T_effector_base", "T_base_lidar")

BUDGET = {source: f"covariance_{source}" for source in SOURCES}
"""Columns of the covariance from each source."""

LATER = ("pose_version", *BUDGET.values(), "scans")
"""Columns of poses.parquet and pairs.parquet that older data sets lack."""


@dataclass(frozen=True)
class PairRecord:
    """A row of pairs.parquet.

    Args:
        pair_id: `<scenario>/pose_000/000`, unique in the data set.
        scenario: Name of the recording.
        pose_id: `<scenario>/pose_000`.
        stamp_lidar_ns: Time of the scan on the recording's clock.
        stamp_image_ns: Time of the image on the recording's clock.
        dt_ns: Image minus scan.
        image: Path of the image, relative to the data set.
        cloud: Path of the cloud, relative to the data set.
        image_sha256: Checksum of the image file.
        cloud_sha256: Checksum of the cloud file.
        points: Points in the cloud file, those without a return included.
        scans: Scans that were merged into the cloud; 1 for a scan as it was recorded.
    """

    pair_id: str
    scenario: str
    pose_id: str
    stamp_lidar_ns: int
    stamp_image_ns: int
    dt_ns: int
    image: str
    cloud: str
    image_sha256: str
    cloud_sha256: str
    points: int
    scans: int = 1


@dataclass(frozen=True, eq=False)
class PoseRecord:
    """A row of poses.parquet: an arm pose and its ground truth.

    Args:
        pose_id: `<scenario>/pose_000`.
        scenario: Name of the recording.
        start_ns: First stamp of the dwell.
        end_ns: Last stamp of the dwell.
        joint_positions: (n,) mean over the dwell in radians, in the arm's order; empty without
            an arm.
        joint_positions_std: (n,) scatter within the dwell in radians.
        samples: Joint states in the dwell.
        T_camera_lidar: 4x4 ground truth, maps LiDAR points to camera points.
        covariance: 6x6, translation (m) then rotation (rad), left perturbation in the camera
            frame; NaN where it is unknown.
        T_camera_effector: 4x4 link of the chain; None without an arm.
        T_effector_base: 4x4 link of the chain; None without an arm.
        T_base_lidar: 4x4 link of the chain; None without an arm.
        groundtruth_version: Version of the ground truth; the data set's own.
        pose_version: Version of this pose's own ground truth, which results name: poses that are
            added or move leave it as it is. In older data sets that of the data set.
        budget: 6x6 covariance from each source of uncertainty, see `groundtruth.budget`; they
            add up to `covariance`. Empty where that is unknown.
    """

    pose_id: str
    scenario: str
    start_ns: int
    end_ns: int
    joint_positions: Array
    joint_positions_std: Array
    samples: int
    T_camera_lidar: Array
    covariance: Array
    T_camera_effector: Array | None
    T_effector_base: Array | None
    T_base_lidar: Array | None
    groundtruth_version: str = ""
    pose_version: str = ""
    budget: dict[str, Array] = field(default_factory=dict)


@dataclass(frozen=True)
class Scenario:
    """What dataset.json says about one recording.

    Args:
        camera: Model and intrinsics of its images.
        topics: Topics used: lidar, image, camera_info, joint_states.
        lidar_frame: `frame_id` of the clouds.
        camera_frame: `frame_id` of the images.
        warnings: What a user should know about it, a line each.
        clock_offset: Clock of the arm minus the camera's as measured (`offset_s`, `std_s`), what
            was taken out of the joints' stamps (`applied_s`), and what the rest does to pairs, see
            `recording.clock_report`; None without an arm and in older data sets.
    """

    camera: Camera
    topics: dict[str, str | None]
    lidar_frame: str = ""
    camera_frame: str = ""
    warnings: tuple[str, ...] = ()
    clock_offset: dict[str, Any] | None = None


@dataclass(frozen=True)
class DatasetInfo:
    """dataset.json.

    Args:
        rig: The rig as used, plain values.
        arm: Name, sha256 of the URDF, frames, joint names and joint offsets; None without arm.
        sources: Name, size and fingerprint of each recording.
        scenarios: By name of the recording.
        simulated: Whether the recordings come from a simulation.
        groundtruth_version: Of poses.parquet, see `groundtruth_version`.
        pairs_per_pose: What was asked of the build; None for all.
        failures: Recordings, poses and pairs that could not be used, a line each.
        schema_version: `SCHEMA_VERSION` of the writer.
        lcdata_version: Version of the package that wrote it.
        groundtruth_history: Versions of the ground truth before the present one, oldest first:
            `version`, `rig`, `arm`, and what changed then, see `dataset.regenerate`.
    """

    rig: dict[str, Any]
    arm: dict[str, Any] | None
    sources: tuple[dict[str, Any], ...]
    scenarios: dict[str, Scenario]
    simulated: bool
    groundtruth_version: str = ""
    pairs_per_pose: int | None = None
    failures: tuple[str, ...] = ()
    schema_version: int = SCHEMA_VERSION
    lcdata_version: str = __version__
    groundtruth_history: tuple[dict[str, Any], ...] = ()

    @property
    def as_built(self) -> dict[str, Any]:
        """Rig and arm that the data set was built with, whatever its ground truth is of now."""
        first = self.groundtruth_history[0] if self.groundtruth_history else None
        return {
            "rig": first["rig"] if first else self.rig,
            "arm": first["arm"] if first else self.arm,
        }

    def to_dict(self) -> dict[str, Any]:
        """Plain values, versions first."""
        content = asdict(self)
        first = ("schema_version", "lcdata_version", "groundtruth_version", "simulated")
        return {**{key: content[key] for key in first}, **content}

    @classmethod
    def from_dict(cls, content: Any, path: Path) -> Self:
        """The contents of dataset.json.

        Args:
            content: As parsed.
            path: The file, for errors.

        Raises:
            DatasetError: Older or newer schema, or not a dataset.json.
        """
        version = content.get("schema_version") if isinstance(content, dict) else None
        if not isinstance(version, int) or isinstance(version, bool):
            raise DatasetError(f"{path}: no schema_version", "this is no lcdata data set")
        check_version(version, path)
        try:
            content = {"groundtruth_history": (), **content}
            values = {f.name: content[f.name] for f in fields(cls)}
            values["scenarios"] = {
                name: Scenario(
                    camera=Camera(**scenario["camera"]),
                    topics=dict(scenario["topics"]),
                    lidar_frame=scenario["lidar_frame"],
                    camera_frame=scenario["camera_frame"],
                    warnings=tuple(scenario["warnings"]),
                    clock_offset=scenario.get("clock_offset"),
                )
                for name, scenario in values["scenarios"].items()
            }
        except (KeyError, TypeError, AttributeError) as error:
            raise DatasetError(
                f"{path}: damaged ({type(error).__name__}: {error})", "build the data set again"
            ) from error
        for name in ("sources", "failures", "groundtruth_history"):
            values[name] = tuple(values[name])
        return cls(**values)


def check_version(version: int, path: Path) -> None:
    """Refuse a data set of another schema.

    Raises:
        DatasetError: It is older or newer than this package.
    """
    if version > SCHEMA_VERSION:
        raise DatasetError(
            f"{path}: schema version {version}, this lcdata reads {SCHEMA_VERSION}",
            "upgrade lcdata (pip install --upgrade lcdata)",
        )
    if version < SCHEMA_VERSION:
        raise DatasetError(
            f"{path}: schema version {version} is older than {SCHEMA_VERSION}",
            "build it again from its recordings (lcdata build --force)",
        )


def versioned(poses: Sequence[PoseRecord]) -> list[PoseRecord]:
    """Poses with the versions of their ground truth: of all of them and of each."""
    version = groundtruth_version(poses)
    return [
        replace(pose, groundtruth_version=version, pose_version=pose_version(pose))
        for pose in poses
    ]


def groundtruth_version(poses: Sequence[PoseRecord]) -> str:
    """Name of a ground truth by its values: other extrinsics or covariances, another name.

    Returns:
        12 hexadecimal digits.
    """
    digest = hashlib.sha256()
    poses = sorted(poses, key=lambda pose: in_order(pose.pose_id))
    transforms = se3.to_xyz_xyzw([pose.T_camera_lidar for pose in poses])
    for pose, transform in zip(poses, transforms, strict=True):
        digest.update(pose.pose_id.encode())
        for values in (transform, pose.covariance):
            digest.update(np.ascontiguousarray(values, "<f8").tobytes())
    return digest.hexdigest()[:12]


def pose_version(pose: PoseRecord) -> str:
    """Name of one pose's ground truth by its values, to a nanometre.

    Results carry it, so that errors against an older ground truth are known as such.

    Returns:
        12 hexadecimal digits.
    """
    digest = hashlib.sha256()
    for values, decimals in ((pose.T_camera_lidar, 9), (pose.covariance, 15)):
        rounded = np.round(values, decimals) + 0.0  # no -0
        digest.update(np.ascontiguousarray(rounded, "<f8").tobytes())
    return digest.hexdigest()[:12]


def version_file(version: str) -> str:
    """Where the poses of a version of the ground truth are, relative to the data set."""
    return f"{GROUNDTRUTH}/{version}.parquet"


def in_order(name: str) -> list[str | int]:
    """Sorting key of pair and pose ids: their numbers count as numbers, 1000 after 999."""
    return [int(part) if part.isdecimal() else part for part in re.split(r"(\d+)", name)]


def pairs_table(records: Sequence[PairRecord]) -> Any:
    """`pyarrow.Table` of pairs.parquet."""
    import pyarrow as pa

    texts = ("pair_id", "scenario", "pose_id", "image", "cloud", "image_sha256", "cloud_sha256")
    columns = [
        pa.field(f.name, pa.string() if f.name in texts else pa.int64(), nullable=False)
        for f in fields(PairRecord)
    ]
    return _table([asdict(record) for record in records], columns, "lcdata.pairs")


def poses_table(records: Sequence[PoseRecord]) -> Any:
    """`pyarrow.Table` of poses.parquet."""
    import pyarrow as pa

    transform, numbers = pa.list_(pa.float64(), 7), pa.list_(pa.float64())
    columns = [
        pa.field("pose_id", pa.string(), nullable=False),
        pa.field("scenario", pa.string(), nullable=False),
        pa.field("start_ns", pa.int64(), nullable=False),
        pa.field("end_ns", pa.int64(), nullable=False),
        pa.field("joint_positions", numbers, nullable=False),
        pa.field("joint_positions_std", numbers, nullable=False),
        pa.field("samples", pa.int64(), nullable=False),
        pa.field("T_camera_lidar", transform, nullable=False),
        pa.field("covariance", pa.list_(pa.float64(), 36), nullable=False),
        *(pa.field(name, transform) for name in LINKS),
        pa.field("groundtruth_version", pa.string(), nullable=False),
        pa.field("pose_version", pa.string()),
        *(pa.field(name, pa.list_(pa.float64(), 36)) for name in BUDGET.values()),
    ]
    return _table(pose_rows(records), columns, "lcdata.poses")


def pose_rows(records: Sequence[PoseRecord]) -> list[dict[str, Any]]:
    """Plain values, as poses.parquet has them. Transforms are converted all at once: fast."""
    rows = [{f.name: getattr(r, f.name) for f in fields(r)} for r in records]
    for name in ("T_camera_lidar", *LINKS):
        there = [row for row in rows if row[name] is not None]
        values = se3.to_xyz_xyzw([row[name] for row in there])
        for row, value in zip(there, values, strict=True):
            row[name] = value
    for row in rows:
        row["covariance"] = np.reshape(row["covariance"], 36)
        budget = row.pop("budget")
        for source, column in BUDGET.items():
            row[column] = np.reshape(budget[source], 36) if source in budget else None
    return rows


def pose_records(rows: Sequence[Mapping[str, Any]]) -> list[PoseRecord]:
    """The records of rows of poses.parquet; columns of others are ignored."""
    result: list[dict[str, Any]] = [
        {f.name: row.get(f.name) for f in fields(PoseRecord) if f.name != "budget"} for row in rows
    ]
    for name in ("T_camera_lidar", *LINKS):
        there = [values for values in result if values[name] is not None]
        stack = se3.from_xyz_xyzw(np.reshape([values[name] for values in there], (-1, 7)))
        for values, T in zip(there, stack, strict=True):
            values[name] = T
    for values, row in zip(result, rows, strict=True):
        for name in ("joint_positions", "joint_positions_std"):
            values[name] = np.array(values[name], float)
        values["pose_version"] = values["pose_version"] or values["groundtruth_version"]
        values["covariance"] = np.reshape(np.array(values["covariance"], float), (6, 6))
        values["budget"] = {
            source: np.reshape(np.array(row[column], float), (6, 6))
            for source, column in BUDGET.items()
            if row.get(column) is not None
        }
    return [PoseRecord(**values) for values in result]


def _table(rows: list[dict[str, Any]], columns: list[Any], kind: str) -> Any:
    import pyarrow as pa

    metadata = {"kind": kind, "schema_version": str(SCHEMA_VERSION)}
    return pa.Table.from_pylist(rows, pa.schema(columns, metadata))


def plain(value: Any) -> Any:
    """A value as it comes back from JSON: lists for tuples, text for keys."""
    return json.loads(json.dumps(value))
