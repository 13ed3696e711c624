"""A recording whose clocks are apart by a known time, through every command. Simulated."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import yaml

from lcdata.dataset import Dataset
from lcdata.simulation import simulate

pytestmark = pytest.mark.slow

OFFSET_S = 0.25


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two poses, the way between them filmed with 10 small images a second."""
    (path,) = simulate(
        tmp_path_factory.mktemp("clocks"),
        scenario="yard",
        poses=2,
        pairs=1,
        seed=31,
        columns=512,
        azimuth_window_deg=60,
        width=320,
        height=180,
        clock_offset_s=OFFSET_S,
        motion_hz=10,
    )
    return path


@pytest.fixture(scope="module")
def true_s(recording: Path) -> float:
    value = json.loads((recording.parent / "truth.json").read_text())["clock_offset_s"]["yard"]
    assert value == pytest.approx(OFFSET_S, abs=0.01)
    return value


def rig_that_says(recording: Path, folder: Path, offset: object) -> Path:
    content = yaml.safe_load((recording.parent / "rig.yaml").read_text())
    path = folder / "rig.yaml"
    path.write_text(yaml.safe_dump(content | {"clock_offset_s": offset}))
    return path


def is_measured(content: dict, true_s: float) -> bool:
    assert content["std_s"] < 0.003
    return abs(content["offset_s"] - true_s) < 4 * content["std_s"]


def test_info_and_arm_clock_find_it(lcdata, recording, true_s):
    told = json.loads(lcdata("info", recording, "--json").stdout)["recordings"][0]["clock_offset"]
    assert is_measured(told, true_s)
    assert (told["applied_s"], told["moved_pairs"]) == (0, 0)
    text = lcdata("info", recording).stdout
    assert "clock      arm - camera +2" in text
    assert "no pair is affected" in text
    alone = json.loads(lcdata("arm", "clock", recording, "--json").stdout)["recordings"][0]
    assert alone["offset_s"] == told["offset_s"]
    assert alone["source"] == "motion"


def test_a_rig_that_asks_for_it_gets_it_out_of_the_joints(lcdata, recording, true_s, tmp_path):
    def built(name: str, *options: object) -> Dataset:
        done = lcdata("build", recording, "-o", tmp_path / name, "--no-calibrate", *options)
        assert (done.returncode, done.stderr) == (0, "")
        return Dataset.open(tmp_path / name)

    plain = built("plain")
    rig = rig_that_says(recording, tmp_path, "estimate")
    estimated = built("estimated", "--rig", rig)
    for dataset, applied in ((plain, 0.0), (estimated, true_s)):
        clock = dataset.info.scenarios["yard"].clock_offset
        assert is_measured(clock, true_s)
        assert clock["applied_s"] == pytest.approx(applied, abs=0.01)
    shift = plain.poses[0].start_ns - estimated.poses[0].start_ns
    assert shift * 1e-9 == pytest.approx(true_s, abs=0.015)
    done = lcdata("groundtruth", tmp_path / "plain", "--rig", rig)
    assert done.returncode == 1
    assert "clock_offset_s: estimate" in done.stderr
    assert "build the data set again" in done.stderr


def test_pairs_of_the_moving_arm_are_warned_of(lcdata, recording, tmp_path):
    rig = rig_that_says(recording, tmp_path, -1.4)  # takes the way for a part of the dwell
    out = tmp_path / "wrong"
    done = lcdata("build", recording, "-o", out, "--no-calibrate", "--rig", rig, "--json")
    content = json.loads(done.stdout)
    (warning,) = content["warnings"]
    assert "beyond the rig's -1400.0 ms" in warning
    assert "set `clock_offset_s: estimate` in the rig" in warning
    assert "off the camera's" in done.stderr


def test_a_camera_that_is_mounted_otherwise_is_warned_of(lcdata, recording, tmp_path):
    content = yaml.safe_load((recording.parent / "rig.yaml").read_text())
    content["T_camera_effector"]["rotation_rpy_deg"] = [1.5, -2.0, 0.0]  # not 90
    rig = tmp_path / "rig.yaml"
    rig.write_text(yaml.safe_dump(content))
    done = lcdata("build", recording, "-o", tmp_path / "out", "--no-calibrate", "--rig", rig)
    assert done.returncode == 0
    assert "what the images show is not the motion of the joints" in done.stderr
    assert "is T_camera_effector right" in done.stderr
