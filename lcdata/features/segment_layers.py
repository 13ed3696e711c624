"""Masks of an image as layers of labels, so that the masks of a pixel are found at once.

Masks may overlap: a pixel has up to `MOST_LAYERS` of them (four in the published code as well).
Of a large mask only the rim counts: points deep inside say nothing of the pose, whatever it is.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lcdata.features.image_segments import segment_scales
from lcdata.features.nid_views import FINEST, pixels_per_radian
from lcdata.geometry.camera import Camera

Bytes = NDArray[np.uint8]
Mask = NDArray[np.bool_]

MOST_LAYERS = 4
MOST_MASKS = 60_000

RIM = 0.015
"""Width of the rim of a mask, radians."""

LEAST_AREA = 2e-5
"""Least area of a mask, as a share of the image."""


@dataclass(frozen=True, eq=False)
class SegmentLayers:
    """The masks of one image, at the resolution of the registration.

    Args:
        labels: (h, w, K) uint16 masks of each pixel, from 1 on; 0 for none.
        areas: (M + 1,) pixels of the rim of each mask; of none at 0.
        centres: (M + 1, 2) column and row of the middle of the rim.
        camera: Of the image at this resolution.
        focal: Pixels a radian in the middle of the image.
    """

    labels: NDArray[np.uint16]
    areas: NDArray[np.int64]
    centres: NDArray[np.float64]
    camera: Camera
    focal: float

    @property
    def masks(self) -> int:
        """How many masks there are."""
        return len(self.areas) - 1


def reduced_camera(camera: Camera) -> Camera:
    """The camera of an image no finer than a LiDAR can tell."""
    focal = pixels_per_radian(camera)
    if focal <= 1.25 * FINEST:
        return camera
    scale = FINEST / focal
    return camera.resized(round(camera.width * scale), round(camera.height * scale))


def reduced_image(image: Bytes, camera: Camera) -> Bytes:
    """An image at a camera's size."""
    import cv2

    if image.shape[:2] == (camera.height, camera.width):
        return image
    size = camera.width, camera.height
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.uint8)


def layers_of_image(image: Bytes, camera: Camera, scales: Sequence[float]) -> SegmentLayers:
    """Segments by colour, one layer a scale.

    Args:
        image: (H, W) or (H, W, 3) uint8 RGB, as recorded.
        camera: Of the image.
        scales: See `image_segments`.
    """
    small = reduced_camera(camera)
    layers, count = [], 0
    for labels in segment_scales(reduced_image(image, small), scales):
        layers.append(np.where(_in_rim(labels, small), labels + count + 1, 0))
        count += int(labels.max()) + 1
    return _counted(np.stack(layers, 2), count, small)


def layers_of_masks(masks: Iterable[Bytes], camera: Camera) -> SegmentLayers:
    """Layers of masks that may overlap; a pixel in too many belongs to the smallest.

    Args:
        masks: (H, W) uint8 each, 0 outside; of the camera's image or of the reduced one.
        camera: Of the image.
    """
    small = reduced_camera(camera)
    crops = [_cropped(reduced_image(mask, small) >= 128) for mask in masks]
    crops.sort(key=lambda crop: int(crop[2].sum()))
    labels = np.zeros((small.height, small.width, MOST_LAYERS), np.int32)
    count = 0
    for row, column, mask in crops[:MOST_MASKS]:
        if mask.sum() < LEAST_AREA * labels[:, :, 0].size:
            continue
        count += 1
        height, width = mask.shape
        part = labels[row : row + height, column : column + width]
        left = _rim(mask, row, column, small)
        for layer in range(MOST_LAYERS):
            free = left & (part[:, :, layer] == 0)
            part[:, :, layer][free] = count
            left &= ~free
    used = max(1, int((labels > 0).any(axis=(0, 1)).sum()))
    return _counted(labels[:, :, :used], count, small)


def _counted(labels: NDArray[np.int32], count: int, camera: Camera) -> SegmentLayers:
    """Layers with the areas and middles of their masks."""
    areas = np.zeros(count + 1, np.int64)
    sums = np.zeros((count + 1, 2))
    columns = np.tile(np.arange(labels.shape[1], dtype=float), labels.shape[0])
    rows = np.repeat(np.arange(labels.shape[0], dtype=float), labels.shape[1])
    for layer in range(labels.shape[2]):
        flat = labels[:, :, layer].reshape(-1)
        areas += np.bincount(flat, minlength=count + 1)
        sums[:, 0] += np.bincount(flat, columns, count + 1)
        sums[:, 1] += np.bincount(flat, rows, count + 1)
    centres = sums / np.maximum(areas, 1)[:, None]
    areas[0] = 0
    layers = np.ascontiguousarray(labels.astype(np.uint16))
    return SegmentLayers(layers, areas, centres, camera, pixels_per_radian(camera))


def _in_rim(labels: NDArray[np.int32], camera: Camera) -> Mask:
    """Pixels near a border between segments."""
    import cv2

    values = labels.astype(np.float32)  # exact below 2^24
    box = np.ones((3, 3), np.uint8)
    inside = cv2.erode(values, box) == cv2.dilate(values, box)
    distance = cv2.distanceTransform(inside.astype(np.uint8), cv2.DIST_L2, 5)
    return np.asarray(distance <= RIM * pixels_per_radian(camera))


def _cropped(mask: Mask) -> tuple[int, int, Mask]:
    """First row, first column and the part of a mask that is not empty."""
    rows, columns = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
    if not len(rows):
        return 0, 0, mask[:0, :0]
    top, left = int(rows[0]), int(columns[0])
    return top, left, mask[top : rows[-1] + 1, left : columns[-1] + 1]


def _rim(mask: Mask, row: int, column: int, camera: Camera) -> Mask:
    """The rim of a cropped mask; where the image ends is no rim."""
    import cv2

    height, width = mask.shape
    beyond = (
        int(row > 0),
        int(row + height < camera.height),
        int(column > 0),
        int(column + width < camera.width),
    )
    padded = cv2.copyMakeBorder(mask.astype(np.uint8), *beyond, cv2.BORDER_CONSTANT, value=0)
    if padded.all():
        return np.zeros_like(mask)
    distance = cv2.distanceTransform(padded, cv2.DIST_L2, 5)
    distance = distance[beyond[0] : beyond[0] + height, beyond[2] : beyond[2] + width]
    return np.asarray(mask & (distance <= RIM * pixels_per_radian(camera)))
