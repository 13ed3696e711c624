"""The main job as a user types it, on the sample recordings (simulated) and on real ones."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from lcdata.dataset import Dataset
from lcdata.geometry import se3


@pytest.fixture(scope="module")
def gym(lcdata, sample_recordings, tmp_path_factory) -> Path:
    """Data set of one sample recording, packaged only."""
    out = tmp_path_factory.mktemp("gym") / "dataset"
    done = lcdata("build", sample_recordings / "gym", "-o", out, "--no-calibrate", "--json")
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["pairs"] == 5
    return out


def test_a_packaged_recording_holds_the_true_extrinsics_within_their_covariance(
    gym, sample_recordings
):
    truth = json.loads((sample_recordings / "truth.json").read_text())["poses"]
    dataset = Dataset.open(gym)
    distances = []
    for pose in dataset.poses:
        T = np.array(truth[pose.pose_id]["T_camera_lidar"])
        distances.append(se3.sigma_distance(pose.T_camera_lidar, T, pose.covariance))
        assert se3.rotation_error(pose.T_camera_lidar, T) < np.deg2rad(2)
        assert se3.translation_error(pose.T_camera_lidar, T) < 0.05
    assert len(distances) == 5
    # One rig, one draw of its errors: chi-squared with 6 degrees of freedom, 99.9 % below 22.5.
    assert np.mean(np.square(distances)) < 22.5


def test_building_again_changes_nothing(lcdata, gym, sample_recordings):
    before = {p: p.stat().st_mtime_ns for p in gym.rglob("*") if p.is_file()}
    done = lcdata("build", sample_recordings / "gym", "-o", gym, "--no-calibrate")
    assert done.returncode == 0, done.stderr
    assert {p: p.stat().st_mtime_ns for p in gym.rglob("*") if p.is_file()} == before


def test_a_data_set_of_other_recordings_is_not_overwritten(lcdata, gym, sample_recordings):
    before = (gym / "dataset.json").read_bytes()
    done = lcdata("build", sample_recordings / "yard", "-o", gym, "--no-calibrate")
    assert done.returncode == 1
    assert "--force" in done.stderr
    assert done.stderr.count("\n") == 1
    assert (gym / "dataset.json").read_bytes() == before


def test_a_folder_that_is_no_data_set_is_left_alone(lcdata, sample_recordings, tmp_path):
    (tmp_path / "thesis.tex").write_text("years of work")
    done = lcdata("build", sample_recordings / "gym", "-o", tmp_path, "--no-calibrate", "--force")
    assert done.returncode == 1
    assert done.stderr.count("\n") == 1
    assert [p.name for p in tmp_path.iterdir()] == ["thesis.tex"]


def test_info_prints_topics_dwells_and_a_rig(lcdata, sample_recordings):
    done = lcdata("info", sample_recordings / "gym")
    assert done.returncode == 0, done.stderr
    for word in ("/ouster/points", "gym/pose_004", "128 rings", "5 pairs"):
        assert word in done.stdout
    as_json = json.loads(lcdata("info", sample_recordings / "gym", "--json").stdout)
    assert len(as_json["recordings"]) == 1


def test_validate_names_a_damaged_file(lcdata, gym, tmp_path):
    import shutil

    copy = tmp_path / "dataset"
    shutil.copytree(gym, copy)
    assert lcdata("validate", copy).returncode == 0
    victim = next(copy.rglob("*.pcd"))
    content = bytearray(victim.read_bytes())
    content[-100] ^= 0xFF
    victim.write_bytes(content)
    done = lcdata("validate", copy)
    assert done.returncode == 3
    assert victim.name in done.stdout


@pytest.mark.slow
def test_the_main_job_on_one_recording_makes_everything(lcdata, sample_recordings, tmp_path):
    out = tmp_path / "dataset"
    done = lcdata("build", sample_recordings / "yard", "-o", out, "--pairs-per-pose", 1, "--json")
    assert done.returncode == 0, done.stderr
    summary = json.loads(done.stdout)
    assert summary["pairs"] == summary["poses"] == 5
    assert (out / "report" / "index.html").stat().st_size > 10_000
    assert (out / "review.rrd").stat().st_size > 10_000
    (results,) = (out / "results").glob("*.parquet")
    rows = pq.read_table(results).to_pylist()
    assert len(rows) == 15  # three methods
    assert {row["method"] for row in rows} == {"projection", "plk", "cascade"}
    assert all(np.isfinite(row["T_camera_lidar_estimated"]).all() for row in rows)
    again = lcdata("build", sample_recordings / "yard", "-o", out, "--pairs-per-pose", 1, "--json")
    assert again.returncode == 0, again.stderr
    assert json.loads(again.stdout)["results"] == summary["results"]


@pytest.mark.slow
def test_real_recordings_without_an_arm_go_through(lcdata, shared, tmp_path):
    """Road scans: the line methods may fail, but flagged, and nothing may crash."""
    (tmp_path / "rig.yaml").write_text("ground_truth: static\n")
    out = tmp_path / "dataset"
    done = lcdata(
        "build", shared / "recordings", "--rig", tmp_path / "rig.yaml", "-o", out, "--json"
    )
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["pairs"] == 11
    (results,) = (out / "results").glob("*.parquet")
    for row in pq.read_table(results).to_pylist():
        wrong = row["rotation_error_deg"] >= 0.5 or row["translation_error_m"] >= 0.1
        assert not (row["converged"] and wrong), row["message"]
    assert lcdata("validate", out).returncode == 0


@pytest.mark.slow
@pytest.mark.parametrize("begun", ["**/*.pcd", "dataset.json"], ids=["packaging", "calibration"])
def test_control_c_keeps_what_was_done_and_the_same_command_goes_on(
    lcdata, sample_recordings, tmp_path, begun
):
    out = tmp_path / "dataset"
    arguments = ["build", str(sample_recordings), "-o", str(out)]
    process = subprocess.Popen(
        [sys.executable, "-m", "lcdata", *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    while not any(out.glob(begun)):
        assert process.poll() is None, process.stderr
        time.sleep(0.01)
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does: the whole group
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 130, errors
    assert "Traceback" not in errors
    assert errors.count("\n") == 1, errors
    done = lcdata(*arguments, "--no-calibrate")
    assert done.returncode == 0, done.stderr
    assert lcdata("validate", out).returncode == 0
