"""The last step of the wide-range method: intensities and edges by a quadratic, then gradients."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from lcdata.features.nid_objective import objective
from lcdata.features.nid_registration import averaged
from lcdata.features.nid_search import bfgs
from lcdata.features.nid_views import BLOCK_GRID, BLOCKS
from lcdata.features.wide_features import WideFeatures
from lcdata.features.wide_objective import Images, Objective, Terms, View, views
from lcdata.features.wide_search import FINE
from lcdata.features.wide_surface import middle, scatter

Array = NDArray[np.float64]
Floats = NDArray[np.float32]

REACH = np.repeat([0.05, np.deg2rad(0.3)], 3)
"""Largest step away from the search's result, metres then radians."""

TERMS = Terms((), 0, (12, 6), 20_000, 1.0, 6000)
"""Of the cost whose valley's middle is sought: all edges, and points enough for NID."""

HALVES = 24
"""Random halves of the images' parts whose minima tell the covariance."""

POINTS = 15_000
"""Points of a pair; more are thinned out."""


def centred(frames: Sequence[View], T: Array) -> Array:
    """The middle of the valley of NID and edges that the search's result lies in: 4x4.

    Args:
        frames: Of all frames, see `close_views`.
        T: 4x4 result of the search.
    """
    return middle(Objective(frames, TERMS), T)


def refined(
    features: Sequence[WideFeatures], frames: Sequence[View], T: Array, rng: np.random.Generator
) -> Array:
    """The minimum of NID and edges next to the search's result: 4x4.

    First the middle of the valley that the result lies in, then downhill from there, and the mean
    of the minima of random halves of points and edges.

    Args:
        features: Of all frames.
        frames: The same, see `close_views`.
        T: 4x4 result of the search.
        rng: Of samples and halves.
    """
    T = centred(frames, T)
    last = objective([f.nid for f in features], T, True).thinned(POINTS * len(features), rng)
    found, _ = bfgs(last.slope, T, REACH, 30, 1e-7)
    return averaged(last, found, 0.5 * REACH, rng)


def close_views(
    features: Sequence[WideFeatures],
    pictures: Sequence[Images],
    T: Array,
    rng: np.random.Generator,
) -> list[View]:
    """All frames as sampled about the search's result.

    Args:
        features: Of all frames.
        pictures: Of all frames.
        T: 4x4 result of the search.
        rng: Of the samples.
    """
    return views(features, pictures, T, np.deg2rad(FINE.margin_deg), True, rng)


def covariance(
    features: Sequence[WideFeatures], frames: Sequence[View], T: Array, rng: np.random.Generator
) -> Array | None:
    """6x6 predicted covariance of an estimate; None where the cost is not curved upwards.

    Args:
        features: Of all frames.
        frames: The same, see `close_views`.
        T: 4x4 the estimate.
        rng: Of the halves.
    """
    whole = Objective(frames, TERMS)
    blocks = [
        (_blocks(f, v.edges, T), _blocks(f, v.lit, T))
        for f, v in zip(features, frames, strict=True)
    ]
    halves = []
    for _ in range(HALVES):
        part = []
        for v, (edges, lit) in zip(frames, blocks, strict=True):
            chosen = np.zeros(BLOCKS, bool)
            chosen[rng.permutation(BLOCKS)[: BLOCKS // 2]] = True
            e, p = chosen[edges], chosen[lit]
            part.append(
                replace(
                    v,
                    edges=v.edges[e],
                    weights=v.weights[e],
                    lit=v.lit[p],
                    bins=v.bins[p],
                    lit_order=v.lit_order[p],
                )
            )
        halves.append(Objective(part, TERMS))
    alone = [Objective([v], TERMS) for v in frames]
    return scatter(whole, alone, halves, T)


def _blocks(f: WideFeatures, points: Floats, T: Array) -> NDArray[np.int64]:
    """Part of the image that points are in or next to, below `BLOCKS`."""
    camera = f.nid.image.camera
    pixels, _ = camera.project(points @ T[:3, :3].T + T[:3, 3])
    columns, rows = BLOCK_GRID
    u, v = np.nan_to_num(pixels).T
    column = np.clip(u * columns / camera.width, 0, columns - 1).astype(np.int64)
    row = np.clip(v * rows / camera.height, 0, rows - 1).astype(np.int64)
    return np.asarray(row * columns + column)
