from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "review"))  # data set of a room

from box_room import CLEAN, make
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
        (["--points", "9", "--thin", "2"], "both say what to keep"),
        (["--reach-rotation", "1"], "are for one pair: give one --pair alone"),
    ],
)
def test_what_cannot_be_shown_is_told_in_one_line(dataset, tmp_path, options, message):
    command = ["review", str(dataset.path), "--save", str(tmp_path / "x.rrd"), *options]
    done = CliRunner().invoke(app, command)
    assert done.exit_code == 1
    assert message in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
    assert not list(tmp_path.iterdir())
