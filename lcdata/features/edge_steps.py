"""Depth discontinuities of sparse scans on distance fields of the image: a cost of poses.

A sweep of few rings has hardly any edge that is good enough to measure with, but hundreds of
steps of range and of reflectance along its rings. Features and fields are those of `nid_edges`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lcdata.features.nid_edges import TRUNCATIONS, EdgeFields, edge_costs, edge_gradient
from lcdata.features.nid_views import BLOCK_GRID, BLOCKS, NidImage, flat, visible

Array = NDArray[np.float64]
Floats = NDArray[np.float32]

FINEST = (len(TRUNCATIONS) - 2, len(TRUNCATIONS) - 1)
"""Distance fields of the last steps."""


@dataclass(frozen=True, eq=False)
class StepView:
    """Discontinuities of one pair in view near a pose.

    Args:
        image: Its camera and resolution.
        fields: Distances to the image's edges.
        points: (N, 3) float32 in the LiDAR frame, metres.
        weights: (N,) float32 of sum 1.
        blocks: (N,) part of the image, below `BLOCKS`.
    """

    image: NidImage
    fields: EdgeFields
    points: Floats
    weights: Floats
    blocks: NDArray[np.uint8]

    def part(self, index: NDArray[Any]) -> StepView:
        """Some of the points."""
        weights = self.weights[index]
        weights = weights / np.float32(max(float(weights.sum()), 1e-9))
        points = np.ascontiguousarray(self.points[index])
        return StepView(self.image, self.fields, points, weights, self.blocks[index])


def step_view(
    image: NidImage, fields: EdgeFields, cloud: Floats, points: Floats, weights: Floats, T: Array
) -> StepView:
    """The discontinuities that the camera sees or nearly sees at a pose.

    Args:
        image: What sees them.
        fields: Distances to its edges.
        cloud: (K, 3) all points, metres, that may hide others.
        points: (N, 3) at discontinuities.
        weights: (N,) their weights.
        T: 4x4 `T_camera_lidar`.
    """
    seen = visible(image, np.concatenate([cloud, points]), T)
    own = seen.index >= len(cloud)
    index = seen.index[own] - len(cloud)
    whole = StepView(image, fields, points[index], weights[index], seen.blocks[own])
    return whole.part(np.arange(len(index)))


@dataclass(frozen=True, eq=False)
class StepCost:
    """Mean over pairs of the fields at the discontinuities; a `pose_cost.PoseCost`.

    Args:
        views: One a pair.
    """

    views: Sequence[StepView]

    @property
    def count(self) -> int:
        """Discontinuities of all pairs."""
        return sum(len(v.points) for v in self.views)

    def hard(self, poses: Array, levels: Sequence[int] = FINEST) -> Array:
        """Costs of (P, 4, 4) poses, (P,): 0 of chance, below it where edges agree."""
        rows = flat(poses)
        costs = np.zeros(len(poses))
        for v in self.views:
            weights = v.weights / np.float32(len(levels) * len(self.views))
            camera = v.image.model, v.image.parameters
            fields = v.fields.fields
            edge_costs(*camera, rows, v.points, weights, fields, np.array(levels), costs)
        return costs

    def soft(self, T: Array, levels: Sequence[int] = FINEST) -> tuple[float, Array]:
        """Interpolated cost of a pose, and its gradient by part of each image.

        Returns:
            The cost, and (len(views) * BLOCKS, 6) by a left perturbation.
        """
        pose = flat(T[None])[0]
        total, gradients = 0.0, np.zeros((len(self.views), BLOCKS, 6))
        for v, shares in zip(self.views, gradients, strict=True):
            weights = v.weights / np.float32(len(levels) * len(self.views))
            camera = v.image.model, v.image.parameters
            fields = v.fields.fields, np.array(levels)
            total += edge_gradient(*camera, pose, v.points, weights, *fields, v.blocks, shares)
        return total, gradients.reshape(-1, 6)

    def slope(self, T: Array) -> tuple[float, Array]:
        """Interpolated cost of a pose, and its (6,) gradient."""
        cost, shares = self.soft(T)
        return cost, shares.sum(axis=0)

    def thinned(self, count: int, rng: np.random.Generator) -> StepCost:
        """So many points of all pairs together."""
        return self.sampled(count / max(self.count, 1), rng) if count < self.count else self

    def sampled(self, share: float, rng: np.random.Generator) -> StepCost:
        """A random share of the points."""
        return StepCost(
            [v.part(np.flatnonzero(rng.random(len(v.points)) < share)) for v in self.views]
        )

    def half(self, odd: int) -> StepCost:
        """Every other pair; of a single pair every other part of the image, as on a chessboard."""
        if len(self.views) > 1:
            return StepCost(self.views[odd::2])
        (v,) = self.views
        columns = BLOCK_GRID[0]
        mine = (v.blocks // columns + v.blocks % columns) % 2 == odd
        return StepCost([v.part(np.flatnonzero(mine))])
