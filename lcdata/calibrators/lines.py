"""What the line methods share: features, search, matching, and the verdict on the result."""

from __future__ import annotations

import time
from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lcdata.calibrators.base import Calibration, Calibrator, LineMatches
from lcdata.errors import CalibrationError
from lcdata.features.chamfer_search import FINEST, Objective, SearchOptions, search
from lcdata.features.line_features import LineFeatures, extract_line_features
from lcdata.features.line_solver import (
    ROTATION_RATIO,
    TRANSLATION_RATIO,
    Solution,
    Solver,
    singular_ratios,
)
from lcdata.features.matching import Matches, make_problem, refine
from lcdata.pair import Pair

Array = NDArray[np.float64]

MIN_MATCHES = 3
"""Lines that six unknowns need."""


@dataclass(frozen=True)
class LineCalibrator(Calibrator):
    """A method that solves for the extrinsic from matched lines.

    The search box has to contain the error of the initial guess; its defaults are twice the
    5 degrees and 1.4 times the 0.5 m on each axis of PLK-Calib's protocol.

    Args:
        search_rotation_deg: Half-width of the search about each axis, degrees.
        search_translation_m: Half-width of the search along each axis, metres.
        search_samples: Poses in the first stage of the search.
        max_rotation_sigma_deg: A result is not trusted if the predicted standard deviation of
            its rotation is larger, degrees.
        max_translation_sigma_m: The same of the translation, metres.
        seed: Seed of the search's random numbers.
    """

    search_rotation_deg: float = 10.0
    search_translation_m: float = 0.7
    search_samples: int = 20_000
    max_rotation_sigma_deg: float = 1.0
    max_translation_sigma_m: float = 0.2
    seed: int = 0

    @property
    @abstractmethod
    def solver(self) -> Solver:
        """Solves for the pose of matched lines."""

    def prepare(self, pair: Pair) -> LineFeatures:
        """Image lines, cloud lines and distance fields of one pair."""
        return extract_line_features(pair)

    def calibrate(
        self,
        pairs: Sequence[Pair],
        initial: Array | None,
        prepared: Sequence[Any] | None = None,
    ) -> Calibration:
        """Estimate the extrinsic that all the pairs share; see `Calibrator.calibrate`."""
        started = time.perf_counter()
        if initial is None or not pairs:
            raise CalibrationError(
                f"method {self.name!r} got {len(pairs)} pairs and initial guess {initial}",
                "give one pair or more and a 4x4 T_camera_lidar",
            )
        T_initial = np.array(initial, float)
        ready = prepared or [None] * len(pairs)
        features = [
            self.prepare(pair) if done is None else done
            for pair, done in zip(pairs, ready, strict=True)
        ]
        options = SearchOptions(
            self.search_rotation_deg,
            self.search_translation_m,
            samples=self.search_samples,
            seed=self.seed,
        )
        poses, objective = search(features, T_initial, options)
        refined = [refine(features, pose, self.solver) for pose in poses]
        found = [(s, m) for s, m in refined if s is not None]
        if not found:
            return _failure(T_initial, _why_no_match(features, objective), started)
        costs = objective(np.stack([T_initial, *(s.T_camera_lidar for s, _ in found)]), FINEST)
        winner = int(np.argmin(costs[1:]))
        solution, matches = found[winner]
        reasons, degenerate = self._doubts(solution, matches, features, costs, T_initial)
        return Calibration(
            solution.T_camera_lidar,
            converged=not reasons,
            degenerate=degenerate,
            covariance=solution.covariance,
            seconds=time.perf_counter() - started,
            cost_initial=float(costs[0]),
            cost_final=float(costs[1 + winner]),
            message="; ".join(reasons),
            matches=_line_matches(features, matches),
        )

    def _doubts(
        self,
        solution: Solution,
        matches: Matches,
        features: Sequence[LineFeatures],
        costs: Array,
        T_initial: Array,
    ) -> tuple[list[str], bool]:
        """Why the result should not be trusted, and whether the lines leave it undetermined."""
        T = solution.T_camera_lidar
        rotation, translation = singular_ratios(
            make_problem(features, matches), T, solution.weights
        )
        sigma = np.sqrt(np.diag(solution.covariance))
        sigma_m, sigma_deg = np.linalg.norm(sigma[:3]), np.rad2deg(np.linalg.norm(sigma[3:]))
        undetermined = []
        if rotation < ROTATION_RATIO:
            undetermined.append(f"lines nearly parallel (singular values {rotation:.3f})")
        if translation < TRANSLATION_RATIO:
            undetermined.append(f"lines leave the translation open ({translation:.4f})")
        if sigma_deg > self.max_rotation_sigma_deg or sigma_m > self.max_translation_sigma_m:
            undetermined.append(f"predicted deviation {sigma_deg:.2f} deg, {sigma_m:.2f} m")
        return undetermined, bool(undetermined)


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
