"""Trials on Dask: on a cluster that runs, or on one of this machine that is made for them."""

from __future__ import annotations

import logging
import re
import threading
from collections import deque
from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager, suppress
from queue import Empty, SimpleQueue
from typing import TYPE_CHECKING, Any

from lcdata.errors import CalibrationError, MissingLibraryError
from lcdata.evaluation import dispatch
from lcdata.evaluation.pool import THREAD_VARIABLES, Executor, child_settings, default_jobs

if TYPE_CHECKING:
    from distributed import Client

ADDRESS = re.compile(r"([\w+-]+://)?[^\s/:]+:\d+|[\w+-]+://[^\s:]\S*")
"""HOST:PORT, with or without a protocol, or whatever another protocol of Dask's takes."""

GRACE_S = 1.0
"""What a connection may take beyond its own limit."""

CLOSE_S = 10.0
"""How long to wait for a connection, or a cluster of this machine, to close."""


RESTART_S = 600.0
"""How long a worker of this machine that died may take to come back."""


def cluster_executor(
    scheduler: str, jobs: int | None = None, note: Callable[[str], object] = lambda _: None
) -> Executor:
    """An `Executor` on Dask, which connects once there is something to run.

    Args:
        scheduler: `tcp://HOST:PORT` of a scheduler that runs, or `local` or `local:N` for a cluster
            of this machine with N workers while it is used.
        jobs: Number of workers of `local`; None for one a processor.
        note: Called with what a user should know.

    Raises:
        CalibrationError: No such kind of scheduler.
    """
    own = re.fullmatch(r"local(?::([1-9]\d*))?", scheduler)
    address = ADDRESS.fullmatch(scheduler) and not scheduler.startswith("local:")
    if not (own or address):
        raise CalibrationError(
            f"no scheduler {scheduler!r}", "write tcp://HOST:PORT, or local, or local:N"
        )
    count = int(own[1]) if own and own[1] else jobs or default_jobs()

    def run(function: Any, tasks: deque[Any]) -> Generator[Any, None, None]:
        with _quiet(), _own_cluster(count) if own else _connected(scheduler) as client:
            yield from dispatch.Dispatcher(client, function, tasks, note).run()

    return run


@contextmanager
def _connected(address: str) -> Iterator[Client]:
    """Connected to a scheduler that runs.

    Raises:
        CalibrationError: It does not answer.
        MissingLibraryError: Dask is not installed.
    """
    distributed = _distributed()
    answer: SimpleQueue[Any] = SimpleQueue()

    def connect() -> None:
        try:
            answer.put(distributed.Client(address, timeout=dispatch.ANSWER_S, set_as_default=False))
        except Exception as error:  # told below
            answer.put(error)

    # Dask's own limit does not hold where something listens that says nothing.
    threading.Thread(target=connect, daemon=True).start()
    try:
        client = answer.get(timeout=dispatch.ANSWER_S + GRACE_S)
    except Empty:
        client = TimeoutError("no answer")
    if isinstance(client, Exception):
        raise CalibrationError(
            f"no Dask scheduler answers at {address}",
            "check the address that `dask scheduler` printed, or use --scheduler local",
        ) from client
    try:
        yield client
    finally:
        _close(client)


@contextmanager
def _own_cluster(count: int) -> Iterator[Client]:
    """A cluster of this machine with so many processes.

    Raises:
        MissingLibraryError: Dask is not installed.
    """
    distributed = _distributed()
    import dask

    # By default a worker that died and is not back after 15 s, as on a busy machine, is let go.
    with dask.config.set({"distributed.deploy.lost-worker-timeout": f"{RESTART_S:.0f}s"}):
        with child_settings():  # Ctrl-C is for this process alone
            cluster = distributed.LocalCluster(
                n_workers=count,
                threads_per_worker=1,
                dashboard_address=":0",
                silence_logs=logging.CRITICAL,
                env=dict.fromkeys(THREAD_VARIABLES, "1"),
            )
        try:
            client = distributed.Client(cluster, timeout=dispatch.ANSWER_S, set_as_default=False)
            try:
                yield client
            finally:
                _close(client)
        finally:
            with suppress(Exception):  # the work is over: what still runs ends with this process
                cluster.close(timeout=CLOSE_S)


def _close(client: Client) -> None:
    with suppress(Exception):  # its scheduler may be gone
        client.close(timeout=CLOSE_S)


def _distributed() -> Any:
    try:
        import distributed
    except ImportError as error:
        raise MissingLibraryError(
            "Dask is not installed", "pip install 'lcdata[dask]', or run without --scheduler"
        ) from error
    return distributed


@contextmanager
def _quiet() -> Iterator[None]:
    """Dask's own words on lost connections are not for a user: errors here say what matters."""
    loggers = [logging.getLogger(name) for name in ("distributed", "tornado", "asyncio")]
    before = [logger.level for logger in loggers]
    for logger in loggers:
        logger.setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        for logger, level in zip(loggers, before, strict=True):
            logger.setLevel(level)
