"""Results on disk: one Parquet file a run in DATASET/results, one row a trial."""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lcdata.calibrators.base import LineMatches
from lcdata.errors import ReportError
from lcdata.evaluation import metrics
from lcdata.evaluation.comparison import Comparison, compare
from lcdata.geometry import se3

if TYPE_CHECKING:
    import pyarrow as pa
    import pyarrow.parquet as pq

    from lcdata.dataset import Dataset
    from lcdata.dataset.schema import PoseRecord

Array = NDArray[np.float64]

SCHEMA_VERSION = 2
"""2 has `initial_groundtruth_version`; files of 1 are read too."""

FOLDER = "results"


class Guess(NamedTuple):
    """An initial guess.

    Args:
        T_camera_lidar: 4x4; None for none.
        groundtruth_version: The ground truth that it was made from.
    """

    T_camera_lidar: Array | None
    groundtruth_version: str


@dataclass(frozen=True, eq=False)
class TrialResult:
    """One estimate of one method from one initial guess. Fields are the file's columns.

    Args:
        run: Name of the run: the trials that were made by one protocol.
        method: Name of the method.
        method_version: `Calibrator.version`.
        parameters: The method's parameters as JSON.
        lcdata_version: Version that made this row.
        pair_ids: The pairs that were solved jointly; usually one.
        scenario: Name of the recording.
        pose_id: Name of the arm pose.
        trial: Number of the trial on these pairs.
        seed: Seed of the run.
        group: "pair", or "pose" where all pairs of a pose were solved jointly.
        init_rotation_deg: Initial error about each axis, degrees.
        init_translation_m: Initial error along each axis, metres.
        T_camera_lidar_initial: 4x4 initial guess; None where the method got none.
        T_camera_lidar_estimated: 4x4 estimate; None if the method gave none.
        covariance: 6x6 that the method predicts for its estimate; NaN where unknown.
        initial_rotation_error_deg: Geodesic angle of the initial guess, degrees; NaN without one.
        initial_translation_error_m: L2 norm of the initial guess's error, metres.
        rotation_error_deg: Geodesic angle, degrees; NaN without an estimate.
        translation_error_m: L2 norm, metres; NaN without an estimate.
        sigma_distance: Error in ground-truth standard deviations; NaN where unknown.
        groundtruth_rotation_sigma_deg: Root mean square error of the ground truth itself.
        groundtruth_translation_sigma_m: The same for the translation.
        groundtruth_version: Version of the pose's ground truth that the errors are against.
        converged: The method's own verdict.
        degenerate: The data do not determine all degrees of freedom, says the method.
        failed: There is no estimate: an error was raised or the process died.
        cost_initial: The method's cost at the initial guess.
        cost_final: The method's cost at the estimate.
        seconds: Wall time of the calibration, features included.
        features_seconds: The part of it that the trials on these pairs share.
        message: What went wrong or should be known.
        initial_groundtruth_version: Version that the initial guess was made from; empty for the
            one that the errors are against.
        matches: Matched lines (columns matches_lidar, matches_image, matches_pair, flattened).
    """

    run: str
    method: str
    method_version: int
    parameters: str
    lcdata_version: str
    pair_ids: tuple[str, ...]
    scenario: str
    pose_id: str
    trial: int
    seed: int
    group: str
    init_rotation_deg: float
    init_translation_m: float
    T_camera_lidar_initial: Array | None
    groundtruth_version: str
    T_camera_lidar_estimated: Array | None = None
    covariance: Array = field(default_factory=lambda: np.full((6, 6), np.nan))
    initial_rotation_error_deg: float = math.nan
    initial_translation_error_m: float = math.nan
    rotation_error_deg: float = math.nan
    translation_error_m: float = math.nan
    sigma_distance: float = math.nan
    groundtruth_rotation_sigma_deg: float = math.nan
    groundtruth_translation_sigma_m: float = math.nan
    converged: bool = False
    degenerate: bool = False
    failed: bool = True
    cost_initial: float = math.nan
    cost_final: float = math.nan
    seconds: float = math.nan
    features_seconds: float = math.nan
    message: str = ""
    initial_groundtruth_version: str = ""
    matches: LineMatches = field(default_factory=LineMatches.empty)

    @property
    def diverged(self) -> bool:
        """Whether the method's own cost grew."""
        return self.cost_final > self.cost_initial

    @property
    def success(self) -> bool:
        """Whether both errors are below 0.5 deg and 0.1 m."""
        return metrics.is_success(self.rotation_error_deg, self.translation_error_m)

    @property
    def guess(self) -> Guess:
        """Where it started."""
        return Guess(self.T_camera_lidar_initial, self.initial_groundtruth_version)

    @property
    def rebased(self) -> bool:
        """Whether the initial guess was made from another ground truth than that of the errors."""
        guessed = self.T_camera_lidar_initial is not None
        return guessed and self.initial_groundtruth_version not in {"", self.groundtruth_version}

    @property
    def key(self) -> tuple[str, tuple[str, ...], int]:
        """What a run has one row of: method, pairs, trial."""
        return self.method, self.pair_ids, self.trial

    @property
    def name(self) -> str:
        """Method, pairs and trial in words."""
        pairs = self.pair_ids[0] if len(self.pair_ids) == 1 else f"{self.pose_id} (jointly)"
        return f"{self.method} on {pairs}, trial {self.trial}"

    def against(self, pose: PoseRecord) -> TrialResult:
        """The same trial, its errors measured against a pose's ground truth."""
        T, estimate = pose.T_camera_lidar, self.T_camera_lidar_estimated
        initial = self.T_camera_lidar_initial
        sigma = metrics.groundtruth_sigma(T, pose.covariance)
        rotation_error_deg = translation_error_m = sigma_distance = math.nan
        if estimate is not None:
            rotation_error_deg = metrics.rotation_error_deg(estimate, T)
            translation_error_m = metrics.translation_error_m(estimate, T)
            sigma_distance = se3.sigma_distance(estimate, T, pose.covariance)
        return dataclasses.replace(
            self,
            rotation_error_deg=rotation_error_deg,
            translation_error_m=translation_error_m,
            sigma_distance=sigma_distance,
            initial_rotation_error_deg=math.nan
            if initial is None
            else metrics.rotation_error_deg(initial, T),
            initial_translation_error_m=math.nan
            if initial is None
            else metrics.translation_error_m(initial, T),
            groundtruth_rotation_sigma_deg=sigma.rotation_deg,
            groundtruth_translation_sigma_m=sigma.translation_m,
            groundtruth_version=pose.pose_version,
            initial_groundtruth_version=self.initial_groundtruth_version
            or self.groundtruth_version,
        )


@dataclass(frozen=True, eq=False)
class Results:
    """Trials of one run or of several."""

    trials: tuple[TrialResult, ...] = ()

    @property
    def failures(self) -> list[str]:
        """Every trial that gave no estimate, and why."""
        return [f"{t.name}: {t.message}" for t in self.trials if t.failed]

    @cached_property
    def summaries(self) -> list[metrics.Summary]:
        """Table of `metrics.summarise`."""
        return metrics.summarise(self.trials)

    @cached_property
    def comparisons(self) -> list[Comparison]:
        """Methods two by two, on the trials that both have made."""
        return compare(self.trials)

    def to_dict(self) -> dict[str, Any]:
        """Summaries, comparisons and failures as plain values."""
        summaries = [
            dataclasses.asdict(s)
            | {"success_rate": s.success_rate, "explained_rate": s.explained_rate}
            for s in self.summaries
        ]
        for summary in summaries:
            for name in ("rotation_deg", "translation_m", "groundtruth"):
                summary[name] = summary[name]._asdict()
        comparisons = [
            dataclasses.asdict(c) | {"better": c.better or None} for c in self.comparisons
        ]
        return {"summary": summaries, "comparisons": comparisons, "failures": self.failures}

    def split_stale(self, dataset: Dataset) -> tuple[Results, Results]:
        """Trials measured against the data set's present ground truth, and all others."""
        versions = {pose.pose_id: pose.pose_version for pose in dataset.poses}
        is_current = [versions.get(t.pose_id) == t.groundtruth_version for t in self.trials]
        current = tuple(t for t, ok in zip(self.trials, is_current, strict=True) if ok)
        stale = tuple(t for t, ok in zip(self.trials, is_current, strict=True) if not ok)
        return Results(current), Results(stale)

    def recomputed(self, dataset: Dataset) -> Results:
        """The same estimates, errors measured against the present ground truth.

        Initial guesses stay where they were, so initial errors are no longer the protocol's
        round numbers: such trials are `rebased`. Trials of poses that the data set no longer has
        are left as they are.
        """
        poses = {pose.pose_id: pose for pose in dataset.poses}
        return Results(
            tuple(t.against(poses[t.pose_id]) if t.pose_id in poses else t for t in self.trials)
        )


def results_path(dataset: Dataset, run: str) -> Path:
    """Where the results of a run are."""
    return Path(dataset.path) / FOLDER / f"{run}.parquet"


def read_results(dataset: Dataset, run: str | None = None) -> Results:
    """Results of one run, or of all runs of a data set in the order of their names.

    Raises:
        ReportError: A file that cannot be read or is of another version.
    """
    if run is not None:
        path = results_path(dataset, run)
        return read_run(path) if path.exists() else Results()
    paths = sorted((Path(dataset.path) / FOLDER).glob("[!.]*.parquet"))
    return Results(tuple(trial for path in paths for trial in read_run(path).trials))


def read_run(path: Path) -> Results:
    """Read one results file."""
    with readable(path) as file:
        return Results(tuple(_from_row(row) for row in file.read().to_pylist()))


@contextmanager
def readable(path: Path) -> Iterator[pq.ParquetFile]:
    """A file of results to be read; what is wrong with it is told by its name.

    Raises:
        ReportError: It cannot be read or is of another version.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        with pq.ParquetFile(path) as file:
            version = int((file.schema_arrow.metadata or {}).get(b"lcdata.results", b"0"))
            if version not in {1, SCHEMA_VERSION}:
                age = "a newer" if version > SCHEMA_VERSION else "another"
                raise ReportError(
                    f"{path} has results schema {version}, this lcdata reads {SCHEMA_VERSION}",
                    f"it was written by {age} version: use that, or calibrate again",
                )
            yield file
    except (pa.ArrowException, OSError, KeyError, TypeError, ValueError) as error:
        first = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise ReportError(
            f"{path} is not a results file ({first})", "delete it and calibrate again"
        ) from error


def write_run(path: Path, trials: Iterable[TrialResult]) -> None:
    """Write one results file, atomically; its folder is made."""
    from lcdata.dataset.atomic import write_parquet

    write_parquet(path, to_table(trials))


def to_table(trials: Iterable[TrialResult]) -> pa.Table:
    """Trials as they are stored."""
    import pyarrow as pa

    return pa.Table.from_pylist([_to_row(trial) for trial in trials], schema=_schema())


def from_table(table: pa.Table) -> list[TrialResult]:
    """Stored trials."""
    return [_from_row(row) for row in table.to_pylist()]


def _schema() -> pa.Schema:
    """Arrow schema of a results file."""
    import pyarrow as pa

    pose, flat = pa.list_(pa.float64(), 7), pa.list_(pa.float32())
    special = {
        "pair_ids": pa.list_(pa.string()),
        "T_camera_lidar_initial": pose,
        "T_camera_lidar_estimated": pose,
        "covariance": pa.list_(pa.float64(), 36),
    }
    plain = {"str": pa.string(), "int": pa.int64(), "float": pa.float64(), "bool": pa.bool_()}
    columns = [
        (f.name, special[f.name] if f.name in special else plain[str(f.type)])
        for f in dataclasses.fields(TrialResult)
        if f.name != "matches"
    ]
    columns += [("matches_lidar", flat), ("matches_image", flat)]
    columns += [("matches_pair", pa.list_(pa.int32()))]
    metadata = {
        "lcdata.results": str(SCHEMA_VERSION),
        "lcdata.units": json.dumps(
            {
                "T_*": "x y z (m) qx qy qz qw; maps LiDAR points to camera points",
                "covariance": "row-major 6x6, translation (m) then rotation (rad), left, camera",
                "matches_lidar": "M segments of x y z x y z in the LiDAR frame, metres",
                "matches_image": "M segments of u v u v in the undistorted image, pixels",
                "matches_pair": "M indices into pair_ids",
            }
        ),
    }
    return pa.schema(columns, metadata=metadata)


def _to_row(trial: TrialResult) -> dict[str, Any]:
    row = {f.name: getattr(trial, f.name) for f in dataclasses.fields(trial)}
    matches = row.pop("matches")
    for name in ("T_camera_lidar_initial", "T_camera_lidar_estimated"):
        row[name] = None if row[name] is None else se3.to_xyz_xyzw(row[name])
    return row | {
        "pair_ids": list(trial.pair_ids),
        "covariance": np.ravel(trial.covariance),
        "matches_lidar": np.ravel(matches.points_lidar).astype(np.float32),
        "matches_image": np.ravel(matches.points_image).astype(np.float32),
        "matches_pair": np.ravel(matches.pair_index).astype(np.int32),
    }


def _from_row(row: dict[str, Any]) -> TrialResult:
    for name in ("T_camera_lidar_initial", "T_camera_lidar_estimated"):
        row[name] = None if row[name] is None else se3.from_xyz_xyzw(row[name])
    matches = LineMatches(
        np.array(row.pop("matches_lidar"), float).reshape(-1, 2, 3),
        np.array(row.pop("matches_image"), float).reshape(-1, 2, 2),
        np.array(row.pop("matches_pair"), np.int64),
    )
    return TrialResult(
        **row
        | {
            "pair_ids": tuple(row["pair_ids"]),
            "covariance": np.array(row["covariance"], float).reshape(6, 6),
            "matches": matches,
        }
    )
