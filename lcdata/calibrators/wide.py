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
from lcdata.calibrators.uncertainty import too_uncertain
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
        agree_rotation_deg: Halves of the pairs, each searched anew, must come to rotations so
            close to the joint one.
        agree_translation_m: And to translations so close.
        min_pairs: Fewer different scenes are never called converged: their halves know too
            little. At least 2.
        max_rotation_sigma_deg: A result is not trusted if the predicted standard deviation of
            its rotation is larger, degrees.
        max_translation_sigma_m: The same of the translation, metres.
        seed: Seed of the search's random numbers.
    """

    name: ClassVar[str] = "wide"
    version: ClassVar[int] = 2

    search_rotation_deg: float = 7.0
    search_translation_m: float = 0.7
    agree_rotation_deg: float = 0.5
    agree_translation_m: float = 0.1
    min_pairs: int = 5
    max_rotation_sigma_deg: float = 0.5
    max_translation_sigma_m: float = 0.1
    seed: int = 0

    def __post_init__(self) -> None:
        limits = {
            "search_rotation_deg": 90.0,
            "search_translation_m": math.inf,
            "agree_rotation_deg": 180.0,
            "agree_translation_m": math.inf,
            "min_pairs": 1_000_000,
            "max_rotation_sigma_deg": math.inf,
            "max_translation_sigma_m": math.inf,
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
        from lcdata.calibrators.wide_verdict import doubts
        from lcdata.features.wide_finish import close_views, covariance, refined
        from lcdata.features.wide_objective import images
        from lcdata.features.wide_search import passes, solve

        started = time.perf_counter()
        T_initial, features = self._ready(pairs, initial, prepared)
        rng = np.random.default_rng(self.seed)
        plan = passes(self.search_rotation_deg, self.search_translation_m)
        pictures = images(features, rng)
        found = solve(features, pictures, T_initial, plan, rng)
        frames = close_views(features, pictures, found.T, rng)
        T = refined(features, frames, found.T, rng)
        scattered = covariance(features, frames, T, rng)
        undetermined = self._undetermined(scattered)
        limits = (self.agree_translation_m, self.agree_rotation_deg, self.min_pairs)
        doubtful = doubts(features, pictures, T_initial, T, plan, limits, rng)
        return Calibration(
            T,
            converged=not (undetermined or doubtful),
            degenerate=bool(undetermined),
            covariance=np.full((6, 6), np.nan) if scattered is None else scattered,
            seconds=time.perf_counter() - started,
            cost_initial=found.cost_initial,
            cost_final=found.cost_final,
            message="; ".join(undetermined + doubtful),
        )

    def _undetermined(self, covariance: Array | None) -> list[str]:
        """What the frames do not determine."""
        if covariance is None:
            return ["the cost is not curved in every direction"]
        limits = self.max_translation_sigma_m, self.max_rotation_sigma_deg
        return too_uncertain(covariance, *limits)
