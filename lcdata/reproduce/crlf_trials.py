"""Trials of CRLF on one frame: from nothing, or from extrinsics that are off."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lcdata.evaluation.protocol import perturb
from lcdata.reproduce.crlf_errors import Six, displaced, per_axis
from lcdata.reproduce.crlf_frames import Frame, frame, source_of
from lcdata.reproduce.crlf_steps import REFINEMENTS, Found, Steps, steps
from lcdata.reproduce.kept import KeptRows

Array = NDArray[np.float64]

GUESS = 1.0, 0.1
"""Error of a guess on each axis where there are no masks: deg, m."""

LEVELS = 6
"""Figure 7: initial errors of up to k / LEVELS of 1 m and 6 deg on each axis."""


@dataclass(frozen=True)
class Trial:
    """What one refinement made of one start.

    Args:
        level: 0 from the coarse calibration, or from `GUESS`; else see `LEVELS`.
        refinement: Name in `crlf_steps.REFINEMENTS`.
        start: Error of the start, see `crlf_errors.per_axis`.
        end: Error of the result.
        seconds: Processor time.
        converged: The method's own verdict.
    """

    level: int
    refinement: str
    start: Six
    end: Six
    seconds: float
    converged: bool = False


@dataclass(frozen=True)
class Row:
    """What became of one frame.

    Args:
        experiment: Name of the experiment.
        source: Name of the frame's source.
        frame: Number.
        seed: Of scenes and starts.
        feature_seconds: Processor time of the line features of cloud and image.
        coarse_seconds: The same of the coarse calibration.
        verdict_seconds: The same of our verdict, which the paper has not.
        given: Whether there are no masks, and thus a given start instead of a coarse one.
        trials: Those that could be made.
        message: Why there are none.
    """

    experiment: str
    source: str
    frame: int
    seed: int
    feature_seconds: float = float("nan")
    coarse_seconds: float = float("nan")
    verdict_seconds: float = float("nan")
    given: bool = False
    trials: tuple[Trial, ...] = ()
    message: str = ""

    @property
    def key(self) -> tuple[str, str, int, int]:
        """What it is a row of."""
        return self.experiment, self.source, self.frame, self.seed


@dataclass(frozen=True)
class Task:
    """A frame to work on."""

    experiment: str
    source: str
    frame: int
    seed: int
    data: Path

    @property
    def key(self) -> tuple[str, str, int, int]:
        """What its row is a row of."""
        return self.experiment, self.source, self.frame, self.seed


class Kept(KeptRows[Row]):
    """Rows that are done.

    Args:
        path: Their file; None keeps none.
    """

    def __init__(self, path: Path | None) -> None:
        super().__init__(path, _parsed)


def _parsed(line: dict[str, Any]) -> Row:
    trials = tuple(
        Trial(**{**t, "start": tuple(t["start"]), "end": tuple(t["end"])}) for t in line["trials"]
    )
    return Row(**{**line, "trials": trials})


def from_nothing(task: Task) -> Iterator[Row]:
    """Table II: the coarse calibration, then each refinement of it; ours does both itself.

    Without masks there is no coarse calibration: all start from `GUESS` then.
    """
    shot = _shot(task)
    with steps(shot) as ready:
        coarse = ready.coarse() if ready.masks else Found(_guess(shot, task), float("nan"))
        start = coarse.T_camera_lidar
        given = not ready.masks
        row = Row(*task.key, ready.feature_seconds, given=given)
        if start is None:
            yield replace(row, message=coarse.message)
            return
        own = 0.0 if given else ready.coarse_seconds()
        trials = []
        for name in REFINEMENTS:
            whole = name == "crlf" and not given
            trials.append(_trial(ready, name, 0, start, whole, own))
        yield replace(
            row,
            coarse_seconds=float("nan") if given else own,
            verdict_seconds=ready.verdict_seconds(start),
            trials=tuple(t for t in trials if t is not None),
        )


def from_levels(task: Task) -> Iterator[Row]:
    """Figure 7: each refinement from a start of each level."""
    shot = _shot(task)
    trials = []
    with steps(shot) as ready:
        for level in range(1, LEVELS + 1):
            chance = np.random.default_rng([task.seed, task.frame, level])
            start = displaced(_truth(shot), level / LEVELS, chance)
            trials += [_trial(ready, name, level, start) for name in REFINEMENTS]
    yield Row(*task.key, trials=tuple(t for t in trials if t is not None))


def _shot(task: Task) -> Frame:
    """The frame; in a new process, all is run once before, uncounted, to be compiled."""
    import cv2

    cv2.setNumThreads(1)
    shot = frame(source_of(task.source), task.frame, task.seed, task.data)
    if not _COMPILED:
        with steps(shot) as ready:
            ready.coarse()
            if ready.masks and ready.features.view is not None:
                ready.coarse_seconds()
                ready.refined("crlf", None)
            for name in REFINEMENTS:
                ready.refined(name, _truth(shot))
            ready.verdict_seconds(_truth(shot))
        _COMPILED.add(True)
    return shot


_COMPILED: set[bool] = set()


def _truth(shot: Frame) -> Array:
    assert shot.pair.T_camera_lidar is not None
    return shot.pair.T_camera_lidar


def _guess(shot: Frame, task: Task) -> Array:
    return perturb(_truth(shot), *GUESS, np.random.default_rng([task.seed, task.frame, 4]))


def _trial(
    ready: Steps,
    name: str,
    level: int,
    start: Array,
    whole: bool = False,
    coarse_seconds: float = 0.0,
) -> Trial | None:
    """One refinement; None where the method refuses.

    Args:
        ready: The frame.
        name: Of the refinement.
        level: Of the start.
        start: 4x4.
        whole: Let the method find its own start, which takes `coarse_seconds`.
        coarse_seconds: Not counted.
    """
    truth = _truth(ready.frame)
    found = ready.refined(name, None if whole else start, wide=level > 0)
    if found.T_camera_lidar is None:
        return None
    seconds = found.seconds - ready.verdict_seconds(found.T_camera_lidar)
    seconds -= coarse_seconds if whole else 0.0
    end = per_axis(found.T_camera_lidar, truth)
    return Trial(level, name, per_axis(start, truth), end, seconds, found.converged)
