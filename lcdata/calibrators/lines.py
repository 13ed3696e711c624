"""What the line methods share: features, search, matching, and the verdict on the result."""

from __future__ import annotations

import math
import time
from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from lcdata.calibrators.base import Calibration, Calibrator, LineMatches
from lcdata.calibrators.uncertainty import too_uncertain
from lcdata.errors import CalibrationError
from lcdata.features.chamfer_search import (
    FINEST,
    Objective,
    SearchOptions,
    contrast,
    search,
    visible_share,
)
from lcdata.features.held import HOLDS, NOTHING, ROTATION, TRANSLATION
from lcdata.features.line_features import LineFeatures, extract_line_features
from lcdata.features.line_solver import (
    ROTATION_RATIO,
    TRANSLATION_RATIO,
    Problem,
    Solution,
    Solver,
    singular_ratios,
)
from lcdata.features.matching import Matches, make_problem, refine
from lcdata.geometry import se3
from lcdata.pair import Pair

Array = NDArray[np.float64]

MIN_MATCHES = 3
"""Lines that six unknowns need."""

MIN_SUPPORT = 8.0
"""Sum of robust weights below which a result may be a coincidence of few lines: 20 and more at
right poses of simulated pairs."""

MIN_SHARE = 0.3
"""Part of the cloud lines in view that must be matched: 0.37-0.69 at right poses of simulated
pairs, 0.06-0.19 at wrong ones."""

MIN_CONTRAST = 2.8
"""See `contrast`: 3-15 at right poses, mostly below 2 at wrong ones, up to 4 on road scans."""

REACH = 1.6
"""Largest correction of the initial guess on one axis, in half-widths of the search."""

CORRELATION = 4.0
"""Variance of the estimate over that of independent lines, measured on simulated pairs.

Lines of one ledge or of one row of windows are wrong together."""


@dataclass(frozen=True)
class LineCalibrator(Calibrator):
    """A method that solves for the extrinsic from matched lines.

    The search box has to contain the error of the initial guess; its defaults are twice the
    5 degrees and 1.4 times the 0.5 m on each axis of PLK-Calib's protocol.

    Args:
        search_rotation_deg: Half-width of the search about each axis, degrees.
        search_translation_m: Half-width of the search along each axis, metres.
        search_samples: Poses in the first stage of the search.
        paint: Use borders of paint in the LiDAR's intensity as well as edges of shape; ours, not
            in the paper. Without it errors are about twice as large in open places.
        max_rotation_sigma_deg: A result is not trusted if the predicted standard deviation of
            its rotation is larger, degrees.
        max_translation_sigma_m: The same of the translation, metres.
        hold: What is kept as the initial guess has it: nothing, rotation or translation (where
            the camera sees the LiDAR's origin), as in PLK-Calib's test of bad initial guesses.
        seed: Seed of the search's random numbers.
    """

    version: ClassVar[int] = 3

    search_rotation_deg: float = 10.0
    search_translation_m: float = 0.7
    search_samples: int = 20_000
    paint: bool = True
    max_rotation_sigma_deg: float = 1.0
    max_translation_sigma_m: float = 0.2
    hold: str = NOTHING
    seed: int = 0

    def __post_init__(self) -> None:
        limits = {
            "search_rotation_deg": 180.0,
            "search_translation_m": math.inf,
            "search_samples": 10_000_000,
            "max_rotation_sigma_deg": math.inf,
            "max_translation_sigma_m": math.inf,
        }
        self._check_numbers(limits, ("search_samples", "seed"))
        if self.hold not in HOLDS:
            raise CalibrationError(f"hold is {self.hold!r}", f"use {', '.join(HOLDS)}")

    @property
    @abstractmethod
    def solver(self) -> Solver:
        """Solves for the pose of matched lines."""

    def prepare(self, pair: Pair) -> LineFeatures:
        """Image lines, cloud lines and distance fields of one pair."""
        return extract_line_features(pair, self.paint)

    def calibrate(
        self,
        pairs: Sequence[Pair],
        initial: Array | None,
        prepared: Sequence[Any] | None = None,
    ) -> Calibration:
        """Estimate the extrinsic that all the pairs share; see `Calibrator.calibrate`."""
        started = time.perf_counter()
        T_initial, features = self._ready(pairs, initial, prepared)
        options = SearchOptions(
            self.search_rotation_deg,
            self.search_translation_m,
            samples=self.search_samples,
            seed=self.seed,
            hold=self.hold,
        )
        poses, objective = search(features, T_initial, options)
        refined = [refine(features, pose, self.solver) for pose in poses]
        solved = [(s, m) for s, m in refined if s is not None]
        if not solved:
            return _failure(T_initial, _why_no_match(features, objective), started)
        found = [(s, m) for s, m in solved if self._in_box(s.T_camera_lidar, T_initial)]
        if not found:
            message = f"{len(solved)} estimates all left the box of the search"
            return _failure(T_initial, message, started)
        costs = objective(np.stack([T_initial, *(s.T_camera_lidar for s, _ in found)]), FINEST)
        winner = int(np.argmin(costs[1:]))
        solution, matches = found[winner]
        covariance = CORRELATION * solution.covariance
        undetermined = self._undetermined(solution, make_problem(features, matches), covariance)
        doubts = _doubts(solution, matches, objective)
        if costs[1 + winner] >= costs[0]:
            doubts.append("no better than the initial guess")
        return Calibration(
            solution.T_camera_lidar,
            converged=not (undetermined or doubts),
            degenerate=bool(undetermined),
            covariance=covariance,
            seconds=time.perf_counter() - started,
            cost_initial=float(costs[0]),
            cost_final=float(costs[1 + winner]),
            message="; ".join(undetermined + doubts),
            matches=_line_matches(features, matches),
        )

    def _in_box(self, T: Array, T_initial: Array) -> bool:
        """Whether a pose is within reach of the search."""
        turned = se3.log(T @ se3.inverse(T_initial))[3:] / np.deg2rad(self.search_rotation_deg)
        moved = (T - T_initial)[:3, 3] / self.search_translation_m
        return float(max(np.abs(turned).max(), np.abs(moved).max())) <= REACH

    def _undetermined(self, solution: Solution, problem: Problem, covariance: Array) -> list[str]:
        """What the lines leave open, however well they fit."""
        found = []
        rotation, translation = singular_ratios(problem, solution.T_camera_lidar, solution.weights)
        if self.hold != ROTATION and rotation < ROTATION_RATIO:
            found.append(f"matched lines are nearly parallel (singular values {rotation:.3f})")
        if self.hold != TRANSLATION and translation < TRANSLATION_RATIO:
            found.append(f"matched lines leave the translation open ({translation:.4f})")
        limits = self.max_translation_sigma_m, self.max_rotation_sigma_deg
        return found + too_uncertain(covariance, *limits)


def _doubts(solution: Solution, matches: Matches, objective: Objective) -> list[str]:
    """Signs that the pose is a wrong one that happens to fit."""
    found = []
    T = solution.T_camera_lidar
    support = float(solution.weights.sum())
    if support < MIN_SUPPORT:
        found.append(f"only {len(matches.pair)} lines match (robust weight {support:.1f})")
    seen = sum(int((visible_share(f, T[None]) > 0.5).sum()) for f in objective.pairs)
    if len(matches.pair) < MIN_SHARE * seen:
        found.append(f"only {len(matches.pair)} of {seen} cloud lines in view match")
    stands_out = contrast(objective, T)
    if stands_out < MIN_CONTRAST:
        found.append(f"poses around fit nearly as well (contrast {stands_out:.1f})")
    return found


def _why_no_match(features: Sequence[LineFeatures], objective: Objective) -> str:
    image = sum(len(f.image_lines) for f in features)
    cloud = sum(len(f.segments) for f in features)
    seen = sum(len(s) for s in objective.segments)
    return (
        f"fewer than {MIN_MATCHES} lines match: {image} in the image, {cloud} in the cloud, "
        f"{seen} of them in view of the search"
    )


def _failure(T_initial: Array, message: str, started: float) -> Calibration:
    return Calibration(
        T_initial,
        converged=False,
        degenerate=True,
        covariance=np.full((6, 6), np.nan),
        seconds=time.perf_counter() - started,
        message=message,
    )


def _line_matches(features: Sequence[LineFeatures], matches: Matches) -> LineMatches:
    lidar = [features[k].segments[s] for k, s in zip(matches.pair, matches.segment, strict=True)]
    image = [features[k].image_lines[b] for k, b in zip(matches.pair, matches.line, strict=True)]
    return LineMatches(
        np.array(lidar).reshape(-1, 2, 3), np.array(image).reshape(-1, 2, 2), matches.pair
    )
