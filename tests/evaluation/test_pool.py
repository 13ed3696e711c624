from __future__ import annotations

import multiprocessing
import os
import signal
import time
from collections import deque
from collections.abc import Iterator
from contextlib import closing

from lcdata.evaluation.pool import Crash, default_jobs, run_here, run_in_processes


def countdown(task: int) -> Iterator[tuple[int, int]]:
    for left in range(task, 0, -1):
        yield task, left
        if task == 7 and left == 5:
            os.kill(os.getpid(), signal.SIGKILL)
        if task == 9:
            time.sleep(600)


def test_items_come_back_and_a_crash_says_how_far_the_task_was() -> None:
    tasks = deque([3, 7, 2])
    items, crashes = [], []
    for item in run_in_processes(countdown, tasks, 2):
        if isinstance(item, Crash):
            crashes.append(item)
            tasks.append(1)
        else:
            items.append(item)
    assert sorted(items) == [(1, 1), (2, 1), (2, 2), (3, 1), (3, 2), (3, 3), (7, 5), (7, 6), (7, 7)]
    assert [(c.task, c.last) for c in crashes] == [(7, (7, 5))]
    assert "SIGKILL" in crashes[0].reason and "memory" in crashes[0].reason
    assert list(run_here(countdown, deque([2, 1]))) == [(2, 2), (2, 1), (1, 1)]


def test_closing_ends_the_work_and_the_settings_are_as_before() -> None:
    environment, handler = dict(os.environ), signal.getsignal(signal.SIGINT)
    with closing(run_in_processes(countdown, deque([9, 9]), 2)) as items:
        assert next(items) == (9, 9)
        assert len(multiprocessing.active_children()) == 2
    assert not multiprocessing.active_children()
    assert dict(os.environ) == environment and signal.getsignal(signal.SIGINT) is handler


def test_default_is_one_process_a_processor() -> None:
    assert 1 <= default_jobs() <= (os.cpu_count() or 1)
