"""PLK-Calib's Figures 5 and 6, run again on few and small trials."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import pytest
from typer.testing import CliRunner

from lcdata.calibrators import create
from lcdata.calibrators.base import Calibration, Calibrator
from lcdata.cli.app import app
from lcdata.dataset import Dataset
from lcdata.errors import LcdataError
from lcdata.geometry import se3
from lcdata.reproduce import find, plk_pairs
from lcdata.reproduce.experiment import Settings
from lcdata.reproduce.plk_starts import Offset, RandomSigns
from lcdata.reproduce.plk_tests import TESTS, Sweep
from lcdata.reproduce.plk_trials import Kept, Task, Work, run_task
from lcdata.simulation import render_pair

T = se3.exp([0.2, -0.1, 0.4, 1.2, -1.1, 1.3])


@dataclass(frozen=True)
class Nearly(Calibrator):
    """Comes to a pose that is a given number of centimetres off, and counts its features."""

    name: ClassVar[str] = "nearly"
    centimetres: float = 1.0
    prepared: ClassVar[list[str]] = []

    def prepare(self, pair):
        self.prepared.append(pair.pair_id)
        return pair.T_camera_lidar

    def calibrate(self, pairs, initial, prepared=None):
        if self.centimetres > 50.0:
            raise ValueError("much too far")
        off = se3.exp([0.01 * self.centimetres, 0, 0, 0, 0, 0])
        return Calibration(off @ prepared[0], True, False, np.full((6, 6), np.nan), 0.1)


@pytest.fixture
def small(monkeypatch):
    """Simulated pairs of a fraction of the size."""

    def load(name):
        numbers = {"pose_index": name.pose, "pair_index": name.index, "seed": name.seed}
        return render_pair(name.scenario, **numbers, columns=512, width=320, height=180)

    monkeypatch.setattr(plk_pairs.PairName, "load", load)


def test_offsets_are_along_and_about_the_lidars_own_axes():
    start = Offset(metres=-3.0).guess(T, "a")
    assert np.array_equal(start[:3, :3], T[:3, :3])
    point = np.array([1.0, 2.0, 3.0])
    np.testing.assert_allclose(
        se3.apply(start, point), se3.apply(T, point - [0, 3.0, 0]), atol=1e-12
    )
    turned = Offset(degrees=90.0).guess(T, "a")
    np.testing.assert_allclose(turned[:3, 3], T[:3, 3])
    np.testing.assert_allclose(
        se3.apply(turned, [1.0, 0, 0]), se3.apply(T, [0, 1.0, 0]), atol=1e-12
    )
    along_x = Offset(metres=2.0, translation_axis="x").guess(T, "a")
    np.testing.assert_allclose(se3.inverse(T) @ along_x, se3.exp([2.0, 0, 0, 0, 0, 0]), atol=1e-12)
    signs = {
        float(np.sign((se3.inverse(T) @ Offset(1.0, 10.0, any_sign=True).guess(T, f"{i}"))[1, 0]))
        for i in range(20)
    }
    assert signs == {-1.0, 1.0}


def test_random_signs_are_those_of_the_main_job():
    start = RandomSigns(5.0, 0.5, 0).guess(T, "gym/pose_000/000")
    np.testing.assert_allclose(np.abs(start - T)[:3, 3], 0.5)
    turned = se3.log(start @ se3.inverse(T))[3:]
    np.testing.assert_allclose(np.rad2deg(np.abs(turned)), 5.0, atol=1e-9)
    other = RandomSigns(5.0, 0.5, 1).guess(T, "gym/pose_000/000")
    assert not np.array_equal(start, other)


def test_tests_hold_and_search_what_the_figure_says():
    sweep = Sweep()
    method = create("projection")
    held = TESTS["translation"]
    assert [start.metres for start in held.offsets(sweep)] == list(range(-5, 6))
    assert held.method(method, sweep) == create(
        "projection", hold="rotation", search_translation_m=6.0
    )
    turned = TESTS["rotation"]
    assert [start.degrees for start in turned.offsets(sweep)] == list(range(-25, 26, 5))
    wanted = create("projection", hold="translation", search_rotation_deg=30.0)
    assert turned.method(method, sweep) == wanted
    both = TESTS["both-free"].offsets(sweep)
    assert {(start.metres, start.degrees) for start in both} >= {(5.0, 25.0), (-2.0, -10.0)}
    assert TESTS["translation"].method(create("nid"), sweep) == create("nid")


def test_features_are_made_once_a_pair_and_a_raised_error_is_a_row(small):
    Nearly.prepared.clear()
    pair = plk_pairs.simulated(["gym"], 1, 1, 3)[0]
    near, far = Nearly(2.0), Nearly(60.0)
    work = [Work("t", "near", near, Offset(metres=m)) for m in (-1.0, 1.0)]
    # the same front end has the same features whatever the other parameters are
    work.append(Work("t", "far", far, Offset(metres=1.0)))
    task = Task(pair, tuple(work))
    rows = list(run_task(task))
    assert [row.key for row in rows] == task.keys
    assert [row.success for row in rows] == [True, True, False]
    assert rows[0].translation_error_m == pytest.approx(0.02)
    assert rows[2].message == "ValueError: much too far"
    assert rows[2].rotation_error_deg == np.inf
    assert rows[2].result().failed
    assert len(task.only(task.keys[1:]).work) == 2
    assert len(Nearly.prepared) <= 4  # twice, and once more each to warm up


def test_rows_outlive_the_process(small, tmp_path):
    pair = plk_pairs.simulated(["gym"], 1, 1, 3)[0]
    work = (
        Work("t", "near", Nearly(), Offset(metres=1.0)),
        Work("t", "far", Nearly(70.0), Offset()),
    )
    rows = list(run_task(Task(pair, work)))
    kept = Kept(tmp_path / "rows.jsonl")
    for row in rows:
        kept.add(row)
    again = list(Kept(tmp_path / "rows.jsonl").rows.values())
    assert [row.key for row in again] == [row.key for row in rows]
    assert repr(again) == repr(rows)
    # another version of a method, other parameters, another start: not the same row
    others = (
        Work("t", "near", Nearly(1.5), Offset(metres=1.0)),
        Work("t", "near", Nearly(), Offset(metres=1.5)),
        Work("u", "near", Nearly(), Offset(metres=1.0)),
    )
    assert len({w.key(pair) for w in (*work, *others)}) == 5


def test_figure_5_goes_on_and_writes_what_it_prints(small, tmp_path):
    options = ["--set", "scenes=gym", "--set", "poses=1", "--runs", "1", "--jobs", "1"]
    command = ["reproduce", "plk-fig5", "-o", str(tmp_path), *options]
    done = CliRunner().invoke(app, command)
    assert done.exit_code == 0, done.output
    assert "worse than plk" in done.output and "1 arm pose in gym" in done.output
    text = (tmp_path / "plk-fig5.json").read_text()
    assert "NaN" not in text and "Infinity" not in text
    stored = json.loads(text)
    assert [s["trials"] for s in stored["values"]["summary"]] == [1, 1]
    assert (tmp_path / "plk-fig5.png").read_bytes().startswith(b"\x89PNG")
    before = (tmp_path / "plk-fig5.jsonl").read_text()
    more = CliRunner().invoke(app, [*command, "--set", "methods=projection,plk,plk:decoupled=true"])
    assert more.exit_code == 0, more.output
    after = (tmp_path / "plk-fig5.jsonl").read_text()
    assert after.startswith(before) and len(after.splitlines()) == 3


def test_figure_6_on_a_dataset(sample_dataset, tmp_path):
    dataset = Dataset.open(sample_dataset)
    options = {
        "data": str(sample_dataset),
        "poses": "1",
        "pairs": "1",
        "metres-step": "5",
        "tests": "translation,both-free",
        "methods": "projection",
    }
    settings = Settings(folder=tmp_path, options=options, jobs=1)
    outcome = find("plk-fig6").run(settings, None)
    assert "Data set" in outcome.protocol
    assert set(outcome.values) == {"translation", "both-free"}
    trials = len(dataset.scenarios) * 3
    assert outcome.values["translation"]["projection"]["trials"] == trials
    assert [row[0] for row in outcome.tables[1].rows] == ["-5 m", "+0 m", "+5 m"]
    assert outcome.tables[2].rows[0][0] == "-5 m, 25°"
    assert outcome.pictures["plk-fig6.png"].startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("name", "options", "message"),
    [
        ("plk-fig5", {"scenes": "gim"}, "did you mean 'gym'"),
        ("plk-fig5", {"methods": "projektion"}, "did you mean 'projection'"),
        ("plk-fig5", {"methods": "plk:decopled=true"}, "did you mean 'decoupled'"),
        ("plk-fig5", {"methods": "plk,plk"}, "given twice"),
        ("plk-fig5", {"poses": "0"}, "poses is 0"),
        ("plk-fig5", {"pairs": "1.5"}, "pairs is 1.5"),
        ("plk-fig5", {"init-rotation": "far"}, "init-rotation is 'far'"),
        ("plk-fig5", {"init-translation": "-1"}, "init-translation is '-1'"),
        ("plk-fig5", {"data": "nowhere"}, "nowhere"),
        ("plk-fig6", {"tests": "translations"}, "did you mean 'translation'"),
        ("plk-fig6", {"translation-axis": "w"}, "unknown axis 'w'"),
        ("plk-fig6", {"metres-step": "0"}, "in steps of 0"),
        ("plk-fig6", {"degrees": "170"}, "up to 150"),
    ],
)
def test_bad_options_are_named(name, options, message):
    with pytest.raises(LcdataError, match=message):
        find(name).run(Settings(options=options, jobs=1), None)


def test_an_unknown_recording_of_a_dataset_is_named(sample_dataset):
    options = {"data": str(sample_dataset), "scenes": "moon"}
    with pytest.raises(LcdataError, match="has no scenario 'moon'"):
        find("plk-fig5").run(Settings(options=options, jobs=1), None)
