"""What a recording yields: clouds, images, camera infos, joint states and transforms."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lcdata.errors import GeometryError
from lcdata.geometry.camera import Camera
from lcdata.recording import fields, images

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Message:
    """What all messages have.

    Args:
        stamp_ns: Stamp that is used: the header's, or the recorder's if the rig says so.
        bag_stamp_ns: When the recorder received it.
        frame_id: Frame of the data, without a leading slash.
    """

    stamp_ns: int
    bag_stamp_ns: int
    frame_id: str


@dataclass(frozen=True, eq=False)
class Cloud(Message):
    """One LiDAR scan.

    Args:
        records: (height * width,) structured, every recorded field under its recorded name, in
            native byte order and without padding; read-only where it is a view of the message.
        height: Rings of an organised scan, else 1.
        width: Columns of an organised scan, else the number of points.
    """

    records: NDArray[np.void]
    height: int
    width: int

    @property
    def organised(self) -> tuple[int, int] | None:
        """(rings, columns) of an organised scan."""
        return (self.height, self.width) if self.height > 1 and self.width > 1 else None


@dataclass(frozen=True, eq=False)
class Image(Message):
    """One image, not yet decoded.

    Args:
        data: Pixels as recorded, or the bytes of a JPEG or PNG.
        encoding: `mono8`, `bgr8`, ...; of a compressed image the recorded format string.
        compressed: Whether `data` is a JPEG or PNG.
        height: Pixels; of a compressed image from its own header.
        width: Pixels; of a compressed image from its own header.
        step: Bytes a row; 0 if compressed.
        big_endian: Byte order of 16-bit pixels.
    """

    data: memoryview
    encoding: str
    compressed: bool
    height: int
    width: int
    step: int = 0
    big_endian: bool = False

    def decode(self) -> NDArray[np.uint8]:
        """(H, W) gray or (H, W, 3) RGB pixels.

        Raises:
            MessageError: Unknown encoding, or pixels that are not all there.
        """
        if self.compressed:
            return images.decode_compressed(self.data, self.encoding)
        return images.to_8_bit(self._pixels())

    def encoded(self) -> tuple[bytes, str]:
        """Bytes of an image file and its suffix.

        A compressed image's bytes are kept as they were recorded; raw pixels become a lossless
        PNG (colour filter arrays are interpolated first, alpha is dropped).

        Raises:
            MessageError: Unknown encoding, or pixels that are not all there.
        """
        if self.compressed:
            images.check_whole(self.data, self.encoding)
            return bytes(self.data), images.suffix(self.data, self.encoding)
        return images.encode_png(self._pixels()), ".png"

    def _pixels(self) -> NDArray[Any]:
        return images.decode_raw(
            self.data,
            self.encoding,
            height=self.height,
            width=self.width,
            step=self.step,
            big_endian=self.big_endian,
        )


@dataclass(frozen=True, eq=False)
class CameraInfo(Message):
    """A calibration of a camera as published beside its images.

    Args:
        distortion_model: `plumb_bob`, `rational_polynomial`, `equidistant`.
        height: Pixels of the sensor as calibrated.
        width: The same.
        k: (9,) row-major intrinsic matrix, of the whole sensor.
        d: Distortion coefficients.
        roi: x, y, width and height of the part of the sensor that the images show, before
            binning; no width or height for all of it.
        binning: Pixels of the sensor, across and down, that make one of the image; 0 as 1.
    """

    distortion_model: str
    height: int
    width: int
    k: Array
    d: Array
    roi: tuple[int, int, int, int] = (0, 0, 0, 0)
    binning: tuple[int, int] = (1, 1)

    def camera(self) -> Camera:
        """The camera model of the images: a part of the sensor, binned.

        Raises:
            GeometryError: Unknown distortion model, a camera that was never calibrated, or a region
                of interest outside the sensor.
        """
        camera = Camera.from_ros(self.distortion_model, self.width, self.height, self.k, self.d)
        x, y, width, height = self.roi if all(self.roi[2:]) else (0, 0, self.width, self.height)
        if x + width > self.width or y + height > self.height:
            raise GeometryError(
                f"a region of interest of {width}x{height} pixels at {x}, {y} of a camera info for "
                f"{self.width}x{self.height}"
            )
        across, down = (max(1, factor) for factor in self.binning)
        columns, rows = width // across, height // down
        *others, cx, cy = camera.intrinsics
        part = replace(
            camera,
            width=columns * across,
            height=rows * down,
            intrinsics=(*others, cx - x, cy - y),
        )
        return part if (across, down) == (1, 1) else part.resized(columns, rows)


@dataclass(frozen=True, eq=False)
class JointState(Message):
    """Joint positions.

    Args:
        names: Joint names in the recorded order.
        positions: (len(names),) radians.
    """

    names: tuple[str, ...]
    positions: Array


@dataclass(frozen=True, eq=False)
class StaticTransform:
    """One transform of /tf or /tf_static: `p_parent = T_parent_child p_child`."""

    parent: str
    child: str
    T_parent_child: Array


@dataclass(frozen=True, eq=False)
class Transforms(Message):
    """One message of /tf or /tf_static; `frame_id` is empty."""

    transforms: tuple[StaticTransform, ...]


def xyz(cloud: Cloud) -> NDArray[np.float32]:
    """(N, 3) points in metres; rows without a return are NaN (see `fields.points`)."""
    return fields.points(cloud.records)


def intensity_field(cloud: Cloud) -> str | None:
    """Name of the field that holds intensity or reflectivity; None without one."""
    return fields.intensity_name(cloud.records.dtype)


def ring_field(cloud: Cloud) -> str | None:
    """Name of the field that holds the ring (laser, channel); None without one."""
    return fields.ring_name(cloud.records.dtype)


def time_field(
    cloud: Cloud, *, field: str = "auto", unit: str = "auto"
) -> fields.PointTimeField | None:
    """The per-point time field, its unit and why (see `fields.point_time`)."""
    return fields.point_time(cloud.records, field=field, unit=unit)
