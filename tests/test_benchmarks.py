"""The page of figures says what the benchmarks printed, and nothing else."""

from __future__ import annotations

import importlib.util
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

FOLDER = Path(__file__).parents[1] / "benchmarks"


@pytest.fixture(scope="module")
def runner():
    spec = importlib.util.spec_from_file_location("benchmarks_run", FOLDER / "run.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


def test_the_page_is_what_the_kept_runs_give(runner):
    assert runner.PAGE.read_text() == runner.page(runner.plan())


def test_every_script_is_in_the_plan_once_at_least(runner):
    planned = {shlex.split(benchmark.command)[0] for benchmark in runner.plan()}
    helpers = {"run.py", "common.py"}
    there = {path.name for path in FOLDER.glob("*.py")} - helpers
    assert there == planned


def test_what_is_kept_belongs_to_the_plan(runner):
    names = {benchmark.name for benchmark in runner.plan()}
    assert {path.stem for path in runner.PRINTED.glob("*.json")} <= names


def test_a_figure_is_read_and_held_to_its_target(runner):
    figure = runner.Figure("seconds", r"took ([\d.]+) s", "s", at_most=2.0)
    assert figure.value("a took 1.5 s\nb took 2.5 s\nc took 1.75 s") == 1.75
    assert (figure.verdict(1.75), figure.verdict(2.5)) == ("reached", "missed")
    assert figure.target() == "2 or less"
    with pytest.raises(SystemExit, match="nothing printed matches"):
        figure.value("no seconds")


def test_a_command_that_fails_keeps_nothing(runner, monkeypatch, tmp_path):
    monkeypatch.setattr(runner, "PRINTED", tmp_path)
    broken = runner.Benchmark("broken", "Broken", "command_line.py --no-such-option")
    with pytest.raises(SystemExit, match="ended with 2"):
        runner.run(broken)
    assert not list(tmp_path.iterdir())


def test_an_unknown_name_is_named(runner):
    done = subprocess.run(
        [sys.executable, FOLDER / "run.py", "wied"], capture_output=True, text=True, check=False
    )
    assert done.returncode == 2
    assert "no benchmark wied: there are" in done.stderr
