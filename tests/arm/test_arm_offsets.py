from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml

from lcdata.arm import Arm
from lcdata.arm.offsets import read_offsets_file
from lcdata.errors import ArmError
from lcdata.rig import Rig, load_rig

OFFSETS = {"joint_1": 0.5, "joint_2": -1.0, "joint_4": 0.25}


@pytest.fixture
def write(tmp_path: Path):
    def write(**content: object) -> Path:
        path = tmp_path / "arm.yaml"
        path.write_text(yaml.safe_dump({"offsets_deg": OFFSETS} | content))
        return path

    return write


def test_standard_deviations_become_a_covariance_in_the_arms_order(write):
    path = write(offsets_std_deg={"joint_2": 0.1, "joint_4": 0.2})
    arm = Arm.load(joint_offsets=path)
    std = np.rad2deg(np.sqrt(np.diag(arm.offset_covariance)))
    np.testing.assert_allclose(std, [np.nan, 0.1, np.nan, 0.2, np.nan, np.nan])
    assert Arm.load(joint_offsets=write()).offset_covariance is None


def test_a_full_covariance_wins(write):
    rows = [[0.04, 0.01, 0], [0.01, 0.09, 0], [0, 0, 0.01]]
    path = write(offsets_covariance_deg2=rows, offsets_std_deg={"joint_1": 9.0})
    covariance = np.rad2deg(np.rad2deg(Arm.load(joint_offsets=path).offset_covariance))
    np.testing.assert_allclose(covariance[:2, :2], np.array(rows)[:2, :2])
    assert covariance[3, 3] == pytest.approx(0.01)
    assert np.isnan(covariance[2, 2])
    assert covariance[2, 3] == 0


@pytest.mark.parametrize(
    ("content", "named"),
    [
        ({"model": "ur5"}, "of a ur5, the arm is a gen3_lite"),
        ({"model_sha256": "ab" * 32}, "sha256 abababababab"),
        ({"serial": "GL00001"}, "serial GL00001, the rig's arm.serial is 7"),
        ({"offsets_std_deg": {"joint_2": -0.1}}, "deviation of joint_2 is -0.1"),
        ({"offsets_std_deg": {"joint_9": 0.1}}, "joint_9"),
        ({"offsets_std_deg": 3}, "offsets_std_deg is 3"),
        ({"offsets_covariance_deg2": [[1]]}, "shape"),
        ({"offsets_covariance_deg2": np.diag([1, -1, 1]).tolist()}, "no covariance"),
        ({"offsets_deg": {"joint_9": 0.1}}, "joint_9"),
    ],
)
def test_offsets_of_another_arm_and_wrong_ones_are_refused(write, content, named):
    with pytest.raises(ArmError, match=named):
        Arm.load(joint_offsets=write(**content), serial="7")


def test_the_same_arm_is_taken(write, tmp_path):
    known = Arm.load()
    path = write(serial=7, model="gen3_lite", model_sha256=known.sha256)
    assert read_offsets_file(path).serial == "7"
    links = {"T_camera_effector": np.eye(4).tolist(), "T_base_lidar": np.eye(4).tolist()}
    rig = tmp_path / "rig.yaml"
    rig.write_text(yaml.safe_dump({"arm": {"serial": 7, "joint_offsets": path.name}, **links}))
    arm = load_rig(rig).load_arm()
    assert arm.serial == "7"
    assert arm.joint_offsets["joint_2"] == pytest.approx(np.deg2rad(-1.0))


def test_a_real_arms_offsets_are_uncertain_unless_the_rig_says_otherwise():
    links = {"T_camera_effector": np.eye(4).tolist(), "T_base_lidar": np.eye(4).tolist()}
    assert Rig.from_dict(links).arm.joint_offset_std_deg == 0.75


def test_a_joint_given_twice_is_refused(tmp_path):
    path = tmp_path / "arm.yaml"
    path.write_text("serial: 7\noffsets_deg:\n  joint_2: 0.1\n  joint_3: 0.2\n  joint_2: 1.0\n")
    with pytest.raises(ArmError, match=r":5: offsets_deg\.joint_2 is given twice, first in line 3"):
        read_offsets_file(path)
