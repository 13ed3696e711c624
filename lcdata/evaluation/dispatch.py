"""Tasks given to the workers of a Dask cluster, so that no lost worker loses a trial.

Each worker gets one part of a task at a time, a few seconds of work, and goes on with the same
pair: its features are prepared once a worker. Parts are pinned to their worker. Where it is lost,
the rest of its task is done elsewhere, one step at a time from then on, so that a step that ends
its process is known; one that did so `DEATHS` times is given up. Nothing here waits without end.
"""

from __future__ import annotations

import dataclasses
import time
import uuid
from collections import Counter, deque
from collections.abc import Callable, Generator, Iterator
from contextlib import suppress
from dataclasses import dataclass
from queue import Empty, SimpleQueue
from typing import TYPE_CHECKING, Any

import lcdata
from lcdata.errors import CalibrationError, LcdataError
from lcdata.evaluation.pool import Crash
from lcdata.evaluation.results import TrialResult
from lcdata.evaluation.slices import Slice, perform, probe_for
from lcdata.evaluation.task import Begin, Task

if TYPE_CHECKING:
    from distributed import Client

DEATHS = 3
"""How many workers a step may cost before its trials are recorded as failed."""

SLICE_S = 2.0
"""How long a worker works before it hands in what it has: what its loss may cost."""

POLL_S = 0.25
"""How often to look which workers there are."""

ANSWER_S = 10.0
"""How long the scheduler may be silent."""

GATHER_S = 20.0
"""How long what a part has given may take from its worker."""

WORKERS_S = 60.0
"""How long to wait for a worker where there is none."""

STRAY_S = 10.0
"""After what time the scheduler is asked whether it still knows a part that has not come back."""

Note = Callable[[str], object]


@dataclass(eq=False)
class Part:
    """A task, or what is left of it, on its way.

    Args:
        task: With the work that is left.
        careful: One step at a time: it, or a neighbour of it, has cost a worker.
        step: What is being done, where that is known.
        worker: Address of the worker that has it.
        future: Dask's handle of it.
        since: When it was given, or last asked for, monotonic seconds.
        missed: Whether the scheduler did not know it then.
    """

    task: Task
    careful: bool = False
    step: Begin | None = None
    worker: str = ""
    future: Any = None
    since: float = 0.0
    missed: bool = False


class Dispatcher:
    """One run of tasks on a cluster.

    Args:
        client: Connected to the cluster.
        function: `worker.run_task`.
        tasks: Taken from the left as workers are free; the caller may change them meanwhile.
        note: Called with what a user should know.
    """

    def __init__(
        self, client: Client, function: Any, tasks: deque[Any], note: Note = lambda _: None
    ) -> None:
        self.client, self.function, self.tasks, self.note = client, function, tasks, note
        self.owner = uuid.uuid4().hex
        self.again: deque[Part] = deque()
        self.flying: dict[str, Part] = {}
        self.landed: SimpleQueue[Part] = SimpleQueue()
        self.usable: set[str] = set()
        self.refused: set[str] = set()
        self.probes: dict[str, Any] = {}
        self.deaths: Counter[tuple[str, tuple[str, ...], str, int]] = Counter()
        self.started = self.heard = self.staffed = time.monotonic()
        self.begun = False

    def run(self) -> Generator[Any, None, None]:
        """Items of the function, and `Crash`es of steps that were given up.

        Raises:
            CalibrationError: The scheduler is gone, there are no workers for a while, or the first
                ones are of another version.
        """
        looked = -POLL_S
        try:
            while self.tasks or self.again or self.flying:
                if time.monotonic() - looked >= POLL_S:
                    yield from self._look()
                    looked = time.monotonic()
                self._give()
                with suppress(Empty):
                    yield from self._take(self.landed.get(timeout=POLL_S))
        finally:
            for part in self.flying.values():
                part.future.release()
            for future in self.probes.values():
                future.release()

    def _look(self) -> Iterator[Any]:
        """See which workers there are; what those had that are gone is to be done again."""
        try:
            there = set(self._ask(self.client.scheduler.ncores))
        except (OSError, TimeoutError, RuntimeError) as error:
            if time.monotonic() - self.heard > ANSWER_S:
                raise CalibrationError(
                    "the Dask scheduler is gone", "the same command goes on from what is stored"
                ) from error
            return
        self.heard = time.monotonic()
        for address in list(self.probes):
            if address not in there:
                self.probes.pop(address).release()
        self._hear(there)
        self.usable &= there
        self.refused &= there
        for address in there - self.usable - self.refused - self.probes.keys():
            self._probe(address)
        if self.usable:
            self.staffed = time.monotonic()
        elif time.monotonic() - self.staffed > WORKERS_S:
            raise CalibrationError(
                "the Dask scheduler has no workers that can be used",
                "start some (`dask worker`); the same command goes on from what is stored",
            )
        for address in [address for address in self.flying if address not in there]:
            yield from self._bury(self.flying.pop(address))
        yield from self._find_strays()

    def _ask(self, question: Any) -> Any:
        return self.client.sync(question, callback_timeout=ANSWER_S)

    def _probe(self, address: str) -> None:
        """Ask a worker whether it would compute the same as this process."""
        methods = {
            label: (type(method).__module__, type(method).__qualname__, method.version)
            for task in [*self.tasks, *(part.task for part in self.again)][:1]
            for label, method in task.methods.items()
        }
        self.probes[address] = self.client.submit(
            probe_for(lcdata.__version__, methods),
            key=f"lcdata-probe-{uuid.uuid4().hex}",
            workers=[address],
            pure=False,
        )

    def _hear(self, there: set[str]) -> None:
        """What the workers that were asked have answered."""
        for address, future in list(self.probes.items()):
            if not future.done():
                continue
            del self.probes[address]
            try:
                wrong = future.result(timeout=GATHER_S)
            except Exception as error:
                if address not in there or future.status in {"cancelled", "lost"}:
                    continue
                wrong = f"no way to say which lcdata it has ({type(error).__name__}: {error})"
            if not wrong:
                self.usable.add(address)
                continue
            self.refused.add(address)
            text = f"worker {address} has {wrong}, this is lcdata {lcdata.__version__}"
            if not self.begun:
                raise CalibrationError(text, "install the same version on all workers")
            self.note(f"{text}: it is left out")

    def _give(self) -> None:
        """Give work to the workers that have none."""
        if self.probes and not self.begun and time.monotonic() - self.started < ANSWER_S:
            return  # of the first ones all are heard, lest the wrong one be found too late
        for address in sorted(self.usable - self.flying.keys()):
            if self.again:
                part = self.again.popleft()
            elif self.tasks:
                part = Part(self.tasks.popleft())
            else:
                return
            self._send(part, address)

    def _send(self, part: Part, address: str) -> None:
        self.begun = True
        order = Slice(self.owner, part.task, SLICE_S, part.careful, lcdata.__version__)
        part.worker, part.since = address, time.monotonic()
        part.future = self.client.submit(
            perform,
            self.function,
            order,
            key=f"lcdata-{uuid.uuid4().hex}",
            workers=[address],
            pure=False,
        )
        self.flying[address] = part
        part.future.add_done_callback(lambda _: self.landed.put(part))

    def _take(self, part: Part) -> Iterator[Any]:
        """What a part has given; its worker goes on with the rest."""
        if self.flying.get(part.worker) is not part:
            return  # buried meanwhile
        del self.flying[part.worker]
        items = self._items(part)
        if items is None:
            yield from self._bury(part)
            return
        yield from items
        done = {(item.method, item.trial) for item in items if isinstance(item, TrialResult)}
        left = tuple(piece for piece in part.task.work if piece not in done)
        last = items[-1] if items else None
        if not left:
            return
        if not done and not isinstance(last, Begin):
            raise CalibrationError(f"worker {part.worker} gave nothing for its task")
        step = last if part.careful and isinstance(last, Begin) else None
        rest = Part(dataclasses.replace(part.task, work=left), part.careful, step)
        if not part.careful and self._shared(items, left):
            half = len(left) // 2
            self.again.append(Part(dataclasses.replace(part.task, work=left[half:])))
            rest = Part(dataclasses.replace(part.task, work=left[:half]))
        if part.worker in self.usable:
            self._send(rest, part.worker)
        else:
            self.again.appendleft(rest)

    def _shared(self, items: list[Any], left: tuple[tuple[str, int], ...]) -> bool:
        """Whether an idle worker should do half of what is left: more than its features cost."""
        idle = self.usable - self.flying.keys()
        if self.tasks or self.again or len(idle) < 2 or len(left) < 2:  # one has just handed in
            return False
        results = [item for item in items if isinstance(item, TrialResult)]
        seconds = sum(t.seconds - t.features_seconds for t in results) / max(1, len(results))
        features = max((t.features_seconds for t in results), default=0.0)
        return seconds * len(left) / 2 > features

    def _items(self, part: Part) -> list[Any] | None:
        """What a part has given; None where it is lost.

        Raises:
            CalibrationError: The worker cannot run it.
        """
        from distributed.scheduler import KilledWorker

        try:
            return list(part.future.result(timeout=GATHER_S))
        except KilledWorker:  # it came back under the same address, again and again
            if part.step is not None:
                for piece in part.step.work:
                    self.deaths[self._name(part.task, piece)] = DEATHS
            return None
        except LcdataError:
            raise
        except Exception as error:
            if part.future.status in {"error"}:
                raise CalibrationError(
                    f"worker {part.worker} cannot run a task ({type(error).__name__}: {error})",
                    "install lcdata and the methods' packages on all workers",
                ) from error
            return None  # gone with its worker

    def _bury(self, part: Part) -> Iterator[Crash]:
        """Do the work of a lost worker again, without what has cost too many."""
        part.future.release()
        blamed = part.task.work if part.step is None else part.step.work
        blamed = tuple(piece for piece in blamed if piece in part.task.work)
        for piece in blamed:
            self.deaths[self._name(part.task, piece)] += 1
        given_up = tuple(p for p in blamed if self.deaths[self._name(part.task, p)] >= DEATHS)
        left = tuple(piece for piece in part.task.work if piece not in given_up)
        if left:
            task = dataclasses.replace(part.task, work=left)
            careful = not given_up
            step = Begin("loading the pair", left) if careful else None
            self.again.append(Part(task, careful, step))
        if given_up:
            doing = part.step.step if part.step else "working"
            yield Crash(
                dataclasses.replace(part.task, work=given_up),
                Begin(doing, given_up),
                f"it ended {DEATHS} workers, the last was {part.worker},",
            )

    def _name(self, task: Task, piece: tuple[str, int]) -> tuple[str, tuple[str, ...], str, int]:
        return task.run, task.pair_ids, *piece

    def _find_strays(self) -> Iterator[Crash]:
        """Parts that the scheduler does not know any more are lost, though their worker is not."""
        now = time.monotonic()
        due = [part for part in self.flying.values() if now - part.since > STRAY_S]
        if not due:
            return
        try:
            known = self._ask(self.client.scheduler.processing)
        except (OSError, TimeoutError, RuntimeError):
            return  # `_look` finds out what is wrong
        for part in due:
            part.since = now
            there = part.future.key in {str(key) for key in known.get(part.worker, ())}
            if there or part.future.done():
                part.missed = False
            elif part.missed:
                del self.flying[part.worker]
                yield from self._bury(part)
            else:  # it may be on its way
                part.missed = True
