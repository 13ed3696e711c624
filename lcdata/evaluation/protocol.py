"""How initial guesses are made from the ground truth (PLK-Calib, section V-C)."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lcdata.errors import CalibrationError
from lcdata.geometry import se3

if TYPE_CHECKING:
    from lcdata.evaluation.results import TrialResult

Array = NDArray[np.float64]

GROUPS = ("pair", "pose")
"""What one estimate is made from: a single pair, or all pairs of an arm pose jointly."""

TOLERANCE = 0.1
"""How much farther off or nearer a guess may be after the ground truth has moved. No guess is known
better: the true extrinsic is off any ground truth by that one's own uncertainty."""


@dataclass(frozen=True)
class Protocol:
    """What makes trials comparable: all methods start from the same wrong extrinsics.

    Args:
        init_rotation_deg: Size of the error about *each* axis, degrees.
        init_translation_m: Size of the error along *each* axis, metres.
        trials: Initial guesses for each pair (or pose).
        seed: Seed of the random signs.
        group: One of `GROUPS`.

    Raises:
        CalibrationError: A value that no initial guess can be made from.
    """

    init_rotation_deg: float = 5.0
    init_translation_m: float = 0.5
    trials: int = 1
    seed: int = 0
    group: str = "pair"

    def __post_init__(self) -> None:
        limit = 180 / math.sqrt(3)
        if not 0 <= self.init_rotation_deg < limit:
            raise CalibrationError(
                f"initial rotation error of {self.init_rotation_deg} deg an axis",
                f"give 0 or more, below {limit:.0f}",
            )
        if not 0 <= self.init_translation_m < math.inf:
            raise CalibrationError(
                f"initial translation error of {self.init_translation_m} m an axis",
                "give 0 or more",
            )
        if self.trials < 1 or self.seed < 0:
            raise CalibrationError(
                f"{self.trials} trials with seed {self.seed}",
                "give one trial or more and a seed of 0 or more",
            )
        if self.group not in GROUPS:
            raise CalibrationError(f"unknown group {self.group!r}", f"use {' or '.join(GROUPS)}")

    @property
    def run(self) -> str:
        """Name of the run whose trials are made like this; more trials extend the same run."""
        joint = "" if self.group == "pair" else f"-{self.group}"
        return f"{self.init_rotation_deg:g}deg-{self.init_translation_m:g}m-seed{self.seed}{joint}"

    def initial_guess(self, T_truth: ArrayLike, pair_ids: Sequence[str], trial: int) -> Array:
        """The initial guess of one trial.

        It depends on the seed, the pairs' names and the trial's number alone, so that neither
        the order of the work nor the number of processes changes it.

        Args:
            T_truth: 4x4 ground truth `T_camera_lidar`.
            pair_ids: Names of the pairs.
            trial: Number of the trial.

        Returns:
            4x4 `T_camera_lidar`.
        """
        digest = hashlib.sha256("\n".join(pair_ids).encode()).digest()
        words = np.frombuffer(digest, np.uint32).tolist()
        rng = np.random.default_rng([self.seed, trial, *words])
        return perturb(T_truth, self.init_rotation_deg, self.init_translation_m, rng)

    def made(self, trial: TrialResult) -> bool:
        """Whether a stored trial started as this protocol says."""
        theirs = (trial.init_rotation_deg, trial.init_translation_m, trial.seed, trial.group)
        return theirs == (self.init_rotation_deg, self.init_translation_m, self.seed, self.group)

    def holds(self, rotation_error_deg: float, translation_error_m: float) -> bool:
        """Whether an initial guess is as far off as the protocol's, within `TOLERANCE`.

        Args:
            rotation_error_deg: Geodesic angle.
            translation_error_m: L2 norm.
        """
        wanted = math.sqrt(3) * np.array([self.init_rotation_deg, self.init_translation_m])
        apart = np.abs(np.array([rotation_error_deg, translation_error_m]) - wanted)
        return bool((apart <= TOLERANCE * wanted).all())


@dataclass(frozen=True)
class GivenGuesses(Protocol):
    """Initial guesses that do not come from the ground truth: picks, matches of a file, a search.

    Args:
        source: Where they come from, one word.
    """

    init_rotation_deg: float = math.nan
    init_translation_m: float = math.nan
    source: str = "picks"

    def __post_init__(self) -> None:
        if self.group not in GROUPS:
            raise CalibrationError(f"unknown group {self.group!r}", f"use {' or '.join(GROUPS)}")

    @property
    def run(self) -> str:
        """Name of the run."""
        return f"init-{self.source}{'' if self.group == 'pair' else f'-{self.group}'}"

    def made(self, trial: TrialResult) -> bool:
        """Whether a stored trial started from a given guess."""
        given = trial.T_camera_lidar_initial is not None
        return given and math.isnan(trial.init_rotation_deg) and trial.group == self.group

    def holds(self, rotation_error_deg: float, translation_error_m: float) -> bool:
        """A guess of one's own may be as far off as it is."""
        return True


@dataclass(frozen=True)
class NoGuesses(GivenGuesses):
    """No initial guesses: for methods that need none. Others fail and say so."""

    source: str = "none"

    def made(self, trial: TrialResult) -> bool:
        """Whether a stored trial started from nothing."""
        return trial.T_camera_lidar_initial is None and trial.group == self.group


def perturb(
    T: ArrayLike, rotation_deg: float, translation_m: float, rng: np.random.Generator
) -> Array:
    """A transform with an error of fixed size and random sign on each axis.

    Args:
        T: 4x4 `T_a_b`.
        rotation_deg: Each component of the rotation vector by which the rotation is turned (in
            frame a), degrees; the rotation error is sqrt(3) times this.
        translation_m: What is added to each component of the translation, metres.
        rng: Where the six signs come from.

    Returns:
        4x4 `T_a_b`.
    """
    signs = rng.choice([-1.0, 1.0], 6)
    T = np.array(T, float)
    turn = se3.exp(np.concatenate([np.zeros(3), np.radians(rotation_deg) * signs[:3]]))
    T[:3, :3] = turn[:3, :3] @ T[:3, :3]
    T[:3, 3] += translation_m * signs[3:]
    return T
