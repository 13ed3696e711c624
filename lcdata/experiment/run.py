"""Compute what is missing of an experiment, and say how far it has come."""

from __future__ import annotations

import random
import time
from collections import deque
from contextlib import closing, suppress
from dataclasses import dataclass
from pathlib import Path

from lcdata.errors import DatasetError
from lcdata.evaluation.execution import local_executor, outcomes
from lcdata.evaluation.pool import Executor
from lcdata.evaluation.results import Results, TrialResult
from lcdata.evaluation.task import Task
from lcdata.evaluation.trials import Progress
from lcdata.evaluation.worker import guess_of
from lcdata.experiment.checksums import Checksums
from lcdata.experiment.plan import Plan, counted
from lcdata.experiment.spec import Experiment
from lcdata.experiment.store import Store

SAVE_EVERY_S = 10.0
"""How much work a killed process may lose, and how late another one learns what is done."""


@dataclass(frozen=True)
class Status:
    """How far one method has come on one data set.

    Args:
        dataset: Name of the data set.
        method: Label of the method.
        trials: How many the experiment asks for.
        done: Of them in the store.
        failed: Of these without an estimate.
    """

    dataset: str
    method: str
    trials: int
    done: int
    failed: int


def run_experiment(
    experiment: Experiment,
    *,
    jobs: int | None = None,
    executor: Executor | None = None,
    retry_failed: bool = False,
    progress: Progress | None = None,
) -> dict[str, Results]:
    """Compute the trials that are not in the store, and return all of them.

    Any number of processes may run one experiment at a time, on one file system: each takes pairs
    in an order of its own, and leaves out what the others have stored meanwhile.

    Args:
        experiment: The experiment.
        jobs: Number of processes; None for one a processor, 0 for none (in this process).
        executor: Runs the tasks in place of local processes.
        retry_failed: Compute trials again that gave no estimate.
        progress: Called as trials finish.

    Returns:
        Results by the name of the data set.

    Raises:
        ExperimentError: A file that has changed, or a store that cannot be used.
        DatasetError: A data set that cannot be read, a full disk. What was stored is kept.
        CalibrationError: Processes that cannot be started.
    """
    store = Store.open(experiment.store)
    plan = Plan.of(experiment, Checksums.read(store.folder), store.guess)
    stored = store.keys()
    retried = {key for key, failed in stored.items() if failed and retry_failed}
    tasks = plan.left(stored.keys() - retried)
    if tasks:
        if executor is None:
            executor = local_executor(experiment.methods, jobs, len(tasks))
        _compute(plan, store, retried, executor, tasks, progress)
    return plan.results(store.read(plan.wanted))


def _compute(
    plan: Plan,
    store: Store,
    retried: set[str],
    executor: Executor,
    tasks: list[Task],
    progress: Progress | None,
) -> None:
    random.shuffle(tasks)
    queue = deque(tasks)
    total = len(plan.wanted)
    missing = plan.wanted - (store.keys().keys() - retried)
    fresh: dict[str, TrialResult] = {}
    written: list[Path] = []
    saved = time.monotonic()
    reserve = store.reserve()
    try:
        with closing(outcomes(executor, queue)) as results:
            for result in results:
                key = plan.key(result)
                fresh[key] = result
                if (guess := plan.guess_key(result)) is not None:
                    store.keep_guess(guess, guess_of(result))
                missing.discard(key)
                if time.monotonic() - saved > SAVE_EVERY_S:
                    written.append(store.write(fresh))
                    fresh, saved = {}, time.monotonic()
                    missing -= store.keys().keys() - retried
                    _leave_out(queue, plan, missing)
                if progress:
                    progress("experiment", total - len(missing), total)
    finally:  # Ctrl-C and a full disk too: what was computed is kept
        reserve.unlink(missing_ok=True)
        if fresh:
            written.append(store.write(fresh))
    with suppress(DatasetError):  # on a full disk they stay as they are
        store.merge(written)


def _leave_out(queue: deque[Task], plan: Plan, missing: set[str]) -> None:
    """Take from tasks that wait the work that another process has done."""
    waiting = {(task.run, task.pair_ids) for task in queue}
    left = plan.left(plan.wanted - missing)
    left = [task for task in left if (task.run, task.pair_ids) in waiting]
    random.shuffle(left)
    queue.clear()
    queue.extend(left)


def status(experiment: Experiment) -> list[Status]:
    """How far an experiment has come, by data set and method; computes nothing."""
    store = Store.open(experiment.store)
    plan = Plan.of(experiment, Checksums.read(store.folder))
    done = store.keys()
    rows = []
    for dataset in plan.datasets:
        for label in experiment.methods:
            mine = [t for t in plan.trials if (t.dataset, t.label) == (dataset, label)]
            rows.append(Status(dataset, label, *counted(mine, done)))
    return rows
