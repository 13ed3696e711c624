from __future__ import annotations

import dataclasses
import shlex
from pathlib import Path

import cv2
import numpy as np
import pytest
import toy_dataset
from page_reader import Reader
from toy_methods import Blobs, Habit

from lcdata.dataset import Dataset
from lcdata.evaluation import read_results, run_trials
from lcdata.evaluation.results import TrialResult
from lcdata.geometry.camera import Camera
from lcdata.pair import Pair
from lcdata.report import failures, gallery, write_report
from lcdata.report.gallery import Painter, choose, choose_worst, with_edges, worst_of_each
from lcdata.report.showcase import Opener


def badness(t: TrialResult) -> float:
    return max(t.rotation_error_deg / 0.5, t.translation_error_m / 0.1)


@pytest.fixture(scope="module")
def habit(tmp_path_factory: pytest.TempPathFactory) -> tuple[Dataset, list[TrialResult]]:
    """Half of the pairs fail; three trials a pair."""
    dataset = toy_dataset.make(tmp_path_factory.mktemp("gallery") / "set", ("hall",), 4, 2)
    return dataset, list(run_trials(dataset, [Habit()], trials=3, jobs=0).trials)


def test_best_and_median_count_failures(habit) -> None:
    _, trials = habit
    made = [t for t in trials if not t.failed]
    assert len(made) == 12
    chosen = choose(trials)
    assert chosen["best"] is min(made, key=badness)
    assert chosen["median"].failed  # half of them did
    assert list(choose(trials[:1])) == ["best"]


def test_worst_are_of_different_pairs_and_have_estimates(habit) -> None:
    _, trials = habit
    worst = choose_worst(trials, 3)
    made = sorted((t for t in trials if not t.failed), key=badness)
    assert worst[0] is made[-1]
    assert len({t.pair_ids for t in worst}) == 3
    assert [badness(t) for t in worst] == sorted(map(badness, worst), reverse=True)
    for t in worst:
        same = [badness(other) for other in made if other.pair_ids == t.pair_ids]
        assert badness(t) == max(same)
    assert len(choose_worst(trials, 100)) == 4  # pairs with estimates
    assert choose_worst([t for t in trials if t.failed]) == []


def test_pages_of_many_galleries_show_fewer_trials_of_each() -> None:
    assert worst_of_each(3) == gallery.WORST
    assert worst_of_each(1000) == 1
    for n in range(1, 12):
        assert n * (2 + worst_of_each(n)) <= max(gallery.MOST, 3 * n)


def test_edges_of_a_cloud_where_it_has_enough_of_them() -> None:
    camera = Camera("pinhole", 640, 480, (500.0, 500.0, 320.0, 240.0))
    azimuth, elevation = np.meshgrid(
        np.radians(np.arange(-40, 40, 0.2)), np.radians(np.arange(-30, 30, 0.2))
    )
    rays = np.stack([np.tan(azimuth), np.tan(elevation), np.ones_like(azimuth)], -1).reshape(-1, 3)
    board = (np.abs(rays[:, 0]) < 0.25) & (np.abs(rays[:, 1]) < 0.2)
    points = rays * np.where(board, 4.0, 9.0)[:, None]
    image = np.zeros((480, 640), np.uint8)
    pair = Pair(image, points.astype(np.float32), None, camera, T_camera_lidar=np.eye(4))
    drawn = with_edges(pair).points
    assert 200 < len(drawn) < len(points) / 10
    beside = np.maximum(
        np.abs(drawn[:, 0] / drawn[:, 2]) / 0.25, np.abs(drawn[:, 1] / drawn[:, 2]) / 0.2
    )
    assert np.abs(beside - 1).max() < 0.1  # all of them on the board's border
    wall = dataclasses.replace(pair, points=(rays * 9).astype(np.float32))
    assert len(with_edges(wall).points) == len(rays)
    empty = dataclasses.replace(pair, points=np.full((5, 3), np.nan, np.float32))
    assert len(with_edges(empty).points) == 0
    wide = dataclasses.replace(camera, intrinsics=(120.0, 120.0, 320.0, 240.0))
    assert len(with_edges(dataclasses.replace(pair, camera=wide)).points) > 200


def test_pictures_of_a_pair_are_drawn_once(habit) -> None:
    dataset, trials = habit
    painter = Painter(dataset, 2)
    shown = painter.exhibits(trials)
    assert [e.rank for e in shown] == ["best", "median", "worst", "worst 2"]
    assert list(shown[0].pictures) == ["Initial guess", "Estimate", "Ground truth"]
    assert list(shown[1].pictures) == ["Initial guess", "Ground truth"]  # no estimate
    assert list(shown[2].pictures) == ["Estimate", "Ground truth"]
    assert list(painter.pictures(shown[0].trial, ("Ground truth",))) == ["Ground truth"]
    same = painter.pictures(shown[0].trial, ("Ground truth",))["Ground truth"]
    assert same is shown[0].pictures["Ground truth"]
    picture = cv2.imdecode(np.frombuffer(same, np.uint8), cv2.IMREAD_COLOR)
    assert picture.shape == (120, 160, 3)


def test_commands_name_pair_and_method_and_say_what_else_they_show(tmp_path: Path) -> None:
    dataset = toy_dataset.make(tmp_path / "a set", ("hall",), 1, 2)
    run_trials(dataset, [Blobs()], trials=2, jobs=0)
    run_trials(dataset, [Blobs()], init_rotation_deg=1, init_translation_m=0.1, jobs=0)
    trials = read_results(dataset).trials
    opener = Opener.of(dataset, trials)
    last, first, second = (
        next(t for t in trials if t.init_rotation_deg == deg and t.trial == number)
        for deg, number in ((1, 0), (5, 0), (5, 1))
    )
    assert opener(last) == [
        *("lcdata", "review", str(dataset.path)),
        *("--pair", last.pair_ids[0], "--method", "blobs"),
    ]
    assert opener(first) == [*opener(last), "--run", "5deg-0.5m-seed0"]
    assert opener.differs(last) == opener.differs(first) == ""
    assert opener.differs(second) == "shows trial 0 on this pair"
    assert opener.worst("blobs", "run", 3)[-6:] == [
        "--worst",
        "3",
        "--method",
        "blobs",
        "--run",
        "run",
    ]
    elsewhere = Opener.of(dataset, ())
    assert "--method" not in elsewhere(last) and "ground truth" in elsewhere.differs(last)
    page = Reader(write_report(dataset).read_text())
    commands = [text for text in page.commands if text.startswith("lcdata review")]
    assert all(shlex.split(text)[2] == str(dataset.path) for text in commands)
    single = {tuple(words) for text in commands if "--pair" in (words := shlex.split(text))}
    assert single == {tuple(opener(t)) for t in trials}


def test_failures_are_counted_by_reason_where_they_are_many(habit) -> None:
    _, trials = habit
    failed = [t for t in trials if t.failed]
    few = Reader(failures.section([*failed[:3], trials[0]], lambda m: ""))
    assert few.text.startswith("Trials without an estimate: 3 of 4")
    assert few.text.count("ZeroDivisionError") == 3
    other = [dataclasses.replace(t, message="out of <memory>") for t in failed[:4]]
    many = Reader(failures.section([*trials, *other], lambda m: ""))
    assert many.text.startswith("Trials without an estimate: 16 of 28")
    rows = many.tables[0].rows
    assert [row.cells[1] for row in rows] == ["12", "4"]
    assert rows[1].cells[2] == "out of <memory>"
    distinct = [
        dataclasses.replace(t, message=f"{i} {k}") for k in range(5) for i, t in enumerate(failed)
    ]
    section = Reader(failures.section(distinct, lambda m: ""))
    assert len(section.tables[0].rows) == failures.MOST_KINDS
    assert "20 more reasons are not listed" in section.text
    assert failures.section([trials[0]], lambda m: "") == ""
