from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import toy_dataset
from toy_methods import Biased, Blobs

from lcdata.dataset import Dataset
from lcdata.errors import ReportError
from lcdata.evaluation import read_results, run_trials, summary_lines
from lcdata.evaluation.results import results_path
from lcdata.geometry import se3

CONTRACT = {
    "run",
    "method",
    "pair_ids",
    "scenario",
    "pose_id",
    "trial",
    "seed",
    "rotation_error_deg",
    "translation_error_m",
    "converged",
    "degenerate",
    "sigma_distance",
    "seconds",
    "groundtruth_version",
    "message",
}


@pytest.fixture
def calibrated(dataset: Dataset) -> Dataset:
    run_trials(dataset, [Blobs(), Biased()], jobs=0)
    return dataset


def test_file_has_the_columns_of_the_contract(calibrated: Dataset) -> None:
    path = results_path(calibrated, "5deg-0.5m-seed0")
    table = pq.read_table(path)
    assert set(table.column_names) >= CONTRACT
    assert {"T_camera_lidar_initial", "T_camera_lidar_estimated"} <= set(table.column_names)
    assert {"initial_rotation_error_deg", "initial_translation_error_m"} <= set(table.column_names)
    assert table.num_rows == 16
    json.loads(table.schema.metadata[b"lcdata.units"])


def test_what_is_written_is_read(calibrated: Dataset) -> None:
    run = "5deg-0.5m-seed0"
    rows = pq.read_table(results_path(calibrated, run)).to_pylist()
    trials = read_results(calibrated, run).trials
    assert len(rows) == len(trials) == 16
    for row, t in zip(rows, trials, strict=True):
        assert (row["method"], tuple(row["pair_ids"]), row["trial"]) == t.key
        np.testing.assert_allclose(
            se3.to_xyz_xyzw(t.T_camera_lidar_estimated), row["T_camera_lidar_estimated"]
        )
        # errors once more from what is in the file, by a formula of its own
        truth = calibrated.pose(t.pose_id).T_camera_lidar
        cosine = (np.trace(truth[:3, :3].T @ t.T_camera_lidar_estimated[:3, :3]) - 1) / 2
        assert row["rotation_error_deg"] == pytest.approx(
            math.degrees(math.acos(min(1, cosine))), abs=1e-5
        )
        assert row["translation_error_m"] == pytest.approx(
            math.dist(truth[:3, 3], row["T_camera_lidar_estimated"][:3])
        )
        assert row["initial_rotation_error_deg"] == pytest.approx(5 * 3**0.5)
    blobs = next(t for t in trials if t.method == "blobs")
    assert blobs.matches.points_lidar.shape == (8, 2, 3)
    assert blobs.matches.points_image.shape == (8, 2, 2)
    assert len(blobs.matches.pair_index) == 8
    assert not blobs.diverged and not blobs.failed


def test_a_biased_method_is_that_many_sigmas_off(calibrated: Dataset) -> None:
    biased = [t for t in read_results(calibrated).trials if t.method == "biased"]
    # 0.05 m along x, where the ground truth has 0.004 m
    assert np.median([t.sigma_distance for t in biased]) == pytest.approx(12.5, rel=0.15)


def test_stale_results_are_told_apart_and_can_be_recomputed(calibrated: Dataset) -> None:
    before = read_results(calibrated)
    moved = toy_dataset.move_truth(calibrated, np.array([0.0, 0, 0.3, 0, 0, 0]))
    current, stale = before.split_stale(moved)
    assert not current.trials and len(stale.trials) == 16
    again = stale.recomputed(moved)
    assert len(again.split_stale(moved)[0].trials) == 16
    for old, new in zip(stale.trials, again.trials, strict=True):
        np.testing.assert_array_equal(old.T_camera_lidar_estimated, new.T_camera_lidar_estimated)
        assert new.translation_error_m == pytest.approx(0.3, abs=0.1)
        assert old.translation_error_m < 0.1
        assert new.groundtruth_version == moved.pose(new.pose_id).pose_version
        assert new.initial_groundtruth_version == old.groundtruth_version
        assert new.rebased and not old.rebased


def test_static_reference_without_covariance(tmp_path: Path) -> None:
    dataset = toy_dataset.make(tmp_path / "set", ("road",), 1, 2, covariance=None)
    results = run_trials(dataset, [Blobs()], jobs=0)
    assert all(math.isnan(t.sigma_distance) for t in results.trials)
    assert all(t.success for t in results.trials)
    assert "sigma" not in "".join(summary_lines(results))


def test_every_run_is_read_and_leftovers_are_not(calibrated: Dataset) -> None:
    run_trials(calibrated, [Blobs()], init_rotation_deg=1, jobs=0)
    (calibrated.path / "results" / ".x.lcdata-tmp1.parquet").write_bytes(b"half")
    assert {t.run for t in read_results(calibrated).trials} == {
        "5deg-0.5m-seed0",
        "1deg-0.5m-seed0",
    }
    assert not read_results(calibrated, "no such run").trials


def test_files_of_the_version_before_are_read(calibrated: Dataset) -> None:
    path = results_path(calibrated, "5deg-0.5m-seed0")
    table = pq.read_table(path).drop_columns(["initial_groundtruth_version"])
    pq.write_table(table.replace_schema_metadata({"lcdata.results": "1"}), path)
    trials = read_results(calibrated).trials
    assert len(trials) == 16 and not any(t.rebased for t in trials)


def test_damaged_and_newer_files_are_named(calibrated: Dataset) -> None:
    path = results_path(calibrated, "5deg-0.5m-seed0")
    table = pq.read_table(path)
    pq.write_table(table.replace_schema_metadata({"lcdata.results": "9"}), path)
    with pytest.raises(ReportError, match="schema 9"):
        read_results(calibrated)
    pq.write_table(pa.table({"a": [1]}), path)
    with pytest.raises(ReportError, match=path.name):
        read_results(calibrated)
    path.write_bytes(b"PAR1")
    with pytest.raises(ReportError, match="not a results file"):
        read_results(calibrated)


def test_plain_values_for_json(calibrated: Dataset) -> None:
    content = json.loads(json.dumps(read_results(calibrated).to_dict()))
    assert content["failures"] == []
    first = content["summary"][0]
    assert first["method"] == "blobs" and first["success_rate"] == 1.0
    assert set(first["rotation_deg"]) == {"q1", "median", "q3"}
