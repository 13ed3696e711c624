"""Live: what is in a recording that grew with its results."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from box_room import BAD, GOOD, RUN, add_results, make
from rrd import Rrd

from lcdata.errors import ReportError
from lcdata.evaluation.results import results_path, write_run
from lcdata.review import Selection, Wanted, save_review
from lcdata.review.live import Options, follow
from lcdata.review.live_viewer import into_file


def steps(*actions):
    """Something that does one action at each look, and ends when none is left."""
    left = list(actions)

    def ended():
        if not left:
            return True
        left.pop(0)()
        return False

    return ended


@pytest.fixture
def grown(tmp_path):
    """A data set without results, its results one by one, and its finished review."""
    dataset = make(tmp_path / "rooms", arm=False, pairs=2)
    results = add_results(dataset)
    whole = save_review(dataset, tmp_path / "whole.rrd").path
    path = results_path(dataset, RUN)
    path.unlink()
    return dataset, results, path, Rrd(whole)


def run(dataset, out: Path, ended, **wanted) -> tuple[int, list[str]]:
    told: list[str] = []
    options = Options(Wanted(**wanted), poll_s=0.02)
    count = follow(dataset, options, into_file("live", out), ended=ended, tell=told.append)
    return count, told


def latest(rrd: Rrd, entity: str, component: str) -> dict:
    return {time: value for time, value in rrd.rows(entity, component).items() if time is not None}


def test_what_grew_is_what_is_written_at_once(grown, tmp_path):
    dataset, results, path, whole = grown
    alphas = [r for r in results if r.method == GOOD]
    ended = steps(
        lambda: write_run(path, alphas[:1]),
        lambda: write_run(path, alphas[:1]),  # nothing new
        lambda: write_run(path, [*alphas[:1], *(r for r in results if r.method == BAD)]),
        lambda: write_run(path, results),
    )
    count, told = run(dataset, tmp_path / "live.rrd", ended)
    assert count == len(results)
    assert told[0].startswith("no trials yet")
    assert told[-1] == f"run {RUN}: {len(results)} trials of {GOOD}, {BAD}"
    rrd = Rrd(tmp_path / "live.rrd")
    assert whole.entities <= rrd.entities
    for source in (GOOD, BAD, "initial", "ground_truth"):
        for entity, component in (
            (f"/overlays/{source}/cloud", "Points2D:positions"),
            (f"/overlays/{source}/verdict", "Boxes2D:colors"),
            (f"/frustums/{source}", "LineStrips3D:strips"),
            (f"/errors/rotation_deg/{source}", "Scalars:scalars"),
            (f"/errors/translation_m/{source}", "Scalars:scalars"),
            (f"/outcomes/{source}", "StateChange:state"),
            (f"/lines/{source}", "LineStrips3D:strips"),
        ):
            expected = latest(whole, entity, component)
            found = latest(rrd, entity, component)
            assert found.keys() == expected.keys(), entity
            assert found == expected, entity
    assert latest(rrd, "/pair", "TextDocument:text") == latest(whole, "/pair", "TextDocument:text")


def test_half_a_file_is_told_and_waited_for(grown, tmp_path):
    dataset, results, path, _ = grown
    write_run(path, results)
    data = path.read_bytes()
    ended = steps(lambda: path.write_bytes(data[: len(data) // 2]), lambda: path.write_bytes(data))
    path.unlink()
    count, told = run(dataset, tmp_path / "live.rrd", ended)
    assert count == len(results)
    assert any("is not a results file" in line for line in told)


def test_another_run_takes_the_place_of_the_first(grown, tmp_path):
    dataset, results, path, _ = grown
    write_run(path, results)
    os.utime(path, ns=(10**18, 10**18))
    other = [r for r in results if r.method == GOOD]
    ended = steps(lambda: write_run(results_path(dataset, "other"), other), lambda: None)
    count, told = run(dataset, tmp_path / "live.rrd", ended)
    assert count == len(other)
    assert "run other is written now" in told
    assert "other" in Rrd(tmp_path / "live.rrd").static("/summary", "TextDocument:text")[0]
    assert f"/outcomes/{BAD}" not in Rrd(tmp_path / "live.rrd").entities


def test_a_run_that_is_named_is_waited_for(grown, tmp_path):
    dataset, results, path, _ = grown
    write_run(results_path(dataset, "old"), results)
    ended = steps(lambda: write_run(path, results[:1]))
    count, told = run(dataset, tmp_path / "live.rrd", ended, run=RUN)
    assert count == 1
    assert told == ["no trials yet; Ctrl-C ends", f"run {RUN}: 1 trials of {GOOD}"]


def test_filters_hold(grown, tmp_path):
    dataset, results, path, _ = grown
    selection = Selection(methods=(BAD,), scenarios=("lab",))
    ended = steps(lambda: write_run(path, results))
    count, _ = run(dataset, tmp_path / "live.rrd", ended, selection=selection)
    assert count == 1
    rrd = Rrd(tmp_path / "live.rrd")
    assert f"/outcomes/{GOOD}" not in rrd.entities
    assert sorted(rrd.rows("/lidar/cloud", "Points3D:positions")) == [0, 1]


def test_comparisons_are_not_live(grown, tmp_path):
    with pytest.raises(ReportError, match="one run as it grows"):
        run(grown[0], tmp_path / "live.rrd", steps(), compare="other")
    assert not (tmp_path / "live.rrd").exists()


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no SIGINT for one process")
@pytest.mark.parametrize(
    "number", [signal.SIGINT, pytest.param(signal.SIGTERM, marks=pytest.mark.slow)]
)
def test_ctrl_c_ends_it_with_a_whole_file(grown, tmp_path, number):
    dataset, results, path, _ = grown
    out = tmp_path / "out" / "live.rrd"
    command = [sys.executable, "-m", "lcdata", "review", dataset.path, "--live", "--save", out]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
    assert process.stderr is not None
    assert "no trials yet" in process.stderr.readline()
    write_run(path, results)
    assert f"{len(results)} trials" in process.stderr.readline()
    process.send_signal(number)
    process.wait(timeout=60)
    assert process.returncode == 0
    assert [file.name for file in out.parent.iterdir()] == ["live.rrd"]
    assert f"/outcomes/{GOOD}" in Rrd(out).entities


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no SIGINT for one process")
def test_ctrl_c_while_pairs_are_written_leaves_nothing(grown, tmp_path):
    dataset, *_ = grown
    script = (
        "import os, signal, sys\n"
        "from lcdata.review import content\n"
        "from lcdata.cli import main\n"
        "read = content.cloud_file.read\n"
        "def interrupted(path):\n"
        "    os.kill(os.getpid(), signal.SIGINT)\n"
        "    return read(path)\n"
        "content.cloud_file.read = interrupted\n"
        "sys.argv = ['lcdata', 'review', sys.argv[1], '--save', sys.argv[2]]\n"
        "main()\n"
    )
    out = tmp_path / "out"
    arguments = [sys.executable, "-c", script, str(dataset.path), str(out / "r.rrd")]
    started = time.monotonic()
    done = subprocess.run(arguments, check=False, capture_output=True, text=True, timeout=60)
    assert done.returncode == 130, done.stderr
    assert "Traceback" not in done.stderr
    assert list(out.iterdir()) == []
    assert time.monotonic() - started < 50
