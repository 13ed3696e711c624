from __future__ import annotations

import signal
import subprocess
import sys
import textwrap
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import toy_dataset
from toy_methods import Biased, Blobs, Habit, Threads

from lcdata.calibrators import registry
from lcdata.dataset import Dataset
from lcdata.errors import CalibrationError
from lcdata.evaluation import Results, read_results, run_trials
from lcdata.evaluation.results import results_path
from lcdata.evaluation.worker import front_end


def comparable(results: Results) -> list[Any]:
    """What must be equal: all but times, to the last digits that a file keeps."""
    transforms = [(t.T_camera_lidar_initial, t.T_camera_lidar_estimated) for t in results.trials]
    return [
        (t.key, np.round(pair, 12).tolist())
        for t, pair in zip(results.trials, transforms, strict=True)
    ]


def test_results_do_not_depend_on_processes_or_order(tmp_path: Path) -> None:
    alone = toy_dataset.make(tmp_path / "alone")
    together = toy_dataset.make(tmp_path / "together")
    here = run_trials(alone, [Blobs(), Biased()], trials=3, jobs=0)
    first = run_trials(together, [Biased()], trials=1, pair_ids=[alone.pairs[5].pair_id], jobs=0)
    calls: list[tuple[str, int, int]] = []
    there = run_trials(
        together,
        [Blobs(), Biased()],
        trials=3,
        jobs=2,
        progress=lambda *call: calls.append(call),
    )
    assert comparable(here) == comparable(there)
    assert comparable(first)[0] in comparable(there)
    assert calls[0] == ("calibrate", 1, 48) and calls[-1] == ("calibrate", 48, 48)
    assert len(calls) == 48
    assert all(t.success for t in there.trials if t.method == "blobs")


def test_features_are_prepared_once_a_pair_for_all_trials_and_methods(dataset: Dataset) -> None:
    Blobs.prepared.clear()
    run_trials(dataset, [Blobs(), Biased()], trials=3, jobs=0)
    assert sorted(Blobs.prepared) == [p.pair_id for p in dataset.pairs]
    assert front_end(Blobs()) == front_end(Biased(bias_m=3))
    assert front_end(Blobs()) != front_end(Biased(smallest=3))
    assert front_end(Blobs()) != front_end(Habit())


def test_what_is_stored_is_not_computed_again(dataset: Dataset) -> None:
    run_trials(dataset, [Blobs()], jobs=0)
    Blobs.prepared.clear()
    path = results_path(dataset, "5deg-0.5m-seed0")
    stamp = path.stat().st_mtime_ns
    run_trials(dataset, [Blobs()], jobs=0)
    assert not Blobs.prepared and path.stat().st_mtime_ns == stamp
    more = run_trials(dataset, [Blobs(), Biased()], trials=2, jobs=0)
    assert len(more.trials) == 8 * 2 * 2
    assert len(run_trials(dataset, [Blobs()], jobs=0).trials) == 8 * 2
    assert len(read_results(dataset).trials) == 32
    Blobs.prepared.clear()
    run_trials(dataset, [Blobs()], jobs=0, force=True)
    assert len(Blobs.prepared) == 8
    assert len(read_results(dataset).trials) == 8 + 16


def test_other_parameters_and_another_ground_truth_replace_what_is_stored(dataset: Dataset) -> None:
    run_trials(dataset, [Biased()], jobs=0)
    wider = run_trials(dataset, [Biased(bias_m=0.2)], jobs=0)
    assert len(wider.trials) == 8 and wider.trials[0].translation_error_m > 0.15
    moved = toy_dataset.move_truth(dataset, np.array([0.2, 0, 0, 0, 0, 0]))
    again = run_trials(moved, [Biased(bias_m=0.2)], jobs=0)
    assert len(again.trials) == 8
    assert {t.groundtruth_version for t in again.trials} == {p.pose_version for p in moved.poses}
    assert again.trials[0].translation_error_m < 0.1


def test_a_named_run_keeps_its_protocol(dataset: Dataset) -> None:
    run_trials(dataset, [Blobs()], run="mine", jobs=0)
    with pytest.raises(CalibrationError, match="seed 0"):
        run_trials(dataset, [Blobs()], run="mine", seed=1, jobs=0)
    replaced = run_trials(dataset, [Blobs()], run="mine", seed=1, jobs=0, force=True)
    assert {t.seed for t in replaced.trials} == {1}
    with pytest.raises(CalibrationError, match="cannot name"):
        run_trials(dataset, [Blobs()], run="../up", jobs=0)


def test_pairs_of_a_pose_jointly(dataset: Dataset) -> None:
    joint = run_trials(dataset, [Blobs()], group="pose", jobs=0)
    assert [len(t.pair_ids) for t in joint.trials] == [2] * 4
    assert all(t.success and "jointly" in t.name for t in joint.trials)
    single = run_trials(dataset, [Blobs()], jobs=0)
    assert np.mean([t.rotation_error_deg for t in joint.trials]) < np.mean(
        [t.rotation_error_deg for t in single.trials]
    )


def test_methods_by_name_and_by_label(dataset: Dataset, monkeypatch: pytest.MonkeyPatch) -> None:
    class Entry:
        name, value = "blobs", "toy_methods:Blobs"

        def load(self) -> type[Blobs]:
            return Blobs

    monkeypatch.setattr(registry, "entry_points", lambda group: [Entry()])
    assert run_trials(dataset, ["blobs"], jobs=0).trials[0].method == "blobs"
    sweep = {f"bias {b}": Biased(bias_m=b) for b in (0.0, 0.3)}
    rows = run_trials(dataset, sweep, jobs=0).summaries
    assert [(r.method, r.success_rate) for r in rows[-2:]] == [("bias 0.0", 1.0), ("bias 0.3", 0.0)]
    with pytest.raises(CalibrationError, match="twice"):
        run_trials(dataset, [Biased(), Biased(bias_m=1)], jobs=0)
    with pytest.raises(CalibrationError, match="unknown method"):
        run_trials(dataset, ["blops"], jobs=0)
    with pytest.raises(CalibrationError, match="no pair 'x'"):
        run_trials(dataset, [Blobs()], pair_ids=["x"], jobs=0)


@pytest.mark.parametrize(
    ("method", "message"),
    [
        (Habit(habit="raise"), "ZeroDivisionError: a line of no length"),
        (Habit(habit="raise", in_prepare=True), "ZeroDivisionError: a line of no length"),
        (Habit(habit="refuse"), "too few lines: use another scene"),
        (Habit(habit="nan"), "not finite"),
        (Habit(habit="none"), "returned NoneType"),
    ],
)
def test_a_method_that_fails_on_some_pairs(dataset: Dataset, method: Habit, message: str) -> None:
    results = run_trials(dataset, [method, Biased()], trials=2, jobs=0)
    failed = [t for t in results.trials if t.failed]
    assert len(failed) == 8 and {t.method for t in failed} == {"habit"}
    assert all(t.pair_ids[0].endswith("001") and message in t.message for t in failed)
    assert len(results.failures) == 8 and "trial 1" in results.failures[1]
    assert results.summaries[0].failed == 4 and results.summaries[0].successes == 4
    stored = [t for t in read_results(dataset).trials if t.failed]
    assert len(stored) == 8 and stored[0].T_camera_lidar_estimated is None


def test_failed_trials_are_tried_again(dataset: Dataset) -> None:
    broken = dataset.path / dataset.pairs[0].image
    content = broken.read_bytes()
    broken.write_bytes(content[:50])
    results = run_trials(dataset, [Blobs()], jobs=0)
    assert [t.pair_ids[0] for t in results.trials if t.failed] == [dataset.pairs[0].pair_id]
    assert broken.name in results.failures[0]
    broken.write_bytes(content)
    assert not run_trials(dataset, [Blobs()], jobs=0).failures


@pytest.mark.parametrize(
    ("habit", "in_prepare", "reason"),
    [("segfault", False, "SIGSEGV while calibrating"), ("exit", True, "exit code 3 while prep")],
)
def test_a_method_that_kills_its_process(
    dataset: Dataset, habit: str, in_prepare: bool, reason: str
) -> None:
    killer = Habit(habit=habit, in_prepare=in_prepare, where="lawn/pose_001/001")
    results = run_trials(dataset, [Blobs(), killer, Biased()], trials=2, jobs=1)
    assert len(results.trials) == 8 * 3 * 2
    failed = [t for t in results.trials if t.failed]
    assert [(t.method, t.trial) for t in failed] == [("habit", 0), ("habit", 1)]
    assert all(reason in t.message for t in failed)
    assert all(t.success for t in results.trials if t.method == "blobs")


def test_one_thread_a_worker(dataset: Dataset) -> None:
    results = run_trials(dataset, [Threads()], pair_ids=[dataset.pairs[0].pair_id], jobs=1)
    assert results.trials[0].message == "[1, 1, 1, 1]"


def test_a_method_that_cannot_be_sent(dataset: Dataset) -> None:
    class Local(Blobs):
        pass

    with pytest.raises(CalibrationError, match="jobs=0"):
        run_trials(dataset, [Local()], jobs=1)
    assert len(run_trials(dataset, [Local()], jobs=0).trials) == 8


SCRIPT = """
    import sys
    from toy_methods import Blobs, Habit
    from lcdata.dataset import Dataset
    from lcdata.evaluation import run_trials

    if __name__ == "__main__" or not {guard}:
        sleeper = Habit(habit="sleep", where="lawn/pose_001/001")
        print("ready", flush=True)
        run_trials(
            Dataset.open(sys.argv[1]), [Blobs(), sleeper], jobs=2,
            progress=lambda _, done, total: print(done, flush=True),
        )
"""


def start(script: Path, dataset: Dataset, guard: bool) -> subprocess.Popen[str]:
    script.write_text(textwrap.dedent(SCRIPT.format(guard=guard)))
    return subprocess.Popen(
        [sys.executable, str(script), str(dataset.path)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={"PYTHONPATH": str(Path(__file__).parent), "PATH": ""},
        start_new_session=True,
    )


@pytest.mark.slow
@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGKILL])
def test_interrupted_work_is_kept_and_continued(
    dataset: Dataset, tmp_path: Path, how: signal.Signals
) -> None:
    process = start(tmp_path / "script.py", dataset, guard=True)
    assert process.stdout
    for line in process.stdout:
        if line.strip() == "15":  # all but the one that sleeps
            break
    process.send_signal(how)
    began = time.monotonic()
    _, errors = process.communicate(timeout=30)
    assert time.monotonic() - began < 10
    if how == signal.SIGINT:
        assert "KeyboardInterrupt" in errors and errors.count("Traceback") == 1
        assert len(read_results(dataset).trials) == 15
    else:
        assert not list((dataset.path / "results").glob("*.parquet"))  # less than SAVE_EVERY_S
    workers = subprocess.run(["ps", "-eo", "args"], capture_output=True, text=True, check=True)
    assert str(tmp_path) not in workers.stdout
    awake = Habit(habit="awake", where="lawn/pose_001/001")
    results = run_trials(dataset, [Blobs(), awake], jobs=0)
    assert len(results.trials) == 16 and not results.failures


@pytest.mark.slow
def test_a_script_without_a_main_guard_is_told(dataset: Dataset, tmp_path: Path) -> None:
    process = start(tmp_path / "script.py", dataset, guard=False)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 1
    assert "a worker process could not start" in errors.splitlines()[-1]
