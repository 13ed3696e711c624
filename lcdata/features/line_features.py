"""The lines of a LiDAR-camera pair, and what the search looks up about them."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from lcdata.features.cloud_lines import extract_cloud_lines
from lcdata.features.distance_fields import FIELDS, DistanceFields, distance_fields
from lcdata.features.image_lines import extract_image_lines
from lcdata.features.paint_lines import extract_paint_lines
from lcdata.geometry.camera import Camera
from lcdata.pair import Pair

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class LineFeatures:
    """Lines of one pair.

    Args:
        camera: Of the undistorted image.
        image_lines: (B, 4) x1 y1 x2 y2, pixels.
        segments: (A, 2, 3) cloud lines in the LiDAR frame, metres.
        sigma: (A,) expected standard deviation of a cloud line across its direction, metres.
        fields: Distance fields by truncation distance in pixels at a focal length of 1000.
    """

    camera: Camera
    image_lines: Array
    segments: Array
    sigma: Array
    fields: dict[float, DistanceFields]

    @property
    def focal_length(self) -> float:
        """Geometric mean of fx and fy, pixels."""
        fx, fy = self.camera.intrinsics[:2]
        return float(np.sqrt(fx * fy))


def extract_line_features(pair: Pair, paint: bool = True) -> LineFeatures:
    """Detect the lines of a pair.

    Args:
        pair: Points may contain NaN; a cloud that is no scan has no lines.
        paint: Also take borders of paint from the intensity, if there is one.
    """
    gray = pair.image if pair.image.ndim == 2 else cv2.cvtColor(pair.image, cv2.COLOR_RGB2GRAY)
    camera = pair.camera.undistorted()
    valid = None
    if pair.camera.is_distorted:
        valid = pair.camera.undistort(np.full_like(gray, 255)) == 255
        gray = pair.camera.undistort(gray)
    image_lines = extract_image_lines(gray, valid=valid)
    cloud = extract_cloud_lines(pair.points, organised=pair.organised, ring=pair.ring)
    segments, sigma = cloud.segments, cloud.std
    if paint:
        painted, painted_sigma = extract_paint_lines(
            pair.points, pair.intensity, pair.organised, pair.ring
        )
        segments = np.concatenate([segments, painted])
        sigma = np.concatenate([sigma, painted_sigma])
    scale = np.sqrt(camera.intrinsics[0] * camera.intrinsics[1]) / 1000.0
    fields = {
        truncation: distance_fields(image_lines, camera, truncation * scale, reach)
        for truncation, reach in FIELDS.items()
    }
    return LineFeatures(camera, image_lines, segments, sigma, fields)
