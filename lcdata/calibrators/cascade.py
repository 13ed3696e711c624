"""Several methods one after the other, each step accepted by evidence of another kind."""

from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from lcdata.calibrators.base import Calibration, Calibrator
from lcdata.calibrators.evidence import Finding, agreeing, distance, fused
from lcdata.calibrators.polish import Polished, confirm, polish
from lcdata.calibrators.registry import create
from lcdata.calibrators.uncertainty import too_uncertain
from lcdata.errors import CalibrationError, LcdataError
from lcdata.features.wide_frames import scenes
from lcdata.pair import Pair

Array = NDArray[np.float64]

SAME_DATA = frozenset({"wide"})
"""Methods that look at intensities and edges themselves and end at their lowest cost: they are
confirmed, but there is nothing to refine them with."""

FARTHEST = 2.0
"""Intensities and edges are believed within so many standard deviations of the first estimate,
root mean square over the degrees of freedom: about the 0.999 quantile of right ones."""

HALVES_AGREE = frozenset({"wide"})
"""Methods that trust a result only if disjoint halves of the pairs, each searched anew, come within
0.5 deg and 0.1 m of it: what a success may be off."""

TESTED = 2.0
"""How much larger their predicted standard deviations may be: up to what was tested. Of others the
prediction is all that is known, and has to be well below what a success may be off."""

MIN_CONTRAST = 3.0
"""See `Polished.contrast`: below, intensities and edges do not confirm a pose."""


@dataclass(eq=False)
class Prepared:
    """A pair, and the features that methods have asked for so far."""

    pair: Pair
    features: dict[str, Any] = field(default_factory=dict)

    def of(self, method: Calibrator) -> Any:
        """Features of one method, made when they are first asked for."""
        if method.name not in self.features:
            self.features[method.name] = method.prepare(self.pair)
        return self.features[method.name]


@dataclass(frozen=True)
class Cascade(Calibrator):
    """Lines where there are planes, `wide` where there are not, then intensities and edges.

    1. `projection`, which needs straight edges and knows when it has found too few.
    2. Where it does not converge: `crlf`, if there are masks, and `wide`.
    3. Where none of them converges: two of them that come to the same pose.
    4. Intensities and edges confirm the estimate, and refine one of lines.

    Ours, not in a paper. Nothing is tuned to a kind of scene: what a step finds decides.

    Args:
        search_rotation_deg: Half-width of the search about each axis, degrees.
        search_translation_m: Half-width of the search along each axis, metres.
        masks: Lane and pole masks, a file or a folder, see `crlf`; none: `crlf` is left out.
        max_rotation_sigma_deg: A result is not trusted if the predicted standard deviation of
            its rotation is larger, degrees; twice as large where halves of the pairs agree.
        max_translation_sigma_m: The same of the translation, metres.
        seed: Seed of everything random.
    """

    name: ClassVar[str] = "cascade"
    version: ClassVar[int] = 2

    search_rotation_deg: float = 10.0
    search_translation_m: float = 0.7
    masks: str = ""
    max_rotation_sigma_deg: float = 0.25
    max_translation_sigma_m: float = 0.05
    seed: int = 0

    def __post_init__(self) -> None:
        limits = {
            "search_rotation_deg": 90.0,
            "search_translation_m": math.inf,
            "max_rotation_sigma_deg": math.inf,
            "max_translation_sigma_m": math.inf,
        }
        self._check_numbers(limits, ("seed",))

    def prepare(self, pair: Pair) -> Prepared:
        """Nothing yet: which features are needed shows on the way; they are kept for the next."""
        return Prepared(pair)

    def calibrate(
        self,
        pairs: Sequence[Pair],
        initial: Array | None,
        prepared: Sequence[Any] | None = None,
    ) -> Calibration:
        """Estimate the extrinsic that all the pairs share; see `Calibrator.calibrate`."""
        started = time.perf_counter()
        T_initial, ready = self._ready(pairs, initial, prepared)
        findings = self._findings(pairs, ready, T_initial)
        steps = [finding.words for finding in findings]
        first = next((f for f in findings if f.trusted), None)
        if first is None and (both := agreeing(findings)):
            first = both[0]
            steps.append(f"{both[0].by} and {both[1].by} agree")
        trusted = first is not None
        if first is None:
            best, confirmed = self._least_bad(pairs, ready, T_initial, findings)
        else:
            best, confirmed = first, self._polished(pairs, ready, first)
        result, accepted, words = self._concluded(best, confirmed)
        steps.append(words)
        undetermined = too_uncertain(result.covariance, *self._limits(best))
        return dataclasses.replace(
            result,
            converged=trusted and accepted and not undetermined,
            degenerate=bool(undetermined),
            seconds=time.perf_counter() - started,
            message="; ".join(steps + undetermined),
        )

    def _least_bad(
        self,
        pairs: Sequence[Pair],
        ready: Sequence[Prepared],
        T_initial: Array,
        findings: Sequence[Finding],
    ) -> tuple[Finding, Polished | None]:
        """What to return where nothing is trusted: a finding, refined.

        Of several scenes that of `wide`, if intensities and edges speak for it: it has weighed the
        whole box on all of them, while a wrong pose that is refined may stand out as well as a
        right one. Else whatever stands out most, and be it the guess: one that is near may be
        better than what a wide search ends at.
        """
        usable = [f for f in findings if f.usable]
        signatures = [each.features["wide"].signature for each in ready if "wide" in each.features]
        several = len(scenes(signatures)) > 1
        polished = []
        for finding in reversed(usable):  # `wide` is the last that is tried
            confirmed = self._polished(pairs, ready, finding)
            if several and finding.by in SAME_DATA and _contrast(confirmed) >= MIN_CONTRAST:
                return finding, confirmed
            polished.append((finding, confirmed))
        guess = Finding("initial guess", _untouched(T_initial))
        polished.append((guess, self._polished(pairs, ready, guess)))
        return max(polished, key=lambda item: _contrast(item[1]))

    def _limits(self, best: Finding) -> tuple[float, float]:
        """Largest predicted standard deviations of a trusted result, metres and degrees."""
        tested = best.trusted and best.by in HALVES_AGREE
        share = TESTED if tested else 1.0
        return share * self.max_translation_sigma_m, share * self.max_rotation_sigma_deg

    def _methods(self, pairs: Sequence[Pair]) -> list[Calibrator]:
        """What to try, in this order, until one converges."""
        box = {
            "search_rotation_deg": self.search_rotation_deg,
            "search_translation_m": self.search_translation_m,
            "seed": self.seed,
        }
        methods: list[Calibrator] = [create("projection", **box)]
        if self.masks:
            methods.append(create("crlf", masks=self.masks))
        if all(pair.intensity is not None for pair in pairs):
            wide = {**box, "search_rotation_deg": 0.7 * self.search_rotation_deg}
            methods.append(create("wide", **wide))
        return methods

    def _findings(
        self, pairs: Sequence[Pair], ready: Sequence[Prepared], T_initial: Array
    ) -> list[Finding]:
        """What the methods find, up to the first that trusts its result."""
        findings = []
        for method in self._methods(pairs):
            try:
                features = [each.of(method) for each in ready]
                finding = Finding(method.name, method.calibrate(pairs, T_initial, features))
            except LcdataError as error:
                finding = Finding(method.name, None, str(error))
            findings.append(finding)
            if finding.trusted:
                break
        return findings

    def _polished(
        self, pairs: Sequence[Pair], ready: Sequence[Prepared], finding: Finding
    ) -> Polished | None:
        """The finding, refined by intensities and edges, where there are any."""
        result = finding.result
        assert result is not None
        method = create("nid_edge")
        try:
            features = [each.of(method) for each in ready]
        except CalibrationError:
            return None
        if finding.by not in SAME_DATA:
            return polish(features, result.T_camera_lidar, self.seed)
        contrast = confirm(features, result.T_camera_lidar, self.seed)
        if contrast is None:
            return None
        known = np.isfinite(result.covariance).all()
        return Polished(
            result.T_camera_lidar,
            result.covariance if known else None,
            contrast,
            result.cost_final,
            result.cost_initial,
        )

    def _concluded(
        self, finding: Finding, confirmed: Polished | None
    ) -> tuple[Calibration, bool, str]:
        """The estimate, whether a second witness speaks for it, and what was decided."""
        result = finding.result
        assert result is not None
        if confirmed is None:
            return result, False, "nothing else to confirm it: no intensities in view"
        told = f"contrast {confirmed.contrast:.1f}"
        if confirmed.contrast < MIN_CONTRAST:
            return result, False, f"intensities and edges do not confirm it ({told})"
        if finding.by in SAME_DATA:
            words = f"{finding.by} confirmed by intensities and edges ({told})"
            return result, confirmed.covariance is not None, words
        refined = dataclasses.replace(
            result,
            T_camera_lidar=confirmed.T,
            covariance=_known(confirmed.covariance),
            cost_initial=confirmed.cost_before,
            cost_final=confirmed.cost,
        )
        if not finding.trusted:
            words = f"{finding.by} refined by intensities and edges ({told})"
            return refined, confirmed.covariance is not None, words
        apart = distance(result.T_camera_lidar, result.covariance, confirmed.T, refined.covariance)
        if not apart <= FARTHEST:
            return result, False, f"intensities and edges are {apart:.1f} sigma away ({told})"
        T, covariance = fused(
            result.T_camera_lidar, result.covariance, confirmed.T, refined.covariance
        )
        words = f"averaged with intensities and edges ({told}, {apart:.1f} sigma apart)"
        return dataclasses.replace(refined, T_camera_lidar=T, covariance=covariance), True, words


def _known(covariance: Array | None) -> Array:
    return np.full((6, 6), np.nan) if covariance is None else covariance


def _contrast(polished: Polished | None) -> float:
    return -math.inf if polished is None else polished.contrast


def _untouched(T_initial: Array) -> Calibration:
    """The initial guess as if it had been found."""
    return Calibration(T_initial, False, True, np.full((6, 6), np.nan), 0.0)
