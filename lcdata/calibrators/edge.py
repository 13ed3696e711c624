"""Edges of the cloud on edges of the image, point by point."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from lcdata.calibrators import edge_verdict, nid_verdict
from lcdata.calibrators.base import Calibration, Calibrator
from lcdata.errors import CalibrationError
from lcdata.features.edge_alignment import (
    GATES,
    Aligned,
    Alignment,
    EdgeNoise,
    edge_view,
    rough_poses,
)
from lcdata.features.edge_features import EdgeFeatures, edge_features
from lcdata.features.edge_steps import StepCost, step_view
from lcdata.features.nid_registration import CANDIDATES, averaged
from lcdata.features.nid_registration import search as search_cost
from lcdata.features.nid_search import bfgs, different
from lcdata.features.nid_views import whereabouts
from lcdata.geometry import se3
from lcdata.pair import Pair

Array = NDArray[np.float64]

VARIANTS = ("auto", "continuous", "discontinuity")

FEWEST_POINTS = 60
"""Edge points in view of a pair below which there is nothing to align."""

ROUGH, ROUGH_POINTS = 12, 1500
"""Poses of the search that are aligned with so many edge points a pair."""

ENOUGH_POINTS = 1200
"""Edge points with direction in view of a pair from which on "auto" needs no others: 1400 and more
in simulated scans that they align, fewer in sweeps of roads, where those that there are lie on
verges and bushes."""


@dataclass(frozen=True)
class Edge(Calibrator):
    """Point-to-edge alignment (Yuan et al. 2021), and distance fields for sparse scans.

    The box around the initial guess has to contain its error.

    Args:
        variant: `"continuous"`: edges with direction, matched point by point, as in the paper.
            `"discontinuity"`: steps along rings on distance fields. `"auto"` takes the first
            where the pairs have enough of such edges.
        borders: With "continuous", also edges where depth jumps or paint ends; ours. The paper
            takes only those where planes meet.
        range_sigma_m: Noise of the LiDAR's range, metres.
        bearing_sigma_deg: Noise of its directions, degrees.
        pixel_sigma: Noise of image edges, pixels.
        direction_deg: Largest angle between matched edges in the image, degrees.
        search_rotation_deg: Half-width of the rough search about each axis, degrees.
        search_translation_m: Half-width along each axis, metres.
        search_samples: Poses in the first stage of the search.
        rounds: Hidden edges are removed and the rest aligned so many times at most.
        max_rotation_sigma_deg: A result is not trusted if the predicted standard deviation of
            its rotation is larger, degrees.
        max_translation_sigma_m: The same of the translation, metres.
        seed: Seed of the search's random numbers.
    """

    name: ClassVar[str] = "edge"

    variant: str = "auto"
    borders: bool = True
    range_sigma_m: float = 0.02
    bearing_sigma_deg: float = 0.05
    pixel_sigma: float = 1.0
    direction_deg: float = 15.0
    search_rotation_deg: float = 3.0
    search_translation_m: float = 0.3
    search_samples: int = 3000
    rounds: int = 3
    max_rotation_sigma_deg: float = 0.25
    max_translation_sigma_m: float = 0.05
    seed: int = 0

    def __post_init__(self) -> None:
        if self.variant not in VARIANTS:
            raise CalibrationError(
                f"method {self.name!r}: variant is {self.variant!r}", f"use {', '.join(VARIANTS)}"
            )
        limits = {
            "range_sigma_m": 1.0,
            "bearing_sigma_deg": 5.0,
            "pixel_sigma": 100.0,
            "direction_deg": 90.0,
            "search_rotation_deg": 180.0,
            "search_translation_m": math.inf,
            "search_samples": 10_000_000,
            "rounds": 100,
            "max_rotation_sigma_deg": math.inf,
            "max_translation_sigma_m": math.inf,
        }
        self._check_numbers(limits, ("search_samples", "rounds", "seed"))

    @property
    def box(self) -> Array:
        """(6,) half-widths, metres then radians."""
        return np.repeat([self.search_translation_m, np.deg2rad(self.search_rotation_deg)], 3)

    def prepare(self, pair: Pair) -> EdgeFeatures:
        """Edges of cloud and image."""
        with_lines, with_steps = self.variant != "discontinuity", self.variant != "continuous"
        return edge_features(pair, with_lines, with_steps, self.borders)

    def calibrate(
        self,
        pairs: Sequence[Pair],
        initial: Array | None,
        prepared: Sequence[Any] | None = None,
    ) -> Calibration:
        """Estimate the extrinsic that all the pairs share; see `Calibrator.calibrate`."""
        started = time.perf_counter()
        T_initial, features = self._ready(pairs, initial, prepared)
        usable, remark = self._usable(features)
        if self._takes_lines(usable, T_initial):
            return self._by_lines(usable, T_initial, remark, started)
        return self._by_steps(usable, T_initial, remark, started)

    def _usable(self, features: Sequence[EdgeFeatures]) -> tuple[list[EdgeFeatures], list[str]]:
        """The pairs that have edges, and a remark if others have not.

        Raises:
            CalibrationError: None has.
        """
        bare = sum(len(f.image_edges.points) == 0 for f in features)
        usable = [f for f in features if len(f.image_edges.points) and _cloud_edges(f)]
        if not usable:
            raise CalibrationError(
                f"method {self.name!r}: no edges in {bare} of {len(features)} images and in "
                f"{sum(_cloud_edges(f) == 0 for f in features)} of as many clouds",
                "it needs a picture, and a cloud of more than one surface; nid compares "
                "intensities instead",
            )
        if len(usable) < len(features):
            return usable, [f"{len(features) - len(usable)} of {len(features)} pairs have no edges"]
        return usable, []

    def _alignment(self, features: Sequence[EdgeFeatures], T: Array) -> Alignment:
        noise = EdgeNoise(
            self.range_sigma_m, float(np.deg2rad(self.bearing_sigma_deg)), self.pixel_sigma
        )
        views = [
            edge_view(f.image, f.image_edges, f.cloud, f.lines, T)
            for f in features
            if f.lines is not None
        ]
        return Alignment(views, noise, float(np.deg2rad(self.direction_deg)))

    def _takes_lines(self, features: Sequence[EdgeFeatures], T_initial: Array) -> bool:
        """Whether edges with direction are used; "auto" asks for enough of them in view."""
        if self.variant != "auto":
            return self.variant == "continuous"
        if not any(len(f.steps) for f in features):
            return True
        return self._alignment(features, T_initial).count >= ENOUGH_POINTS * len(features)

    def _by_lines(
        self,
        features: Sequence[EdgeFeatures],
        T_initial: Array,
        remark: list[str],
        started: float,
    ) -> Calibration:
        """Rough search, then association and Gauss-Newton with gates that shrink."""
        rng = np.random.default_rng(self.seed)
        current = self._alignment(features, T_initial)
        if current.count < FEWEST_POINTS * len(features):
            return _blind(features, T_initial, current.count, started)
        starts = rough_poses(current, T_initial, self.box, self.search_samples, ROUGH, rng)
        thin = current.thinned(ROUGH_POINTS * len(features), rng)
        rough = sorted((thin.minimise(T, GATES[1:]) for T in starts), key=_cost)
        apart = different(np.array([r.T for r in rough]), CANDIDATES, 0.05 * self.box)
        minima = sorted((current.minimise(T, GATES[-2:]) for T in apart), key=_cost)
        found = minima[0]
        for _ in range(self.rounds):
            current = self._alignment(features, found.T)
            before, found = found.T, current.minimise(found.T, GATES[-2:])
            moved = np.abs(se3.log(before @ se3.inverse(found.T)))
            if moved[:3].max() < 1e-3 and moved[3:].max() < np.deg2rad(0.01):
                break
        others = [current.at(m.T) for m in minima[1:]]
        covariance, undetermined, doubts = edge_verdict.judge(
            current, found, others, T_initial, self.box, self._limits, rng
        )
        cost_initial = current.at(T_initial).cost
        return self._result(
            found.T, covariance, undetermined, doubts, (cost_initial, found.cost), remark, started
        )

    def _by_steps(
        self,
        features: Sequence[EdgeFeatures],
        T_initial: Array,
        remark: list[str],
        started: float,
    ) -> Calibration:
        """Shrinking search and BFGS on distance fields; means of halves, as they are rough."""
        rng = np.random.default_rng(self.seed)
        current = _step_cost(features, T_initial)
        if current.count < FEWEST_POINTS * len(features):
            return _blind(features, T_initial, current.count, started)
        minima = search_cost(current, T_initial, self.box, self.search_samples, CANDIDATES, rng)
        T = minima[0][0]
        for _ in range(self.rounds):
            current = _step_cost(features, T)
            before, T = T, bfgs(current.slope, T, 0.3 * self.box)[0]
            moved = np.abs(se3.log(before @ se3.inverse(T)))
            if moved[:3].max() < 1e-3 and moved[3:].max() < np.deg2rad(0.01):
                break
        T = averaged(current, T, 0.25 * self.box, rng)
        covariance, undetermined, doubts = nid_verdict.judge(
            current,
            nid_verdict.Minimum(T, tuple(minima[1:])),
            T_initial,
            self.box,
            self._limits,
            rng,
        )
        costs = current.soft(T_initial)[0], current.soft(T)[0]
        return self._result(T, covariance, undetermined, doubts, costs, remark, started)

    @property
    def _limits(self) -> tuple[float, float]:
        return self.max_translation_sigma_m, self.max_rotation_sigma_deg

    def _result(
        self,
        T: Array,
        covariance: Array,
        undetermined: list[str],
        doubts: list[str],
        costs: tuple[float, float],
        remark: list[str],
        started: float,
    ) -> Calibration:
        if not costs[1] < costs[0] and not doubts:
            doubts.append("no better than the initial guess")
        return Calibration(
            T,
            converged=not (undetermined or doubts),
            degenerate=bool(undetermined),
            covariance=covariance,
            seconds=time.perf_counter() - started,
            cost_initial=costs[0],
            cost_final=costs[1],
            message="; ".join(undetermined + doubts + remark),
        )


def _cost(found: Aligned) -> float:
    return found.cost


def _cloud_edges(features: EdgeFeatures) -> int:
    lines = 0 if features.lines is None else len(features.lines.points)
    return lines + len(features.steps)


def _step_cost(features: Sequence[EdgeFeatures], T: Array) -> StepCost:
    return StepCost(
        [
            step_view(f.image, f.fields, f.cloud, f.steps, f.step_weights, T)
            for f in features
            if f.fields is not None
        ]
    )


def _blind(
    features: Sequence[EdgeFeatures], T_initial: Array, count: int, started: float
) -> Calibration:
    places = "; ".join(dict.fromkeys(whereabouts(f.image, f.cloud, T_initial) for f in features))
    seen = "no edge point" if count == 0 else f"only {count} edge points"
    return Calibration(
        T_initial,
        converged=False,
        degenerate=True,
        covariance=np.full((6, 6), np.nan),
        seconds=time.perf_counter() - started,
        message=f"{seen} in view from the initial guess: {places}",
    )
