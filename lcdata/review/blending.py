"""One pair at one pose: the cloud in the image's colours, the image under the LiDAR's picture."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lcdata.geometry import se3
from lcdata.geometry.camera import Camera

if TYPE_CHECKING:
    from lcdata.features.nid_views import NidImage
    from lcdata.pair import Pair

Array = NDArray[np.float64]
Bytes = NDArray[np.uint8]

WIDEST_PX = 1600
"""Larger images are reduced: the viewer's are not larger."""

UNSEEN = (54, 58, 66)
"""Colour of points that the camera does not see."""


@dataclass(frozen=True, eq=False)
class Blending:
    """What a pair shows at any pose, whatever the camera model: nothing is undistorted.

    Args:
        pair: The pair.
    """

    pair: Pair

    @cached_property
    def camera(self) -> Camera:
        """The pair's camera, of an image of at most `WIDEST_PX`."""
        return reduced(self.pair.camera)

    @cached_property
    def image(self) -> Bytes:
        """(H, W, 3) or (H, W) image of `camera`."""
        import cv2

        size = (self.camera.width, self.camera.height)
        if size == (self.pair.camera.width, self.pair.camera.height):
            return self.pair.image
        return np.asarray(cv2.resize(self.pair.image, size, interpolation=cv2.INTER_AREA))

    @cached_property
    def usable(self) -> NDArray[np.int64]:
        """Rows of the pair's points that are returns of the surroundings."""
        from lcdata.features.lidar_view import usable_points

        return np.flatnonzero(usable_points(self.pair.points))

    @cached_property
    def points(self) -> NDArray[np.float32]:
        """(N, 3) usable points in the LiDAR frame, metres."""
        return np.ascontiguousarray(self.pair.points[self.usable], np.float32)

    @cached_property
    def values(self) -> NDArray[np.float32]:
        """(N,) what the LiDAR's picture shows: intensities, or without any the ranges (m)."""
        if self.pair.intensity is None:
            return np.asarray(np.linalg.norm(self.points, axis=1), np.float32)
        return np.nan_to_num(np.asarray(self.pair.intensity[self.usable], np.float32))

    @cached_property
    def _eye(self) -> NidImage:
        from lcdata.features.nid_views import nid_image

        return nid_image(self.image, self.camera)

    def seen(self, T_camera_lidar: Array) -> tuple[NDArray[np.int64], Array]:
        """Points that nothing nearer hides.

        Returns:
            (M,) rows of `points` and their (M, 2) pixels in `image`.
        """
        from lcdata.features.nid_views import visible

        found = visible(self._eye, self.points, T_camera_lidar)
        index = np.sort(found.index[found.inside])
        pixels, inside = self.camera.project(se3.apply(T_camera_lidar, self.points[index]))
        return index[inside], pixels[inside]

    def colours(self, T_camera_lidar: Array) -> Bytes:
        """(N, 3) RGB of the points: the image's where the camera sees them."""
        index, pixels = self.seen(T_camera_lidar)
        rgb = np.tile(np.array(UNSEEN, np.uint8), (len(self.points), 1))
        columns, rows = np.rint(pixels).astype(int).T
        picked = self.image[rows, columns]
        rgb[index] = picked if picked.ndim == 2 else picked[:, None]
        return rgb

    def picture(self, T_camera_lidar: Array) -> Bytes:
        """(H, W, 4) RGBA of what the LiDAR measured as the camera would see it.

        Ranked greys, as NID compares them; nothing where the LiDAR saw nothing.
        """
        from lcdata.features.lidar_view import make_view

        index, _ = self.seen(T_camera_lidar)
        if not len(index):
            return np.zeros((self.camera.height, self.camera.width, 4), np.uint8)
        in_camera = se3.apply(T_camera_lidar, self.points[index])
        view = make_view(in_camera, self.values[index], self.camera, np.eye(3))
        shown = (255 * (view.index >= 0)).astype(np.uint8)
        return np.dstack([view.intensity] * 3 + [shown])


def reduced(camera: Camera) -> Camera:
    """The camera of images of at most `WIDEST_PX`."""
    scale = min(1.0, WIDEST_PX / max(camera.width, camera.height))
    return camera.resized(round(camera.width * scale), round(camera.height * scale))


def encoded(picture: NDArray[Any], suffix: str) -> bytes:
    """An image file of a grey, RGB or RGBA picture."""
    import cv2

    to_bgr = {2: None, 3: cv2.COLOR_RGB2BGR, 4: cv2.COLOR_RGBA2BGRA}
    code = to_bgr[2 if picture.ndim == 2 else picture.shape[2]]
    bgr = picture if code is None else cv2.cvtColor(picture, code)
    return bytes(cv2.imencode(suffix, bgr)[1])
