"""What the NID methods minimise: NID of one pair or several, and with it, if asked, edges."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lcdata.errors import CalibrationError
from lcdata.features.nid_cost import cost_of, cost_slopes
from lcdata.features.nid_edges import (
    TRUNCATIONS,
    EdgeFields,
    edge_costs,
    edge_fields,
    edge_gradient,
    edge_points,
)
from lcdata.features.nid_kernels import BINS, count_hard, count_soft, soft_gradient
from lcdata.features.nid_views import (
    BLOCKS,
    NEAREST_M,
    NidCloud,
    NidImage,
    flat,
    nid_cloud,
    nid_image,
    visible,
)
from lcdata.pair import Pair

Array = NDArray[np.float64]
Floats = NDArray[np.float32]

LEAST_SHARE = 0.6
"""Least part of the points first in view that must stay in view."""

BORDER = 0.006
"""Width of the strip along the image's border in which points fade, radians."""

NID_SCALE, EDGE_SCALE = 0.01, 0.05
"""What NID and edges are divided by before they are added."""

NEIGHBOURHOOD = 0.25
"""With edges, pixels are ranked against the box of so many radians around them."""

FINEST = (len(TRUNCATIONS) - 2, len(TRUNCATIONS) - 1)
"""Distance fields of the last steps."""


@dataclass(frozen=True, eq=False)
class NidFeatures:
    """What one pair gives, whatever the pose.

    Args:
        image: Equalised.
        points: (N, 3) float32 in the LiDAR frame, metres, finite.
        intensity: (N,) float32, finite.
        edges: (M, 3) float32 cloud edges in the LiDAR frame, metres; none for plain NID.
        edge_weights: (M,) float32.
        fields: Distances to the image's edges; None for plain NID.
    """

    image: NidImage
    points: Floats
    intensity: Floats
    edges: Floats
    edge_weights: Floats
    fields: EdgeFields | None


def nid_features(pair: Pair, with_edges: bool) -> NidFeatures:
    """Features of one pair.

    Raises:
        CalibrationError: No intensities, or all alike.
    """
    name = f"pair {pair.pair_id}" if pair.pair_id else "pair"
    if pair.intensity is None:
        raise CalibrationError(
            f"{name}: the cloud has no intensity field", "use a line method: projection or plk"
        )
    with np.errstate(invalid="ignore", over="ignore"):
        points = np.asarray(pair.points, np.float32)
        intensity = np.asarray(pair.intensity, np.float32)
        x, y, z = np.abs(points.T)
        good = np.isfinite(intensity) & (x + y + z > NEAREST_M)
        good &= (x < 1e6) & (y < 1e6) & (z < 1e6)  # and no NaN
    light = intensity[good]
    if len(light) and light.min() == light.max():
        raise CalibrationError(
            f"{name}: all intensities are {light[0]:g}",
            "nid compares intensities; record them, or use a line method",
        )
    if pair.image.min() == pair.image.max():
        raise CalibrationError(
            f"{name}: all pixels are {int(pair.image.min())}", "nid needs a picture"
        )
    image = nid_image(pair.image, pair.camera, NEIGHBOURHOOD if with_edges else 0.0)
    edges, weights = np.zeros((0, 3), np.float32), np.zeros(0, np.float32)
    fields = None
    if with_edges:
        edges, weights = edge_points(points, intensity, pair.organised, pair.ring)
        fields = edge_fields(image)
    return NidFeatures(
        image,
        np.ascontiguousarray(points[good]),
        np.ascontiguousarray(light),
        edges,
        weights,
        fields,
    )


@dataclass(frozen=True, eq=False)
class View:
    """What of one pair counts at poses near the one that it was culled for.

    Args:
        image: Equalised.
        cloud: Points in view.
        edges: (M, 3) float32 cloud edges in view, in the LiDAR frame, metres.
        edge_weights: (M,) float32, of sum 1.
        edge_blocks: (M,) uint8 part of the image, below `BLOCKS`.
        fields: Distances to the image's edges.
    """

    image: NidImage
    cloud: NidCloud
    edges: Floats
    edge_weights: Floats
    edge_blocks: NDArray[np.uint8]
    fields: EdgeFields | None

    def part(self, points: NDArray[Any], edges: NDArray[Any]) -> View:
        """Some of the points and edges, by index or mask."""
        weights = self.edge_weights[edges]
        return View(
            self.image,
            self.cloud.part(points),
            self.edges[edges],
            weights / np.float32(max(float(weights.sum()), 1e-9)),
            self.edge_blocks[edges],
            self.fields,
        )


def view(features: NidFeatures, T: Array) -> View:
    """Remove what is hidden or far out of view at a pose."""
    count = len(features.points)
    seen = visible(features.image, np.concatenate([features.points, features.edges]), T)
    is_edge = seen.index >= count
    weights = features.edge_weights[seen.index[is_edge] - count]
    own = replace(
        seen,
        index=seen.index[~is_edge],
        pixels=seen.pixels[~is_edge],
        blocks=seen.blocks[~is_edge],
        inside=seen.inside[~is_edge],
    )
    return View(
        features.image,
        nid_cloud(own, features.points, features.intensity),
        np.ascontiguousarray(features.edges[seen.index[is_edge] - count]),
        weights / np.float32(max(float(weights.sum()), 1e-9)),
        seen.blocks[is_edge],
        features.fields,
    )


@dataclass(frozen=True, eq=False)
class Objective:
    """Cost of poses over pairs that share their extrinsic.

    Without edges the mean NID (see `nid_cost`) of the pairs, 0 .. 1; with them NID / 0.01 + edges
    / 0.05.

    Args:
        views: One a pair.
        with_edges: Whether edges count.
    """

    views: Sequence[View]
    with_edges: bool

    @property
    def inside(self) -> int:
        """Points in the images at the pose that the views were made for."""
        return sum(v.cloud.inside for v in self.views)

    def hard(self, poses: Array, levels: Sequence[int] = FINEST) -> Array:
        """Costs of (P, 4, 4) poses with hard bins: (P,); infinite where too much left the view."""
        rows = flat(poses)
        costs, inside = np.zeros(len(poses)), np.zeros(len(poses))
        for v in self.views:
            counts = np.zeros((len(poses), BINS, BINS), np.int32)
            camera = v.image.model, v.image.parameters
            count_hard(*camera, rows, v.cloud.points, v.cloud.bins, v.image.hard, counts)
            costs += cost_of(counts, len(v.cloud.points)) * self._nid_weight
            inside += counts.sum(axis=(1, 2))
            if self.with_edges and v.fields is not None:
                weights = v.edge_weights * np.float32(self._edge_weight / len(levels))
                fields = v.fields.fields
                edge_costs(*camera, rows, v.edges, weights, fields, np.array(levels), costs)
        costs[inside < LEAST_SHARE * self.inside] = np.inf
        return costs

    def soft(self, T: Array, levels: Sequence[int] = FINEST) -> tuple[float, Array]:
        """Cost of a pose with soft bins, and its gradient by a left perturbation.

        Args:
            T: 4x4.
            levels: Distance fields to use.

        Returns:
            The cost, and (len(views) * BLOCKS, 6) shares of the gradient by part of the image,
            translation (a metre) then rotation (a radian).
        """
        pose = flat(T[None])[0]
        total, gradients = 0.0, np.zeros((len(self.views), BLOCKS, 6))
        for v, shares in zip(self.views, gradients, strict=True):
            camera = v.image.model, v.image.parameters
            counts = np.zeros((BINS, BINS))
            kept = np.empty((len(v.cloud.points), 11), np.float32)
            border = BORDER * v.image.focal
            count_soft(
                *camera, pose, v.cloud.points, v.cloud.bins, v.image.soft, border, counts, kept
            )
            cost, slopes = cost_slopes(counts, len(v.cloud.points))
            total += cost * self._nid_weight
            soft_gradient(v.cloud.bins, kept, slopes * self._nid_weight, v.cloud.blocks, shares)
            if self.with_edges and v.fields is not None:
                weights = v.edge_weights * np.float32(self._edge_weight / len(levels))
                fields, chosen = v.fields.fields, np.array(levels)
                total += edge_gradient(
                    *camera, pose, v.edges, weights, fields, chosen, v.edge_blocks, shares
                )
        return total, gradients.reshape(-1, 6)

    def slope(self, T: Array) -> tuple[float, Array]:
        """Cost of a pose with soft bins, and its (6,) gradient."""
        cost, shares = self.soft(T)
        return cost, shares.sum(axis=0)

    @property
    def _nid_weight(self) -> float:
        return (1.0 / NID_SCALE if self.with_edges else 1.0) / len(self.views)

    @property
    def _edge_weight(self) -> float:
        return 1.0 / EDGE_SCALE / len(self.views)

    def thinned(self, count: int, rng: np.random.Generator) -> Objective:
        """So many points of all pairs together, and all edges."""
        share = count / max(sum(len(v.cloud.points) for v in self.views), 1)
        if share >= 1.0:
            return self
        return self._sample(share, 1.0, rng)

    def sampled(self, share: float, rng: np.random.Generator) -> Objective:
        """A random share of points and edges."""
        return self._sample(share, share, rng)

    def _sample(self, points: float, edges: float, rng: np.random.Generator) -> Objective:
        views = []
        for v in self.views:
            chosen = np.flatnonzero(rng.random(len(v.cloud.points)) < points)
            views.append(v.part(chosen, np.flatnonzero(rng.random(len(v.edges)) < edges)))
        return Objective(views, self.with_edges)

    def half(self, odd: int) -> Objective:
        """Every other pair; of a single pair every other part of the image, as on a chessboard."""
        if len(self.views) > 1:
            return Objective(self.views[odd::2], self.with_edges)
        (v,) = self.views
        columns = 8

        def mine(blocks: NDArray[np.uint8]) -> NDArray[np.bool_]:
            return np.asarray((blocks // columns + blocks % columns) % 2 == odd)

        return Objective([v.part(mine(v.cloud.blocks), mine(v.edge_blocks))], self.with_edges)


def objective(features: Sequence[NidFeatures], T: Array, with_edges: bool) -> Objective:
    """The objective for poses near `T`."""
    return Objective([view(f, T) for f in features], with_edges)
