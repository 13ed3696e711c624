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

ON_EDGE = 0.9
"""Gradient at a mask's border, as a share of the largest one near it, that shows it on an edge."""


def given_masks(
    pair: Pair,
    masks: str | os.PathLike[str],
    model: str | os.PathLike[str],
    classes: Mapping[str, Sequence[int]] | None,
    contours: str = "never",
) -> RoadImage:
    """Lanes and poles of one pair's image.

    Args:
        pair: The pair.
        masks: See `lcdata.features.mask_files.mask_file`; or "".
        model: See `lcdata.features.segmentation.segment`; used without masks.
        classes: Of the model.
        contours: Whether to move borders onto the image's edges: always, never, or where they lie
            beside (auto).

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
    if contours != "never":
        grey = worked(_grey(pair.image), camera)
        focal = max(pinhole.pixels_per_radian)
        found = [
            snapped(mask, grey, focal)
            if contours == "always" or beside(mask, grey, focal)
            else mask
            for mask in found
        ]
    return road_image(found[0], found[1] if len(found) > 1 else None, pinhole)


def beside(mask: Mask, grey: Bytes, focal: float) -> bool:
    """Whether a mask's borders lie beside the image's edges rather than on them.

    The image's gradient across the border is averaged by the distance from it: it is largest at a
    border that lies on edges, and farther off at one that is displaced or drawn too wide.

    Args:
        mask: (h, w).
        grey: (h, w) uint8 image.
        focal: Pixels a radian.
    """
    import cv2

    reach = max(2, round(WINDOW * focal))
    deep = cv2.distanceTransform(mask.astype(np.uint8), cv2.DIST_L2, 3)
    far = cv2.distanceTransform((~mask).astype(np.uint8), cv2.DIST_L2, 3)
    light = cv2.GaussianBlur(grey, (0, 0), 1.0)
    near = np.flatnonzero(cv2.add(deep, far) < reach + 0.5)
    across, down = (
        cv2.Sobel(light, cv2.CV_32F, *d, ksize=3).ravel()[near] for d in ((1, 0), (0, 1))
    )
    slope = np.hypot(across, down)
    # Depths of -0.5 and 0.5 are those of the pixels on both sides of the border.
    depth = np.where(mask.ravel()[near], deep.ravel()[near] - 0.5, 0.5 - far.ravel()[near])
    ring = np.floor(depth).astype(np.int64) + reach
    mean = np.bincount(ring, slope) / np.maximum(np.bincount(ring), 1)
    return bool(mean[reach - 1 : reach + 1].max() < ON_EDGE * mean.max())


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
    near = np.flatnonzero(cv2.dilate(mask.astype(np.uint8), disc))
    grey_near, total_near = light.ravel()[near], total.ravel()[near]
    mask = mask.copy()
    for _ in range(TURNS):
        share = mask.astype(np.float32)
        part = cv2.blur(share, window).ravel()[near]
        inside = cv2.blur(light * share, window).ravel()[near]
        outside = (total_near - inside) / np.maximum(1.0 - part, 1e-3)
        inside = inside / np.maximum(part, 1e-3)
        clear = (np.abs(inside - outside) > CONTRAST) & (part > 1e-3) & (part < 0.999)
        nearer = np.abs(grey_near - inside) < np.abs(grey_near - outside)
        mask.ravel()[near[clear]] = nearer[clear]
    return np.asarray(cv2.medianBlur(mask.astype(np.uint8), 3) > 0)
