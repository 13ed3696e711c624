"""A process pool that survives its workers.

`concurrent.futures` gives up all its work when one process dies and does not say whose task it
was. Here a task is a generator that runs in a worker; each item it yields comes back at once,
and where a worker dies (a segmentation fault in a third party's method, the out-of-memory
killer) the caller gets a `Crash` that says how far the task had come. Others go on.

Another way to run tasks, on a cluster say, is a function with the signature of `Executor`.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections import deque
from collections.abc import Callable, Generator, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from typing import Any

from lcdata.errors import CalibrationError

THREAD_VARIABLES = (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "VECLIB_MAXIMUM_THREADS",
    "NUMBA_NUM_THREADS",
    "OPENCV_FOR_THREADS_NUM",
)
"""Libraries read these as they are imported: one thread a worker, or workers fight for cores."""


@dataclass(frozen=True)
class Crash:
    """A worker died in the midst of a task.

    Args:
        task: The task.
        last: The last item that the task yielded; None if there was none.
        reason: What is known, in words.
    """

    task: Any
    last: Any
    reason: str


Function = Callable[[Any], Iterator[Any]]
"""What a worker runs on a task; importable by name, and so is everything in a task."""

Executor = Callable[[Function, deque[Any]], Generator[Any, None, None]]
"""Runs a function on tasks and yields items and `Crash`es in the order in which they come.

The caller may append tasks while it iterates. Closing the generator ends the work at once.
"""


def default_jobs() -> int:
    """Number of processors that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def run_here(function: Function, tasks: deque[Any]) -> Generator[Any, None, None]:
    """An `Executor` in this process, for debugging and for methods that cannot be pickled."""
    while tasks:
        yield from function(tasks.popleft())


def run_in_processes(
    function: Function, tasks: deque[Any], jobs: int
) -> Generator[Any, None, None]:
    """An `Executor` with local processes.

    Processes are spawned, not forked: a fork copies the locks of numba's, OpenCV's and
    Arrow's threads in whatever state they are.

    Args:
        function: What to run on each task.
        tasks: Tasks; taken from the left.
        jobs: Number of processes, at least 1.

    Raises:
        CalibrationError: Processes cannot be started.
    """
    workers: list[_Worker] = []
    try:
        while tasks or any(worker.busy for worker in workers):
            for worker in workers:
                if tasks and not worker.busy:
                    worker.give(tasks.popleft())
            while tasks and len(workers) < jobs:
                workers.append(_Worker(function))
                workers[-1].give(tasks.popleft())
            connections = {w.connection: w for w in workers if w.busy}
            for connection in wait(list(connections)):
                worker = connections[connection]  # type: ignore[index]
                kind, item = worker.receive()
                if kind == "crash":
                    workers.remove(worker)
                if kind in ("item", "crash"):
                    yield item
    finally:
        for worker in workers:
            worker.connection.close()
        for worker in workers:
            worker.stop()


class _Worker:
    """One process and what it is doing."""

    def __init__(self, function: Function) -> None:
        context = multiprocessing.get_context("spawn")
        self.connection, child = context.Pipe()
        self.process = context.Process(target=_serve, args=(function, child), daemon=True)
        with child_settings():
            self.process.start()
        child.close()
        self.ready = self.busy = False
        self.task: Any = None
        self.last: Any = None

    def give(self, task: Any) -> None:
        self.task, self.last, self.busy = task, None, True
        try:
            self.connection.send(task)
        except OSError:  # it died while it waited; `receive` finds out and tells
            return

    def receive(self) -> tuple[str, Any]:
        """Next message: ready, item, done, or crash with a `Crash`.

        Raises:
            CalibrationError: The process died before it could take work.
        """
        try:
            kind, item = self.connection.recv()
        except (EOFError, OSError):
            self.stop(patience_s=5)
            reason = _explain(self.process.exitcode)
            if not self.ready:
                raise CalibrationError(
                    f"a worker process could not start ({reason})",
                    'put the call under `if __name__ == "__main__":`, or use jobs=0',
                ) from None
            return "crash", Crash(self.task, self.last, reason)
        if kind == "ready":
            self.ready = True
        elif kind == "item":
            self.last = item
        else:
            self.busy = False
        return kind, item

    def stop(self, patience_s: float = 0.2) -> None:
        """End the process; one that waits for work ends by itself as its connection closes."""
        self.connection.close()
        self.process.join(patience_s)
        self.process.terminate()
        self.process.join(5)
        if self.process.exitcode is None:
            self.process.kill()
            self.process.join()


def _serve(function: Function, connection: Connection) -> None:
    """What a worker does: take tasks until the other end closes."""
    threading.Thread(target=_end_with_parent, daemon=True).start()
    with suppress(EOFError, ConnectionError):  # nobody there any more: the work is over
        connection.send(("ready", None))
        while True:
            for item in function(connection.recv()):
                connection.send(("item", item))
            connection.send(("done", None))


def _end_with_parent() -> None:
    """End this process, whatever it is doing, when its parent is killed."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _explain(exitcode: int | None) -> str:
    """An exit code in words."""
    if exitcode is None or exitcode >= 0:
        return f"its process ended with exit code {exitcode}"
    try:
        name = signal.Signals(-exitcode).name
    except ValueError:
        name = f"signal {-exitcode}"
    hint = ", perhaps for want of memory" if name == "SIGKILL" else ""
    return f"its process was ended by {name}{hint}"


@contextmanager
def child_settings() -> Iterator[None]:
    """Environment and signals for a process that is about to be started.

    A child inherits an ignored SIGINT: Ctrl-C in a terminal reaches the whole process group,
    and the parent alone shall answer it.
    """
    before = {name: os.environ.get(name) for name in THREAD_VARIABLES}
    with ExitStack() as stack:
        for name, value in before.items():
            stack.callback(_set_environment, name, value)
            os.environ[name] = "1"
        handler = signal.getsignal(signal.SIGINT)
        if threading.current_thread() is threading.main_thread() and handler is not None:
            signal.signal(signal.SIGINT, signal.SIG_IGN)
            stack.callback(signal.signal, signal.SIGINT, handler)
        yield


def _set_environment(name: str, value: str | None) -> None:
    if value is None:
        os.environ.pop(name, None)
    else:
        os.environ[name] = value
