"""CRLF's tables and figure, run again on simulated roads and what real frames there are."""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import pytest

from lcdata.errors import LcdataError
from lcdata.geometry import se3
from lcdata.reproduce import find
from lcdata.reproduce.crlf_errors import displaced, per_axis, sizes
from lcdata.reproduce.crlf_frames import SOURCES, count, frame, source_of
from lcdata.reproduce.crlf_run import kept_rows
from lcdata.reproduce.crlf_steps import REFINEMENTS
from lcdata.reproduce.crlf_trials import LEVELS, Kept, Row, Trial
from lcdata.reproduce.experiment import Settings

TRUTH = se3.exp([0.1, -0.3, -0.2, 0.3, -1.1, 0.9])
GOOD = (0.01, 0.02, -0.03, 0.1, -0.05, 0.02)
BAD = (0.4, -0.2, 0.9, 1.0, -4.0, 0.3)


def test_errors_are_those_of_each_axis():
    turn = np.deg2rad([0.4, -0.7, 1.1])
    (cz, cy, cx), (sz, sy, sx) = np.cos(turn[::-1]), np.sin(turn[::-1])
    Rz = np.array([[cz, -sz, 0], [sz, cz, 0], [0, 0, 1]])
    Ry = np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
    Rx = np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
    T = TRUTH.copy()
    T[:3, :3] = Rz @ Ry @ Rx @ TRUTH[:3, :3]
    T[:3, 3] += [0.1, -0.2, 0.3]
    np.testing.assert_allclose(per_axis(T, TRUTH), [0.1, -0.2, 0.3, 0.4, -0.7, 1.1], atol=1e-9)


@pytest.mark.parametrize("share", [0.25, 1.0])
def test_starts_are_off_by_a_share_of_a_metre_and_six_degrees(share):
    rng = np.random.default_rng(3)
    shifts, turns = [], []
    for _ in range(200):
        T = displaced(TRUTH, share, rng)
        shifts.append(T[:3, 3] - TRUTH[:3, 3])
        rotation = np.eye(4)
        rotation[:3, :3] = T[:3, :3] @ TRUTH[:3, :3].T
        turns.append(np.rad2deg(se3.log(rotation)[3:]))
    np.testing.assert_allclose(np.abs(shifts).max(axis=1), share)
    np.testing.assert_allclose(np.abs(turns).max(axis=1), 6 * share)
    assert np.abs(np.mean(shifts, axis=0)).max() < 0.15 * share
    metres, degrees = sizes([per_axis(displaced(TRUTH, share, rng), TRUTH)])
    assert share <= metres[0] <= np.sqrt(3) * share
    assert 5.9 * share <= degrees[0] <= 6.1 * np.sqrt(3) * share


def trials(level, start, end):
    return tuple(Trial(level, name, start, end, 0.2, name == "crlf") for name in REFINEMENTS)


def test_the_table_sets_what_is_done_beside_the_paper(tmp_path):
    kept = kept_rows("crlf-table", tmp_path)
    kept.add(Row("crlf-table", "sim-kitti", 0, 5, 0.1, 0.03, 0.01, False, trials(0, BAD, GOOD)))
    kept.add(Row("crlf-table", "sim-kitti", 1, 5, 0.3, 0.05, 0.03, False, trials(0, GOOD, BAD)))
    kept.add(Row("crlf-table", "sim-kitti", 2, 5, message="no lanes"))
    settings = Settings(3, 5, 1, tmp_path, {"sources": "sim-kitti"})
    outcome = find("crlf-table").run(settings, None)
    values = outcome.values["sim-kitti"]
    assert (values["frames"], values["coarse_found"], values["coarse_good"]) == (3, 2, 1)
    assert values["feature_seconds"] == pytest.approx(0.2)
    assert values["crlf"]["success"] == 1
    assert values["crlf"]["wrong_but_converged"] == 1
    assert values["messages"] == ["no lanes"]
    np.testing.assert_allclose(values["crlf"]["mae"], np.mean([np.abs(GOOD), np.abs(BAD)], axis=0))
    times, errors, shares = outcome.tables
    assert times.rows[0][1:] == ("0.104", "0.200")
    coarse = next(r for r in errors.rows if r[1] == "coarse")
    assert coarse[2] == "2 / 3"
    assert coarse[3] == "0.121 | 0.205 (0.205)"
    assert [cell.split(" ")[0] for cell in coarse[4:]] == [
        *("0.067", "0.182", "0.628", "1.043", "0.805")
    ]
    assert shares.rows[0][-1] == "1"
    assert all(len(r) == len(t.header) for t in outcome.tables for r in t.rows)
    assert "0.1 rad" in errors.note


def test_the_figure_counts_each_level(tmp_path):
    kept = kept_rows("crlf-fig7", tmp_path)
    for number, end in enumerate((GOOD, BAD)):
        levels = [t for k in range(1, LEVELS + 1) for t in trials(k, BAD, end if k > 3 else GOOD)]
        kept.add(Row("crlf-fig7", "sim-1200", number, 0, trials=tuple(levels)))
    settings = Settings(2, 0, 1, tmp_path, {"sources": "sim-1200"})
    outcome = find("crlf-fig7").run(settings, None)
    levels = outcome.values["sim-1200"]["crlf"]
    assert [level["success"] for level in levels] == [2, 2, 2, 1, 1, 1]
    assert [level["wrong_but_converged"] for level in levels] == [0, 0, 0, 1, 1, 1]
    assert levels[-1]["initial_deg"] == 6.0
    (table,) = outcome.tables
    assert len(table.rows) == 1 + LEVELS * len(REFINEMENTS)
    assert all(len(r) == len(table.header) for r in table.rows)


def test_rows_come_back_as_they_were_kept(tmp_path):
    row = Row("crlf-table", "kitti", 4, 1, 0.1, 0.2, 0.1, True, trials(0, BAD, GOOD), "so")
    Kept(tmp_path / "rows.jsonl").add(row)
    assert Kept(tmp_path / "rows.jsonl").rows == {row.key: row}
    assert json.loads((tmp_path / "rows.jsonl").read_text()) == json.loads(
        json.dumps(dataclasses.asdict(row))
    )


def test_what_is_not_there_is_named(tmp_path):
    with pytest.raises(LcdataError, match=r"'moon'.*sim-kitti"):
        find("crlf-table").run(Settings(options={"sources": "moon"}), None)
    options = {"sources": "kitti,crossing", "data": str(tmp_path)}
    with pytest.raises(LcdataError, match="data=FOLDER"):
        find("crlf-fig7").run(Settings(options=options), None)
    (tmp_path / "kitti_road").mkdir()
    (tmp_path / "kitti_road" / "1.pcd").write_text("")
    with pytest.raises(LcdataError, match=r"kitti_road: frame 1 cannot be read.*reference.json"):
        frame(source_of("kitti"), 0, 0, tmp_path)
    assert [count(s, 7, tmp_path) for s in SOURCES] == [7, 7, 1, 0]


@pytest.mark.slow
def test_a_simulated_frame_is_calibrated_from_nothing(tmp_path):
    options = {"sources": "sim-kitti"}
    outcome = find("crlf-table").run(Settings(1, 2, 1, tmp_path, options), None)
    values = outcome.values["sim-kitti"]
    assert values["coarse_found"] == 1
    assert values["feature_seconds"] > 0
    assert values["messages"] == []
    for name in REFINEMENTS:
        assert values[name]["seconds"] > 0
        assert np.isfinite(values[name]["mae"]).all()
    (kept,) = kept_rows("crlf-table", tmp_path).rows.values()
    assert [t.refinement for t in kept.trials] == list(REFINEMENTS)
    assert len({t.start for t in kept.trials}) == 1
