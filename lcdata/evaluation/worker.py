"""What a worker does for one pair: load, prepare features, run every method from every guess."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import PurePath
from typing import TYPE_CHECKING, Any

import numpy as np

import lcdata
from lcdata.calibrators.base import Calibration, Calibrator
from lcdata.errors import CalibrationError, DatasetError, LcdataError, MissingLibraryError
from lcdata.evaluation.protocol import NoGuesses
from lcdata.evaluation.results import Guess, TrialResult
from lcdata.evaluation.task import DOUBT, NO_GUESS, Begin, FoundGuess, Refusal, Task
from lcdata.geometry.se3 import check_transform

if TYPE_CHECKING:
    from lcdata.pair import Pair


NEEDS_GUESS = "needs an initial guess: start it from truth, auto, picks or matches"
"""What a method says that is run without one and cannot be."""


@dataclass
class Kept:
    """Pairs that were loaded last, with their features: more work on them need not begin again.

    Args:
        pair_ids: Folder of their data set, and their names.
        pairs: The pairs.
        features: By front end.
        guesses: Initial guesses that were found, by number of the trial.
    """

    pair_ids: tuple[str, ...] = ()
    pairs: list[Pair] = field(default_factory=list)
    features: dict[str, _Features] = field(default_factory=dict)
    guesses: dict[int, FoundGuess] = field(default_factory=dict)


@dataclass(frozen=True)
class _Features:
    """What `prepare` made of some pairs, or the error that it raised."""

    prepared: list[Any]
    seconds: float
    error: str = ""


def run_task(task: Task, kept: Kept | None = None) -> Iterator[Begin | TrialResult | Refusal]:
    """Run one task: a `TrialResult` for each piece of its work, whatever happens.

    Features are prepared once for all trials, and once for all methods of the same front end.

    Args:
        task: The task.
        kept: What this process has loaded and prepared for its task before.

    Yields:
        Results, and before each step what begins; or one `Refusal`, where files are not those that
        the task is for.
    """
    import cv2

    cv2.setNumThreads(1)
    kept = Kept() if kept is None else kept
    pair_ids = (str(task.dataset), *task.pair_ids)
    if kept.pair_ids != pair_ids:
        yield Begin("loading the pair", task.work)
        kept.pair_ids, kept.pairs, kept.features, kept.guesses = (), [], {}, {}
        try:
            kept.pairs = _load(task)
        except _OtherFileError as error:
            yield Refusal(error.message, error.remedy)
            return
        except (LcdataError, OSError) as error:
            for label, trial in task.work:
                yield failure(task, label, trial, str(error))
            return
        kept.pair_ids = pair_ids
    pairs, shared = kept.pairs, kept.features
    yield from _look_for_guesses(task, kept)
    task = _started(task, kept.guesses)
    for label in dict.fromkeys(label for label, _ in task.work):
        method = task.methods[label]
        work = tuple(piece for piece in task.work if piece[0] == label)
        if method.needs_initial and isinstance(task.protocol, NoGuesses):
            for _, trial in work:
                yield failure(task, label, trial, NEEDS_GUESS)
            continue
        key = front_end(method)
        if key not in shared:
            yield Begin("preparing features", work)
            shared[key] = _prepare(method, pairs)
        for _, trial in work:
            if trial in kept.guesses and kept.guesses[trial].error:
                yield without_guess(task, label, trial, kept.guesses[trial].error)
                continue
            yield Begin("calibrating", ((label, trial),))
            yield _doubted(
                _run_trial(task, label, trial, pairs, shared[key]), kept.guesses.get(trial)
            )


def _look_for_guesses(task: Task, kept: Kept) -> Iterator[Begin]:
    """Look for the initial guesses that a task's trials start from and nobody has found yet."""
    for trial, options in task.automatic.items():
        work = tuple(piece for piece in task.work if piece[1] == trial)
        if trial in task.found:
            kept.guesses[trial] = task.found[trial]
        elif work and trial not in kept.guesses:
            yield Begin("looking for an initial guess", work)
            kept.guesses[trial] = _guessed(kept.pairs, options)


def _guessed(pairs: Sequence[Pair], options: Mapping[str, object]) -> FoundGuess:
    from lcdata.calibrators.initial_guess import guess

    try:
        found = guess(pairs, **options)
    except Exception as error:  # as of methods
        return FoundGuess(None, error=f"{NO_GUESS}{_describe(error)}")
    return FoundGuess(found.T_camera_lidar, "" if found.converged else f"{DOUBT}{found.message}")


def _started(task: Task, found: Mapping[int, FoundGuess]) -> Task:
    """A task with the initial guesses that were found for it."""
    more = {
        trial: Guess(guess.T_camera_lidar, task.pose.pose_version)
        for trial, guess in found.items()
        if guess.T_camera_lidar is not None
    }
    return dataclasses.replace(task, guesses={**task.guesses, **more}) if more else task


def _doubted(result: TrialResult, guess: FoundGuess | None) -> TrialResult:
    """A trial that says what is doubtful about where it started."""
    if guess is None or not guess.doubt:
        return result
    message = "; ".join(part for part in (result.message, guess.doubt) if part)
    return dataclasses.replace(result, message=message)


class _OtherFileError(DatasetError):
    """A file is not there, or not the one that a task is for."""


def _load(task: Task) -> list[Pair]:
    """The pairs of a task.

    Raises:
        _OtherFileError: A file has another checksum than the task says, or cannot be read.
        DatasetError: A file is damaged.
    """
    from lcdata.dataset import Dataset

    if not task.checksums:
        dataset = Dataset.open(task.dataset)
        return [dataset.load(pair_id) for pair_id in task.pair_ids]
    pairs = []
    try:
        dataset = Dataset.open(task.dataset)
        contents = [dataset.files(pair_id) for pair_id in task.pair_ids]
    except (DatasetError, MissingLibraryError) as error:
        raise _OtherFileError(error.message, error.remedy) from error
    for pair_id, expected, found in zip(task.pair_ids, task.checksums, contents, strict=True):
        record = dataset.pair(pair_id)
        for name, wanted, data in zip((record.image, record.cloud), expected, found, strict=True):
            actual = hashlib.sha256(data).hexdigest()
            if actual != wanted:
                raise _OtherFileError(
                    f"{dataset.place(name)} has changed: its sha256 is {actual[:12]}…, the "
                    f"experiment is about {wanted[:12]}…",
                    "bring the file back or build the data set again; stored trials are kept",
                )
        pairs.append(dataset.decode(pair_id, *found))
    return pairs


def front_end(method: Calibrator) -> str:
    """Methods with the same front end prepare the same features.

    They have `prepare` from the same class and the same values of that class's parameters
    (of all parameters, where that class is no dataclass).
    """
    owner = next(cls for cls in type(method).__mro__ if "prepare" in vars(cls))
    scope = owner if dataclasses.is_dataclass(owner) else method
    values = {f.name: getattr(method, f.name) for f in _fields(scope)}
    return f"{owner.__module__}.{owner.__qualname__} {values!r}"


def parameters(method: Calibrator, contents: Mapping[str, str] | None = None) -> str:
    """Parameters of a method as JSON.

    Args:
        method: The method.
        contents: sha256 of files that parameters name, by parameter, see `inputs.file_contents`.
    """
    values = {f.name: getattr(method, f.name) for f in _fields(method)}
    values |= {f"{name}.sha256": digest for name, digest in (contents or {}).items()}
    return json.dumps(values, sort_keys=True, default=_plain)


def _plain(value: object) -> str:
    return str(value) if isinstance(value, PurePath) else repr(value)


def _fields(scope: Any) -> tuple[dataclasses.Field[Any], ...]:
    return dataclasses.fields(scope) if dataclasses.is_dataclass(scope) else ()


def _prepare(method: Calibrator, pairs: Sequence[Pair]) -> _Features:
    start = time.perf_counter()
    try:
        prepared, error = [method.prepare(pair) for pair in pairs], ""
    except Exception as exception:  # anything a third party's method may raise is its result
        prepared, error = [], _describe(exception)
    return _Features(prepared, time.perf_counter() - start, error)


def _run_trial(
    task: Task, label: str, trial: int, pairs: Sequence[Pair], features: _Features
) -> TrialResult:
    if features.error:
        return failure(task, label, trial, features.error, features.seconds)
    blank = failure(task, label, trial, "")
    start = time.perf_counter()
    try:
        initial = blank.T_camera_lidar_initial
        initial = None if initial is None else initial.copy()
        calibration = task.methods[label].calibrate(pairs, initial, features.prepared)
        seconds = features.seconds + time.perf_counter() - start
        if not isinstance(calibration, Calibration):
            raise CalibrationError(f"{label} returned {type(calibration).__name__}")
        estimate = check_transform(calibration.T_camera_lidar, f"the estimate of {label}")
    except Exception as exception:  # as above
        seconds = features.seconds + time.perf_counter() - start
        return dataclasses.replace(
            blank,
            message=_describe(exception),
            seconds=seconds,
            features_seconds=features.seconds,
        )
    return dataclasses.replace(
        blank,
        failed=False,
        T_camera_lidar_estimated=estimate,
        covariance=calibration.covariance,
        converged=bool(calibration.converged),
        degenerate=bool(calibration.degenerate),
        cost_initial=float(calibration.cost_initial),
        cost_final=float(calibration.cost_final),
        seconds=seconds,
        features_seconds=features.seconds,
        message=calibration.message,
        matches=calibration.matches,
    ).against(task.pose)


def failure(
    task: Task, label: str, trial: int, message: str, seconds: float = float("nan")
) -> TrialResult:
    """A trial without an estimate."""
    method, protocol, pose = task.methods[label], task.protocol, task.pose
    if trial in task.automatic and trial not in task.guesses:
        return without_guess(task, label, trial, message)
    guess = task.guess(trial)
    return TrialResult(
        run=task.run,
        method=label,
        method_version=method.version,
        parameters=parameters(method, task.contents.get(label)),
        lcdata_version=lcdata.__version__,
        pair_ids=task.pair_ids,
        scenario=pose.scenario,
        pose_id=pose.pose_id,
        trial=trial,
        seed=protocol.seed,
        group=protocol.group,
        init_rotation_deg=protocol.init_rotation_deg,
        init_translation_m=protocol.init_translation_m,
        T_camera_lidar_initial=guess.T_camera_lidar,
        initial_groundtruth_version=guess.groundtruth_version,
        groundtruth_version=pose.pose_version,
        seconds=seconds,
        features_seconds=seconds,
        message=message,
    ).against(pose)


def guess_of(result: TrialResult) -> FoundGuess:
    """The initial guess that a trial started from and that was found from its pairs."""
    if np.isnan(result.initial_rotation_error_deg):
        return FoundGuess(None, error=result.message)
    _, mark, why = result.message.partition(DOUBT)
    return FoundGuess(result.T_camera_lidar_initial, mark + why)


def without_guess(task: Task, label: str, trial: int, message: str) -> TrialResult:
    """A trial that could not start: its initial errors are unknown."""
    nowhere = Guess(np.eye(4), task.pose.pose_version)
    task = dataclasses.replace(task, guesses={**task.guesses, trial: nowhere})
    return dataclasses.replace(
        failure(task, label, trial, message),
        initial_rotation_error_deg=float("nan"),
        initial_translation_error_m=float("nan"),
    )


def _describe(error: Exception) -> str:
    """An error in one line: ours as they are, others with their type."""
    text = " ".join(str(error).split())
    if isinstance(error, LcdataError):
        return text
    return f"{type(error).__name__}: {text}" if text else type(error).__name__
