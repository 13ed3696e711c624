"""Edges of clouds laid on edges of images: association, weights, minimisation.

Yuan et al. 2021, sections III-C and III-D. A point P of a cloud edge has the residual
r = n . (pi(T P) - q), with q the image edge point next to its projection and n across that edge.
Its variance is that of both sensors, J_w Sigma J_w^T: range and bearing of the LiDAR through the
projection, and the image's pixels.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lcdata.features.cloud_edge_points import CloudEdgePoints
from lcdata.features.edge_projection import directional_costs, project_edges
from lcdata.features.image_edges import ImageEdges
from lcdata.features.nid_search import Stage, different, shrinking_search
from lcdata.features.nid_views import BLOCK_GRID, BLOCKS, NidImage, flat, visible
from lcdata.geometry import se3

Array = NDArray[np.float64]

GATES = (0.03, 0.02, 0.014, 0.01, 0.007, 0.005)
"""Largest distances of a match, radians, from round to round: the paper's 25 to 7 pixels."""

ROUNDS = 3
"""Associations a gate; the last gate has so many more until the pose settles."""
LAST_ROUNDS = 12

CAUCHY = 1.0
"""Residual, in standard deviations, at which a match has lost half its weight."""

FADE = 0.35
"""The same in shares of the gate, where that is larger: early rounds must draw from afar."""

GAIN = 2.0
"""Residual, in standard deviations, at which a match gains half."""

RADIANS_A_SIGMA = 0.002
"""About what a standard deviation of the residuals is, radians."""

LARGEST_STEP = np.repeat([0.05, np.deg2rad(0.5)], 3)
"""Of one round: metres, radians."""

SETTLED_M, SETTLED_RAD = 1e-4, np.deg2rad(0.001)

CELL = 1.0
"""Edge points in one pixel are one: edges of overlapping voxels repeat each other."""


@dataclass(frozen=True)
class EdgeNoise:
    """Standard deviations of the measurements (the published code's values).

    Args:
        range_m: Of the LiDAR's range, metres.
        bearing_rad: Of its directions, radians.
        pixel: Of an image edge across itself, pixels.
    """

    range_m: float = 0.02
    bearing_rad: float = np.deg2rad(0.05)
    pixel: float = 1.0


@dataclass(frozen=True, eq=False)
class EdgeView:
    """What one pair has in view near a pose.

    Args:
        image: Its camera and resolution.
        edges: Of the image.
        points: (N, 3) on cloud edges in the LiDAR frame, metres.
        tangents: (N, 3) unit directions of these edges.
        spread: (N,) standard deviations of these edges across themselves, metres.
        blocks: (N,) part of the image, below `BLOCKS`.
    """

    image: NidImage
    edges: ImageEdges
    points: Array
    tangents: Array
    spread: Array
    blocks: NDArray[np.uint8]

    def part(self, index: NDArray[Any]) -> EdgeView:
        """Some of the points."""
        return EdgeView(
            self.image,
            self.edges,
            np.ascontiguousarray(self.points[index]),
            np.ascontiguousarray(self.tangents[index]),
            self.spread[index],
            self.blocks[index],
        )


@dataclass(frozen=True, eq=False)
class Matches:
    """Residuals of one association at a pose, of all pairs together.

    Args:
        residual: (M,) pixels.
        jacobian: (M, 6) by a left perturbation of the pose, translation then rotation.
        sigma: (M,) standard deviations of the residuals, pixels.
        cluster: (M,) part of the image of which pair, for what is wrong together.
        tangents: (M, 3) directions of the cloud edges.
        normals: (M, 2) across the image edges.
        proof: (M,) what a match counts, 0 .. 1: see `ImageEdges.alone`.
    """

    residual: Array
    jacobian: Array
    sigma: Array
    cluster: NDArray[np.int64]
    tangents: Array
    normals: Array
    proof: Array


@dataclass(frozen=True, eq=False)
class Aligned:
    """Where a minimisation ended.

    Args:
        T: 4x4 `T_camera_lidar`.
        matches: Of the last association at T.
        weights: (M,) robust weights times inverse variances.
        cost: Minus the mean gain of an edge point: 0 without matches, -1 if all fit exactly.
    """

    T: Array
    matches: Matches
    weights: Array
    cost: float


def edge_view(
    image: NidImage,
    edges: ImageEdges,
    cloud: NDArray[np.float32],
    cloud_edges: CloudEdgePoints,
    T: Array,
) -> EdgeView:
    """The cloud edges that the camera sees or nearly sees at a pose, one a pixel.

    Args:
        image: What sees them.
        edges: Of the image.
        cloud: (K, 3) all points, metres, that may hide edges.
        cloud_edges: Of the cloud.
        T: 4x4 `T_camera_lidar`.
    """
    everything = np.concatenate([cloud, cloud_edges.points.astype(np.float32)])
    seen = visible(image, everything, T)
    own = seen.index >= len(cloud)
    index = seen.index[own] - len(cloud)
    cell = np.floor(seen.pixels[own] / CELL).astype(np.int64)
    _, first = np.unique(cell[:, 1] * (1 << 20) + cell[:, 0], return_index=True)
    chosen = index[first]
    return EdgeView(
        image,
        edges,
        np.ascontiguousarray(cloud_edges.points[chosen]),
        np.ascontiguousarray(cloud_edges.tangents[chosen]),
        cloud_edges.sigma[chosen],
        seen.blocks[own][first],
    )


@dataclass(frozen=True, eq=False)
class Alignment:
    """Cloud edges of pairs with one extrinsic, to be laid on their images' edges.

    Args:
        views: One a pair.
        noise: Of the measurements.
        angle_rad: Largest angle between a projected edge and its match.
    """

    views: Sequence[EdgeView]
    noise: EdgeNoise
    angle_rad: float

    @property
    def count(self) -> int:
        """Edge points of all pairs."""
        return sum(len(v.points) for v in self.views)

    def costs(self, poses: Array, level: int) -> Array:
        """Costs of (P, 4, 4) poses by the images' fields, (P,): 0 of chance, down to about -1."""
        rows = flat(poses)
        costs = np.zeros(len(poses))
        for v in self.views:
            weights = np.full(len(v.points), 1.0 / max(self.count, 1))
            field, stride = v.edges.fields[level], v.edges.strides[level]
            camera = v.image.model, v.image.parameters
            directional_costs(*camera, rows, v.points, v.tangents, weights, field, stride, costs)
        return costs

    def matches(self, T: Array, gate: float) -> Matches:
        """Associate every edge point with the image edge next to it.

        Args:
            T: 4x4 `T_camera_lidar`.
            gate: Largest distance, radians.
        """
        parts = [self._match(v, k, T, gate) for k, v in enumerate(self.views)]
        return Matches(*(np.concatenate(column) for column in zip(*parts, strict=True)))

    def _match(
        self, view: EdgeView, number: int, T: Array, gate: float
    ) -> tuple[NDArray[Any], ...]:
        count = len(view.points)
        pixels, along = np.empty((count, 2)), np.empty((count, 2))
        by_point = np.empty((count, 2, 3))
        pose = flat(T[None])[0]
        camera = view.image.model, view.image.parameters
        project_edges(*camera, pose, view.points, view.tangents, pixels, along, by_point)
        height, width = view.image.grey.shape
        inside = (pixels > -0.5).all(axis=1) & (along != 0.0).any(axis=1)
        inside &= (pixels < [width - 0.5, height - 0.5]).all(axis=1)
        seen = np.flatnonzero(inside)
        reach = gate * view.image.focal
        index = view.edges.nearest(pixels[seen], along[seen], reach, self.angle_rad)
        seen, index = seen[index >= 0], index[index >= 0]
        n = view.edges.normals[index]
        residual = ((pixels[seen] - view.edges.points[index]) * n).sum(axis=1)
        # Its derivative by the point in the camera frame.
        a = np.einsum("ni,nij->nj", n, by_point[seen])
        turned = view.points[seen] @ T[:3, :3].T
        jacobian = np.concatenate([a, np.cross(turned + T[:3, 3], a)], axis=1)
        variance = lidar_variance(a, turned, self.noise) + self.noise.pixel**2
        variance += view.spread[seen] ** 2 * (a**2).sum(axis=1)
        sigma = np.sqrt(variance)
        cluster = number * BLOCKS + view.blocks[seen].astype(np.int64)
        proof = view.edges.alone[index]
        return residual, jacobian, sigma, cluster, view.tangents[seen], n, proof

    def minimise(self, T: Array, gates: Sequence[float] = GATES) -> Aligned:
        """Associate and solve again and again, with gates that shrink."""
        for k, gate in enumerate(gates):
            last = k + 1 == len(gates)
            for _ in range(LAST_ROUNDS if last else ROUNDS):
                found = self.matches(T, gate)
                step = self._step(found, gate)
                T = se3.exp(step) @ T
                if np.abs(step[:3]).max() < SETTLED_M and np.abs(step[3:]).max() < SETTLED_RAD:
                    break
        return self.at(T, gates[-1])

    def at(self, T: Array, gate: float = GATES[-1]) -> Aligned:
        """The matches of a pose with their weights, and its cost."""
        found = self.matches(T, gate)
        square = (found.residual / found.sigma) ** 2
        weights = found.proof / (1.0 + square / CAUCHY**2) / found.sigma**2
        gain = found.proof / (1.0 + square / GAIN**2)
        return Aligned(T, found, weights, -float(gain.sum()) / max(self.count, 1))

    def _step(self, found: Matches, gate: float) -> Array:
        """Gauss-Newton with a Cauchy loss, damped and bounded: (6,) twist."""
        if len(found.residual) < 6:
            return np.zeros(6)
        step = np.zeros(6)
        scale = max(CAUCHY, FADE * gate / RADIANS_A_SIGMA)
        for _ in range(3):
            residual = found.residual + found.jacobian @ step
            weights = found.proof / found.sigma**2
            weights /= 1.0 + (residual / found.sigma / scale) ** 2
            weighted = found.jacobian * weights[:, None]
            H = weighted.T @ found.jacobian
            H += 1e-6 * np.diag(np.diag(H)) + 1e-12 * np.trace(H) * np.eye(6)
            step = step - np.linalg.solve(H, weighted.T @ residual)
        return np.asarray(np.clip(step, -LARGEST_STEP, LARGEST_STEP))

    def thinned(self, count: int, rng: np.random.Generator) -> Alignment:
        """At most so many points of all pairs together."""
        share = count / max(self.count, 1)
        if share >= 1.0:
            return self
        views = [v.part(rng.random(len(v.points)) < share) for v in self.views]
        return Alignment(views, self.noise, self.angle_rad)

    def half(self, odd: int) -> Alignment:
        """Every other pair; of a single pair every other part of the image, as on a chessboard."""
        if len(self.views) > 1:
            return Alignment(self.views[odd::2], self.noise, self.angle_rad)
        columns = BLOCK_GRID[0]
        (v,) = self.views
        mine = (v.blocks // columns + v.blocks % columns) % 2 == odd
        return Alignment([v.part(mine)], self.noise, self.angle_rad)


SEARCH_POINTS, SEARCH_POINTS_PAIR = 800, 300
"""Edge points that the search looks at: of all pairs together, or a pair if that is more."""

STAGES = (
    Stage(0, 0.35, 60, 800),
    Stage(1, 0.2, 40, 600),
    Stage(1, 0.12, 25, 400),
    Stage(2, 0.07, 15, 300),
    Stage(2, 0.04, 10, 200),
)


def rough_poses(
    alignment: Alignment,
    T: Array,
    box: Array,
    samples: int,
    candidates: int,
    rng: np.random.Generator,
) -> Array:
    """Different good poses in a box, best first: (K, 4, 4).

    The published rough stage turns about one axis at a time, 50 steps of 0.1 degrees, and counts
    matched points; it does not move. This samples all six directions.

    Args:
        alignment: What to search.
        T: 4x4 middle of the box.
        box: (6,) half-widths, metres then radians.
        samples: Poses in the first round.
        candidates: How many poses.
        rng: Of everything random.
    """
    count = max(SEARCH_POINTS, SEARCH_POINTS_PAIR * len(alignment.views))
    thin = alignment.thinned(count, rng)
    costs = [lambda poses, level=level: thin.costs(poses, level) for level in range(3)]
    half_width = np.concatenate([box[3:], box[:3]])
    poses, _ = shrinking_search(costs, T, half_width, samples, STAGES, rng)
    return different(poses, candidates, 0.1 * box)


def lidar_variance(a: Array, turned: Array, noise: EdgeNoise) -> Array:
    """Variance of residuals from the LiDAR's range and bearing noise, (N,) squared pixels.

    Args:
        a: (N, 3) derivatives of the residuals by the point in the camera frame.
        turned: (N, 3) points, turned into the camera frame but not moved: the LiDAR's rays.
        noise: Standard deviations.
    """
    square = (turned**2).sum(axis=1)
    along = (a * turned).sum(axis=1) ** 2 / np.maximum(square, 1e-12)
    across = np.maximum((a**2).sum(axis=1) - along, 0.0)
    return np.asarray(noise.range_m**2 * along + noise.bearing_rad**2 * square * across)
