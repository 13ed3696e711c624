"""nuScenes (Caesar et al., 2020): tables in `v1.0-*/*.json`, files in `samples/`.

LiDAR and camera are not triggered at one time, and the vehicle moves in between: a key frame's
image may be 50 ms, at 15 m/s 0.7 m, from its scan, whose points the publisher has brought to one
time. The points are therefore moved to the image's time through the vehicle's poses,

    p' = T_lidar_ego T_ego(image)_world T_world_ego(scan) T_ego_lidar p,

and the pair keeps the extrinsic of the two sensors, T_camera_lidar = T_camera_ego T_ego_lidar,
which is the same for all pairs of a scene. (Put into the extrinsic instead, the motion would give
every pair one of its own: nothing to solve several pairs together for.) What moves by itself stays
where the scan saw it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from lcdata.dataset.importers.calibration import camera_of, intrinsics_of, numbers, read_json
from lcdata.dataset.importers.published import Item, Lost, Published
from lcdata.errors import GeometryError, SourceError
from lcdata.geometry import se3

Array = NDArray[np.float64]
Row = dict[str, Any]
Size = tuple[int, int]
Intrinsics = tuple[float, float, float, float]

TABLES = ("scene", "sample", "sample_data", "calibrated_sensor", "ego_pose", "sensor")
LIDAR = "LIDAR_TOP"
TOLERANCE_MS = 100.0
"""Of a key frame's image and scan; what the vehicle moves in between is taken out."""


@dataclass(frozen=True)
class NuScenes:
    """Scenes of a folder of nuScenes.

    Args:
        source: With `v1.0-mini` or the like and `samples` in it.
        camera: Channel, `CAM_FRONT`.
        version: Folder of tables, where there are several.
    """

    source: Path
    camera: str = "CAM_FRONT"
    version: str = ""
    format: ClassVar[str] = "nuscenes"

    def recordings(self) -> dict[str, Callable[[], Published]]:
        """See `published.Importer`."""
        tables = self._tables
        channels = sorted(str(row.get("channel")) for row in tables.rows("sensor").values())
        for channel in (self.camera, LIDAR):
            if channel not in channels:
                raise SourceError(
                    f"{tables.path('sensor')}: no channel {channel!r}",
                    f"there are {', '.join(channels)}",
                )
        keyframes = tables.keyframes((self.camera, LIDAR))
        scenes: dict[str, list[Row]] = {}
        for sample in tables.rows("sample").values():
            scenes.setdefault(str(sample.get("scene_token")), []).append(sample)
        return {
            str(scene["name"]): partial(self._scene, scene, scenes.get(token, []), keyframes)
            for token, scene in tables.rows("scene").items()
            if "name" in scene
        }

    @cached_property
    def _tables(self) -> Tables:
        return Tables(_folder(self.source, self.version))

    def _scene(
        self, scene: Row, samples: list[Row], keyframes: dict[tuple[str, str], Row]
    ) -> Published:
        name = str(scene["name"])
        items: list[Item | Lost] = []
        camera: tuple[Size, Intrinsics] | None = None
        for sample in sorted(samples, key=lambda row: _integer(row, "timestamp")):
            try:
                rows = (_of_sample(keyframes, sample, channel) for channel in (self.camera, LIDAR))
                item, its_camera = self._item(*rows)
                camera = camera or its_camera
                if its_camera != camera:
                    raise SourceError("its camera_intrinsic differs from the scene's first", "")
                items.append(item)
            except SourceError as error:
                items.append(Lost(f"sample {sample['token']}", str(error)))
        if camera is None:
            lost = next((item.reason for item in items if isinstance(item, Lost)), "no samples")
            raise SourceError(
                f"scene {name}: {lost}", "check that tables and files belong together"
            )
        size, intrinsics = camera
        return Published(
            name=name,
            camera=camera_of(f"{name}: {self.camera}", size, intrinsics, size_given=True),
            items=tuple(items),
            image=self.camera,
            lidar=LIDAR,
            calibration=(),  # in tables of all scenes
            tolerance_ms=TOLERANCE_MS,
        )

    def _item(self, image: Row, scan: Row) -> tuple[Item, tuple[Size, Intrinsics]]:
        """A pair, and size and intrinsics of its camera."""
        tables = self._tables
        of_camera, of_lidar = (tables.get(row, "calibrated_sensor") for row in (image, scan))
        T_ego_camera, T_ego_lidar = tables.pose(of_camera), tables.pose(of_lidar)
        T_world_image, T_world_scan = (
            tables.pose(tables.get(row, "ego_pose")) for row in (image, scan)
        )
        T_image_scan = se3.inverse(T_world_image) @ T_world_scan
        files = [tables.root / str(row.get("filename")) for row in (image, scan)]
        for file, row in zip(files, (image, scan), strict=True):
            if not file.is_file():
                raise SourceError(
                    f"{tables.path('sample_data')}: file {file} of {row['token']} is not there",
                    "unpack all archives of the version into one folder",
                )
        # microseconds in the tables
        stamps = [_integer(row, "timestamp") * 1000 for row in (image, scan)]
        item = Item(
            name=str(stamps[0] // 1000),
            image=files[0],
            cloud=files[1],
            stamp_image_ns=stamps[0],
            stamp_lidar_ns=stamps[1],
            T_camera_lidar=se3.inverse(T_ego_camera) @ T_ego_lidar,
            T_moved=se3.inverse(T_ego_lidar) @ T_image_scan @ T_ego_lidar,
        )
        where = f"{tables.path('calibrated_sensor')}: camera_intrinsic of {of_camera['token']}"
        size = _integer(image, "width"), _integer(image, "height")
        return item, (size, intrinsics_of(of_camera.get("camera_intrinsic", ()), where))


class Tables:
    """The tables of a version, read as they are needed.

    Args:
        folder: `v1.0-mini` or the like.
    """

    def __init__(self, folder: Path) -> None:
        self.folder, self.root = folder, folder.parent
        self._rows: dict[str, dict[str, Row]] = {}

    def path(self, table: str) -> Path:
        """File of a table."""
        return self.folder / f"{table}.json"

    def rows(self, table: str, keep: Callable[[Row], bool] | None = None) -> dict[str, Row]:
        """Rows by token.

        Args:
            table: Its name.
            keep: Which rows are wanted, the first time that the table is asked for: of millions,
                most are not.

        Raises:
            SourceError: No such table, or rows without token.
        """
        if table not in self._rows:

            def hook(row: Row) -> Row | None:
                return None if keep and "token" in row and not keep(row) else row

            content = read_json(self.path(table), hook if keep else None)
            if not isinstance(content, list) or not content:
                raise SourceError(f"{self.path(table)}: no rows in it", "unpack it again")
            kept = [row for row in content if row is not None]
            if not all(isinstance(row, dict) and "token" in row for row in kept):
                raise SourceError(f"{self.path(table)}: rows without token", "unpack it again")
            self._rows[table] = {str(row["token"]): row for row in kept}
        return self._rows[table]

    def get(self, row: Row, table: str) -> Row:
        """The row of another table that a row refers to.

        Raises:
            SourceError: It is not there.
        """
        token = str(row.get(f"{table}_token"))
        found = self.rows(table).get(token)
        if found is None:
            raise SourceError(
                f"{self.path(table)}: no {token}, which {row['token']} refers to",
                "take all tables of one version",
            )
        return found

    def pose(self, row: Row) -> Array:
        """4x4 of a row's translation (m) and rotation (quaternion w x y z).

        Raises:
            SourceError: It has none.
        """
        where = f"{self.folder.name}: {row['token']}"
        p = numbers(row.get("translation", ()), f"{where}: translation")
        q = numbers(row.get("rotation", ()), f"{where}: rotation")
        if (p.shape, q.shape) != ((3,), (4,)):
            raise SourceError(f"{where}: translation, rotation have {p.size}, {q.size} values", "")
        try:
            return se3.from_xyz_xyzw([*p, *q[1:], q[0]])
        except GeometryError as error:
            raise SourceError(f"{where}: {error.message}", error.remedy) from error

    def keyframes(self, channels: Sequence[str]) -> dict[tuple[str, str], Row]:
        """Rows of sample_data of key frames by sample and channel; their poses are read too."""
        wanted = {
            token: str(row["channel"])
            for token, row in self.rows("sensor").items()
            if row.get("channel") in channels
        }
        sensors = {
            token: wanted[str(row.get("sensor_token"))]
            for token, row in self.rows("calibrated_sensor").items()
            if str(row.get("sensor_token")) in wanted
        }
        found = dict(self._of_sensors(sensors, channels))
        poses = {str(row.get("ego_pose_token")) for row in found.values()}
        self.rows("ego_pose", lambda row: str(row["token"]) in poses)
        return found

    def _of_sensors(
        self, sensors: dict[str, str], channels: Sequence[str]
    ) -> Iterator[tuple[tuple[str, str], Row]]:
        for row in self.rows("sample_data", lambda row: bool(row.get("is_key_frame"))).values():
            sensor = str(row.get("calibrated_sensor_token"))
            if sensor in sensors:
                yield (str(row.get("sample_token")), sensors[sensor]), row
            elif sensor not in self.rows("calibrated_sensor"):
                # it may be of any channel: the file's folder has its name
                for channel in channels:
                    if f"/{channel}/" in str(row.get("filename")):
                        yield (str(row.get("sample_token")), channel), row


def _folder(source: Path, version: str) -> Path:
    """The folder with the tables."""
    if version:
        if not (source / version).is_dir():
            raise SourceError(f"{source / version}: no such folder", "check --version")
        return source / version
    if (source / "sample_data.json").is_file():
        return source.resolve()
    found = sorted(path.parent for path in source.glob("*/sample_data.json"))
    if not found:
        raise SourceError(
            f"{source}: no tables of nuScenes in it (v1.0-*/sample_data.json)",
            "give the folder with v1.0-mini or the like and samples in it",
        )
    if len(found) > 1:
        names = ", ".join(path.name for path in found)
        raise SourceError(f"{source}: several versions: {names}", "choose one with --version")
    return found[0]


def _of_sample(keyframes: dict[tuple[str, str], Row], sample: Row, channel: str) -> Row:
    row = keyframes.get((str(sample["token"]), channel))
    if row is None:
        raise SourceError(
            f"no key frame of {channel} of this sample in sample_data.json",
            "take all tables of one version",
        )
    return row


def _integer(row: Row, key: str) -> int:
    """A whole number of a row.

    Raises:
        SourceError: It has none, or one that no clock and no image has.
    """
    value = row.get(key)
    if not isinstance(value, int) or not 0 <= value < 1 << 53:
        raise SourceError(f"{key} of {row['token']} is {value!r}", "take the published tables")
    return value
