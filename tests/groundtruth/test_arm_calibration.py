from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from lcdata.arm import Arm, read_joint_offsets
from lcdata.errors import ArmError, GroundTruthError
from lcdata.groundtruth.arm_calibration import Socket, calibrate_arm, read_sockets
from lcdata.groundtruth.ball_in_socket import Model

# Like Kinova's Jaco: continuous joints 1, 4 and 6, and another convention of axes.
CONTINUOUS = """<robot name="spinner">
  <link name="base"/><link name="a"/><link name="b"/><link name="c"/><link name="d"/>
  <link name="e"/><link name="tip"/>
  <joint name="turn" type="continuous"><parent link="base"/><child link="a"/>
    <origin xyz="0 0 0.28"/><axis xyz="0 0 -1"/></joint>
  <joint name="shoulder" type="revolute"><parent link="a"/><child link="b"/>
    <origin xyz="0 0 0"/><axis xyz="0 1 0"/>
    <limit lower="-2.3" upper="2.3" velocity="1" effort="1"/></joint>
  <joint name="elbow" type="revolute"><parent link="b"/><child link="c"/>
    <origin xyz="0.41 0 0"/><axis xyz="0 1 0"/>
    <limit lower="-2.8" upper="2.8" velocity="1" effort="1"/></joint>
  <joint name="roll" type="continuous"><parent link="c"/><child link="d"/>
    <origin xyz="0.21 0 0"/><axis xyz="1 0 0"/></joint>
  <joint name="pitch" type="revolute"><parent link="d"/><child link="e"/>
    <origin xyz="0.1 0.05 0"/><axis xyz="0 1 0"/>
    <limit lower="-2" upper="2" velocity="1" effort="1"/></joint>
  <joint name="twist" type="continuous"><parent link="e"/><child link="tip"/>
    <origin xyz="0.16 0 0"/><axis xyz="1 0 0"/></joint>
</robot>"""

OFFSETS = np.deg2rad([0.0, 1.4, 0.6, 1.0, -0.7, 0.0])
BALL = np.array([0.03, -0.02, 0.15])
PLACES = {
    "front": [0.4, 0.0, 0.1],
    "left": [0.2, 0.35, 0.05],
    "right": [0.15, -0.35, 0.1],
    "high": [0.3, 0.1, 0.5],
}


@pytest.fixture(params=["gen3_lite", "continuous joints"])
def arm(request, tmp_path) -> Arm:
    if request.param == "gen3_lite":
        return Arm.load("gen3_lite")
    path = tmp_path / "spinner.urdf"
    path.write_text(CONTINUOUS)
    return Arm(path, "base", "tip")


@pytest.fixture
def gen3() -> Arm:
    return Arm.load("gen3_lite")


def reach(rng, arm: Arm, place, n: int) -> np.ndarray:
    """(n, 6) true joint positions with the ball at a place, found from random starts."""
    model, x = Model(arm, 1.0), np.concatenate([BALL, np.zeros(6)])
    q = rng.uniform(-1.8, 1.8, (25 * n, 6))
    for _ in range(30):
        balls, J = model.balls(q, x)
        steps = np.linalg.pinv(J[:, :, 3:]) @ (balls - place)[:, :, None]
        q = q - np.clip(steps[:, :, 0], -0.3, 0.3)
    good = (np.abs(balls - place).max(axis=1) < 1e-9) & (np.abs(q).max(axis=1) < 1.9)
    assert good.sum() >= n
    return q[good][:n]


def simulated(arm: Arm, seed=0, readings=12, noise_deg=0.02, tools=PLACES) -> list[Socket]:
    rng = np.random.default_rng(seed)
    sockets = []
    for tool, place in tools.items():
        for name, shift in (("hole_0", 0.0), ("hole_1", 0.05)):
            q = reach(rng, arm, np.add(place, [0, shift, 0]), readings)
            noise = rng.normal(0, np.deg2rad(noise_deg), q.shape)
            sockets.append(Socket(tool, name, q - OFFSETS + noise))
    return sockets


def test_joint_offsets_are_found_and_help_where_the_tool_was_not(arm):
    found = calibrate_arm(arm, simulated(arm))
    offsets = np.array(list(found.offsets_deg.values()))
    std = np.array(list(found.offsets_std_deg.values()))
    assert (np.abs(offsets - np.rad2deg(OFFSETS))[1:5] < 4 * std[1:5]).all()
    assert std[1:5].max() < 0.1
    assert found.heldout_nominal_rms_mm > 3 and found.heldout_rms_mm < 0.6
    assert found.fitted_rms_mm <= found.heldout_rms_mm < found.heldout_max_mm
    assert found.socket_distance_mm == pytest.approx(50, abs=0.3)
    np.testing.assert_allclose(found.ball[:2], BALL[:2], atol=3e-3)
    assert found.moved == () and found.readings == 96
    # Turning the base, or the ball about the last axis, says nothing about the sockets.
    assert found.undetermined == tuple(f"offset of {arm.joint_names[k]}" for k in (0, 5))
    np.testing.assert_allclose(offsets[[0, 5]], 0, atol=1e-2)
    np.testing.assert_allclose(std[[0, 5]], 2, rtol=0.1)


def test_the_offsets_go_through_the_file_that_a_rig_names(gen3, tmp_path):
    found = calibrate_arm(gen3, simulated(gen3, readings=6))
    path = tmp_path / "AB123.yaml"
    path.write_text(found.offsets_yaml("AB123"))
    again = Arm(gen3.urdf, joint_offsets=read_joint_offsets(path))
    q = np.array([0.3, -0.4, 0.8, 0.2, -0.9, 1.0])
    np.testing.assert_allclose(again.forward(q), found.arm.forward(q), atol=2e-6)
    content = yaml.safe_load(path.read_text())
    assert content["serial"] == "AB123" and content["model"] == "gen3_lite"
    arm = Arm.load(joint_offsets=path)
    np.testing.assert_allclose(arm.offset_covariance, found.covariance, atol=1e-9)
    assert content["undetermined"] == ["offset of joint_1", "offset of joint_6"]
    json = found.to_dict()
    assert {"nominal_rms_mm", "fitted_rms_mm", "heldout_nominal_rms_mm", "heldout_rms_mm"} < set(
        json
    )
    assert {"socket_distance_mm", "offsets_deg", "offsets_std_deg"} < set(json)


def test_a_calibrated_arm_needs_no_more_offsets(gen3):
    sockets = simulated(gen3, readings=6)
    once = calibrate_arm(gen3, sockets)
    twice = calibrate_arm(once.arm, sockets)
    for name, value in once.offsets_deg.items():
        assert twice.offsets_deg[name] == pytest.approx(value, abs=0.02)
    assert twice.nominal_rms_mm < 1 < once.nominal_rms_mm


def test_a_socket_that_moved_is_named_and_does_not_mislead(gen3):
    sockets = simulated(gen3, seed=1)
    rng = np.random.default_rng(5)
    later = reach(rng, gen3, np.add(PLACES["front"], [0.012, 0, 0]), 6) - OFFSETS
    sockets[0] = replace(sockets[0], positions=np.vstack([sockets[0].positions[:6], later]))
    found = calibrate_arm(gen3, sockets)
    assert len(found.moved) == 1
    assert found.moved[0].startswith("front/hole_0 after reading 6: 1")
    for k in range(1, 5):
        name = gen3.joint_names[k]
        error = found.offsets_deg[name] - np.rad2deg(OFFSETS[k])
        assert abs(error) < 4 * found.offsets_std_deg[name]
    assert found.heldout_steady_rms_mm < 0.6 < found.heldout_rms_mm


def test_kinematic_parameters_are_regularised_and_named(gen3):
    found = calibrate_arm(gen3, simulated(gen3, readings=8), kinematics=True)
    assert found.link_twists is not None and found.link_twists.shape == (7, 6)
    assert np.abs(found.link_twists[:, :3]).max() < 1e-3
    assert found.heldout_rms_mm < 0.6
    assert any(name.startswith("link before joint_") for name in found.undetermined)


@pytest.mark.parametrize("which", ["nominal", "fitted"])
def test_the_jacobian_equals_finite_differences(arm, which):
    rng = np.random.default_rng(3)
    model = Model(arm, 0.0 if which == "nominal" else 0.1, (1e-3, 1e-3))
    x, q = rng.normal(0, 0.05, len(model.std)), rng.uniform(-1.5, 1.5, (5, 6))
    _, J = model.balls(q, x)
    step = 1e-6 * np.eye(len(x))
    for k in range(9 if which == "fitted" else 3):
        numeric = (model.balls(q, x + step[k])[0] - model.balls(q, x - step[k])[0]) / 2e-6
        np.testing.assert_allclose(J[:, :, k], numeric, atol=1e-8)
    # Twists of the links are left perturbations: their Jacobian holds at a twist of zero.
    x[-30:] = 0
    _, J = model.balls(q, x)
    for k in range(len(x) - 30, len(x)):
        numeric = (model.balls(q, x + step[k])[0] - model.balls(q, x - step[k])[0]) / 2e-6
        np.testing.assert_allclose(J[:, :, k], numeric, atol=1e-8)


def test_one_place_of_the_tool_has_no_held_out_figures(gen3):
    found = calibrate_arm(gen3, simulated(gen3, tools={"front": PLACES["front"]}))
    assert np.isnan(found.heldout_rms_mm) and np.isnan(found.socket_distance_mm)
    assert found.to_dict()["heldout_rms_mm"] is None
    assert found.fitted_rms_mm < 0.6


def write_csv(path: Path, header: str, rows) -> Path:
    path.write_text("\n".join([header, *(",".join(map(str, row)) for row in rows)]) + "\n")
    return path


def test_both_layouts_say_the_same(gen3, tmp_path):
    names, q = gen3.joint_names, np.random.default_rng(0).uniform(-1, 1, (4, 6))
    for i, (tool, socket) in enumerate([("a", "hole_0"), ("a", "hole_1"), ("b", "hole_0")]):
        (tmp_path / "data" / tool).mkdir(parents=True, exist_ok=True)
        rows = np.column_stack([q + i, np.full(4, 9)])  # a further column
        np.savetxt(tmp_path / "data" / tool / f"{socket}.csv", rows, delimiter=",")
    table = [
        [9, tool, *row, socket]
        for i, (tool, socket) in enumerate([("a", "hole_0"), ("a", "hole_1"), ("b", "hole_0")])
        for row in (q + i).tolist()
    ]
    path = write_csv(tmp_path / "all.csv", f"stamp,tool,{','.join(names)},socket", table)
    for folder, plain in zip(
        read_sockets(tmp_path / "data", names), read_sockets(path, names), strict=True
    ):
        assert str(folder) == str(plain)
        np.testing.assert_allclose(folder.positions, plain.positions)


def test_bad_files_are_named(gen3, tmp_path):
    names = gen3.joint_names
    folder = tmp_path / "data" / "front"
    with pytest.raises(GroundTruthError, match=r"nowhere.*cannot be read"):
        read_sockets(tmp_path / "nowhere", names)
    folder.mkdir(parents=True)
    with pytest.raises(GroundTruthError, match=r"no TOOL/SOCKET\.csv"):
        read_sockets(tmp_path / "data", names)
    (folder / "hole_0.csv").write_text("1,2,3,4,5,6\n1,2,3,4,5\n")
    with pytest.raises(GroundTruthError, match=r"hole_0\.csv: reading 2 has 5 columns.*joint_6"):
        read_sockets(tmp_path / "data", names)
    (folder / "hole_0.csv").write_text("1,2,x,4,5,6\n")
    with pytest.raises(GroundTruthError, match="joint_3 of reading 1 is 'x'"):
        read_sockets(tmp_path / "data", names)
    path = write_csv(tmp_path / "t.csv", "tool,socket,joint_1,joint_2,joint_3,joint_5,joint_6", [])
    with pytest.raises(GroundTruthError, match="no column joint_4; it has tool, socket"):
        read_sockets(path, names)
    path = write_csv(tmp_path / "t.csv", f"tool,socket,{','.join(names)}", [["a", "b", 1]])
    with pytest.raises(GroundTruthError, match="3 of 8 columns"):
        read_sockets(path, names)


def test_readings_that_cannot_be_used(gen3):
    few = [Socket("a", "hole_0", np.zeros((3, 6))), Socket("b", "hole_0", np.zeros((2, 6)))]
    with pytest.raises(GroundTruthError, match="5 readings in 2 sockets cannot determine 9"):
        calibrate_arm(gen3, few)
    with pytest.raises(GroundTruthError, match="0 readings"):
        calibrate_arm(gen3, [])
    degrees = [Socket("a", "hole_0", np.full((20, 6), 40.0))]
    with pytest.raises(ArmError, match=r"a/hole_0 reading 1: joint_1 is at 2291\.83 deg.*radians"):
        calibrate_arm(gen3, degrees)
    with pytest.raises(ArmError, match="joint_1 is at nan"):
        calibrate_arm(gen3, [Socket("a", "hole_0", np.full((20, 6), np.nan))])
    with pytest.raises(GroundTruthError, match=r"shape \(20, 7\)"):
        calibrate_arm(gen3, [Socket("a", "hole_0", np.zeros((20, 7)))])


def test_a_real_arm_held_out_by_place_of_the_tool(gen3, shared: Path, capsys):
    sockets = read_sockets(shared / "data" / "gen3_lite_sockets", gen3.joint_names)
    found = calibrate_arm(gen3, sockets)
    with capsys.disabled():
        print(
            f"\nreal Gen3 lite: held out {found.heldout_nominal_rms_mm:.2f} mm RMS nominal, "
            f"{found.heldout_rms_mm:.2f} with joint offsets"
        )
    assert found.readings == 137
    assert found.nominal_rms_mm == pytest.approx(6.12, abs=0.1)
    assert found.heldout_nominal_rms_mm == pytest.approx(6.2, abs=0.1)
    assert found.heldout_rms_mm <= 3.7
    # Each place's sockets by the fit to the other places; they are 50 mm apart.
    assert found.socket_distance_mm == pytest.approx(50, abs=0.5)
    assert [name.split(" after")[0] for name in found.moved] == ["front/hole_0", "front/hole_1"]
