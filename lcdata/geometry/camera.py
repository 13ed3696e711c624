"""Camera models: projection, bearings, undistortion. Camera frames: x right, y down, z forward."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lcdata.errors import GeometryError
from lcdata.geometry import camera_formulas as formulas
from lcdata.geometry.camera_models import check, radial_profile

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


_BLOCK = 8192
"""Points projected at a time, so that what is in between stays in the processor's cache."""


@dataclass(frozen=True)
class Camera:
    """A calibrated camera.

    Args:
        model: `"pinhole"` (plumb_bob with 4 or 5 coefficients k1 k2 p1 p2 k3, rational
            polynomial with 8, with thin prisms 12, tilted 14), `"fisheye"` (equidistant,
            Kannala-Brandt, 4), `"atan"` (field of view, 1: w in radians), `"omni"` (unified,
            Mei, 4: k1 k2 p1 p2) or `"equirectangular"` (none).
        width: Image width in pixels.
        height: Image height in pixels.
        intrinsics: fx, fy, cx, cy in pixels, of `omni` xi before them; of `equirectangular` the
            image's width and height, or nothing. Pixel centres have integer coordinates.
        distortion: Coefficients in OpenCV's order; empty for none.

    Raises:
        GeometryError: Unknown model, wrong number of parameters, impossible values.
    """

    model: str
    width: int
    height: int
    intrinsics: tuple[float, ...] = ()
    distortion: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        if self.model == "equirectangular" and not len(self.intrinsics):
            object.__setattr__(self, "intrinsics", (self.width, self.height))
        object.__setattr__(self, "intrinsics", tuple(float(v) for v in self.intrinsics))
        object.__setattr__(self, "distortion", tuple(float(v) for v in self.distortion))
        check(self)

    @classmethod
    def from_ros(
        cls, distortion_model: str, width: int, height: int, k: ArrayLike, d: ArrayLike
    ) -> Camera:
        """Camera of a `sensor_msgs/CameraInfo`.

        Args:
            distortion_model: plumb_bob, rational_polynomial, equidistant, fov, omnidirectional
                and what else drivers call them.
            width: Image width in pixels.
            height: Image height in pixels.
            k: (9,) row-major intrinsic matrix.
            d: Distortion coefficients; of `omnidirectional` k1 k2 p1 p2 and then xi.

        Raises:
            GeometryError: Unknown model, wrong number of values, a camera never calibrated.
        """
        from lcdata.geometry.camera_files import camera_of_info

        return camera_of_info(distortion_model, width, height, k, d)

    @classmethod
    def from_kalibr(cls, path: str | Path, cam: str = "cam0") -> Camera:
        """Camera of a Kalibr camchain YAML file.

        Args:
            path: The file.
            cam: Which of its cameras.

        Raises:
            GeometryError: Damaged file, no such camera, or a model that lcdata does not have.
        """
        from lcdata.geometry.camera_files import read_kalibr

        return read_kalibr(Path(path), cam)

    @classmethod
    def from_calib_json(cls, path: str | Path, size: tuple[int, int] | None = None) -> Camera:
        """Camera of a calib.json of direct_visual_lidar_calibration.

        Args:
            path: The file.
            size: Width and height of the images; from the first of them, beside the file, if
                not given: the file does not say it.

        Raises:
            GeometryError: Damaged file, unknown model, or no image to take the size from.
        """
        from lcdata.geometry.camera_files import read_calib_json

        return read_calib_json(Path(path), size)

    @cached_property
    def K(self) -> Array:
        """3x3 intrinsic matrix.

        Raises:
            GeometryError: An equirectangular camera has none.
        """
        if self.model == "equirectangular":
            raise GeometryError("an equirectangular camera has no intrinsic matrix")
        fx, fy, cx, cy = self.intrinsics[-4:]
        return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]])

    @property
    def is_distorted(self) -> bool:
        """Whether an image must be undistorted before straight lines are straight."""
        return self.model != "pinhole" or any(self.distortion)

    @cached_property
    def pixels_per_radian(self) -> tuple[float, float]:
        """Resolution in the middle of the picture, across and down; fx, fy of a pinhole."""
        _, jacobian, _ = self.project_jacobian([[0.0, 0.0, 1.0]])
        return float(jacobian[0, 0, 0]), float(jacobian[0, 1, 1])

    def project(self, points: ArrayLike) -> tuple[Array, Mask]:
        """Project points.

        Args:
            points: (N, 3) in the camera frame, metres.

        Returns:
            (N, 2) pixels, NaN where a point cannot be projected, and (N,) mask of those that
            the camera sees (in front of it, if its lens does not see behind) inside the image.
        """
        pixels, _ = self._by_formula(np.asarray(points, float).reshape(-1, 3))
        return pixels, self.contains(pixels)

    def project_jacobian(self, points: ArrayLike) -> tuple[Array, Array, Mask]:
        """Project points, with derivatives.

        Args:
            points: (N, 3) in the camera frame, metres.

        Returns:
            (N, 2) pixels and (N,) mask as of `project`, between them the (N, 2, 3) derivatives
            of pixel by point, pixels a metre, NaN where a point cannot be projected.
        """
        pixels, jacobian = self._by_formula(np.asarray(points, float).reshape(-1, 3))
        return pixels, jacobian, self.contains(pixels)

    def contains(self, pixels: Array) -> Mask:
        """(N,) mask of the pixels (N, 2) that lie inside the image; NaN do not."""
        u, v = pixels.T
        low, right, bottom = -0.5, self.width - 0.5, self.height - 0.5
        with np.errstate(invalid="ignore"):
            return np.asarray((u >= low) & (u < right) & (v >= low) & (v < bottom))

    def _by_formula(self, points: Array) -> tuple[Array, Array]:
        """Pixels (N, 2) and derivatives (N, 2, 3), NaN where impossible."""
        model, p = self.formula
        pixels, jacobian = np.empty((len(points), 2)), np.empty((len(points), 2, 3))
        with np.errstate(all="ignore"):
            for start in range(0, len(points), _BLOCK):
                block = slice(start, start + _BLOCK)
                x, y, z = np.ascontiguousarray(points[block].T)
                u, v, *slopes = formulas.FORMULAS[model](p, x, y, z)
                impossible = ~(formulas.can_project(model, p, x, y, z) & np.isfinite(u + v))
                pixels[block, 0], pixels[block, 1] = u, v
                jacobian[block] = np.stack(slopes, axis=-1).reshape(-1, 2, 3)
                pixels[block][impossible] = np.nan
                jacobian[block][impossible] = np.nan
        return pixels, jacobian

    @cached_property
    def formula(self) -> tuple[int, Array]:
        """Which of the formulas projects the camera's points, and the numbers that it takes."""
        return formulas.model_id(self), formulas.parameters(self)

    @cached_property
    def distortion_limit(self) -> float:
        """How far from the axis the radial distortion turns back, infinity if it never does.

        Beyond it, far outside the field of view, a polynomial folds points back into the image.
        The angle in radians for `fisheye`, the radius on the plane at depth 1 for others.
        """
        r, distorted = radial_profile(self)
        falling = np.flatnonzero(np.diff(distorted) <= 0)
        return float(r[falling[0]]) if falling.size else float("inf")

    def unproject(self, pixels: ArrayLike) -> Array:
        """Bearings of pixels.

        Args:
            pixels: (N, 2).

        Returns:
            (N, 3) unit vectors in the camera frame; NaN where the lens shows nothing.
        """
        from lcdata.geometry.bearings import bearings

        return bearings(self, np.asarray(pixels, float).reshape(-1, 2))

    def resized(self, width: int, height: int) -> Camera:
        """The camera of its image scaled to another size, in another aspect if need be."""
        across, down = width / self.width, height / self.height
        if self.model == "equirectangular":
            return replace(self, width=width, height=height, intrinsics=())
        *xi, fx, fy, cx, cy = self.intrinsics
        centre = ((cx + 0.5) * across - 0.5, (cy + 0.5) * down - 0.5)
        intrinsics = (*xi, fx * across, fy * down, *centre)
        return replace(self, width=width, height=height, intrinsics=intrinsics)

    def undistorted(self) -> Camera:
        """The pinhole camera without distortion that `undistort` makes images for.

        Of a pinhole the same without its coefficients; of others one of the same resolution in
        the middle that sees at most 110 deg forward.
        """
        from lcdata.geometry.undistortion import virtual_pinhole

        return virtual_pinhole(self)

    def undistort(self, image: NDArray[Any]) -> NDArray[Any]:
        """Undistort an image of this camera to the camera of `undistorted`.

        Args:
            image: (H, W) or (H, W, 3).

        Returns:
            Image of the undistorted camera's size and of the same type, black where the lens
            shows nothing; the same array if there is no distortion.
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
        from lcdata.geometry.undistortion import undistortion_maps

        return undistortion_maps(self)
