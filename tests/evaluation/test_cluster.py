"""Trials on Dask, with worker processes that are killed, that lie and that do not answer."""

from __future__ import annotations

import dataclasses
import os
import signal
import socket
import threading
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import toy_dataset
from toy_methods import Blobs, Habit, Slow

import lcdata
from lcdata.dataset import Dataset
from lcdata.errors import CalibrationError
from lcdata.evaluation import dispatch, run_trials
from lcdata.evaluation.cluster import cluster_executor
from lcdata.evaluation.protocol import Protocol
from lcdata.evaluation.results import TrialResult
from lcdata.evaluation.slices import Slice, perform, probe_for
from lcdata.evaluation.task import Begin, Task
from lcdata.evaluation.trials import _plan
from lcdata.evaluation.worker import run_task

distributed = pytest.importorskip("distributed", reason="the extra dask is not installed")


@pytest.fixture(autouse=True)
def limit() -> Iterator[None]:
    """No test here may hang: each has so many seconds, on a machine however busy."""

    def stop(*_: object) -> None:
        raise TimeoutError("the test hangs")

    before = signal.signal(signal.SIGALRM, stop)
    signal.alarm(240)
    yield
    signal.alarm(0)
    signal.signal(signal.SIGALRM, before)


@pytest.fixture(scope="module")
def cluster() -> Iterator[Any]:
    """Two workers of this machine, which come back when they die."""
    import dask

    places = os.pathsep.join([str(Path(__file__).parent), os.environ.get("PYTHONPATH", "")])
    with dask.config.set({"distributed.deploy.lost-worker-timeout": "600s"}):
        made = distributed.LocalCluster(
            n_workers=2,
            threads_per_worker=1,
            dashboard_address=":0",
            silence_logs=50,
            env={"PYTHONPATH": places},
        )
        yield made
        made.close(timeout=20)


@pytest.fixture
def client(cluster: Any) -> Iterator[Any]:
    with distributed.Client(cluster, set_as_default=False) as connected:
        connected.wait_for_workers(2, timeout=120)
        yield connected


def task(dataset: Dataset, method: Any, trials: int) -> Task:
    made = _plan(dataset, "run", Protocol(trials=trials), {"it": method}, {}, None, ())
    return made[0]


def test_a_task_in_slices_prepares_its_pair_once(dataset: Dataset) -> None:
    Blobs.prepared.clear()
    whole = task(dataset, Slow(seconds=0.03), 9)
    left, found, slices = whole.work, [], 0
    while left:
        part = Slice("me", _with(whole, left), 0.05, False, lcdata.__version__)
        found += [item for item in perform(run_task, part) if isinstance(item, TrialResult)]
        left = tuple(p for p in whole.work if p not in {(t.method, t.trial) for t in found})
        slices += 1
    assert 3 <= slices <= 9 and len(found) == 9
    assert Blobs.prepared == [whole.pair_ids[0]]
    assert [t.T_camera_lidar_initial.tolist() for t in found] == [
        t.T_camera_lidar_initial.tolist() for t in run_task(whole) if isinstance(t, TrialResult)
    ]


def test_a_careful_slice_says_what_comes_next(dataset: Dataset) -> None:
    whole = task(dataset, Blobs(), 2)
    steps, left = [], whole.work
    while left:
        items = perform(run_task, Slice("I", _with(whole, left), 9.0, True, lcdata.__version__))
        steps.append([i.step if isinstance(i, Begin) else i.trial for i in items])
        done = {(i.method, i.trial) for i in items if isinstance(i, TrialResult)}
        left = tuple(piece for piece in left if piece not in done)
    assert steps == [
        ["loading the pair", "preparing features"],
        ["preparing features", "calibrating"],
        ["calibrating", 0, "calibrating"],
        ["calibrating", 1],
    ]


def _with(whole: Task, work: Any) -> Task:
    return dataclasses.replace(whole, work=work)


def test_another_version_does_no_work(dataset: Dataset) -> None:
    with pytest.raises(CalibrationError, match=r"client 0\.0\.0"):
        perform(run_task, Slice("I", task(dataset, Blobs(), 1), 1.0, False, "0.0.0"))
    assert probe_for("0.0.0", {})() == f"lcdata {lcdata.__version__}"
    here = ("toy_methods", "Blobs", 1)
    assert probe_for(lcdata.__version__, {"b": here})() == ""
    assert probe_for(lcdata.__version__, {"b": (*here[:2], 2)})() == "version 1 of method 'b'"
    assert "no method 'b'" in probe_for(lcdata.__version__, {"b": ("nowhere", "B", 1)})()


@pytest.mark.parametrize("address", ["remote", "local:0", "localhost", "tcp://"])
def test_what_is_no_scheduler(address: str) -> None:
    with pytest.raises(CalibrationError, match="write tcp://HOST:PORT"):
        cluster_executor(address)


@pytest.mark.parametrize("kind", ["nobody", "silent"])
def test_a_scheduler_that_does_not_answer(
    kind: str, dataset: Dataset, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(dispatch, "ANSWER_S", 1.0)
    with socket.socket() as listening:
        listening.bind(("127.0.0.1", 0))
        if kind == "silent":
            listening.listen()
        address = f"tcp://127.0.0.1:{listening.getsockname()[1]}"
        start = time.monotonic()
        with pytest.raises(CalibrationError, match=f"no Dask scheduler answers at {address}"):
            run_trials(dataset, [Blobs()], executor=cluster_executor(address))
        assert time.monotonic() - start < 10


@pytest.mark.slow
def test_as_without_a_cluster_and_features_once_a_pair_and_worker(
    client: Any, dataset: Dataset, tmp_path: Path
) -> None:
    methods = {"blobs": Blobs(), "slow": Slow(seconds=0.02)}
    address = client.scheduler.address
    found = run_trials(dataset, methods, trials=4, executor=cluster_executor(address), run="there")
    expected = run_trials(dataset, methods, trials=4, jobs=0, run="here")
    assert len(found.trials) == len(expected.trials) == 64
    for got, want in zip(found.trials, expected.trials, strict=True):
        assert got.key == want.key and not got.failed
        assert got.translation_error_m == pytest.approx(want.translation_error_m, abs=1e-9)
    for names in client.run(_prepared).values():
        assert names and set(Counter(names).values()) == {1}
    no_address = cluster_executor("tcp://127.0.0.1:9")  # nothing is left: nobody is asked
    run_trials(dataset, methods, trials=4, executor=no_address, run="there")


@pytest.mark.slow
def test_a_worker_that_is_killed_loses_nothing(client: Any, dataset: Dataset) -> None:
    processes = client.run(os.getpid)
    executor = cluster_executor(client.scheduler.address)
    killed = []

    def progress(stage: str, done: int, total: int) -> None:
        if done >= 10 and not killed:
            killed.append(processes.popitem()[1])
            os.kill(killed[0], signal.SIGKILL)

    found = run_trials(dataset, [Slow(seconds=0.3)], trials=5, executor=executor, progress=progress)
    assert killed and len({t.key for t in found.trials}) == 40
    assert not [t.message for t in found.trials if t.failed]


@pytest.mark.slow
def test_a_trial_that_ends_three_workers_fails_alone(client: Any, tmp_path: Path) -> None:
    dataset = toy_dataset.make(tmp_path / "one", ("hall",), 1, 2)
    executor = cluster_executor(client.scheduler.address)
    methods = {"blobs": Blobs(), "deadly": Habit(habit="exit")}
    found = run_trials(dataset, methods, executor=executor)
    (failed,) = [t for t in found.trials if t.failed]
    assert failed.key == ("deadly", ("hall/pose_000/001",), 0) and len(found.trials) == 4
    assert "it ended 3 workers, the last was tcp://" in failed.message
    assert failed.message.endswith("while calibrating")


@pytest.mark.slow
def test_workers_of_another_version_are_refused_by_name(client: Any, dataset: Dataset) -> None:
    address = sorted(client.nthreads())[0]
    client.run(_pretend, "0.0.0", workers=[address])
    try:
        with pytest.raises(CalibrationError, match=rf"worker {address} has lcdata 0\.0\.0"):
            run_trials(dataset, [Blobs()], executor=cluster_executor(client.scheduler.address))
    finally:
        client.run(_pretend, lcdata.__version__)


@pytest.mark.slow
def test_no_workers_and_no_scheduler_any_more(
    cluster: Any, dataset: Dataset, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(dispatch, "WORKERS_S", 1.0)
    monkeypatch.setattr(dispatch, "ANSWER_S", 2.0)
    with distributed.LocalCluster(n_workers=0, dashboard_address=":0", silence_logs=50) as empty:
        executor = cluster_executor(empty.scheduler_address)
        with pytest.raises(CalibrationError, match="no workers that can be used"):
            run_trials(dataset, [Blobs()], executor=executor)
    closing: list[threading.Thread] = []

    def progress(stage: str, done: int, total: int) -> None:
        if done >= 4 and not closing:
            closing.append(threading.Thread(target=cluster.close, args=(20,)))
            closing[0].start()

    monkeypatch.setattr(dispatch, "ANSWER_S", 10.0)
    executor = cluster_executor(cluster.scheduler_address)
    method = Slow(seconds=0.5)
    with pytest.raises(CalibrationError, match="the same command goes on"):
        run_trials(dataset, [method], trials=5, executor=executor, progress=progress)
    closing[0].join(60)
    rest = run_trials(dataset, {"slow": Slow(seconds=0.5)}, trials=5, jobs=0, progress=progress)
    assert len(rest.trials) == 40


def _prepared() -> list[str]:
    return Blobs.prepared


def _pretend(version: str) -> None:
    lcdata.__version__ = version
