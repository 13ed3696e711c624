"""Several frames of one extrinsic jointly, from a guess that is far off: for roads."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from lcdata.calibrators.base import Calibration, Calibrator
from lcdata.pair import Pair

if TYPE_CHECKING:
    from lcdata.features.wide_features import WideFeatures

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Wide(Calibrator):
    """Shared information of point classes and pixel labels, and edges, searched widely.

    Args:
        search_rotation_deg: Half-width of the box about each axis, degrees: 1.4 times the
            largest error of the guess that is expected.
        search_translation_m: Half-width of the box along each axis, metres.
        agree_rotation_deg: Halves of the pairs must come to rotations this close.
        agree_translation_m: And to translations this close.
        min_pairs: Fewer pairs are never called converged: their halves agree by chance.
        seed: Seed of the search's random numbers.
    """

    name: ClassVar[str] = "wide"

    search_rotation_deg: float = 7.0
    search_translation_m: float = 0.7
    agree_rotation_deg: float = 0.5
    agree_translation_m: float = 0.1
    min_pairs: int = 5
    seed: int = 0

    def __post_init__(self) -> None:
        limits = {
            "search_rotation_deg": 90.0,
            "search_translation_m": math.inf,
            "agree_rotation_deg": 180.0,
            "agree_translation_m": math.inf,
            "min_pairs": 1_000_000,
        }
        self._check_numbers(limits, ("min_pairs", "seed"))

    def prepare(self, pair: Pair) -> WideFeatures:
        """Edges of cloud and image, and descriptors of the pixels, of one pair."""
        from lcdata.features.wide_features import wide_features

        return wide_features(pair)

    def calibrate(
        self,
        pairs: Sequence[Pair],
        initial: Array | None,
        prepared: Sequence[Any] | None = None,
    ) -> Calibration:
        """Estimate the extrinsic that all the pairs share; see `Calibrator.calibrate`."""
        from lcdata.features.wide_objective import images
        from lcdata.features.wide_search import passes, solve

        started = time.perf_counter()
        T_initial, features = self._ready(pairs, initial, prepared)
        rng = np.random.default_rng(self.seed)
        plan = passes(self.search_rotation_deg, self.search_translation_m)
        pictures = images(features, rng)
        found = solve(features, pictures, T_initial, plan, rng)
        doubts = self._doubts(features, pictures, T_initial, found.T, rng)
        return Calibration(
            found.T,
            converged=not doubts,
            degenerate=False,
            covariance=np.full((6, 6), np.nan),
            seconds=time.perf_counter() - started,
            cost_initial=found.cost_initial,
            cost_final=found.cost_final,
            message="; ".join(doubts),
        )

    def _doubts(
        self,
        features: Sequence[Any],
        pictures: Sequence[Any],
        T_initial: Array,
        T: Array,
        rng: np.random.Generator,
    ) -> list[str]:
        from lcdata.features.wide_search import passes, solve
        from lcdata.geometry import se3

        number = len(features)
        if number < self.min_pairs:
            return [f"low confidence: {number} pairs, fewer than {self.min_pairs}"]
        plan = passes(self.search_rotation_deg, self.search_translation_m)
        poses = [T] + [
            solve(features[odd::2], pictures[odd::2], T_initial, plan, rng).T for odd in (0, 1)
        ]
        metres, radians = 0.0, 0.0
        for i in range(3):
            for j in range(i):
                metres = max(metres, se3.translation_error(poses[i], poses[j]))
                radians = max(radians, se3.rotation_error(poses[i], poses[j]))
        degrees = float(np.rad2deg(radians))
        if degrees > self.agree_rotation_deg or metres > self.agree_translation_m:
            return [f"halves of the pairs disagree by {degrees:.2g} deg, {metres:.2g} m"]
        return []
