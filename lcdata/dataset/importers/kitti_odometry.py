"""KITTI's odometry benchmark: `sequences/00/{calib.txt,times.txt,image_2,velodyne}`.

`Tr` maps LiDAR points to the rectified reference camera, `P2` projects those to the image of the
left colour camera: T_camera_lidar = [I | K^-1 P2[:, 3]] * Tr, with K of P2.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import ClassVar

from lcdata.dataset.importers import files
from lcdata.dataset.importers.calibration import camera_of, rigid, split_projection
from lcdata.dataset.importers.kitti_calib import at, read_calibration, read_times, value
from lcdata.dataset.importers.kitti_raw import read_scan
from lcdata.dataset.importers.published import Item, Lost, Published
from lcdata.errors import SourceError

CAMERAS = ("image_0", "image_1", "image_2", "image_3")
LIDAR = "velodyne"
REMEDY = "data_odometry_calib.zip has calib.txt with P0 to P3 and Tr"


@dataclass(frozen=True)
class KittiOdometry:
    """Sequences below a folder: that of the benchmark, `sequences`, or one sequence itself.

    Args:
        source: The folder.
        camera: `image_0` to `image_3`.
    """

    source: Path
    camera: str = "image_2"
    format: ClassVar[str] = "kitti-odometry"

    def recordings(self) -> dict[str, Callable[[], Published]]:
        """See `published.Importer`."""
        if self.camera not in CAMERAS:
            raise SourceError(f"no camera {self.camera!r} in KITTI", f"one of {', '.join(CAMERAS)}")
        source = self.source.resolve()
        folders = [source] if self._is_sequence(source) else []
        if not folders:
            inside = [*source.glob("*/"), *source.glob("sequences/*/")]
            folders = sorted(folder for folder in inside if self._is_sequence(folder))
        if not folders:
            raise SourceError(
                f"{self.source}: no sequence with {self.camera} and {LIDAR} in it",
                "give the folder with sequences/00, or one sequence",
            )
        return {folder.name: partial(self._sequence, folder) for folder in folders}

    def _is_sequence(self, folder: Path) -> bool:
        return (folder / LIDAR).is_dir() and (folder / self.camera).is_dir()

    def _sequence(self, folder: Path) -> Published:
        calib = folder / "calib.txt"
        found = read_calibration(calib, REMEDY)
        P = self.camera.replace("image_", "P")
        intrinsics, T_camera_reference = split_projection(
            value(found, P, calib, REMEDY), f"{calib}: {P}"
        )
        T_camera_lidar = T_camera_reference @ rigid(
            value(found, "Tr", calib, REMEDY), f"{calib}: Tr"
        )
        stamps = read_times(folder / "times.txt")
        images = files.by_stem(files.files_in(folder / self.camera, files.IMAGES))
        clouds = files.by_stem(files.files_in(folder / LIDAR, (".bin",)))
        if not images or not clouds:
            empty = folder / (LIDAR if images else self.camera)
            raise SourceError(f"{empty}: no files like 000000 in it", "download it again")
        size = files.common_size([*images.values()], folder / self.camera)

        def item(name: str) -> Item | Lost:
            if name not in images or name not in clouds:
                there, lacking = ("scan", "image") if name in clouds else ("image", "scan")
                return Lost(name, f"there is a {there} of this number, but no {lacking}")
            stamp = at(stamps, int(name)) if name.isascii() and name.isdecimal() else None
            if stamp is None:
                return Lost(name, f"{folder / 'times.txt'} has no line for it")
            return Item(
                name, images[name], clouds[name], stamp, stamp, T_camera_lidar, read=read_scan
            )

        return Published(
            name=folder.name,
            camera=camera_of(f"{calib}: {P}", size, intrinsics),
            items=tuple(item(name) for name in sorted(images.keys() | clouds.keys())),
            image=self.camera,
            lidar=LIDAR,
            calibration=(calib, folder / "times.txt"),
        )
