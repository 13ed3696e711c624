"""Initial guesses that are found automatically, for whole data sets."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Mapping
from contextlib import closing
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

import lcdata
from lcdata.errors import CalibrationError, LcdataError
from lcdata.evaluation.pool import Crash, default_jobs, run_here, run_in_processes
from lcdata.evaluation.protocol import GivenGuesses
from lcdata.evaluation.results import read_results

if TYPE_CHECKING:
    from lcdata.dataset import Dataset

SOURCE = "auto"


@dataclass(frozen=True, eq=False)
class AutomaticGuesses:
    """What was found.

    Args:
        initial: 4x4 `T_camera_lidar` by pair_id; pairs that nothing was found of are not in it.
        notes: What a user should know, a line for each guess that is not to be trusted.
        source: Word that names the run of their trials.
    """

    initial: dict[str, NDArray[np.float64]]
    notes: tuple[str, ...]
    source: str = SOURCE


def source_of(options: Mapping[str, object]) -> str:
    """Word that names the run of guesses: other options, other guesses, another run.

    Args:
        options: See `lcdata.calibrators.initial_guess.GuessOptions`; those left at their defaults
            are not named.
    """
    from lcdata.calibrators.initial_guess import GuessOptions

    usual = GuessOptions()
    GuessOptions(**options)  # type: ignore[arg-type]  # refuses what makes no sense
    words = [
        f"{name.replace('_', '-')}-{value}"
        for name, value in sorted(options.items())
        if value != getattr(usual, name)
    ]
    return "-".join([SOURCE, *words])


@dataclass(frozen=True)
class _Task:
    dataset: Path
    pair_ids: tuple[str, ...]
    options: Mapping[str, object] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class _Found:
    pair_ids: tuple[str, ...]
    T_camera_lidar: NDArray[np.float64] | None
    doubt: str


def automatic_guesses(
    dataset: Dataset,
    *,
    group: str = "pair",
    jobs: int | None = None,
    force: bool = False,
    options: Mapping[str, object] | None = None,
    progress: Callable[[str, int, int], None] | None = None,
) -> AutomaticGuesses:
    """Guess the extrinsic of each pair, or of all pairs of each arm pose together.

    Guesses that this version has found before with the same options, and that trials have started
    from, are taken again.

    Args:
        dataset: The data set.
        group: "pair" or "pose".
        jobs: Number of processes; None for one a processor, 0 for none (in this process).
        force: Look for all of them again.
        options: How to look, see `lcdata.calibrators.initial_guess.GuessOptions`.
        progress: Called as guesses are found.

    Raises:
        CalibrationError: No pair has a guess, or an option makes no sense.
    """
    options = dict(options or {})
    source = source_of(options)
    groups: dict[str, list[str]] = {}
    for pair in dataset.pairs:
        name = pair.pair_id if group == "pair" else pair.pose_id
        groups.setdefault(name, []).append(pair.pair_id)
    initial = {} if force else _stored(dataset, group, source)
    tasks = deque(
        _Task(Path(dataset.path).resolve(), tuple(pair_ids), options)
        for pair_ids in groups.values()
        if pair_ids[0] not in initial
    )
    done, notes = len(groups) - len(tasks), []
    count = max(1, min(default_jobs() if jobs is None else jobs, len(tasks)))
    run = run_here if jobs == 0 else partial(run_in_processes, jobs=count)
    with closing(run(_find, tasks)) as items:
        for item in items:
            done += 1
            if progress:
                progress("initial guesses", done, len(groups))
            if isinstance(item, Crash):
                notes.append(f"{item.task.pair_ids[0]}: {item.reason}")
                continue
            if item.doubt:
                notes.append(f"{item.pair_ids[0]}: {item.doubt}")
            if item.T_camera_lidar is not None:
                initial |= dict.fromkeys(item.pair_ids, item.T_camera_lidar)
    if not initial:
        raise CalibrationError(
            f"no initial guess was found: {notes[0] if notes else 'no pairs'}",
            "pick matches by hand: lcdata pick",
        )
    return AutomaticGuesses(initial, tuple(notes), source)


def _stored(dataset: Dataset, group: str, source: str) -> dict[str, NDArray[np.float64]]:
    """Guesses that stored trials started from."""
    run = GivenGuesses(group=group, source=source).run
    return {
        pair_id: T
        for trial in read_results(dataset, run).trials
        if trial.lcdata_version == lcdata.__version__
        and (T := trial.T_camera_lidar_initial) is not None
        for pair_id in trial.pair_ids
    }


def _find(task: _Task) -> Iterator[_Found]:
    """Work of one process: the guess of one pair, or of several together."""
    from lcdata.calibrators.initial_guess import guess
    from lcdata.dataset import Dataset

    try:
        dataset = Dataset.open(task.dataset)
        found = guess([dataset.load(name) for name in task.pair_ids], **task.options)
    except (LcdataError, OSError) as error:
        yield _Found(task.pair_ids, None, f"no initial guess: {error}")
        return
    doubt = "" if found.converged else f"initial guess not to be trusted: {found.message}"
    yield _Found(task.pair_ids, found.T_camera_lidar, doubt)
