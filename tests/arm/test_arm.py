from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from lcdata.arm import Arm, find_urdf, read_joint_offsets
from lcdata.errors import ArmError
from lcdata.geometry import se3

CONTINUOUS = """<robot name="two">
  <link name="base"/><link name="a"/><link name="b"/><link name="tip"/>
  <joint name="spin" type="continuous"><parent link="base"/><child link="a"/>
    <origin xyz="0 0 0.5"/><axis xyz="0 0 1"/></joint>
  <joint name="bend" type="revolute"><parent link="a"/><child link="b"/>
    <origin xyz="0.3 0 0"/><axis xyz="0 1 0"/>
    <limit lower="-2" upper="2" velocity="1" effort="1"/></joint>
  <joint name="flange" type="fixed"><parent link="b"/><child link="tip"/>
    <origin xyz="0.2 0 0"/></joint>
</robot>"""

# Kinova's table (see arm_models/gen3_lite): translation and fixed rotation before each joint.
GEN3_LITE = [
    ((0, 0, 0.12825), (0, 0, 0)),
    ((0, -0.03, 0.115), (90, 0, 0)),
    ((0, 0.28, 0), (-180, 0, 0)),
    ((0, -0.14, 0.02), (90, 0, 0)),
    ((0.0285, 0, 0.105), (0, 90, 0)),
    ((-0.105, 0, 0.0285), (0, -90, 0)),
]


@pytest.fixture(scope="module")
def arm() -> Arm:
    return Arm.load("gen3_lite")


def random_positions(seed: int, n: int) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-2.4, 2.4, (n, 6))


def test_forward_kinematics_is_the_product_of_the_published_links(arm):
    for q in random_positions(1, 20):
        expected = np.eye(4)
        for (xyz, rpy), angle in zip(GEN3_LITE, q, strict=True):
            link = np.eye(4)
            link[:3, 3] = xyz
            link[:3, :3] = (
                Rotation.from_euler("xyz", rpy, degrees=True) * Rotation.from_rotvec([0, 0, angle])
            ).as_matrix()
            expected = expected @ link
        np.testing.assert_allclose(arm.forward(q), expected, atol=1e-12)


def test_zero_position(arm):
    np.testing.assert_allclose(arm.forward(np.zeros(6))[:3, 3], [0.057, -0.010, 0.87325], atol=1e-9)


def test_tool_frame_is_130_mm_and_90_degrees_further(arm):
    tool = Arm.load("gen3_lite", effector_frame="tool_frame")
    q = random_positions(2, 1)[0]
    T_effector_tool = se3.inverse(arm.forward(q)) @ tool.forward(q)
    np.testing.assert_allclose(T_effector_tool[:3, 3], [0, 0, 0.13], atol=1e-12)
    assert se3.rotation_error(T_effector_tool, np.eye(4)) == pytest.approx(np.pi / 2)


@pytest.mark.parametrize("base_frame", ["base_link", "shoulder_link"])
def test_jacobian_equals_finite_differences(base_frame):
    arm = Arm.load("gen3_lite", base_frame=base_frame)
    n = len(arm.joint_names)
    for q in random_positions(3, 5)[:, :n]:
        T_effector_base = se3.inverse(arm.forward(q))
        numeric = np.column_stack(
            [
                se3.log(T_effector_base @ arm.forward(q + d))
                - se3.log(T_effector_base @ arm.forward(q - d))
                for d in np.eye(n) * 1e-6
            ]
        )
        np.testing.assert_allclose(arm.jacobian(q), numeric / 2e-6, atol=1e-7)


def test_continuous_joints_and_frames_of_another_urdf(tmp_path):
    path = tmp_path / "two.urdf"
    path.write_text(CONTINUOUS)
    arm = Arm.load(path, base_frame="base", effector_frame="tip")
    assert arm.joint_names == ("spin", "bend")
    q = np.array([5.0, -0.7])  # 5 rad: a continuous joint has no limit
    arm.check_limits(q)
    expected = Rotation.from_euler("ZY", q).as_matrix()
    T = arm.forward(q)
    np.testing.assert_allclose(T[:3, :3], expected, atol=1e-12)
    spun = Rotation.from_rotvec([0, 0, 5.0]).apply([0.3, 0, 0])
    np.testing.assert_allclose(T[:3, 3], spun + [0, 0, 0.5] + expected @ [0.2, 0, 0], atol=1e-12)
    step = np.array([1e-6, 0])
    numeric = se3.log(se3.inverse(T) @ arm.forward(q + step)) / 1e-6
    np.testing.assert_allclose(arm.jacobian(q)[:, 0], numeric, atol=1e-5)
    with pytest.raises(ArmError, match="bend is at"):
        arm.check_limits([0, 2.3])


def test_joint_states_come_in_any_order_with_other_devices(arm):
    names = ["finger", "joint_4", "joint_2", "joint_1", "joint_6", "joint_5", "joint_3"]
    ordered = arm.order(names, [[9, 4, 2, 1, 6, 5, 3], [0, 40, 20, 10, 60, 50, 30]])
    assert ordered.tolist() == [[1, 2, 3, 4, 5, 6], [10, 20, 30, 40, 50, 60]]
    with pytest.raises(ArmError, match=r"lack joint_1.*they have elbow"):
        arm.order(["elbow"], [1.0])


def test_joints_outside_their_limits_are_named(arm):
    q = np.zeros(6)
    q[2] = 2.9
    with pytest.raises(ArmError, match=r"joint_3 is at 166\.16 deg.*149\.54"):
        arm.check_limits(q)
    q[2] = np.nan
    with pytest.raises(ArmError, match="joint_3 is at nan"):
        arm.check_limits(q)


def test_an_arm_moved_by_hand_goes_past_the_limits_that_its_controller_keeps(arm):
    q = np.deg2rad([0, 0, 0, 0, 0, -157.1])  # a real one
    arm.check_limits(q)
    (text,) = arm.outside_limits(q)
    assert text == "joint_6 is at -157.10 deg, outside its limits [-148.97, 148.97] deg"
    assert not list(arm.outside_limits(np.deg2rad([0, 0, 0, 0, 0, -149.5])))


def test_joint_offsets_are_added_to_the_readings(arm, tmp_path):
    path = tmp_path / "arm.yaml"
    path.write_text("serial: A1\noffsets_deg: {joint_2: 1.5}\n")
    calibrated = Arm.load("gen3_lite", joint_offsets=path)
    q = random_positions(4, 1)[0]
    moved = q + np.deg2rad([0, 1.5, 0, 0, 0, 0])
    np.testing.assert_allclose(calibrated.forward(q), arm.forward(moved), atol=1e-12)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "offsets_deg"),
        ("offsets_deg: {joint_1: much}", "much"),
        ("offsets_deg: [", "cannot read"),
        ("offsets_deg: {joint_1: .nan}", "nan"),
    ],
)
def test_bad_offset_files(tmp_path, text, words):
    path = tmp_path / "arm.yaml"
    path.write_text(text)
    with pytest.raises(ArmError, match=words):
        read_joint_offsets(path)


def test_offset_of_a_joint_that_the_arm_lacks(arm):
    with pytest.raises(ArmError, match="joint_7"):
        Arm(arm.urdf, joint_offsets={"joint_7": 0.1})


def test_unknown_models_and_frames_name_what_there_is(tmp_path):
    with pytest.raises(ArmError, match="gen3_lite"):
        Arm.load("gen4")
    with pytest.raises(ArmError, match="tool_frame"):
        Arm.load("gen3_lite", effector_frame="gripper")
    with pytest.raises(ArmError, match="does not hang"):
        Arm.load("gen3_lite", base_frame="tool_frame", effector_frame="base_link")
    for name, text in {"empty.urdf": "", "broken.urdf": "<robot"}.items():
        path = tmp_path / name
        path.write_text(text)
        with pytest.raises(ArmError, match="not a URDF"):
            Arm.load(path)


def test_the_package_brings_its_model():
    assert find_urdf("gen3_lite").is_file()


def test_a_ball_in_a_socket_shows_how_far_the_real_arm_is_off_its_model(arm, shared: Path, capsys):
    """Real readings; every row of a file has the ball at one place, were the model right."""
    files = sorted((shared / "data" / "gen3_lite_sockets").glob("*/hole_*.csv"))
    rows, right = [], []
    for socket, path in enumerate(files):
        # Unknown: the ball's place on the effector (one for all), and each socket's place.
        for q in np.loadtxt(path, delimiter=",")[:, :6]:
            T = arm.forward(q)
            row = np.zeros((3, 3 + 3 * len(files)))
            row[:, :3] = T[:3, :3]
            row[:, 3 + 3 * socket : 6 + 3 * socket] = -np.eye(3)
            rows.append(row)
            right.append(-T[:3, 3])
    A, b = np.concatenate(rows), np.concatenate(right)
    residuals = (A @ np.linalg.lstsq(A, b, rcond=None)[0] - b).reshape(-1, 3)
    assert len(residuals) == 137
    rms_mm = 1e3 * np.sqrt((residuals**2).sum(1).mean())
    with capsys.disabled():
        print(f"\nreal Gen3 lite, nominal model: socket scatter {rms_mm:.2f} mm RMS")
    assert 4 < rms_mm < 8
