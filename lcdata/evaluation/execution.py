"""Tasks given to an executor, and what comes back: every piece of work has its result."""

from __future__ import annotations

import dataclasses
import pickle
from collections import deque
from collections.abc import Container, Generator, Iterable, Mapping
from contextlib import closing
from functools import partial

from lcdata.calibrators.base import Calibrator
from lcdata.errors import CalibrationError, ExperimentError
from lcdata.evaluation.pool import Crash, Executor, default_jobs, run_here, run_in_processes
from lcdata.evaluation.results import TrialResult
from lcdata.evaluation.task import Begin, Refusal, Task
from lcdata.evaluation.worker import failure, run_task

Key = tuple[str, tuple[str, ...], int]
"""Label of the method, pairs, number of the trial."""


def without(tasks: Iterable[Task], finished: Container[Key]) -> deque[Task]:
    """Tasks with the work that is left."""
    left: deque[Task] = deque()
    for task in tasks:
        work = tuple(
            (label, trial)
            for label, trial in task.work
            if (label, task.pair_ids, trial) not in finished
        )
        if work:
            left.append(dataclasses.replace(task, work=work))
    return left


def local_executor(calibrators: Mapping[str, Calibrator], jobs: int | None, tasks: int) -> Executor:
    """Executor with local processes, or in this process.

    Args:
        calibrators: What the processes must be able to run.
        jobs: Number of processes; None for one a processor, 0 for none.
        tasks: How many there are: no more processes than that.

    Raises:
        CalibrationError: A method cannot be sent to another process.
    """
    if jobs == 0:
        return run_here
    try:
        pickle.dumps(calibrators)
    except (pickle.PicklingError, AttributeError, TypeError) as error:
        raise CalibrationError(
            f"a method cannot be sent to another process ({error})",
            "define its class in a module, or use jobs=0",
        ) from error
    count = default_jobs() if jobs is None else max(1, jobs)
    return partial(run_in_processes, jobs=min(count, max(1, tasks)))


def outcomes(executor: Executor, tasks: deque[Task]) -> Generator[TrialResult, None, None]:
    """Results as they come; a crash fails what was being done, the rest is tried again.

    Raises:
        ExperimentError: Files are not those that a task is for.
    """
    if not tasks:
        return  # nobody is asked for anything
    finished: dict[str, set[Key]] = {}
    with closing(executor(run_task, tasks)) as items:
        for item in items:
            if isinstance(item, Refusal):
                raise ExperimentError(item.message, item.remedy)
            results: list[TrialResult] = []
            if isinstance(item, TrialResult):
                results = [item]
            elif isinstance(item, Crash):
                task, last = item.task, item.last
                lost, step = task.work, "starting"
                if isinstance(last, Begin):
                    lost, step = last.work, last.step
                elif last is not None:
                    lost = ()
                results = [
                    failure(task, label, trial, f"{item.reason} while {step}")
                    for label, trial in lost
                ]
            for result in results:
                finished.setdefault(result.run, set()).add(result.key)
                yield result
            if isinstance(item, Crash):
                tasks.extendleft(without([item.task], finished.get(item.task.run, ())))
