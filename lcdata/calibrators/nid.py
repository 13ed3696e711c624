"""Direct registration: LiDAR intensities on the image's, by normalised information distance."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from lcdata.calibrators.base import Calibration, Calibrator
from lcdata.calibrators.nid_verdict import Minimum, judge
from lcdata.errors import CalibrationError
from lcdata.features.nid_objective import (
    NidFeatures,
    Objective,
    nid_features,
    objective,
)
from lcdata.features.nid_registration import CANDIDATES, averaged, limited, search
from lcdata.features.nid_search import bfgs, nelder_mead
from lcdata.features.nid_views import whereabouts
from lcdata.geometry import se3
from lcdata.pair import Pair

Array = NDArray[np.float64]

SOLVERS = ("global", "bfgs", "nelder_mead")

FEWEST_POINTS = 300
"""Points in view below which a histogram of 256 cells says nothing."""

SETTLED_M, SETTLED_RAD = 0.001, np.deg2rad(0.01)
"""Culling and registration are repeated until the pose moves less."""


@dataclass(frozen=True)
class NidCalibrator(Calibrator):
    """A method that compares intensities.

    The box around the initial guess has to contain its error.

    Args:
        solver: `"global"` (a shrinking random search, then BFGS), `"bfgs"` with the analytic
            gradient, or `"nelder_mead"` as in the paper.
        search_rotation_deg: Half-width of the box about each axis, degrees.
        search_translation_m: Half-width of the box along each axis, metres.
        search_samples: Poses in the first stage of the search.
        rounds: Hidden points are removed and the rest registered so many times at most.
        max_rotation_sigma_deg: A result is not trusted if the predicted standard deviation of
            its rotation is larger, degrees.
        max_translation_sigma_m: The same of the translation, metres.
        seed: Seed of the search's random numbers.
    """

    solver: str = "global"
    search_rotation_deg: float = 2.0
    search_translation_m: float = 0.2
    search_samples: int = 3000
    rounds: int = 6
    max_rotation_sigma_deg: float = 0.25
    max_translation_sigma_m: float = 0.05
    seed: int = 0

    with_edges: ClassVar[bool]

    def __post_init__(self) -> None:
        if self.solver not in SOLVERS:
            raise CalibrationError(
                f"method {self.name!r}: solver is {self.solver!r}", f"use {', '.join(SOLVERS)}"
            )
        limits = {
            "search_rotation_deg": 180.0,
            "search_translation_m": math.inf,
            "search_samples": 10_000_000,
            "rounds": 1000,
            "max_rotation_sigma_deg": math.inf,
            "max_translation_sigma_m": math.inf,
        }
        self._check_numbers(limits, ("search_samples", "rounds", "seed"))

    @property
    def box(self) -> Array:
        """(6,) half-widths, metres then radians."""
        return np.repeat([self.search_translation_m, np.deg2rad(self.search_rotation_deg)], 3)

    def calibrate(
        self,
        pairs: Sequence[Pair],
        initial: Array | None,
        prepared: Sequence[Any] | None = None,
    ) -> Calibration:
        """Estimate the extrinsic that all the pairs share; see `Calibrator.calibrate`."""
        started = time.perf_counter()
        T_initial, features = self._ready(pairs, initial, prepared)
        first = limited(objective(features, T_initial, self.with_edges), self.seed)
        if first.inside < FEWEST_POINTS * len(pairs):
            return _blind(features, T_initial, first.inside, started)
        found, last = self._register(features, T_initial, first)
        # Both costs of the points that are in view in the end, or they could not be compared.
        cost_initial = last.soft(T_initial)[0]
        covariance, undetermined, doubts = judge(
            last,
            found,
            T_initial,
            self.box,
            (self.max_translation_sigma_m, self.max_rotation_sigma_deg),
            np.random.default_rng([self.seed, 1]),
        )
        cost = last.soft(found.T)[0]
        if not cost < cost_initial and not np.array_equal(found.T, T_initial):
            doubts.append("diverged: no better than the initial guess")
        return Calibration(
            found.T,
            converged=not (undetermined or doubts),
            degenerate=bool(undetermined),
            covariance=covariance,
            seconds=time.perf_counter() - started,
            cost_initial=cost_initial,
            cost_final=cost,
            message="; ".join(undetermined + doubts),
        )

    def _register(
        self, features: Sequence[NidFeatures], T_initial: Array, first: Objective
    ) -> tuple[Minimum, Objective]:
        """Remove hidden points and register the rest, again and again."""
        rng = np.random.default_rng(self.seed)
        current, found = first, Minimum(T_initial, ())
        for k in range(self.rounds):
            if k:
                current = limited(objective(features, found.T, self.with_edges), self.seed + k)
            T = self._step(current, found, k, rng)
            moved = np.abs(se3.log(T.T @ se3.inverse(found.T)))
            found = T
            if k and moved[:3].max() < SETTLED_M and moved[3:].max() < SETTLED_RAD:
                break
        if self.with_edges and self.solver != "nelder_mead":
            found = Minimum(averaged(current, found.T, 0.25 * self.box, rng), found.others)
        return found, current

    def _step(
        self, current: Objective, found: Minimum, k: int, rng: np.random.Generator
    ) -> Minimum:
        """One registration of points that stay the same."""
        if self.solver == "nelder_mead":
            T, _ = nelder_mead(current.hard, found.T, self.box * (0.5 if k == 0 else 0.05))
            return Minimum(T, ())
        # A rough cost is searched twice, from the first estimate with what is hidden from there.
        if self.solver == "bfgs" or k > (1 if self.with_edges else 0):
            reach = self.box * (1.0 if k == 0 else 0.25)
            return Minimum(bfgs(current.slope, found.T, reach)[0], found.others)
        reach = self.box * (1.0 if k == 0 else 0.35)
        samples, candidates = self.search_samples // (1 + 2 * k), CANDIDATES // (1 + k)
        minima = search(current, found.T, reach, samples, candidates, rng)
        T, _ = bfgs(current.slope, minima[0][0], reach * 0.5)
        return Minimum(T, tuple(minima[1:]) if k == 0 else found.others)


def _blind(
    features: Sequence[NidFeatures], T_initial: Array, inside: int, started: float
) -> Calibration:
    places = "; ".join(dict.fromkeys(whereabouts(f.image, f.points, T_initial) for f in features))
    seen = "no point" if inside == 0 else f"only {inside} points"
    return Calibration(
        T_initial,
        converged=False,
        degenerate=True,
        covariance=np.full((6, 6), np.nan),
        seconds=time.perf_counter() - started,
        message=f"{seen} in view from the initial guess: {places}",
    )


@dataclass(frozen=True)
class Nid(NidCalibrator):
    """Minimise the NID of LiDAR and image intensities (Koide et al. 2023, section III-E)."""

    name: ClassVar[str] = "nid"
    version: ClassVar[int] = 2
    with_edges: ClassVar[bool] = False

    search_translation_m: float = 0.3

    def prepare(self, pair: Pair) -> NidFeatures:
        """Equalised image and finite points of one pair."""
        return nid_features(pair, False)


@dataclass(frozen=True)
class NidEdge(NidCalibrator):
    """NID and edges together: for sparse scans, several pairs jointly. Ours, not in the paper."""

    name: ClassVar[str] = "nid_edge"
    version: ClassVar[int] = 2
    with_edges: ClassVar[bool] = True

    def prepare(self, pair: Pair) -> NidFeatures:
        """The same as for `nid`, and the edges of cloud and image."""
        return nid_features(pair, True)
