"""A task: work on pairs that are solved together, and what a worker says of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from lcdata.calibrators.base import Calibrator
from lcdata.evaluation.protocol import NoGuesses, Protocol
from lcdata.evaluation.results import Guess

if TYPE_CHECKING:
    from lcdata.dataset.schema import PoseRecord

NO_GUESS = "no initial guess: "
DOUBT = "initial guess not to be trusted: "
"""How messages on automatic guesses begin."""

Work = tuple[tuple[str, int], ...]
"""Label of a method and number of a trial, one estimate each."""


@dataclass(frozen=True, eq=False)
class FoundGuess:
    """An initial guess that was looked for.

    Args:
        T_camera_lidar: 4x4; None if there is none.
        doubt: Why it is not to be trusted; empty if it is.
        error: Why there is none.
    """

    T_camera_lidar: NDArray[np.float64] | None
    doubt: str = ""
    error: str = ""


@dataclass(frozen=True)
class Task:
    """Work on one pair, or on several that are solved jointly.

    Args:
        dataset: Folder or URL of the data set: workers read pairs themselves.
        run: Name of the run.
        protocol: Where initial guesses come from.
        pose: Ground truth of the pairs.
        pair_ids: Names of the pairs.
        methods: Methods by label.
        work: What to do with them.
        guesses: Initial guesses by number of the trial that other methods have started from, from
            which this work starts too; the protocol's where there is none.
        checksums: sha256 of image and cloud of each pair, which the files must have; empty if they
            may be any.
        contents: sha256 of files that parameters name, by label and parameter, see `inputs`.
        automatic: Options of initial guesses that are to be found from the pairs (see
            `calibrators.initial_guess.GuessOptions`), by number of the trial.
        found: Those of them that were found before.
    """

    dataset: Path | str
    run: str
    protocol: Protocol
    pose: PoseRecord
    pair_ids: tuple[str, ...]
    methods: dict[str, Calibrator]
    work: Work
    guesses: Mapping[int, Guess] = field(default_factory=dict)
    checksums: tuple[tuple[str, str], ...] = ()
    contents: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    automatic: Mapping[int, Mapping[str, object]] = field(default_factory=dict)
    found: Mapping[int, FoundGuess] = field(default_factory=dict)

    def guess(self, trial: int) -> Guess:
        """Where a trial starts."""
        if trial in self.guesses:
            return self.guesses[trial]
        if isinstance(self.protocol, NoGuesses):
            return Guess(None, self.pose.pose_version)
        truth = self.pose.T_camera_lidar
        T = self.protocol.initial_guess(truth, self.pair_ids, trial)
        return Guess(T, self.pose.pose_version)


@dataclass(frozen=True)
class Begin:
    """A worker says what it begins, so that a crash is laid at the right door.

    Args:
        step: In words, for the message of a failed trial.
        work: What has failed if the process dies now.
    """

    step: str
    work: Work


@dataclass(frozen=True)
class Refusal:
    """Why work cannot go on: what it would compute were not the trials that were asked for.

    Args:
        message: What is wrong.
        remedy: What to do.
    """

    message: str
    remedy: str
