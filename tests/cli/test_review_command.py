from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "review"))  # data set of a room

from box_room import CLEAN, add_results, make
from typer.testing import CliRunner

from lcdata.cli.app import app
from lcdata.dataset import Dataset


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    return make(tmp_path_factory.mktemp("room") / "set", arm=False, pairs=1, cameras={"lab": CLEAN})


def test_one_pair_is_written_into_the_report(lcdata, dataset):
    done = lcdata("review", dataset.path, "--pair", "lab/pose_000/000", "--json")
    assert done.returncode == 0, done.stderr
    written = json.loads(done.stdout)
    report = dataset.path / "report"
    assert written == {
        "landscape": str(report / "pair-lab-pose_000-000.png"),
        "review": str(report / "pair-lab-pose_000-000.rrd"),
    }
    assert all(Path(file).stat().st_size > 10_000 for file in written.values())


def run(*arguments):
    return CliRunner().invoke(app, ["review", *map(str, arguments)])


def test_filters_are_written_and_told(tmp_path):
    made = make(tmp_path / "set", arm=False, pairs=3, cameras={"lab": CLEAN})
    add_results(made)
    out = tmp_path / "r.rrd"
    done = run(made.path, "--save", out, "--worst", "2", "--method", "beta", "--points", "50")
    assert done.exit_code == 0, done.stderr
    assert done.stdout == f"{out}\n"
    assert "Shown are 2 pairs of 3: `--method beta --worst 2`" in done.stderr
    assert "thinned to 50 each" in done.stderr
    done = run(made.path, "--save", out, "--method", "alpha", "--compare", "beta", "--json")
    assert done.exit_code == 0, done.stderr
    told = json.loads(done.stdout)
    assert (told["review"], told["pairs"], told["failures"]) == (str(out), 3, [])


def test_several_pairs_are_a_filter_and_a_missing_file_is_exit_code_3(tmp_path):
    made = make(tmp_path / "set", arm=False, pairs=3, cameras={"lab": CLEAN})
    (made.path / made.pairs[2].cloud).unlink()
    chosen = [word for n in (0, 2) for word in ("--pair", made.pairs[n].pair_id)]
    done = run(made.path, "--save", tmp_path / "r.rrd", *chosen)
    assert done.exit_code == 3
    assert "Shown are 2 pairs of 3" in done.stderr
    assert "lab/pose_000/002: " in done.stderr
    assert (tmp_path / "r.rrd").is_file()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--pair", "lab/pose_000/007"], "no pair 'lab/pose_000/007'"),
        (["--pair", "lab/pose_000/00"], "did you mean lab/pose_000/000?"),
        (["--method", "nid"], "there are no results of nid"),
        (["--worst", "3"], "--worst 3 needs results"),
        (["--scenario", "lap"], "no scenario 'lap' to show: did you mean lab?"),
        (["--pose", "pose_007"], "no pose 'pose_007' to show: did you mean lab/pose_000?"),
        (["--compare", "other"], "no results to compare with 'other'"),
        (["--ground-truth", "first", "present"], "has one version of its ground truth"),
        (["--run", "x"], "has no run 'x': stored are none"),
        (["--live", "--worst", "3"], "--live shows one run as it grows"),
        (["--points", "9", "--thin", "2"], "both say what to keep"),
        (["--reach-rotation", "1"], "are for one pair: give one --pair alone"),
    ],
)
def test_what_cannot_be_shown_is_told_in_one_line(dataset, tmp_path, options, message):
    done = run(dataset.path, "--save", tmp_path / "x.rrd", *options)
    assert done.exit_code == 1
    assert message in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
    assert not list(tmp_path.iterdir())
