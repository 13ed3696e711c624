"""What the wide-range method minimises: information shared by classes and labels, and edges."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lcdata.features.nid_edges import without_clutter
from lcdata.features.nid_kernels import BINS
from lcdata.features.nid_views import flat, nid_cloud, visible
from lcdata.features.wide_classes import CLASSES, find_ground, point_classes
from lcdata.features.wide_features import WideFeatures
from lcdata.features.wide_kernels import count, field_sums, information
from lcdata.features.wide_labels import LABELS, LEVELS, label_maps
from lcdata.features.wide_sample import sample, seen

Array = NDArray[np.float64]
Floats = NDArray[np.float32]
Bytes = NDArray[np.uint8]

INFORMATION_SCALE, NID_SCALE = 0.007, 0.01
"""What the shares of the cost are divided by before they are added."""

EDGE_SCALE = {100: 0.009, 60: 0.012, 25: 0.013, 12: 0.010, 6: 0.007}
"""The same of the edges' share at each truncation (mrad)."""

NID_WEIGHT = 3.0

MASS = 0.5
"""Power of the share of the points inside with which information is multiplied."""

MOST_POINTS, MOST_NID_POINTS = 4000, 8000
"""Points of a frame in the sample, and for NID."""

AT_ONCE = 64
"""Poses whose histograms are kept at a time: they stay in the processor's cache."""


@dataclass(frozen=True)
class Terms:
    """Which of the terms count in a stage, and on how much of the data.

    Args:
        levels: Levels of labels, 0 coarse, 1 fine.
        points: Points of a frame.
        truncations: Of the edge distances, mrad.
        edges: Edge points of a frame.
        edge_weight: What edges count.
        nid: Whether NID counts too.
    """

    levels: tuple[int, ...]
    points: int
    truncations: tuple[int, ...]
    edges: int
    edge_weight: float
    nid: bool = False


@dataclass(frozen=True, eq=False)
class Images:
    """One frame's image, ready for look-ups.

    Args:
        model: Number of the camera model.
        parameters: Its parameters.
        labels: (h + 2, w + 2) uint8 with a border, for each level.
        distance: (H, W) pixels to the next edge.
        bins: (H + 2, W + 2) uint8 rank of grey, with a border.
        focal: Pixels a radian.
    """

    model: int
    parameters: Array
    labels: tuple[Bytes, ...]
    distance: Floats
    bins: Bytes
    focal: float

    def field(self, truncations: Sequence[int]) -> Floats:
        """(H + 2, W + 2) mean of the edge fields over their scales, with a border of zeros."""
        total = np.zeros((self.distance.shape[0] + 2, self.distance.shape[1] + 2), np.float32)
        for t in truncations:
            field = without_clutter(self.distance, t * 1e-3 * self.focal, self.focal)
            total[1:-1, 1:-1] += field / np.float32(EDGE_SCALE[t] * len(truncations))
        return total


def images(features: Sequence[WideFeatures], rng: np.random.Generator) -> list[Images]:
    """Images of all frames, with labels learned from all of them."""
    by_level = [
        label_maps([f.descriptors[level] for f in features], rng) for level in range(len(LEVELS))
    ]
    return [
        Images(
            f.image.model,
            f.image.parameters,
            tuple(maps[i] for maps in by_level),
            f.distance,
            np.pad(f.image.hard, 1, constant_values=BINS),
            f.image.focal,
        )
        for i, f in enumerate(features)
    ]


@dataclass(frozen=True, eq=False)
class View:
    """One frame as sampled about an estimate.

    Args:
        image: Its image.
        points: (N, 3) float32 sample in random order, LiDAR frame, metres.
        classes: (N,) uint8.
        order: (N,) place of each in the image, for sorting.
        edges: (M, 3) float32 cloud edges in random order, LiDAR frame, metres.
        weights: (M,) float32.
        lit: (K, 3) float32 visible points for NID.
        bins: (K,) uint8 their rank of reflectance.
    """

    image: Images
    points: Floats
    classes: Bytes
    order: NDArray[np.int64]
    edges: Floats
    weights: Floats
    lit: Floats
    bins: Bytes


def views(
    features: Sequence[WideFeatures],
    pictures: Sequence[Images],
    T: Array,
    margin: float,
    with_nid: bool,
    rng: np.random.Generator,
) -> list[View]:
    """Sample all frames about an estimate.

    Args:
        features: Of each frame.
        pictures: Of each frame.
        T: 4x4 `T_camera_lidar`, the estimate.
        margin: How far beside the image points are taken, radians.
        with_nid: Whether NID will be needed.
        rng: Of samples and hypotheses.
    """
    up = -T[1, :3]
    samples = [sample(f.image.camera, f.points, T, margin) for f in features]
    grounds = [
        find_ground(f.points[s.index], up, rng) for f, s in zip(features, samples, strict=True)
    ]
    chosen = []
    for s in samples:
        number = min(MOST_POINTS, len(s.index))
        chosen.append(rng.permutation(len(s.index))[:number])
    points = [f.points[s.index[c]] for f, s, c in zip(features, samples, chosen, strict=True)]
    light = [
        np.zeros(len(c), np.float32) if f.intensity is None else f.intensity[s.index[c]]
        for f, s, c in zip(features, samples, chosen, strict=True)
    ]
    rough = [s.roughness[c] for s, c in zip(samples, chosen, strict=True)]
    classes = point_classes(points, light, rough, grounds)
    result = []
    for i, f in enumerate(features):
        edges, weights = _edges_in_view(f, T, margin, rng)
        lit, bins = np.zeros((0, 3), np.float32), np.zeros(0, np.uint8)
        if with_nid and f.intensity is not None:
            lit, bins = _lit(f, T, rng)
        result.append(
            View(pictures[i], points[i], classes[i], chosen[i], edges, weights, lit, bins)
        )
    return result


def _edges_in_view(
    f: WideFeatures, T: Array, margin: float, rng: np.random.Generator
) -> tuple[Floats, Floats]:
    local = (f.edges @ T[:3, :3].T + T[:3, 3]).astype(np.float32)
    near = rng.permutation(np.flatnonzero(seen(f.image.camera, local, margin)))
    return f.edges[near], f.edge_weights[near]


def _lit(f: WideFeatures, T: Array, rng: np.random.Generator) -> tuple[Floats, Bytes]:
    assert f.intensity is not None
    cloud = nid_cloud(visible(f.image, f.points, T), f.points, f.intensity)
    number = min(MOST_NID_POINTS, len(cloud.points))
    chosen = np.sort(rng.permutation(len(cloud.points))[:number])
    return cloud.points[chosen], cloud.bins[chosen]


class Objective:
    """Cost of poses over frames that share their extrinsic, by the terms of one stage."""

    def __init__(self, frames: Sequence[View], terms: Terms) -> None:
        """Take of each frame what the stage needs, in an order that keeps look-ups close."""
        self.frames, self.terms = frames, terms
        self.points, self.classes, self.edges, self.weights, self.fields = [], [], [], [], []
        self.lit = []
        for v in frames:
            first = np.argsort(v.order[: terms.points])
            self.points.append(np.ascontiguousarray(v.points[first].T))
            self.classes.append(v.classes[first])
            edges, weights = v.edges[: terms.edges], v.weights[: terms.edges]
            place = np.argsort(np.arctan2(edges[:, 1], edges[:, 0]))
            self.edges.append(np.ascontiguousarray(edges[place].T))
            total = max(float(weights.sum()), 1e-9)
            self.weights.append(weights[place] / np.float32(total))
            self.fields.append(v.image.field(terms.truncations))
            self.lit.append(np.ascontiguousarray(v.lit.T))
        most = max(sum(p.shape[1] for p in self.points), MOST_NID_POINTS) + 1
        n = np.arange(1, most)
        self.logs = np.concatenate([[0.0], n * np.log(n)])

    def __call__(self, poses: Array) -> Array:
        """Costs of (P, 4, 4) poses: (P,)."""
        rows = flat(poses).astype(np.float32)
        costs = np.zeros(len(rows))
        for start in range(0, len(rows), AT_ONCE):
            part = rows[start : start + AT_ONCE]
            costs[start : start + AT_ONCE] = self._information(part) + self._edges(part)
            if self.terms.nid:
                costs[start : start + AT_ONCE] += self._nid(part)
        return costs

    def _information(self, rows: Floats) -> Array:
        total = np.zeros(len(rows))
        shared, joint, inside = np.empty((3, len(rows)))
        for level in self.terms.levels:
            counts = np.zeros((len(rows), CLASSES, LABELS + 1), np.int32)
            scale = np.float32(1.0 / LEVELS[level][1])
            for v, points, classes in zip(self.frames, self.points, self.classes, strict=True):
                camera = v.image.model, v.image.parameters
                count(*camera, rows, points, classes, v.image.labels[level], scale, counts)
            information(counts, self.logs, shared, joint, inside)
            total -= inside**MASS * shared / np.maximum(joint, 1e-9)
        return total / (INFORMATION_SCALE * len(self.terms.levels))

    def _edges(self, rows: Floats) -> Array:
        sums = np.zeros(len(rows))
        parts = zip(self.frames, self.edges, self.weights, self.fields, strict=True)
        for v, edges, weights, field in parts:
            camera = v.image.model, v.image.parameters
            field_sums(*camera, rows, edges, weights, field, np.float32(1.0), sums)
        return sums * (self.terms.edge_weight / len(self.frames))

    def _nid(self, rows: Floats) -> Array:
        total = np.zeros(len(rows))
        shared, joint, inside = np.empty((3, len(rows)))
        used = 0
        for v, lit in zip(self.frames, self.lit, strict=True):
            if not lit.shape[1]:
                continue
            used += 1
            counts = np.zeros((len(rows), BINS, BINS + 1), np.int32)
            camera = v.image.model, v.image.parameters
            count(*camera, rows, lit, v.bins, v.image.bins, np.float32(1.0), counts)
            information(counts, self.logs, shared, joint, inside)
            total += 1.0 - shared / np.maximum(joint, 1e-9)
        return total * (NID_WEIGHT / NID_SCALE / max(used, 1))
