"""What a Dask worker does: a part of a task at a time, with what it needs kept between parts."""

from __future__ import annotations

import time
from collections import OrderedDict
from collections.abc import Callable, Generator, Iterator, Mapping
from contextlib import closing
from dataclasses import dataclass
from typing import Any, cast

import lcdata
from lcdata.errors import CalibrationError
from lcdata.evaluation.task import Begin, Task
from lcdata.evaluation.worker import Kept

MOST_KEPT = 2
"""Experiments whose pair a worker keeps at a time: more may share a cluster, at some cost."""

Function = Callable[[Task, Kept], Iterator[Any]]

_kept: OrderedDict[str, Kept] = OrderedDict()


@dataclass(frozen=True)
class Slice:
    """A part of a task.

    Args:
        owner: Whose task it is: no two runs have the same.
        task: The task with the work that is left of it.
        seconds: How long to work; the trial that is under way then is finished.
        careful: Do one step, and say what the next one is: it may end the process.
        version: lcdata of the client.
    """

    owner: str
    task: Task
    seconds: float
    careful: bool
    version: str


def perform(function: Function, part: Slice) -> list[Any]:
    """Work on a task for a while.

    Args:
        function: `worker.run_task`.
        part: What to do.

    Returns:
        Items as `function` yields them. In a careful slice the last one is a `Begin` unless the
        task is finished: what comes next.

    Raises:
        CalibrationError: This process has another lcdata than the client.
    """
    if lcdata.__version__ != part.version:
        raise CalibrationError(
            f"a worker has lcdata {lcdata.__version__}, its client {part.version}",
            "install the same version on all workers",
        )
    _one_thread()
    kept = _kept.setdefault(part.owner, Kept())
    _kept.move_to_end(part.owner)
    while len(_kept) > MOST_KEPT:
        _kept.popitem(last=False)
    end = time.monotonic() + part.seconds
    items: list[Any] = []
    begun = 0
    with closing(cast("Generator[Any, None, None]", function(part.task, kept))) as found:
        for item in found:
            items.append(item)
            if isinstance(item, Begin):
                begun += 1
                if part.careful and begun == 2:
                    break
            elif time.monotonic() > end:
                break
    return items


def _one_thread() -> None:
    """One thread a worker, whatever started it: workers are as many as there are cores."""
    import numba

    numba.set_num_threads(1)


def probe_for(version: str, methods: Mapping[str, tuple[str, str, int]]) -> Callable[[], str]:
    """A function that says what is wrong with the process that it runs in.

    It is sent as code and needs nothing there, so that a worker without lcdata, or with one that
    knows nothing of this module, can be named.

    Args:
        version: lcdata of the client.
        methods: Module, class and version of each method, by label.

    Returns:
        Its result is empty where all is as it is here, else in words: "lcdata 0.0.9".
    """
    wanted = dict(methods)

    def probe() -> str:
        import importlib

        try:
            found = importlib.import_module("lcdata")
        except Exception as error:
            return f"no lcdata that can be imported ({type(error).__name__}: {error})"
        if getattr(found, "__version__", None) != version:
            return f"lcdata {getattr(found, '__version__', 'of an unknown version')}"
        for label, (module, name, number) in wanted.items():
            try:
                cls = getattr(importlib.import_module(module), name)
            except Exception as error:
                return f"no method {label!r} ({type(error).__name__}: {error})"
            if cls.version != number:
                return f"version {cls.version} of method {label!r}"
        return ""

    return probe
