"""What a worker does for one pair: load, prepare features, run every method from every guess."""

from __future__ import annotations

import dataclasses
import json
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import lcdata
from lcdata.calibrators.base import Calibration, Calibrator
from lcdata.errors import CalibrationError, LcdataError
from lcdata.evaluation.protocol import NoGuesses, Protocol
from lcdata.evaluation.results import Guess, TrialResult
from lcdata.geometry.se3 import check_transform

if TYPE_CHECKING:
    from lcdata.dataset.schema import PoseRecord
    from lcdata.pair import Pair

Work = tuple[tuple[str, int], ...]
"""Label of a method and number of a trial, one estimate each."""


NEEDS_GUESS = "needs an initial guess: start it from truth, auto, picks or matches"
"""What a method says that is run without one and cannot be."""


@dataclass(frozen=True)
class Task:
    """Work on one pair, or on several that are solved jointly.

    Args:
        dataset: Folder of the data set: workers read pairs themselves.
        run: Name of the run.
        protocol: Where initial guesses come from.
        pose: Ground truth of the pairs.
        pair_ids: Names of the pairs.
        methods: Methods by label.
        work: What to do with them.
        guesses: Initial guesses by number of the trial that other methods have started from, from
            which this work starts too; the protocol's where there is none.
    """

    dataset: Path
    run: str
    protocol: Protocol
    pose: PoseRecord
    pair_ids: tuple[str, ...]
    methods: dict[str, Calibrator]
    work: Work
    guesses: Mapping[int, Guess] = field(default_factory=dict)

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
class _Features:
    """What `prepare` made of some pairs, or the error that it raised."""

    prepared: list[Any]
    seconds: float
    error: str = ""


def run_task(task: Task) -> Iterator[Begin | TrialResult]:
    """Run one task: a `TrialResult` for each piece of its work, whatever happens.

    Features are prepared once for all trials, and once for all methods of the same front end.
    """
    import cv2

    from lcdata.dataset import Dataset

    cv2.setNumThreads(1)
    yield Begin("loading the pair", task.work)
    try:
        dataset = Dataset.open(task.dataset)
        pairs = [dataset.load(pair_id) for pair_id in task.pair_ids]
    except (LcdataError, OSError) as error:
        for label, trial in task.work:
            yield failure(task, label, trial, str(error))
        return
    shared: dict[str, _Features] = {}
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
            yield Begin("calibrating", ((label, trial),))
            yield _run_trial(task, label, trial, pairs, shared[key])


def front_end(method: Calibrator) -> str:
    """Methods with the same front end prepare the same features.

    They have `prepare` from the same class and the same values of that class's parameters
    (of all parameters, where that class is no dataclass).
    """
    owner = next(cls for cls in type(method).__mro__ if "prepare" in vars(cls))
    scope = owner if dataclasses.is_dataclass(owner) else method
    values = {f.name: getattr(method, f.name) for f in _fields(scope)}
    return f"{owner.__module__}.{owner.__qualname__} {values!r}"


def parameters(method: Calibrator) -> str:
    """Parameters of a method as JSON."""
    values = {f.name: getattr(method, f.name) for f in _fields(method)}
    return json.dumps(values, sort_keys=True, default=repr)


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
    guess = task.guess(trial)
    return TrialResult(
        run=task.run,
        method=label,
        method_version=method.version,
        parameters=parameters(method),
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


def _describe(error: Exception) -> str:
    """An error in one line: ours as they are, others with their type."""
    text = " ".join(str(error).split())
    if isinstance(error, LcdataError):
        return text
    return f"{type(error).__name__}: {text}" if text else type(error).__name__
