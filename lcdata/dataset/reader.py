"""Reading a data set: index at once, pairs one at a time."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from dataclasses import fields as columns
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self, TypeVar, cast

import numpy as np
from numpy.typing import DTypeLike, NDArray

from lcdata.dataset import arms, cloud_file, journal, schema
from lcdata.dataset.schema import DatasetInfo, PairRecord, PoseRecord
from lcdata.errors import DatasetError, GeometryError, MessageError
from lcdata.geometry.camera import Camera
from lcdata.pair import Pair
from lcdata.recording import fields, images
from lcdata.rig import Rig

if TYPE_CHECKING:
    from lcdata.arm import Arm

T = TypeVar("T")


@dataclass(frozen=True, eq=False)
class Dataset:
    """A data set on disk.

        dataset = Dataset.open(Path("DATASET"))
        for pair in dataset:
            pair.image, pair.points, pair.T_camera_lidar

    Args:
        path: Its folder.
        info: dataset.json.
        pairs: Rows of pairs.parquet, sorted by pair_id.
        poses: Rows of poses.parquet, sorted by pose_id.
    """

    path: Path
    info: DatasetInfo
    pairs: tuple[PairRecord, ...]
    poses: tuple[PoseRecord, ...]

    @classmethod
    def open(cls, path: Path | str) -> Self:
        """Open a data set; reads its index, no images or clouds.

        Args:
            path: Its folder, or a URL that fsspec reads.

        Raises:
            DatasetError: Not there, unfinished, damaged, or of another schema version.
            MissingLibraryError: What a URL's protocol needs is not installed.
        """
        from lcdata.dataset import remote

        if remote.is_url(path):
            return cast("Self", remote.open_remote(str(path)))
        path = Path(path)
        info = read_info(path)
        pairs = [PairRecord(**row) for row in _rows(path / schema.PAIRS, PairRecord)]
        poses = read_poses(path / schema.POSES)
        kept = path / schema.version_file(info.groundtruth_version)
        if any(p.groundtruth_version != info.groundtruth_version for p in poses) and kept.is_file():
            # `lcdata groundtruth` was killed between its last two files: dataset.json counts
            poses = read_poses(kept)
        pairs.sort(key=lambda record: schema.in_order(record.pair_id))
        return cls(path, info, tuple(pairs), tuple(poses))

    @property
    def address(self) -> Path | str:
        """Where other processes open it: its folder, resolved, or its URL."""
        return self.path.resolve()

    def place(self, name: str) -> Path | str:
        """Where one of its files is, for people."""
        return self.path / name

    def read_bytes(self, name: str) -> bytes:
        """Content of one of its files.

        Raises:
            OSError: It cannot be read.
            DatasetError: It cannot be read, at a URL.
        """
        return (self.path / name).read_bytes()

    def __len__(self) -> int:
        return len(self.pairs)

    def __iter__(self) -> Iterator[Pair]:
        return (self.load(record.pair_id) for record in self.pairs)

    @cached_property
    def rig(self) -> Rig:
        """The rig that the data set was made with."""
        return Rig.from_dict(self.info.rig, f"{self.path / schema.INFO} (rig)")

    @cached_property
    def _pairs_by_id(self) -> dict[str, PairRecord]:
        return {record.pair_id: record for record in self.pairs}

    @cached_property
    def _poses_by_id(self) -> dict[str, PoseRecord]:
        return {record.pose_id: record for record in self.poses}

    @property
    def scenarios(self) -> tuple[str, ...]:
        """Names of the recordings that it has pairs of."""
        return tuple(sorted({record.scenario for record in self.pairs}))

    def pair(self, pair_id: str) -> PairRecord:
        """Row of a pair."""
        return _look_up(self._pairs_by_id, pair_id, "pair", self.path)

    def pose(self, pose_id: str) -> PoseRecord:
        """Row of a pose."""
        return _look_up(self._poses_by_id, pose_id, "pose", self.path)

    def camera(self, scenario: str) -> Camera:
        """Camera of a recording."""
        return _look_up(self.info.scenarios, scenario, "scenario", self.path).camera

    def load_arm(self) -> Arm:
        """The arm that the ground truth is of: no file beside the data set is needed.

        Raises:
            DatasetError: It was made without an arm, or with another URDF of the arm's name.
            ArmError: Its model is not in this package.
        """
        return arms.load_arm(self.path, self.info, self.rig)

    def load(self, pair_id: str) -> Pair:
        """Image, cloud and ground truth of a pair.

        Raises:
            DatasetError: Unknown pair, or a file that is missing or damaged.
        """
        return self.decode(pair_id, *self.files(pair_id))

    def files(self, pair_id: str) -> tuple[bytes, bytes]:
        """Image file and cloud file of a pair as they are stored.

        Raises:
            DatasetError: Unknown pair, or a file that cannot be read.
        """
        record = self.pair(pair_id)
        found = []
        for name in (record.image, record.cloud):
            try:
                found.append(self.read_bytes(name))
            except OSError as error:
                raise DatasetError(
                    f"{self.place(name)}: cannot be read ({error.strerror})",
                    "`lcdata validate` lists what is wrong",
                ) from error
        return found[0], found[1]

    def decode(self, pair_id: str, image: bytes, cloud: bytes) -> Pair:
        """A pair of its two files' contents.

        Raises:
            DatasetError: Unknown pair, or a file that is damaged.
        """
        record = self.pair(pair_id)
        pose = self.pose(record.pose_id)
        records, height, width = cloud_file.decode(cloud, self.place(record.cloud))
        try:
            points = fields.points(records)
        except MessageError as error:
            raise DatasetError(f"{self.place(record.cloud)}: {error.message}") from error
        points[~np.isfinite(points).all(axis=1)] = np.nan
        intensity = _values(records, fields.intensity_name(records.dtype), np.float32)
        ring = _values(records, fields.ring_name(records.dtype), np.int32)
        organised = (height, width) if height > 1 and width > 1 else None
        if organised is None:  # a grid needs its empty places, a list does not
            returned = np.isfinite(points[:, 0])
            points = points[returned]
            intensity = None if intensity is None else intensity[returned]
            ring = None if ring is None else ring[returned]
        return Pair(
            image=_decoded(image, self.place(record.image)),
            points=points,
            intensity=intensity,
            camera=self.camera(record.scenario),
            organised=organised,
            ring=ring,
            pair_id=record.pair_id,
            pose_id=record.pose_id,
            scenario=record.scenario,
            T_camera_lidar=pose.T_camera_lidar,
            covariance=pose.covariance,
        )

    def results(self) -> Any:
        """All stored results, run after run, as one `pyarrow.Table`; None if there are none.

        Raises:
            DatasetError: A file of results that cannot be read.
        """
        import pyarrow as pa

        tables = [read_table(path) for path in self.result_files()]
        return pa.concat_tables(tables, promote_options="permissive") if tables else None

    def result_files(self) -> list[Path]:
        """Files of stored results, by name of the run."""
        return sorted((self.path / schema.RESULTS).glob("[!.]*.parquet"))


def read_info(path: Path) -> DatasetInfo:
    """dataset.json of a data set.

    Raises:
        DatasetError: No data set, an unfinished one, or of another schema version.
    """
    file = path / schema.INFO
    if not file.is_file():
        if (path / journal.NAME).is_file():
            raise DatasetError(
                f"{path}: its build has not finished",
                "run the same `lcdata build` or `lcdata import` again",
            )
        missing = "no such folder" if not path.exists() else f"no {schema.INFO} in it"
        raise DatasetError(
            f"{path} is no data set ({missing})", "`lcdata build RECORDINGS -o DATASET` makes one"
        )
    try:
        content = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise DatasetError(f"{file}: damaged ({error})", "build the data set again") from error
    return DatasetInfo.from_dict(content, file)


def read_poses(path: Path) -> list[PoseRecord]:
    """Rows of a poses.parquet, sorted by pose_id.

    Raises:
        DatasetError: Not there, or damaged.
    """
    try:
        poses = schema.pose_records(_rows(path, PoseRecord))
    except (GeometryError, TypeError, ValueError) as error:
        raise DatasetError(f"{path}: damaged ({error})") from error
    return sorted(poses, key=lambda record: schema.in_order(record.pose_id))


def read_image(path: Path) -> NDArray[np.uint8]:
    """(H, W) or (H, W, 3) RGB of an image file, as stored: no rotation by EXIF.

    Raises:
        DatasetError: Not there, or not an image.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise DatasetError(
            f"{path}: cannot be read ({error.strerror})", "`lcdata validate` lists what is wrong"
        ) from error
    return _decoded(data, path)


def _decoded(data: bytes, path: Path | str) -> NDArray[np.uint8]:
    """An image file's content, see `read_image`."""
    try:
        return images.decode_file(data)
    except MessageError as error:
        raise DatasetError(f"{path}: {error.message}", "build the data set again") from error


def read_table(path: Path) -> Any:
    """A Parquet file as a `pyarrow.Table`.

    Raises:
        DatasetError: Not there, or not Parquet.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        return pq.ParquetFile(path).read()
    except (OSError, pa.ArrowException) as error:
        reason = str(error).strip().splitlines()[0]
        raise DatasetError(f"{path}: cannot be read ({reason})") from error


def _values(records: NDArray[np.void], name: str | None, dtype: DTypeLike) -> NDArray[Any] | None:
    """(N,) contiguous values of a field; None without one."""
    return None if name is None else np.ascontiguousarray(records[name], dtype)


def _rows(path: Path, record: type[Any]) -> list[dict[str, Any]]:
    """Rows of an index file; columns that this version does not know are left out."""
    names = [f.name for f in columns(record) if f.name not in {"budget", *schema.LATER}]
    table = read_table(path)
    missing = [name for name in names if name not in table.column_names]
    if missing:
        raise DatasetError(f"{path}: no column {', '.join(missing)}", "build the data set again")
    rows: list[dict[str, Any]] = table.select(
        [*names, *(name for name in schema.LATER if name in table.column_names)]
    ).to_pylist()
    return rows


def _look_up(mapping: Mapping[str, T], key: str, kind: str, path: Path) -> T:
    if key not in mapping:
        shown = ", ".join([*list(mapping)[:3], "..."] if len(mapping) > 4 else mapping) or "none"
        raise DatasetError(f"{path} has no {kind} {key!r}", f"it has {shown}")
    return mapping[key]
