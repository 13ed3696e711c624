"""Camera models: projection, bearings, undistortion. Camera frames: x right, y down, z forward."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lcdata.errors import GeometryError

Array = NDArray[np.float64]

MODELS: dict[str, tuple[int, ...]] = {
    "pinhole": (0, 4, 5, 8, 12, 14),
    "fisheye": (0, 4),
}
"""Model names, and how many distortion coefficients each may have (OpenCV's order)."""

ROS_MODELS = {
    "plumb_bob": ("pinhole", (4, 5)),
    "rational_polynomial": ("pinhole", (8, 12, 14)),
    "equidistant": ("fisheye", (4,)),
    "fisheye": ("fisheye", (4,)),
    "": ("pinhole", (0, 4, 5)),
    "none": ("pinhole", (0,)),
}
"""`sensor_msgs/CameraInfo.distortion_model` to our model and its numbers of coefficients."""


@dataclass(frozen=True)
class Camera:
    """A calibrated camera.

    Args:
        model: `"pinhole"` (plumb_bob with 4 or 5 coefficients k1 k2 p1 p2 k3, rational
            polynomial with 8, 12 or 14) or `"fisheye"` (equidistant, Kannala-Brandt, 4).
        width: Image width in pixels.
        height: Image height in pixels.
        intrinsics: fx, fy, cx, cy in pixels; pixel centres have integer coordinates.
        distortion: Coefficients in OpenCV's order; empty for none.

    Raises:
        GeometryError: Unknown model, wrong number of parameters, values that are not finite.
    """

    model: str
    width: int
    height: int
    intrinsics: tuple[float, float, float, float]
    distortion: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "intrinsics", tuple(float(v) for v in self.intrinsics))
        object.__setattr__(self, "distortion", tuple(float(v) for v in self.distortion))
        if self.model not in MODELS:
            raise GeometryError(
                f"unknown camera model {self.model!r}", f"use one of {', '.join(MODELS)}"
            )
        if len(self.intrinsics) != 4:
            raise GeometryError(
                f"camera intrinsics have {len(self.intrinsics)} values", "give fx fy cx cy"
            )
        if len(self.distortion) not in MODELS[self.model]:
            raise GeometryError(
                f"{self.model} camera with {len(self.distortion)} distortion coefficients",
                f"give {', '.join(map(str, MODELS[self.model]))}",
            )
        if not np.isfinite([*self.intrinsics, *self.distortion]).all():
            raise GeometryError("camera parameters are not finite")
        if min(self.intrinsics[:2]) <= 0 or self.width <= 0 or self.height <= 0:
            raise GeometryError(
                f"camera with focal lengths {self.intrinsics[:2]} px and size "
                f"{self.width}x{self.height}",
                "all must be positive",
            )

    @classmethod
    def from_ros(
        cls, distortion_model: str, width: int, height: int, k: ArrayLike, d: ArrayLike
    ) -> Camera:
        """Camera of a `sensor_msgs/CameraInfo`.

        Args:
            distortion_model: plumb_bob, rational_polynomial, equidistant.
            width: Image width in pixels.
            height: Image height in pixels.
            k: (9,) row-major intrinsic matrix.
            d: Distortion coefficients.
        """
        if distortion_model not in ROS_MODELS:
            raise GeometryError(
                f"unknown distortion model {distortion_model!r}",
                f"known are {', '.join(name for name in ROS_MODELS if name)}",
            )
        model, counts = ROS_MODELS[distortion_model]
        matrix = np.asarray(k, float).reshape(-1)
        coefficients = np.asarray(d, float).reshape(-1)
        if matrix.shape != (9,):
            raise GeometryError(f"CameraInfo has {matrix.size} values in K", "it must have 9")
        if not coefficients.any():
            coefficients = coefficients[:0]
        elif coefficients.size not in counts:
            raise GeometryError(
                f"CameraInfo with {distortion_model} and {coefficients.size} coefficients",
                f"give {', '.join(map(str, counts))}",
            )
        fx, fy, cx, cy = matrix[[0, 4, 2, 5]]
        return cls(model, int(width), int(height), (fx, fy, cx, cy), tuple(coefficients))

    @cached_property
    def K(self) -> Array:
        """3x3 intrinsic matrix."""
        fx, fy, cx, cy = self.intrinsics
        return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]])

    @property
    def is_distorted(self) -> bool:
        """Whether an image must be undistorted before straight lines are straight."""
        return self.model != "pinhole" or any(self.distortion)

    def project(self, points: ArrayLike) -> tuple[Array, NDArray[np.bool_]]:
        """Project points.

        Args:
            points: (N, 3) in the camera frame, metres.

        Returns:
            (N, 2) pixels, NaN where a point cannot be projected, and (N,) mask of those that
            lie in front of the camera and inside the image.
        """
        import cv2

        points = np.asarray(points, float).reshape(-1, 3)
        pixels = np.full((len(points), 2), np.nan)
        with np.errstate(invalid="ignore"):
            usable = points[:, 2] > 1e-6
        if usable.any():
            front = points[usable]
            zero = np.zeros(3)
            D = np.array(self.distortion or (0.0,) * 4)
            if not self.is_distorted:
                fx, fy, cx, cy = self.intrinsics
                z = front[:, 2]
                projected = np.stack([fx * front[:, 0] / z + cx, fy * front[:, 1] / z + cy], 1)
            elif self.model == "fisheye":
                projected = cv2.fisheye.projectPoints(front[:, None], zero, zero, self.K, D)[0][
                    :, 0
                ]
            else:
                projected = cv2.projectPoints(front, zero, zero, self.K, D)[0][:, 0]
                projected[~self._inside_distortion_range(front)] = np.nan
            pixels[usable] = projected
        with np.errstate(invalid="ignore"):
            inside = (
                (pixels[:, 0] >= -0.5)
                & (pixels[:, 0] < self.width - 0.5)
                & (pixels[:, 1] >= -0.5)
                & (pixels[:, 1] < self.height - 0.5)
            )
        return pixels, inside

    def _inside_distortion_range(self, points: Array) -> NDArray[np.bool_]:
        """Whether points lie where the distortion polynomial is still monotonous.

        Beyond it, far outside the field of view, a polynomial folds points back into the image.
        """
        radius = np.hypot(points[:, 0], points[:, 1]) / points[:, 2]
        return np.asarray(radius <= self._largest_radius)

    @cached_property
    def _largest_radius(self) -> float:
        """Largest normalised radius before the radial distortion turns back."""
        k = np.zeros(14)
        k[: len(self.distortion)] = self.distortion
        r = np.linspace(0.0, 5.0, 2001)
        r2 = r * r
        distorted = (
            r
            * (1 + r2 * (k[0] + r2 * (k[1] + r2 * k[4])))
            / (1 + r2 * (k[5] + r2 * (k[6] + r2 * k[7])))
        )
        falling = np.flatnonzero(np.diff(distorted) <= 0)
        return float(r[falling[0]]) if falling.size else float("inf")

    def unproject(self, pixels: ArrayLike) -> Array:
        """Bearings of pixels.

        Args:
            pixels: (N, 2).

        Returns:
            (N, 3) unit vectors in the camera frame.
        """
        import cv2

        pixels = np.asarray(pixels, float).reshape(-1, 1, 2)
        D = np.array(self.distortion or (0.0,) * 4)
        if self.model == "fisheye":
            xy = cv2.fisheye.undistortPoints(pixels, self.K, D)[:, 0]
        elif self.is_distorted:
            criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 50, 1e-12)
            xy = cv2.undistortPointsIter(pixels, self.K, D, None, None, criteria)[:, 0]
        else:
            fx, fy, cx, cy = self.intrinsics
            xy = (pixels[:, 0] - [cx, cy]) / [fx, fy]
        bearings = np.column_stack([xy, np.ones(len(xy))])
        return np.asarray(bearings / np.linalg.norm(bearings, axis=1, keepdims=True))

    def undistorted(self) -> Camera:
        """The pinhole camera without distortion that `undistort` makes images for."""
        return replace(self, model="pinhole", distortion=())

    def undistort(self, image: NDArray[Any]) -> NDArray[Any]:
        """Undistort an image of this camera to the camera of `undistorted`.

        Args:
            image: (H, W) or (H, W, 3).

        Returns:
            Image of the same shape and type; the same array if there is no distortion.
        """
        import cv2

        if image.shape[:2] != (self.height, self.width):
            raise GeometryError(
                f"image of {image.shape[1]}x{image.shape[0]} for a camera of "
                f"{self.width}x{self.height}",
                "give the intrinsics of this image size",
            )
        if not self.is_distorted:
            return image
        maps = self._undistortion_maps
        return np.asarray(cv2.remap(image, maps[0], maps[1], cv2.INTER_LINEAR))

    @cached_property
    def _undistortion_maps(self) -> tuple[NDArray[Any], NDArray[Any]]:
        import cv2

        D, size = np.array(self.distortion or (0.0,) * 4), (self.width, self.height)
        initialise = (
            cv2.fisheye.initUndistortRectifyMap
            if self.model == "fisheye"
            else cv2.initUndistortRectifyMap
        )
        first, second = initialise(self.K, D, np.eye(3), self.K, size, cv2.CV_16SC2)
        return first, second
