"""Koide et al.'s tables, run again on simulated sensors."""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import pytest

import lcdata
from lcdata.calibrators import create
from lcdata.errors import LcdataError
from lcdata.reproduce import find
from lcdata.reproduce.experiment import Settings
from lcdata.reproduce.nid_edge import EdgeRow
from lcdata.reproduce.nid_scenes import COMBINATIONS
from lcdata.reproduce.nid_table import _version
from lcdata.reproduce.nid_trials import Kept, Row, Task, run_task


def row(combination: int, scenes: tuple[int, ...], error: float) -> Row:
    return Row(combination, scenes, 0, True, True, 0.2, 0.4, error, 10 * error, True, 9.0, 2.0)


@pytest.fixture
def done(tmp_path):
    """A folder in which two scenes of the first combination, and both together, are done."""
    kept = Kept(tmp_path / f"nid-table-{_version()}.jsonl", Row)
    for scenes, error in (((0,), 0.01), ((1,), 0.03), ((0, 1), 0.005)):
        kept.add(row(0, scenes, error))
    return tmp_path


def test_what_is_done_is_not_done_again_and_is_set_beside_the_paper(done):
    settings = Settings(runs=2, folder=done, options={"combinations": "1"}, jobs=1)
    outcome = find("nid-table").run(settings, None)
    values = outcome.values["OS1-64 and pinhole"]
    assert values["success"] == 2
    assert values["median_m"] == pytest.approx(0.02)
    assert values["joint_m"] == 0.005
    summary, single = outcome.tables
    (line,) = summary.rows
    assert "12 / 15" in line and "0.043 / 0.374" in line and "0.034 / 0.414" in line
    assert [r[0] for r in single.rows] == ["00", "01"]
    assert "disagree" in summary.note


def test_edge_stands_beside_the_papers_edge_based_figures(done):
    kept = Kept(
        done / f"nid-table-{lcdata.__version__}-edge{create('edge').version}.jsonl", EdgeRow
    )
    for scenes, error in (((0,), 0.01), ((1,), 0.03), ((0, 1), 0.004)):
        kept.add(EdgeRow(0, scenes, 0, error, 10 * error, True, 3.0))
    options = {"combinations": "1", "edge": "yes"}
    settings = Settings(runs=2, folder=done, options=options, jobs=1)
    outcome = find("nid-table").run(settings, None)
    assert len(outcome.tables) == 3
    (line,) = outcome.tables[2].rows
    assert line[:5] == (
        "OS1-64 and pinhole",
        "0.236 / 1.329",
        "0.020 / 0.200",
        "0.020 / 0.200",
        "0.004 / 0.040",
    )
    assert len(outcome.values["edge"]) == 3
    with pytest.raises(LcdataError, match="edge is 'maybe'"):
        find("nid-table").run(Settings(options={"edge": "maybe"}), None)


def test_half_a_line_of_a_killed_run_is_left_out(done):
    path = next(done.glob("*.jsonl"))
    path.write_text(path.read_text()[:-20])
    assert len(Kept(path, Row).rows) == 2
    rows = [json.loads(line) for line in path.read_text().splitlines()[:2]]
    assert rows[0] == json.loads(json.dumps(dataclasses.asdict(row(0, (0,), 0.01))))


def test_each_combination_has_its_own_extrinsic_near_the_lidar():
    extrinsics = [c.T_camera_lidar for c in COMBINATIONS]
    for T in extrinsics:
        assert 0.05 < np.linalg.norm(T[:3, 3]) < 0.3
        assert T[2, 0] > 0.95  # the camera looks along the LiDAR's x axis
    assert len({T.tobytes() for T in extrinsics}) == 4


def test_an_unknown_combination_is_named():
    with pytest.raises(LcdataError, match="OS1-64 and pinhole"):
        find("nid-table").run(Settings(options={"combinations": "5"}), None)


@pytest.mark.slow
def test_a_scene_is_solved_from_nothing():
    (found,) = run_task(Task(1, (1,), 7))
    assert found.guessed, found
    assert found.error_m < 0.03 and found.error_deg < 0.25
