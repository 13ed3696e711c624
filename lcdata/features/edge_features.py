"""What the edge method knows of one pair, whatever the pose."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lcdata.features.cloud_edge_points import CloudEdgePoints, cloud_edge_points
from lcdata.features.image_edges import ImageEdges, image_edges
from lcdata.features.nid_edges import EdgeFields, edge_fields, edge_points
from lcdata.features.nid_views import NEAREST_M, NidImage, nid_image
from lcdata.pair import Pair

Floats = NDArray[np.float32]

MOST_POINTS = 200_000
"""Points that may hide edges: more are thinned out."""


@dataclass(frozen=True, eq=False)
class EdgeFeatures:
    """Edges of one pair.

    Args:
        image: Its camera and resolution.
        image_edges: Edge points of the image.
        cloud: (N, 3) float32 in the LiDAR frame, metres, finite: what may hide edges.
        lines: Edges of the cloud that have a direction; None for "discontinuity".
        steps: (M, 3) float32 steps of range and reflectance along rings, metres.
        step_weights: (M,) float32.
        fields: Distances to the image's edges for the steps; None for "continuous".
    """

    image: NidImage
    image_edges: ImageEdges
    cloud: Floats
    lines: CloudEdgePoints | None
    steps: Floats
    step_weights: Floats
    fields: EdgeFields | None


def edge_features(pair: Pair, with_lines: bool, with_steps: bool, borders: bool) -> EdgeFeatures:
    """Find the edges of one pair.

    Args:
        pair: Intensity is optional.
        with_lines: Find edges with direction.
        with_steps: Find steps along rings.
        borders: See `cloud_edge_points`.
    """
    with np.errstate(invalid="ignore", over="ignore"):
        points = np.asarray(pair.points, np.float32)
        size = np.abs(points).sum(axis=1)
        good = np.isfinite(points).all(axis=1) & (size > NEAREST_M) & (size < 1e6)
    image = nid_image(pair.image, pair.camera)
    cloud = points[good]
    cloud = np.ascontiguousarray(cloud[:: len(cloud) // MOST_POINTS + 1])
    steps, weights = np.zeros((0, 3), np.float32), np.zeros(0, np.float32)
    if with_steps:
        light = pair.intensity
        if light is None:
            light = np.ones(len(points), np.float32)
        steps, weights = edge_points(
            points, np.asarray(light, np.float32), pair.organised, pair.ring
        )
    return EdgeFeatures(
        image,
        image_edges(image),
        cloud,
        cloud_edge_points(pair, borders) if with_lines else None,
        steps,
        weights,
        edge_fields(image) if with_steps else None,
    )
