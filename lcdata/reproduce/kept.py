"""Rows of an experiment that are done, so that a run that was stopped goes on."""

from __future__ import annotations

import json
from collections import deque
from collections.abc import Callable, Container, Hashable, Iterator, Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any, Generic, Protocol, Self, TypeVar

from lcdata.errors import CalibrationError
from lcdata.evaluation.pool import Crash, default_jobs, run_here, run_in_processes
from lcdata.reproduce.experiment import Progress


class Keyed(Protocol):
    """A row, or a task, that says what it is of. Rows are dataclasses."""

    @property
    def key(self) -> Hashable:
        """Equal for a task and the row that comes of it."""


class Parted(Protocol):
    """A task of several rows, of which some may be done."""

    @property
    def keys(self) -> Sequence[Hashable]:
        """Those of its rows."""

    def only(self, keys: Container[Hashable]) -> Self:
        """The task without the parts of other rows."""


R = TypeVar("R", bound=Keyed)


class KeptRows(Generic[R]):
    """Rows by what they are of, one JSON line each.

    Args:
        path: File of lines; rows that are in it are done. None keeps none.
        parse: Makes a row of a line's content.
    """

    def __init__(self, path: Path | None, parse: Callable[[dict[str, Any]], R]) -> None:
        self.path = path
        self.rows: dict[Hashable, R] = {}
        if path is not None and path.exists():
            for line in path.read_text().splitlines():
                try:
                    row = parse(json.loads(line))
                except (ValueError, TypeError, KeyError):  # half a line of a killed process
                    continue
                self.rows[row.key] = row

    def add(self, row: R) -> None:
        """Keep a row, on the disk as well."""
        self.rows[row.key] = row
        if self.path is not None:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            with self.path.open("a") as file:
                file.write(json.dumps(asdict(row)) + "\n")  # type: ignore[call-overload]


def run_kept(
    name: str,
    tasks: Sequence[Keyed],
    kept: KeptRows[R],
    run: Callable[[Any], Iterator[R]],
    jobs: int | None,
    progress: Progress | None,
) -> list[R]:
    """Run the tasks that are not done.

    Args:
        name: Of the experiment, for the progress.
        tasks: All of them.
        kept: What is done; filled.
        run: Yields the rows of one task, the task's own among them; importable by name.
        jobs: Processes; None for one a core.
        progress: Called with the name, tasks done and tasks in all.

    Returns:
        The row of each task.

    Raises:
        CalibrationError: A process died.
    """
    waiting = deque(task for task in tasks if task.key not in kept.rows)
    return _run(name, waiting, [task.key for task in tasks], kept, run, jobs, progress)


def run_parts(
    name: str,
    tasks: Sequence[Parted],
    kept: KeptRows[R],
    run: Callable[[Any], Iterator[R]],
    jobs: int | None,
    progress: Progress | None,
) -> list[R]:
    """Run the parts of tasks that are not done; see `run_kept`.

    Args:
        name: Of the experiment, for the progress.
        tasks: All of them.
        kept: What is done; filled.
        run: Yields a row for each key of one task; importable by name.
        jobs: Processes; None for one a core.
        progress: Called with the name, rows done and rows in all.

    Returns:
        The rows of all tasks.

    Raises:
        CalibrationError: A process died.
    """
    wanted = [key for task in tasks for key in task.keys]
    missing = {key for key in wanted if key not in kept.rows}
    waiting = deque(t.only(missing) for t in tasks if not missing.isdisjoint(t.keys))
    return _run(name, waiting, wanted, kept, run, jobs, progress)


def _run(
    name: str,
    waiting: deque[Any],
    wanted: Sequence[Hashable],
    kept: KeptRows[R],
    run: Callable[[Any], Iterator[R]],
    jobs: int | None,
    progress: Progress | None,
) -> list[R]:
    jobs = default_jobs() if jobs is None else jobs
    executor = run_here if jobs == 1 else partial(run_in_processes, jobs=jobs)

    def report() -> None:
        if progress:
            progress(name, sum(key in kept.rows for key in wanted), len(wanted))

    report()
    for item in executor(run, waiting):
        if isinstance(item, Crash):
            raise CalibrationError(f"{item.task}: {item.reason}", "use fewer --jobs")
        kept.add(item)
        report()
    return [kept.rows[key] for key in wanted]
