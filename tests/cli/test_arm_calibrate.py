"""`lcdata arm calibrate` as a user types it, on the encoder readings of a real arm."""

from __future__ import annotations

import json

import numpy as np
import pytest
import yaml

from lcdata.arm import Arm, read_joint_offsets


@pytest.fixture
def readings(shared):
    return shared / "data" / "gen3_lite_sockets"


@pytest.fixture
def table(tmp_path):
    """Simulated readings in one CSV: two sockets at one place of the tool."""
    rng = np.random.default_rng(0)
    names = Arm.load("gen3_lite").joint_names
    rows = [f"tool,socket,{','.join(names)}"]
    for socket in ("hole_0", "hole_1"):
        q = rng.uniform(-0.3, 0.3, len(names))
        rows += [f"a,{socket},{','.join(map(str, q + rng.normal(0, 1e-4, 6)))}" for _ in range(8)]
    path = tmp_path / "readings.csv"
    path.write_text("\n".join(rows))
    return path


def test_json_has_the_figures_and_the_file_is_what_a_rig_reads(lcdata, readings, tmp_path):
    out = tmp_path / "GL12.yaml"
    done = lcdata("arm", "calibrate", readings, "--arm", "gen3_lite", "-o", out, "--json")
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert found["heldout_rms_mm"] <= 3.7
    assert found["fitted_rms_mm"] < found["nominal_rms_mm"]
    assert found["heldout_nominal_rms_mm"] == pytest.approx(6.25, abs=0.1)
    assert found["socket_distance_mm"] == pytest.approx(50, abs=2)
    assert set(found["offsets_deg"]) == set(found["offsets_std_deg"])
    assert {"offset of joint_1", "offset of joint_6"} <= set(found["undetermined"])
    assert yaml.safe_load(out.read_text())["serial"] == "GL12"
    offsets = read_joint_offsets(out)
    assert np.rad2deg(offsets["joint_2"]) == pytest.approx(
        found["offsets_deg"]["joint_2"], abs=1e-3
    )


def test_the_text_names_what_is_open_and_what_moved(lcdata, readings):
    done = lcdata("arm", "calibrate", readings, "--socket-distance", "none")
    assert done.returncode == 0, done.stderr
    for words in ("held out", "not determined: offset of joint_6", "front/hole_0"):
        assert words in done.stdout


def test_one_place_of_the_tool_has_null_for_what_does_not_exist(lcdata, table):
    done = lcdata("arm", "calibrate", table, "--json")
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["heldout_rms_mm"] is None


def test_a_file_is_not_replaced_without_force(lcdata, table, tmp_path):
    out = tmp_path / "mine.yaml"
    out.write_text("kept")
    done = lcdata("arm", "calibrate", table, "-o", out)
    assert (done.returncode, out.read_text()) == (1, "kept")
    assert "--force" in done.stderr
    assert lcdata("arm", "calibrate", table, "-o", out, "--force").returncode == 0
    assert "offsets_deg" in out.read_text()


def test_what_cannot_be_used_is_named_in_one_line(lcdata, table, tmp_path):
    short = tmp_path / "short.csv"
    short.write_text(table.read_text().replace("joint_4", "joint_four"))
    out = tmp_path / "none.yaml"
    for arguments, word in (
        ([tmp_path / "nowhere.csv"], "nowhere.csv"),
        ([short], "joint_4"),
        ([table, "--arm", "gen4"], "gen4"),
        ([table, "--socket-distance", "far"], "'far'"),
    ):
        done = lcdata("arm", "calibrate", *arguments, "-o", out)
        assert done.returncode == 1
        assert word in done.stderr
        assert done.stderr.count("\n") == 1
        assert not out.exists()


def test_help_has_an_example(lcdata):
    done = lcdata("arm", "calibrate", "--help")
    assert "Example:  lcdata arm calibrate" in done.stdout
    assert "--json" in done.stdout


def test_clocks_need_images_of_the_moving_arm(lcdata, sample_recordings):
    done = lcdata("arm", "clock", sample_recordings / "gym")
    assert done.returncode == 1
    assert "0 pairs of neighbouring images of the moving arm, 6 are needed" in done.stderr
    assert "against the scans: 1 images in motion, 3 are needed" in done.stderr
    assert done.stderr.count("\n") == 1
    assert "Example:  lcdata arm clock" in lcdata("arm", "clock", "--help").stdout
