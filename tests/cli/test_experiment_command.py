"""An experiment as a user runs it, with methods that another package registers."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "evaluation"))  # toy data set

import toy_dataset

TESTS = Path(__file__).parents[1]

FILE = """\
datasets: [set]
methods:
  - blobs
  - biased: {bias_m: [0.2, 0.3]}
"""


@pytest.fixture
def experiment(tmp_path, monkeypatch):
    info = tmp_path / "installed" / "toys-1.0.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: toys\nVersion: 1.0\n")
    names = ("Blobs", "Biased", "Habit", "Slow")
    methods = "".join(f"{name.lower()} = toy_methods:{name}\n" for name in names)
    (info / "entry_points.txt").write_text(f"[lcdata.calibrators]\n{methods}")
    places = (str(info.parent), str(TESTS / "evaluation"), os.environ.get("PYTHONPATH", ""))
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(filter(None, places)))
    toy_dataset.make(tmp_path / "set", ("hall",), 1, 2)
    path = tmp_path / "bias.yaml"
    path.write_text(FILE)
    return path


def test_run_status_and_report(lcdata, experiment, tmp_path):
    done = lcdata("experiment", "status", experiment)
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[0].split() == ["set", "blobs", "0/2", "done"]
    done = lcdata("experiment", "run", experiment, "--jobs", 1)
    assert done.returncode == 0, done.stderr
    lines = done.stdout.splitlines()
    assert lines[0] == "set, 5deg-0.5m-seed0" and len(lines) == 4
    assert "2/2 succeeded (34–100 %)" in lines[1] and "biased(bias_m=0.3)" in lines[3]
    again = lcdata("experiment", "run", experiment, "--json")
    found = json.loads(again.stdout)["set"]
    assert [s["successes"] for s in found["summary"]] == [2, 0, 0]
    assert len(found["comparisons"]) == 6
    done = lcdata("experiment", "report", experiment)
    assert done.stdout.strip() == str(tmp_path / "bias-report" / "set" / "index.html")
    assert (tmp_path / "bias-report" / "set" / "comparisons.csv").is_file()


def test_what_is_wrong_is_one_line(lcdata, experiment):
    for old, new, words in (
        ("blobs", "blops", ("bias.yaml:3", "blops", "did you mean 'blobs'")),
        ("bias_m", "bias_n", ("bias.yaml:4", "bias_n", "did you mean 'bias_m'")),
        ("[set]", "[sat]", ("bias.yaml:1", "sat", "did you mean 'set'")),
    ):
        experiment.write_text(FILE.replace(old, new))
        done = lcdata("experiment", "run", experiment)
        assert done.returncode == 1 and done.stderr.count("\n") == 1
        for word in words:
            assert word in done.stderr


def test_failures_are_named_at_the_end(lcdata, experiment):
    experiment.write_text("datasets: [set]\nmethods: [blobs, {habit: {habit: refuse}}]\n")
    for _ in range(2):
        done = lcdata("experiment", "run", experiment, "-j", 1)
        assert done.returncode == 3
        assert "set: habit on hall/pose_000/001, trial 0: too few lines" in done.stderr


def test_a_scheduler_that_is_none_is_told_in_one_line(lcdata, experiment):
    done = lcdata("experiment", "run", experiment, "--scheduler", "remote")
    assert done.returncode == 1 and done.stderr.count("\n") == 1
    assert "no scheduler 'remote': write tcp://HOST:PORT, or local" in done.stderr


@pytest.mark.slow
def test_nothing_left_asks_no_scheduler_and_a_dead_one_is_told(lcdata, experiment):
    pytest.importorskip("distributed", reason="the extra dask is not installed")
    done = lcdata("experiment", "run", experiment, "-j", 1)
    dead = ("--scheduler", "tcp://127.0.0.1:9")
    again = lcdata("experiment", "run", experiment, *dead)
    assert again.returncode == 0 and again.stdout == done.stdout
    experiment.write_text(FILE + "seeds: 1\n")
    done = lcdata("experiment", "run", experiment, *dead)
    assert done.returncode == 1 and done.stderr.count("\n") == 1
    assert "no Dask scheduler answers at tcp://127.0.0.1:9" in done.stderr


def _left(group: int) -> bool:
    """Whether processes of a group are there after a while; they are killed then."""
    try:
        for _ in range(300):
            os.killpg(group, 0)
            time.sleep(0.1)
        os.killpg(group, signal.SIGKILL)
    except ProcessLookupError:
        return False
    return True


@pytest.mark.slow
def test_ctrl_c_on_dask_leaves_what_goes_on(lcdata, experiment):
    """The whole process group gets SIGINT, as from a terminal; nothing of it stays."""
    pytest.importorskip("distributed", reason="the extra dask is not installed")
    slow = "datasets: [set]\nmethods: [slow: {seconds: 0.4}]\ntrials: 40\nstarts: [%s]\n"
    experiment.write_text(slow % "{rotation_deg: [1, 2, 3, 4, 5]}")
    command = ["experiment", "run", str(experiment), "--scheduler", "local:1"]
    with subprocess.Popen(
        [sys.executable, "-m", "lcdata", *command],
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    ) as process:
        trials = experiment.parent / "lcdata-trials" / "trials"
        try:
            end = time.monotonic() + 200
            while not list(trials.glob("*.parquet")) and time.monotonic() < end:
                assert process.poll() is None
                time.sleep(0.1)
            os.killpg(process.pid, signal.SIGINT)
            _, errors = process.communicate(timeout=100)
            assert process.returncode == 130
            assert errors == "lcdata: interrupted; the same command goes on from here\n"
        finally:
            left = _left(process.pid)
    assert not left
    from lcdata.experiment import Store

    assert 0 < len(Store.open(trials.parent).keys()) < 200


def test_help_has_an_example(lcdata):
    for command in ("run", "status", "report"):
        done = lcdata("experiment", command, "--help")
        assert f"Example:  lcdata experiment {command}" in done.stdout
        assert "--json" in done.stdout
