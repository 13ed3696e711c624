"""Run methods on a data set from perturbed initial guesses."""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING

from numpy.typing import ArrayLike

from lcdata.calibrators.base import Calibrator
from lcdata.errors import CalibrationError
from lcdata.evaluation.execution import Key, local_executor, outcomes, without
from lcdata.evaluation.given import having_guess, started_at, starts_there
from lcdata.evaluation.inputs import file_contents
from lcdata.evaluation.labels import by_label
from lcdata.evaluation.pool import Executor
from lcdata.evaluation.protocol import GivenGuesses, NoGuesses, Protocol
from lcdata.evaluation.results import (
    Guess,
    Results,
    TrialResult,
    read_results,
    results_path,
    write_run,
)
from lcdata.evaluation.task import Task
from lcdata.evaluation.worker import parameters

if TYPE_CHECKING:
    from lcdata.dataset import Dataset
    from lcdata.dataset.schema import PairRecord

Progress = Callable[[str, int, int], None]
"""Called with the name of the stage, the number of finished trials and of all trials."""

Contents = Mapping[str, Mapping[str, str]]
"""sha256 of files that methods' parameters name, by label and parameter."""

SAVE_EVERY_S = 20.0
"""How much work a killed process may lose."""


def run_trials(
    dataset: Dataset,
    methods: Sequence[str | Calibrator] | Mapping[str, Calibrator],
    *,
    init_rotation_deg: float = 5.0,
    init_translation_m: float = 0.5,
    initial: Mapping[str, ArrayLike] | None = None,
    source: str = "given",
    from_nothing: bool = False,
    trials: int = 1,
    seed: int = 0,
    group: str = "pair",
    pair_ids: Sequence[str] | None = None,
    jobs: int | None = None,
    executor: Executor | None = None,
    progress: Progress | None = None,
    run: str | None = None,
    force: bool = False,
) -> Results:
    """Run methods on the pairs of a data set and store the results in it.

    Trials that a former call with the same protocol has stored, of the same methods and
    parameters (and files that these name) and against the same ground truth, are not computed
    again. Those that failed are tried again; those of another version of a method or of the ground
    truth are replaced. So are those that were measured again (`update_results`) and whose initial
    errors then turned out more than a tenth off the protocol's; where they are not, other methods
    start from their guesses.

    Args:
        dataset: The data set.
        methods: Names of methods, or `Calibrator`s, or `Calibrator`s by label.
        init_rotation_deg: Initial error about each axis, degrees.
        init_translation_m: Initial error along each axis, metres.
        initial: 4x4 `T_camera_lidar` by pair_id to start from in place of the ground truth with
            an error; pairs without one are left out.
        source: Where they come from, which names the run: picks, matches, auto.
        from_nothing: Give no initial guesses at all: methods that need one fail and say so.
        trials: Initial guesses for each pair.
        seed: Seed of the random signs.
        group: "pair", or "pose": all pairs of an arm pose are solved jointly.
        pair_ids: Use these pairs only.
        jobs: Number of processes; None for one a processor, 0 for none (in this process).
        executor: Runs the tasks in place of local processes.
        progress: Called as trials finish.
        run: Name of the results file; by default named by the protocol.
        force: Compute again what is stored.

    Returns:
        All trials of these methods that the run has now, failed ones among them.

    Raises:
        CalibrationError: An unknown method, pair or option, or a run of another protocol.
    """
    protocol = Protocol(init_rotation_deg, init_translation_m, trials, seed, group)
    if from_nothing:
        if initial is not None:
            raise CalibrationError("initial guesses, and none", "give them, or from_nothing")
        protocol = NoGuesses(group=group)
    elif initial is not None:
        protocol = GivenGuesses(group=group, source=source)
        pair_ids = having_guess(pair_ids or [p.pair_id for p in dataset.pairs], initial)
    calibrators = by_label(methods)
    contents = {label: file_contents(method) for label, method in calibrators.items()}
    run = protocol.run if run is None else _check_name(run)
    results = _stored(dataset, run, protocol, calibrators, contents, force)
    planned = _plan(dataset, run, protocol, calibrators, contents, pair_ids, results.values())
    if initial is not None:
        planned = started_at(initial, planned)
        results = {key: t for key, t in results.items() if starts_there(t, planned)}
    tasks = without(planned, results)
    total = sum(len(task.work) for task in planned)
    done = total - sum(len(task.work) for task in tasks)
    if executor is None:
        executor = local_executor(calibrators, jobs, len(tasks))
    if progress:
        progress("calibrate", done, total)

    path = results_path(dataset, run)
    saved, count = time.monotonic(), len(results)
    try:
        with closing(outcomes(executor, tasks)) as found:
            for result in found:
                results[result.key] = result
                done += 1
                if progress:
                    progress("calibrate", done, total)
                if time.monotonic() - saved > SAVE_EVERY_S:
                    _write(path, results, calibrators)
                    saved, count = time.monotonic(), len(results)
    finally:  # Ctrl-C too: what was computed is kept
        if len(results) > count:
            _write(path, results, calibrators)
    return Results(tuple(t for t in _ordered(results, calibrators) if t.method in calibrators))


def _check_name(run: str) -> str:
    if not re.fullmatch(r"[\w+-][\w.+-]*", run):
        raise CalibrationError(
            f"{run!r} cannot name a run", "use letters, digits, dot, plus, minus, underscore"
        )
    return run


def _stored(
    dataset: Dataset,
    run: str,
    protocol: Protocol,
    calibrators: dict[str, Calibrator],
    contents: Contents,
    force: bool,
) -> dict[Key, TrialResult]:
    """Stored trials of the run that stay as they are."""
    versions = {pose.pose_id: pose.pose_version for pose in dataset.poses}
    kept = {}
    for t in read_results(dataset, run).trials:
        if not protocol.made(t):
            if force:
                continue
            raise CalibrationError(
                f"run {run!r} has trials from {t.init_rotation_deg:g} deg / "
                f"{t.init_translation_m:g} m, seed {t.seed}, by {t.group}",
                "name another run, or force to replace it",
            )
        if (method := calibrators.get(t.method)) is None:
            kept[t.key] = t
            continue
        wanted = method.version, parameters(method, contents[t.method])
        same_method = (t.method_version, t.parameters) == wanted
        if same_method and _holds(t, protocol, versions) and not (t.failed or force):
            kept[t.key] = t
    return kept


def _holds(trial: TrialResult, protocol: Protocol, versions: Mapping[str, str]) -> bool:
    """Whether a trial is against the present ground truth, and started as far off as it ought to.

    `update_results` leaves initial guesses where they were while the ground truth moves.
    """
    if trial.groundtruth_version != versions.get(trial.pose_id):
        return False
    errors = trial.initial_rotation_error_deg, trial.initial_translation_error_m
    return not trial.rebased or protocol.holds(*errors)


def _plan(
    dataset: Dataset,
    run: str,
    protocol: Protocol,
    calibrators: dict[str, Calibrator],
    contents: Contents,
    pair_ids: Sequence[str] | None,
    stored: Iterable[TrialResult],
) -> list[Task]:
    """One task a pair, or a pose; all methods of a run start from the same guesses."""
    versions = {pose.pose_id: pose.pose_version for pose in dataset.poses}
    guesses: dict[tuple[str, ...], dict[int, Guess]] = {}
    for trial in stored:
        if trial.rebased and _holds(trial, protocol, versions):
            guesses.setdefault(trial.pair_ids, {})[trial.trial] = trial.guess
    return [
        Task(
            dataset=Path(dataset.path).resolve(),
            run=run,
            protocol=protocol,
            pose=dataset.pose(pairs[0].pose_id),
            pair_ids=tuple(pair.pair_id for pair in pairs),
            methods=calibrators,
            work=tuple((label, n) for label in calibrators for n in range(protocol.trials)),
            guesses=guesses.get(tuple(pair.pair_id for pair in pairs), {}),
            contents=contents,
        )
        for pairs in grouped(dataset, protocol.group, pair_ids)
    ]


def grouped(
    dataset: Dataset, group: str, pair_ids: Sequence[str] | None = None
) -> list[list[PairRecord]]:
    """Pairs as they are solved: each alone, or all of a pose together.

    Args:
        dataset: The data set.
        group: "pair" or "pose".
        pair_ids: These pairs only.

    Raises:
        CalibrationError: An unknown pair.
    """
    wanted = None if pair_ids is None else set(pair_ids)
    chosen = [p for p in dataset.pairs if wanted is None or p.pair_id in wanted]
    if missing := sorted((wanted or set()) - {p.pair_id for p in chosen}):
        raise CalibrationError(f"no pair {missing[0]!r} in {dataset.path}", "see pairs.parquet")
    groups: dict[str, list[PairRecord]] = {}
    for pair in chosen:
        groups.setdefault(pair.pair_id if group == "pair" else pair.pose_id, []).append(pair)
    return list(groups.values())


def _ordered(
    results: Mapping[Key, TrialResult], calibrators: Mapping[str, Calibrator]
) -> list[TrialResult]:
    """Results in an order that does not depend on who finished first."""
    labels = [*calibrators, *sorted({t.method for t in results.values()} - set(calibrators))]
    rank = {label: i for i, label in enumerate(labels)}
    return sorted(
        results.values(), key=lambda t: (t.scenario, t.pose_id, t.pair_ids, rank[t.method], t.trial)
    )


def _write(
    path: Path, results: Mapping[Key, TrialResult], calibrators: Mapping[str, Calibrator]
) -> None:
    write_run(path, _ordered(results, calibrators))
