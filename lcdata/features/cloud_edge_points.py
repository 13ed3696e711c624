"""Edges of a cloud with their directions, from any kind of scan.

A dense cloud without order (a merged or a Livox one) is cut into voxels, as in Yuan et al. 2021:
lines in which planes meet are known to millimetres. A scan of rings has its neighbours already:
there the lines of `cloud_lines` serve, which are intersections of whole planes and outlines known
to half a beam. A dense cloud's own borders of depth and of reflectance, from its virtual images
(`view_edges`), are rougher but many: where structures are few or walls are of brick, they decide
which of many poses is meant.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lcdata.features.cloud_lines import PLANE_PLANE, extract_cloud_lines
from lcdata.features.scan_grid import scan_grid
from lcdata.pair import Pair

Array = NDArray[np.float64]

SAMPLE = 0.004
"""Spacing of points along a line, as seen from the scanner, radians."""

MOST_SAMPLES = 400
"""Points of a line at most."""

BORDER_SIGMA = 0.0015
"""Standard deviation of borders from virtual images, radians: a third of their pixel."""


@dataclass(frozen=True, eq=False)
class CloudEdgePoints:
    """Points on the edges of one cloud.

    Args:
        points: (N, 3) in the LiDAR frame, metres.
        tangents: (N, 3) unit directions of the edges.
        sigma: (N,) standard deviation of an edge across itself, metres.
    """

    points: Array
    tangents: Array
    sigma: Array

    def and_others(self, other: CloudEdgePoints) -> CloudEdgePoints:
        """These edges and others."""
        return CloudEdgePoints(
            np.concatenate([self.points, other.points]),
            np.concatenate([self.tangents, other.tangents]),
            np.concatenate([self.sigma, other.sigma]),
        )


def cloud_edge_points(pair: Pair, borders: bool) -> CloudEdgePoints:
    """Find the edges of a pair's cloud; none where it has none.

    Args:
        pair: Its points may be NaN.
        borders: Take edges where depth jumps or paint ends as well as those where planes meet.
    """
    if scan_grid(pair.points, pair.organised, pair.ring) is not None:
        lines = extract_cloud_lines(pair.points, pair.organised, pair.ring)
        chosen = (lines.kind == PLANE_PLANE) | borders
        return CloudEdgePoints(*sampled(lines.segments[chosen], lines.std[chosen]))
    from lcdata.features.voxel_edges import voxel_edges

    found = CloudEdgePoints(*voxel_edges(pair.points))
    return found.and_others(_borders(pair)) if borders else found


def _borders(pair: Pair) -> CloudEdgePoints:
    """Borders of depth and of reflectance in a cloud's virtual images."""
    from lcdata.features.view_edges import extract_cloud_edges

    with np.errstate(invalid="ignore", over="ignore"):
        square = (np.asarray(pair.points, float) ** 2).sum(axis=1)
        good = (square > 0.01) & (square < 1e8)
    if pair.intensity is not None:
        good &= np.isfinite(pair.intensity)
    if good.sum() < 100:
        return CloudEdgePoints(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0))
    intensity = None if pair.intensity is None else pair.intensity[good]
    found = extract_cloud_edges(pair.points[good], intensity)
    length = np.linalg.norm(found.tangents, axis=1)
    kept = length > 1e-9
    points = found.points[kept]
    return CloudEdgePoints(
        points,
        found.tangents[kept] / length[kept, None],
        BORDER_SIGMA * np.linalg.norm(points, axis=1),
    )


def sampled(segments: Array, sigma: Array) -> tuple[Array, Array, Array]:
    """Points along segments, evenly as the scanner sees them.

    Args:
        segments: (M, 2, 3) metres.
        sigma: (M,) metres.

    Returns:
        (N, 3) points, (N, 3) unit directions and (N,) sigma of their segments.
    """
    if not len(segments):
        return np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0)
    along = segments[:, 1] - segments[:, 0]
    length = np.linalg.norm(along, axis=1)
    distance = np.linalg.norm(segments.mean(axis=1), axis=1)
    count = np.clip(length / (SAMPLE * np.maximum(distance, 0.5)), 1, MOST_SAMPLES).astype(int)
    owner = np.repeat(np.arange(len(segments)), count)
    first = np.cumsum(count) - count
    place = (np.arange(len(owner)) - first[owner] + 0.5) / count[owner]
    points = segments[owner, 0] + place[:, None] * along[owner]
    tangents = along / np.maximum(length, 1e-12)[:, None]
    return points, tangents[owner], sigma[owner]
