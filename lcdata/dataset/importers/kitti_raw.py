"""KITTI's raw data (Geiger et al., 2013): `2011_09_26/2011_09_26_drive_0001_sync` and the like.

Of a synchronised drive the images are rectified. With the published matrices

    T_camera_lidar = [I | K^-1 P_rect_xx[:, 3]] * R_rect_00 * [R | T]_velo_to_cam

maps LiDAR points to the rectified frame of camera xx, whose intrinsics are those of P_rect_xx. Of
an extracted drive the images are as the sensor gave them, and

    T_camera_lidar = [R_xx | T_xx] * [R | T]_velo_to_cam

with K_xx and D_xx.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lcdata.dataset.importers import files
from lcdata.dataset.importers.calibration import camera_of, intrinsics_of, rigid, split_projection
from lcdata.dataset.importers.kitti_calib import at, read_calibration, read_timestamps, value
from lcdata.dataset.importers.published import Item, Lost, Published
from lcdata.errors import MessageError, SourceError
from lcdata.geometry.camera import Camera
from lcdata.recording.cloud_files import XYZI, CloudFile
from lcdata.recording.pairing import pair_stamps

Array = NDArray[np.float64]

DRIVE = re.compile(r"(\d{4}_\d\d_\d\d)_drive_(\d+)_(sync|extract)\Z")
CAMERAS = ("image_00", "image_01", "image_02", "image_03")
LIDAR = "velodyne_points"
TOLERANCE_MS = 50.0

REMEDY = "the archive of the date's calibration (2011_09_26_calib.zip) has it"


class Calibration(NamedTuple):
    """What a date's files say of one camera."""

    camera: Camera
    T_camera_lidar: Array
    files: tuple[Path, ...]


@dataclass(frozen=True)
class KittiRaw:
    """Drives below a folder: of all dates, of one, or a drive itself.

    Drives of a date share their calibration: they are one scenario.

    Args:
        source: The folder.
        camera: `image_00` to `image_03`.
    """

    source: Path
    camera: str = "image_02"
    format: ClassVar[str] = "kitti-raw"

    def recordings(self) -> dict[str, Callable[[], Published]]:
        """See `published.Importer`."""
        if self.camera not in CAMERAS:
            raise SourceError(f"no camera {self.camera!r} in KITTI", f"one of {', '.join(CAMERAS)}")
        drives = [drive for drive in self._drives() if DRIVE.match(drive.name)]
        if not drives:
            raise SourceError(
                f"{self.source}: no drive of KITTI's raw data in it",
                "give a date with folders like 2011_09_26_drive_0001_sync, or one of those",
            )
        return {drive.name: partial(self._drive, drive) for drive in drives}

    def _drives(self) -> Iterator[Path]:
        source = self.source.resolve() if self.source.name in ("", "..") else self.source
        if DRIVE.match(source.name):
            yield source
            return
        yield from sorted(source.glob("*_drive_*_*"))
        yield from sorted(source.glob("[0-9]*_*_*/*_drive_*_*"))

    def _drive(self, drive: Path) -> Published:
        match = DRIVE.match(drive.name)
        assert match is not None
        date, number, kind = match.groups()
        rectified = kind == "sync"
        found = _calibration(drive.parent, self.camera.removeprefix("image_"), rectified=rectified)
        images = _numbered(drive / self.camera / "data", files.IMAGES)
        clouds = _numbered(drive / LIDAR / "data", (".bin",) if rectified else (".txt", ".bin"))
        image_ns = read_timestamps(drive / self.camera / "timestamps.txt")
        lidar_ns = read_timestamps(drive / LIDAR / "timestamps.txt")
        frames = _Frames(images, clouds, image_ns, lidar_ns, number, found.T_camera_lidar)
        return Published(
            name=date if rectified else f"{date}_extract",
            camera=found.camera,
            items=tuple(frames.same_number() if rectified else frames.nearest()),
            image=self.camera,
            lidar=LIDAR,
            calibration=found.files,
            tolerance_ms=TOLERANCE_MS,
        )


def _calibration(date: Path, xx: str, *, rectified: bool) -> Calibration:
    cameras, velodyne = date / "calib_cam_to_cam.txt", date / "calib_velo_to_cam.txt"
    of_velodyne = read_calibration(velodyne, REMEDY)
    of_cameras = read_calibration(cameras, REMEDY)

    def matrix(key: str) -> Array:
        return value(of_cameras, key, cameras, REMEDY)

    def pose(R: Array, T: Array, path: Path, what: str) -> Array:
        if (R.size, T.size) != (9, 3):
            raise SourceError(f"{path}: {what} have {R.size} and {T.size} values", "not 9 and 3")
        return rigid(np.column_stack([R.reshape(3, 3), T]), f"{path}: {what}")

    R, T = (value(of_velodyne, key, velodyne, REMEDY) for key in ("R", "T"))
    T_reference_lidar = pose(R, T, velodyne, "R, T")
    if rectified:
        T_rect_reference = pose(matrix("R_rect_00"), np.zeros(3), cameras, "R_rect_00, zeros")
        P = f"P_rect_{xx}"
        intrinsics, T_camera_rect = split_projection(matrix(P), f"{cameras}: {P}")
        T_camera_lidar = T_camera_rect @ T_rect_reference @ T_reference_lidar
        distortion, size = np.zeros(0), f"S_rect_{xx}"
    else:
        R, T = matrix(f"R_{xx}"), matrix(f"T_{xx}")
        T_camera_lidar = pose(R, T, cameras, f"R_{xx}, T_{xx}") @ T_reference_lidar
        intrinsics = intrinsics_of(matrix(f"K_{xx}"), f"{cameras}: K_{xx}")
        distortion, size = matrix(f"D_{xx}"), f"S_{xx}"
    shape = matrix(size)
    if shape.size != 2:
        raise SourceError(f"{cameras}: {size} has {shape.size} values", "it must have 2")
    camera = camera_of(
        f"{cameras}: camera {xx}",
        (int(shape[0]), int(shape[1])),
        intrinsics,
        distortion.tolist(),
        size_given=True,
    )
    return Calibration(camera, T_camera_lidar, (cameras, velodyne))


class _Frames(NamedTuple):
    """Files of a drive by number, stamps by line, and what is the same for all of them."""

    images: dict[int, Path]
    clouds: dict[int, Path]
    image_ns: list[int | None]
    lidar_ns: list[int | None]
    drive: str
    T_camera_lidar: Array

    def same_number(self) -> Iterator[Item | Lost]:
        """Synchronised: an image and a scan of one number are a pair."""
        for number in sorted(self.images.keys() | self.clouds.keys()):
            stamps = at(self.image_ns, number), at(self.lidar_ns, number)
            yield self._item(number, number, *stamps)

    def nearest(self) -> Iterator[Item | Lost]:
        """Not synchronised: each scan has the nearest image."""
        images = {n: stamp for n in self.images if (stamp := at(self.image_ns, n)) is not None}
        clouds = {n: stamp for n in self.clouds if (stamp := at(self.lidar_ns, n)) is not None}
        pairing = pair_stamps([*clouds.values()], [*images.values()], int(TOLERANCE_MS * 1e6))
        numbers = [*images], [*clouds]
        image_of = {
            numbers[1][cloud]: numbers[0][image]
            for cloud, image in zip(pairing.lidar, pairing.image, strict=True)
        }
        for cloud in self.clouds:
            if cloud in image_of or cloud not in clouds:
                image = image_of.get(cloud, -1)
                yield self._item(image, cloud, images.get(image), clouds.get(cloud))
            else:
                reason = f"{self.clouds[cloud]}: no image within {TOLERANCE_MS:g} ms"
                yield Lost(f"{self.drive}_{cloud:010d}", reason)

    def _item(
        self, image: int, cloud: int, image_ns: int | None, lidar_ns: int | None
    ) -> Item | Lost:
        name = f"{self.drive}_{cloud:010d}"
        if image not in self.images and lidar_ns is not None:
            return Lost(name, "there is a scan of this number, but no image")
        if cloud not in self.clouds:
            return Lost(name, "there is an image of this number, but no scan")
        if image_ns is None or lidar_ns is None:
            return Lost(name, "timestamps.txt has no line for it")
        return Item(
            name=name,
            image=self.images[image],
            cloud=self.clouds[cloud],
            stamp_image_ns=image_ns,
            stamp_lidar_ns=lidar_ns,
            T_camera_lidar=self.T_camera_lidar,
            read=read_scan,
        )


def _numbered(folder: Path, suffixes: tuple[str, ...]) -> dict[int, Path]:
    """Files by the number that they are named by.

    Raises:
        SourceError: There are none.
    """
    found = {
        number: file
        for file in files.files_in(folder, suffixes)
        if (number := files.frame(file)) is not None
    }
    if not found:
        listed = ", ".join(suffixes)
        raise SourceError(
            f"{folder}: no files like 0000000000 ({listed})", "download the drive again"
        )
    return found


def read_scan(path: Path) -> CloudFile:
    """A scan of KITTI: x y z reflectance, as floats, or of extracted drives as text.

    Raises:
        MessageError: Something else.
    """
    try:
        if path.suffix.lower() == ".txt":
            values = np.loadtxt(path, dtype="<f4", ndmin=2)
            if values.shape[1:] != (4,):
                raise ValueError(f"rows of {values.shape[1:]} numbers")
            records = np.ascontiguousarray(values).view(XYZI).reshape(-1)
        else:
            records = np.frombuffer(path.read_bytes(), XYZI)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error).splitlines()[0]
        raise MessageError(
            f"{path} cannot be read ({reason})", "it is x y z reflectance; copy it again"
        ) from error
    return CloudFile(records, 1, len(records))
