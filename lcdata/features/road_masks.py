"""Lane and pole masks of a pair from a file or a segmentation network."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from lcdata.features.mask_files import mask_file, read_mask
from lcdata.features.road_image import RoadImage, road_image, worked, working_camera
from lcdata.pair import Pair

Bytes = NDArray[np.uint8]
Mask = NDArray[np.bool_]

WINDOW = 0.008
"""How far borders move onto an edge of the image at most, radians."""

CONTRAST = 12.0
"""Least difference in grey between a mask's inside and outside for its border to move."""

TURNS = 2


def given_masks(
    pair: Pair,
    masks: str | os.PathLike[str],
    model: str | os.PathLike[str],
    classes: Mapping[str, Sequence[int]] | None,
    contours: bool,
) -> RoadImage:
    """Lanes and poles of one pair's image.

    Args:
        pair: The pair.
        masks: See `lcdata.features.mask_files.mask_file`; or "".
        model: See `lcdata.features.segmentation.segment`; used without masks.
        classes: Of the model.
        contours: Whether to move borders onto the image's edges.

    Raises:
        CalibrationError: Masks or a model that cannot be used.
    """
    camera = working_camera(pair.camera)
    if masks:
        both = read_mask(mask_file(masks, pair), (pair.camera.height, pair.camera.width))
        found = [worked(both, camera) > 127]
    else:
        from lcdata.features.segmentation import segment

        found = [
            worked(np.where(mask, np.uint8(255), np.uint8(0)), camera) > 127
            for mask in segment(pair.image, model, classes)
        ]
    pinhole = camera.undistorted()
    if contours:
        grey = worked(_grey(pair.image), camera)
        found = [snapped(mask, grey, max(pinhole.pixels_per_radian)) for mask in found]
    return road_image(found[0], found[1] if len(found) > 1 else None, pinhole)


def _grey(image: Bytes) -> Bytes:
    import cv2

    return image if image.ndim == 2 else np.asarray(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY))


def snapped(mask: Mask, grey: Bytes, focal: float) -> Mask:
    """Move a mask's borders onto edges of the image.

    In place of the paper's dense conditional random field, near the border a pixel goes to the side
    whose mean grey around it is nearer (Lankton and Tannenbaum 2008, local Chan-Vese energy).

    Args:
        mask: (h, w).
        grey: (h, w) uint8 image.
        focal: Pixels a radian.
    """
    import cv2

    reach = max(2, round(WINDOW * focal))
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * reach + 1,) * 2)
    window = (4 * reach + 1,) * 2
    light = grey.astype(np.float32)
    total = cv2.blur(light, window)
    near = cv2.dilate(mask.astype(np.uint8), disc) > 0
    for _ in range(TURNS):
        share = mask.astype(np.float32)
        part = cv2.blur(share, window)
        inside = cv2.blur(light * share, window)
        outside = (total - inside) / np.maximum(1.0 - part, 1e-3)
        inside = inside / np.maximum(part, 1e-3)
        clear = near & (np.abs(inside - outside) > CONTRAST) & (part > 1e-3) & (part < 0.999)
        nearer = np.abs(light - inside) < np.abs(light - outside)
        mask = np.where(clear, nearer, mask)
    return np.asarray(cv2.medianBlur(mask.astype(np.uint8), 3) > 0)
