"""One scene of the NID table: initial guess, refinement, errors; what is done is kept."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from lcdata.calibrators.registry import create
from lcdata.errors import CalibrationError
from lcdata.geometry import se3
from lcdata.pair import Pair
from lcdata.reproduce.kept import KeptRows, Keyed
from lcdata.reproduce.nid_scenes import COMBINATIONS, scene

Array = NDArray[np.float64]

GOOD_M, GOOD_DEG = 0.5, 1.0
"""Errors below which the paper calls an initial guess a success."""

PICKS, PICK_PX = 12, 2.0
"""Matches of the simulated hand that helps where the guess fails, and how well it clicks."""


@dataclass(frozen=True)
class Row:
    """What became of one scene, or of all scenes together.

    Args:
        combination: Number of the sensors.
        scenes: Numbers of the scenes.
        seed: Of the scenes.
        guessed: Whether the initial guess is a success by the paper's rule.
        trusted: Whether the guess itself says so.
        guess_m: Error of the guess, metres.
        guess_deg: The same, degrees.
        error_m: Error of the refined extrinsic, metres.
        error_deg: The same, degrees.
        converged: What the refinement says of itself.
        guess_seconds: Wall time of the guess.
        seconds: Wall time of the refinement.
        message: What went wrong, in words.
    """

    combination: int
    scenes: tuple[int, ...]
    seed: int
    guessed: bool
    trusted: bool
    guess_m: float
    guess_deg: float
    error_m: float
    error_deg: float
    converged: bool
    guess_seconds: float
    seconds: float
    message: str = ""

    @property
    def key(self) -> tuple[int, tuple[int, ...], int]:
        """What it is a row of."""
        return self.combination, self.scenes, self.seed


@dataclass(frozen=True)
class Task:
    """Scenes of a combination to solve; several are solved together."""

    combination: int
    scenes: tuple[int, ...]
    seed: int

    @property
    def key(self) -> tuple[int, tuple[int, ...], int]:
        """What its row is a row of."""
        return self.combination, self.scenes, self.seed


def run_task(task: Task) -> Iterator[Row]:
    """Solve one task."""
    import cv2

    cv2.setNumThreads(1)
    combination = COMBINATIONS[task.combination]
    pairs = [scene(combination, number, task.seed) for number in task.scenes]
    truth = combination.T_camera_lidar
    started = time.perf_counter()
    T, trusted, message = _guess(pairs)
    guess_seconds = time.perf_counter() - started
    guess_m, guess_deg = _errors(T, truth)
    guessed = guess_m < GOOD_M and guess_deg < GOOD_DEG
    if not guessed:
        T = _by_hand(pairs[0], np.random.default_rng([task.seed, *task.scenes]))
    started = time.perf_counter()
    found = create("nid").calibrate(pairs, T)
    seconds = time.perf_counter() - started
    error_m, error_deg = _errors(found.T_camera_lidar, truth)
    yield Row(
        task.combination,
        task.scenes,
        task.seed,
        guessed,
        trusted,
        guess_m,
        guess_deg,
        error_m,
        error_deg,
        found.converged,
        guess_seconds,
        seconds,
        "; ".join(text for text in (message, found.message) if text),
    )


def _guess(pairs: Sequence[Pair]) -> tuple[Array | None, bool, str]:
    """The automatic initial guess; None if there is none."""
    from lcdata.calibrators.initial_guess import guess

    try:
        found = guess(pairs)
    except CalibrationError as error:
        return None, False, str(error)
    return found.T_camera_lidar, found.converged, found.message


def _by_hand(pair: Pair, rng: np.random.Generator) -> Array:
    """What a person who clicks matches would get: true matches, each click a little off."""
    from lcdata.features.point_pose import point_pose

    T = pair.T_camera_lidar
    assert T is not None
    pixels, inside = pair.camera.project(se3.apply(T, pair.points))
    distance = np.linalg.norm(pair.points, axis=1)
    usable = np.flatnonzero(inside & (distance > 2.0) & (distance < 40.0))
    chosen = rng.choice(usable, PICKS, replace=False)
    clicks = pixels[chosen] + rng.normal(0.0, PICK_PX, (PICKS, 2))
    return point_pose(pair.points[chosen], clicks, pair.camera).T_camera_lidar


def _errors(T: Array | None, truth: Array) -> tuple[float, float]:
    """Metres and degrees."""
    if T is None:
        return float("inf"), float("inf")
    return se3.translation_error(T, truth), float(np.rad2deg(se3.rotation_error(T, truth)))


AnyRow = TypeVar("AnyRow", bound=Keyed)


class Kept(KeptRows[AnyRow]):
    """Rows that are done.

    Args:
        path: Their file; None keeps none.
        kind: What a line is: `Row`, or another with `scenes`.
    """

    def __init__(self, path: Path | None, kind: type[AnyRow]) -> None:
        super().__init__(path, lambda line: kind(**{**line, "scenes": tuple(line["scenes"])}))
