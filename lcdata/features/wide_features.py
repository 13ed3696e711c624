"""What the wide-range method takes from one pair, whatever the pose."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lcdata.errors import CalibrationError
from lcdata.features.nid_edges import edge_distance, edge_fields, edge_points
from lcdata.features.nid_objective import NEIGHBOURHOOD, NidFeatures
from lcdata.features.nid_views import NEAREST_M, nid_image, pixels_per_radian
from lcdata.features.wide_frames import signature
from lcdata.features.wide_labels import descriptors
from lcdata.pair import Pair

Array = NDArray[np.float64]
Floats = NDArray[np.float32]

FOCAL = 720.0
"""Images are reduced to so many pixels a radian: a LiDAR's spot is a few mrad wide."""

FEWEST_POINTS = 200
"""Returns below which a cloud says nothing."""


@dataclass(frozen=True, eq=False)
class WideFeatures:
    """Features of one pair.

    Args:
        nid: What `nid_edge` takes: points, intensities (zeros where there are none), cloud edges,
            and the reduced image with the ranks of its grey among what is around.
        has_light: Whether intensities say anything.
        distance: (h, w) float32 pixels to the next image edge.
        descriptors: (h, w, 5) float16 what each cell looks like, for each level.
        signature: What tells this scene from others.
    """

    nid: NidFeatures
    has_light: bool
    distance: Floats
    descriptors: list[NDArray[np.float16]]
    signature: NDArray[np.float16]


def wide_features(pair: Pair) -> WideFeatures:
    """Features of one pair.

    Raises:
        CalibrationError: No points, or a picture of one grey.
    """
    import cv2

    name = f"pair {pair.pair_id}" if pair.pair_id else "pair"
    with np.errstate(invalid="ignore", over="ignore"):
        points = np.asarray(pair.points, np.float32)
        good = np.isfinite(points).all(axis=1)
        good &= np.abs(points).sum(axis=1) > NEAREST_M
        good &= np.abs(points).max(axis=1, initial=0.0) < 1e4
        light = _usable(pair, good)
        if light is not None:
            good &= np.isfinite(light)
    if good.sum() < FEWEST_POINTS:
        raise CalibrationError(
            f"{name}: {int(good.sum())} of {len(points)} points are finite and {NEAREST_M} m off",
            f"give a cloud of {FEWEST_POINTS} returns or more",
        )
    if pair.image.min() == pair.image.max():
        raise CalibrationError(
            f"{name}: all pixels are {int(pair.image.min())}", "wide needs a picture"
        )
    image, camera = pair.image, pair.camera
    focal = pixels_per_radian(camera)
    if focal > 1.25 * FOCAL:
        size = (round(camera.width * FOCAL / focal), round(camera.height * FOCAL / focal))
        image = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
        camera = camera.resized(*size)
    ranked = nid_image(image, camera, NEIGHBOURHOOD)
    paint = np.zeros(len(points), np.float32) if light is None else light
    edges, weights = edge_points(points, paint, pair.organised, pair.ring)
    nid = NidFeatures(
        ranked,
        np.ascontiguousarray(points[good]),
        np.ascontiguousarray(paint[good]),
        edges,
        weights,
        edge_fields(ranked),
    )
    return WideFeatures(
        nid,
        light is not None,
        edge_distance(ranked.grey, ranked.focal),
        descriptors(image, ranked.focal),
        signature(nid.points),
    )


def _usable(pair: Pair, good: NDArray[np.bool_]) -> Floats | None:
    """(N,) intensities, NaN where there is none; None where they say nothing."""
    if pair.intensity is None:
        return None
    light = np.asarray(pair.intensity, np.float32)
    known = light[good & np.isfinite(light)]
    return light if len(known) and known.min() < known.max() else None
