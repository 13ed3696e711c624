"""Which trials are worth a picture, and the pictures."""

from __future__ import annotations

import dataclasses
import io
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lcdata.dataset import Dataset
from lcdata.errors import DatasetError
from lcdata.evaluation.metrics import SUCCESS_ROTATION_DEG, SUCCESS_TRANSLATION_M
from lcdata.evaluation.results import TrialResult
from lcdata.geometry.camera import Camera
from lcdata.pair import Pair
from lcdata.report.overlay import depth_range, draw_overlay

if TYPE_CHECKING:
    from lcdata.features.lidar_view import LidarView

PICTURE_WIDTH = 960
WEBP_QUALITY = 62
WEBP_EFFORT = 2
INITIAL, ESTIMATE, TRUTH = "Initial guess", "Estimate", "Ground truth"
PICTURES = (INITIAL, ESTIMATE, TRUTH)

WORST = 6
"""Worst trials of a method that are shown, in a report of few methods and runs."""

MOST = 36
"""Pictured trials of a page: their pictures are most of its size."""

FEWEST_EDGES = 200
"""Of a cloud with fewer points on edges in view all points are drawn."""

WIDEST = 1.3
"""Tangent of half the field of view that fits into one image: 105 degrees."""


@dataclass(frozen=True)
class Exhibit:
    """A trial with its pictures.

    Args:
        rank: "best", "median", "worst", "worst 2" and so on.
        trial: The trial.
        pictures: WebP files, in the order of `PICTURES`; fewer where there is no estimate.
    """

    rank: str
    trial: TrialResult
    pictures: dict[str, bytes]


def badness(trial: TrialResult) -> float:
    """The larger of the two errors, each in units of its limit of success."""
    if trial.failed:
        return math.inf
    return max(
        trial.rotation_error_deg / SUCCESS_ROTATION_DEG,
        trial.translation_error_m / SUCCESS_TRANSLATION_M,
    )


def choose(trials: Sequence[TrialResult]) -> dict[str, TrialResult]:
    """Best and median trial of one method; of few trials, those that differ."""
    ranked = sorted(trials, key=badness)
    chosen = {"best": ranked[0]}
    middle = ranked[len(ranked) // 2]
    if middle is not ranked[0]:
        chosen["median"] = middle
    return chosen


def choose_worst(trials: Sequence[TrialResult], count: int = WORST) -> list[TrialResult]:
    """The worst trials that have an estimate to be drawn, at most one on the same pairs.

    Many initial guesses on one hard pair mostly end alike, and would hide the next hard pair.

    Args:
        trials: Trials of one method.
        count: How many.
    """
    chosen: dict[tuple[str, ...], TrialResult] = {}
    for trial in sorted(trials, key=badness, reverse=True):
        if len(chosen) == count:
            break
        if not trial.failed:
            chosen.setdefault(trial.pair_ids, trial)
    return list(chosen.values())


def worst_of_each(galleries: int) -> int:
    """How many worst trials each method of each run shows, of so many methods in all runs."""
    return min(WORST, max(1, MOST // galleries - 2))


@dataclass
class Painter:
    """Draws trials on the first of their pairs; edges of a pair are looked for once.

    Args:
        dataset: The data set.
        worst: How many worst trials of each method.
    """

    dataset: Dataset
    worst: int = WORST
    _drawn: dict[str, Pair | None] = field(default_factory=dict)
    _truths: dict[str, bytes] = field(default_factory=dict)

    def exhibits(self, trials: Sequence[TrialResult]) -> list[Exhibit]:
        """Best and median trial of one method, then its worst ones.

        A pair whose files can no longer be read is shown without pictures.
        """
        ordinary = choose(trials)
        chosen = choose_worst(trials, self.worst)
        worst = [t for t in chosen if not any(t is o for o in ordinary.values())]
        ranks = ["worst", *(f"worst {n}" for n in range(2, len(worst) + 1))]
        made = [Exhibit(rank, t, self.pictures(t, PICTURES)) for rank, t in ordinary.items()]
        return made + [
            Exhibit(rank, t, self.pictures(t, (ESTIMATE, TRUTH)))
            for rank, t in zip(ranks, worst, strict=False)
        ]

    def pictures(self, trial: TrialResult, names: Sequence[str]) -> dict[str, bytes]:
        """WebP files of a trial, by name.

        Args:
            trial: The trial.
            names: Some of `PICTURES`.
        """
        pair_id = trial.pair_ids[0]
        pair = self._pair(pair_id)
        if pair is None:
            return {}
        truth = self.dataset.pose(trial.pose_id).T_camera_lidar
        poses = {
            INITIAL: trial.T_camera_lidar_initial,
            ESTIMATE: trial.T_camera_lidar_estimated,
            TRUTH: truth,
        }
        depths = depth_range(pair, truth)
        if TRUTH in names and pair_id not in self._truths:
            self._truths[pair_id] = _draw(pair, truth, depths)
        return {
            name: self._truths[pair_id] if name == TRUTH else _draw(pair, T, depths)
            for name, T in poses.items()
            if name in names and T is not None
        }

    def _pair(self, pair_id: str) -> Pair | None:
        """A pair with the points that are drawn; None if its files cannot be read."""
        if pair_id not in self._drawn:
            try:
                self._drawn[pair_id] = with_edges(self.dataset.load(pair_id))
            except DatasetError:
                self._drawn[pair_id] = None
        return self._drawn[pair_id]


def with_edges(pair: Pair) -> Pair:
    """The pair, of its cloud only borders and creases, where the camera looks.

    All points where there are hardly any edges: sparse scans, bare walls.
    """
    from lcdata.features.view_edges import extract_cloud_edges

    points = pair.points[np.isfinite(pair.points).all(axis=1)]
    if not len(points):
        return dataclasses.replace(pair, points=points, intensity=None, organised=None, ring=None)
    edges = extract_cloud_edges(points, None, views=_views(pair, points)).points
    shown = edges if len(edges) >= FEWEST_EDGES else points
    return dataclasses.replace(
        pair, points=np.asarray(shown, np.float32), intensity=None, organised=None, ring=None
    )


def _views(pair: Pair, points: NDArray[np.floating[Any]]) -> list[LidarView] | None:
    """What the LiDAR sees where the camera looks; None where that is too wide for one image."""
    from lcdata.features.lidar_view import make_view
    from lcdata.features.view_edges import FOCAL, MARGIN

    camera = pair.camera
    if camera.model != "pinhole" or pair.T_camera_lidar is None:
        return None
    fx, fy, cx, cy = camera.intrinsics
    reach = [max(cx, camera.width - cx) / fx, max(cy, camera.height - cy) / fy]
    if max(reach) > WIDEST:
        return None
    width, height = (2 * round(FOCAL * tangent + MARGIN) for tangent in reach)
    middle = (0.5 * (width - 1), 0.5 * (height - 1))
    virtual = Camera("pinhole", width, height, (FOCAL, FOCAL, *middle))
    return [make_view(points, None, virtual, np.asarray(pair.T_camera_lidar)[:3, :3])]


def _draw(pair: Pair, T_camera_lidar: ArrayLike, depths: tuple[float, float]) -> bytes:
    from PIL import Image

    width = min(PICTURE_WIDTH, pair.camera.width)
    picture = draw_overlay(pair, T_camera_lidar, width=width, depths=depths)
    file = io.BytesIO()
    Image.fromarray(picture).save(file, "WEBP", quality=WEBP_QUALITY, method=WEBP_EFFORT)
    return file.getvalue()
