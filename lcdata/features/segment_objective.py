"""How consistent the attributes of the points are within the masks that they fall into.

Luo et al., *Calib-Anything*, 2023, section III-C: for each mask the agreement of normals, of
intensities and of classes, averaged over the masks with the number of points as weights
(`segment_kernels.consistency`). With those averages s_a the published cost is

    1 - sum_a w_a s_a,    w = 0.3 (normals), 0.2 (intensity), 0.5 (class)

It also falls where the camera looks at less variety, however badly the masks fit: at the ground
alone every mask is consistent. So ours compares with the consistency S_a that the same points
have as one mask,

    sum_a w_a (1 - s_a) / (1 - S_a),    w = 0.25, 0.5, 0.25

the share of the inconsistency that the masks leave unexplained.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lcdata.features.cloud_attributes import CloudAttributes, direction_vectors
from lcdata.features.nid_views import BLOCK_GRID, BLOCKS, flat, unhidden
from lcdata.features.segment_kernels import CLASSES, consistency
from lcdata.features.segment_layers import SegmentLayers
from lcdata.geometry import camera_kernels

Array = NDArray[np.float64]
Floats = NDArray[np.float32]
Bytes = NDArray[np.uint8]

SCORES = {"published": (0.3, 0.2, 0.5), "explained": (0.25, 0.5, 0.25)}
"""Weights of normals, intensity and class."""

LEAST_SHARE = 0.6
"""Least part of the points first in view that must stay in view."""

LEAST_DENSITY = 0.1
"""A mask counts if its points are so many of those that its area would have on average."""

FEWEST = 10
"""Least points of a mask; fewer of a thinned cloud, but at least `FEWEST_THIN`."""
FEWEST_THIN = 3

HIDDEN = 0.25
"""Points so much farther than the nearest beside them are hidden. Ground seen at a grazing angle
is not: neighbouring rings are 10 % apart."""

PRIOR = 0.005
"""What it costs to be off the initial guess by the half-width of the box on one axis, beside the
sum of the costs of the pairs."""

FLAT = 1e-6
"""Inconsistency of all points together below which an attribute tells nothing."""


@dataclass(frozen=True, eq=False)
class SegmentFeatures:
    """What one pair gives, whatever the pose.

    Args:
        layers: Masks of the image.
        cloud: Points and their attributes.
        note: What should be known about them, in words.
    """

    layers: SegmentLayers
    cloud: CloudAttributes
    note: str = ""


@dataclass(frozen=True, eq=False)
class SegmentView:
    """What of one pair counts at poses near the one that it was made for.

    Args:
        layers: Masks of the image.
        points: (N, 3) float32 in the LiDAR frame, metres.
        light: (N,) float32 intensities 0 .. 1; zeros if there are none.
        has_light: Whether there are.
        directions: (N,) uint8 direction of the normal.
        classes: (N,) uint8, at most `segment_kernels.CLASSES`.
        blocks: (N,) uint8 part of the image, below `nid_views.BLOCKS`.
        inside: Points in the image.
        share: What part of the points in view these are.
    """

    layers: SegmentLayers
    points: Floats
    light: Floats
    has_light: bool
    directions: Bytes
    classes: Bytes
    blocks: Bytes
    inside: int
    share: float = 1.0

    def part(self, index: NDArray[Any]) -> SegmentView:
        """Some of the points, spread over the image."""
        share = len(index) / max(len(self.points), 1)
        return replace(
            self,
            points=self.points[index],
            light=self.light[index],
            directions=self.directions[index],
            classes=self.classes[index],
            blocks=self.blocks[index],
            inside=int(self.inside * share),
            share=self.share * share,
        )

    @property
    def fewest(self) -> Array:
        """(M + 1,) least points of each mask."""
        height, width = self.layers.labels.shape[:2]
        density = self.inside / (height * width)
        least = max(FEWEST_THIN, FEWEST * self.share)
        return np.asarray(np.maximum(least, LEAST_DENSITY * density * self.layers.areas))


def view(features: SegmentFeatures, T: Array, reach: float) -> SegmentView:
    """Remove what is hidden or far out of view at a pose.

    Args:
        features: Of the pair.
        T: 4x4 `T_camera_lidar`.
        reach: How far outside the image points may be to come into it, radians.
    """
    layers, cloud = features.layers, features.cloud
    camera = layers.camera
    index, pixels = unhidden(camera, cloud.points, T, reach * layers.focal, HIDDEN)
    u, v = pixels.T
    inside = (u >= -0.5) & (v >= -0.5) & (u < camera.width - 0.5) & (v < camera.height - 0.5)
    columns, rows = BLOCK_GRID
    column = np.clip(u * columns / camera.width, 0, columns - 1).astype(np.uint8)
    row = np.clip(v * rows / camera.height, 0, rows - 1).astype(np.uint8)
    light = np.zeros(len(index), np.float32) if cloud.intensity is None else cloud.intensity[index]
    return SegmentView(
        layers,
        np.ascontiguousarray(cloud.points[index]),
        np.ascontiguousarray(light),
        cloud.intensity is not None,
        cloud.directions[index],
        _largest(cloud.classes[index]),
        (row * columns + column).astype(np.uint8),
        int(inside.sum()),
    )


def _largest(classes: NDArray[np.int32]) -> Bytes:
    """Classes numbered anew, the largest first; `CLASSES` for none and what is left over."""
    count = np.bincount(classes[classes >= 0], minlength=1)
    order = np.argsort(-count, kind="stable")[:CLASSES]
    number = np.full(len(count) + 1, CLASSES, np.uint8)
    number[order] = np.arange(len(order))
    return number[classes]  # -1 is the last


@dataclass(frozen=True, eq=False)
class Prior:
    """The initial guess and how far it may be off: a sparse scan leaves directions open.

    Args:
        T: 4x4 initial guess.
        box: (6,) half-widths, metres then radians.
    """

    T: Array
    box: Array

    def __call__(self, poses: Array) -> Array:
        """(P,) `PRIOR` times the squared distance of (P, 4, 4) poses, in half-widths."""
        moved = (poses[:, :3, 3] - self.T[:3, 3]) / self.box[:3]
        R = poses[:, :3, :3] @ self.T[:3, :3].T
        turned = np.stack(
            [R[:, 2, 1] - R[:, 1, 2], R[:, 0, 2] - R[:, 2, 0], R[:, 1, 0] - R[:, 0, 1]]
        )
        turned = 0.5 * turned.T / self.box[3:]  # the sine of the angle will do
        return np.asarray(PRIOR * ((moved**2).sum(axis=1) + (turned**2).sum(axis=1)))

    @property
    def curvature(self) -> Array:
        """(6, 6) of it, by a left perturbation near the guess."""
        return np.diag(2.0 * PRIOR / self.box**2)


@dataclass(frozen=True, eq=False)
class SegmentObjective:
    """Cost of poses over pairs that share their extrinsic: the mean of theirs, see the module.

    Args:
        views: One a pair.
        score: One of `SCORES`.
        prior: What was known before; None if that is not to count.
    """

    views: Sequence[SegmentView]
    score: str = "explained"
    prior: Prior | None = None

    @property
    def inside(self) -> int:
        """Points in the images at the pose that the views were made for."""
        return sum(v.inside for v in self.views)

    def hard(self, poses: Array) -> Array:
        """Costs of (P, 4, 4) poses: (P,); infinite where too much left the view."""
        costs, inside = np.zeros(len(poses)), np.zeros(len(poses))
        for v in self.views:
            sums, pooled, seen = count(v, poses, 1)
            costs += self._combine(v, sums[:, 0], pooled) / len(self.views)
            inside += seen
        costs[inside < LEAST_SHARE * self.inside] = np.inf
        return costs if self.prior is None else costs + self.prior(poses) / len(self.views)

    def shares(self, poses: Array, T: Array) -> Array:
        """Parts of the image in the change of the cost from one pose to others near it.

        The cost is a ratio of sums over masks; this is its linear part around `T`.

        Args:
            poses: (P, 4, 4).
            T: 4x4 the pose.

        Returns:
            (P, len(views) * BLOCKS): masks in one part of one image together.
        """
        result = []
        for v in self.views:
            sums, pooled, _ = count(v, np.concatenate([T[None], poses]), BLOCKS)
            # All as it is at T: mean consistencies, weights, and what they are divided by.
            at = sums[0].sum(axis=0)
            mean = at[:3] / np.maximum(at[3:], 1e-9)
            slope = self._weights(v) / np.maximum(at[3:], 1e-9) / len(self.views)
            if self.score == "explained":
                slope = slope / np.maximum(1.0 - pooled[0], FLAT)
            result.append(((mean * sums[1:, :, 3:] - sums[1:, :, :3]) * slope).sum(axis=2))
        return np.concatenate(result, axis=1)

    def _weights(self, v: SegmentView) -> Array:
        weights = np.array(SCORES[self.score])
        if not v.has_light:
            weights[1] = 0.0
        return np.asarray(weights / weights.sum())

    def _combine(self, v: SegmentView, sums: Array, pooled: Array) -> Array:
        counted = sums[:, 3:] > 0
        unexplained = 1.0 - sums[:, :3] / np.maximum(sums[:, 3:], 1e-9)
        if self.score == "explained":
            spread = 1.0 - pooled
            unexplained = np.where(spread > FLAT, unexplained / np.maximum(spread, FLAT), 1.0)
        return np.asarray(np.where(counted, unexplained, 1.0) @ self._weights(v))

    def thinned(self, number: int, rng: np.random.Generator) -> SegmentObjective:
        """So many points of all pairs together."""
        share = number / max(sum(len(v.points) for v in self.views), 1)
        return self if share >= 1.0 else self.sampled(share, rng)

    def sampled(self, share: float, rng: np.random.Generator) -> SegmentObjective:
        """A random share of the points."""
        views = [v.part(np.flatnonzero(rng.random(len(v.points)) < share)) for v in self.views]
        return replace(self, views=views)

    def half(self, odd: int) -> SegmentObjective:
        """Every other pair; of a single pair every other part of the image, as on a chessboard."""
        if len(self.views) > 1:
            return replace(self, views=self.views[odd::2])
        (v,) = self.views
        columns = BLOCK_GRID[0]
        mine = np.flatnonzero((v.blocks // columns + v.blocks % columns) % 2 == odd)
        return replace(self, views=[v.part(mine)])


GRAM = np.abs(direction_vectors() @ direction_vectors().T)


def count(v: SegmentView, poses: Array, groups: int) -> tuple[Array, Array, Array]:
    """Sums over the masks, see `segment_kernels.consistency`.

    Args:
        v: One pair.
        poses: (P, 4, 4).
        groups: 1, or `BLOCKS` for sums by part of the image that the masks are in.

    Returns:
        (P, groups, 6) sums, (P, 3) consistency of all points as one, (P,) points inside.
    """
    sums, pooled = np.empty((len(poses), groups, 6)), np.empty((len(poses), 3))
    inside = np.empty(len(poses))
    camera = v.layers.camera
    group = np.zeros(len(v.layers.areas), np.int32)
    if groups > 1:
        columns, rows = BLOCK_GRID
        column = (v.layers.centres[:, 0] * columns / camera.width).astype(np.int32)
        row = (v.layers.centres[:, 1] * rows / camera.height).astype(np.int32)
        group = np.clip(row * columns + column, 0, groups - 1).astype(np.int32)
    consistency(
        camera_kernels.model_id(camera),
        camera_kernels.parameters(camera),
        flat(poses),
        v.points,
        v.light,
        v.directions,
        v.classes,
        v.layers.labels,
        v.fewest,
        group,
        GRAM,
        sums,
        pooled,
        inside,
    )
    return sums, pooled, inside


def objective(
    features: Sequence[SegmentFeatures],
    T: Array,
    reach: float,
    score: str,
    prior: Prior | None = None,
) -> SegmentObjective:
    """The objective for poses near `T`; see `view`."""
    return SegmentObjective([view(f, T, reach) for f in features], score, prior)
