"""A LiDAR-camera pair: what every calibrator works on."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lcdata.errors import CalibrationError
from lcdata.geometry.camera import Camera

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Pair:
    """One LiDAR scan and one image taken together.

    Args:
        image: (H, W) or (H, W, 3) uint8, colour as RGB, as recorded (distorted).
        points: (N, 3) in the LiDAR frame, metres. Points without a return are NaN.
        intensity: (N,) reflectance or intensity in the sensor's own unit; None if unknown.
        camera: Model and intrinsics of the image.
        organised: (rings, columns) if the points are a row-major image of the scan, with
            rings from top to bottom or bottom to top; then `rings * columns == N`.
        ring: (N,) ring number of each point; None if unknown.
        pair_id: Name of the pair in its data set.
        pose_id: Name of the arm pose; pairs of one pose share their extrinsic.
        scenario: Name of the recording.
        T_camera_lidar: 4x4 ground truth, if there is one.
        covariance: 6x6 of the ground truth: translation (m) then rotation (rad), in the camera
            frame; None or NaN where it is unknown.

    Raises:
        CalibrationError: Arrays whose shapes do not go together, or of a wrong type.
    """

    image: NDArray[np.uint8]
    points: NDArray[np.floating[Any]]
    intensity: NDArray[np.floating[Any]] | None
    camera: Camera
    organised: tuple[int, int] | None = None
    ring: NDArray[np.integer[Any]] | None = None
    pair_id: str = ""
    pose_id: str = ""
    scenario: str = ""
    T_camera_lidar: Array | None = None
    covariance: Array | None = None

    def __post_init__(self) -> None:
        name = f"pair {self.pair_id}" if self.pair_id else "pair"
        if not isinstance(self.camera, Camera):
            raise CalibrationError(
                f"{name}: camera of type {type(self.camera).__name__}", "give a lcdata.Camera"
            )
        given: dict[str, NDArray[Any] | None]
        given = {"intensity": self.intensity, "ring": self.ring}
        optional = {label: array for label, array in given.items() if array is not None}
        needed: dict[str, NDArray[Any]] = {"image": self.image, "points": self.points}
        for label, array in (needed | optional).items():
            if not isinstance(array, np.ndarray) or array.dtype.kind not in "fiu":
                kind = getattr(array, "dtype", type(array).__name__)
                raise CalibrationError(
                    f"{name}: {label} of type {kind}", "give a NumPy array of real numbers"
                )
        shape = self.image.shape
        if self.image.dtype != np.uint8 or not (len(shape) == 2 or shape[2:] == (3,)):
            raise CalibrationError(
                f"{name}: image of type {self.image.dtype} and shape {self.image.shape}",
                "give (H, W) or (H, W, 3) uint8",
            )
        if self.image.shape[:2] != (self.camera.height, self.camera.width):
            raise CalibrationError(
                f"{name}: image of {self.image.shape[1]}x{self.image.shape[0]} for a camera of "
                f"{self.camera.width}x{self.camera.height}",
                "give the intrinsics of this image size",
            )
        if self.points.ndim != 2 or self.points.shape[1] != 3:
            raise CalibrationError(
                f"{name}: points of shape {self.points.shape}", "give (N, 3) in metres"
            )
        for label, array in optional.items():
            if array.shape != (len(self.points),):
                raise CalibrationError(
                    f"{name}: {label} of shape {array.shape} for {len(self.points)} points",
                    f"give ({len(self.points)},)",
                )
        if self.organised is None:
            return
        whole = all(isinstance(n, int | np.integer) and n > 0 for n in self.organised)
        if not whole or math.prod(self.organised) != len(self.points):
            raise CalibrationError(
                f"{name}: {len(self.points)} points are not {self.organised[0]} rings x "
                f"{self.organised[1]} columns",
                "give (rings, columns) whose product is the number of points, or None",
            )
