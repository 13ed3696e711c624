from __future__ import annotations

import sys
from importlib import metadata

import numpy as np
import pytest

from lcdata.arm import Arm, find_urdf
from lcdata.arm.chain import chain_of
from lcdata.arm.urdf import mesh_folder
from lcdata.errors import ArmError, LcdataError, MissingLibraryError

# A continuous joint about a slanted axis, a slide, and a joint about -y.
MIXED = """<robot name="mixed">
  <link name="base"/><link name="a"/><link name="b"/><link name="c"/><link name="tip"/>
  <joint name="spin" type="continuous"><parent link="base"/><child link="a"/>
    <origin xyz="0 0.1 0.5" rpy="0.2 0.1 -0.4"/><axis xyz="0.6 0 0.8"/></joint>
  <joint name="slide" type="prismatic"><parent link="a"/><child link="b"/>
    <origin xyz="0.3 0 0"/><axis xyz="1 0 0"/>
    <limit lower="-1" upper="1" velocity="1" effort="1"/></joint>
  <joint name="bend" type="revolute"><parent link="b"/><child link="c"/>
    <origin xyz="0 0 0.2" rpy="0 0.3 0"/><axis xyz="0 -1 0"/>
    <limit lower="-2" upper="2" velocity="1" effort="1"/></joint>
  <joint name="flange" type="fixed"><parent link="c"/><child link="tip"/>
    <origin xyz="0.2 0 0.1" rpy="1 0 0"/></joint>
</robot>"""


@pytest.fixture
def mixed(tmp_path) -> Arm:
    path = tmp_path / "mixed.urdf"
    path.write_text(MIXED)
    return Arm(path, "base", "tip", {"bend": 0.02})


ARMS = {
    "gen3_lite": lambda _: Arm.load("gen3_lite", effector_frame="tool_frame"),
    "from the shoulder": lambda _: Arm.load("gen3_lite", base_frame="shoulder_link"),
    "continuous and sliding joints": lambda request: request.getfixturevalue("mixed"),
}


@pytest.mark.parametrize("make", ARMS.values(), ids=ARMS.keys())
def test_the_chain_and_the_kernels_equal_pinocchio(make, request):
    arm = make(request)
    n = len(arm.joint_names)
    q = np.random.default_rng(0).uniform(-2, 2, (200, n))
    std = np.random.default_rng(1).uniform(0.001, 0.01, (200, n))
    poses = np.array([arm.forward(row) for row in q])
    jacobians = np.array([arm.jacobian(row) for row in q])
    expected = np.einsum("nik,nk,njk->nij", jacobians, std**2, jacobians)
    chain = arm.chain()
    np.testing.assert_allclose(chain.forward(arm.with_offsets(q)), poses, atol=1e-12)
    for ours, theirs in zip(chain.jacobians(arm.with_offsets(q)), (poses, jacobians), strict=True):
        np.testing.assert_allclose(ours, theirs, atol=1e-12)
    np.testing.assert_allclose(arm.forward_many(q), poses, atol=1e-12)
    many, covariances = arm.covariance_many(q, std)
    np.testing.assert_allclose(many, poses, atol=1e-12)
    np.testing.assert_allclose(covariances, expected, atol=1e-12)
    _, same = arm.covariance_many(q, std[0])
    np.testing.assert_allclose(same[0], expected[0], atol=1e-12)


def test_arrays_of_another_arm_are_refused(mixed):
    with pytest.raises(ArmError, match=r"\(4, 2\).*spin, slide, bend"):
        mixed.forward_many(np.zeros((4, 2)))
    with pytest.raises(ArmError, match="standard deviations"):
        mixed.covariance_many(np.zeros((4, 3)), np.zeros(2))


def test_joints_with_several_degrees_of_freedom_are_refused(tmp_path):
    path = tmp_path / "floating.urdf"
    path.write_text(
        '<robot name="f"><link name="base"/><link name="tip"/><joint name="free" type="floating">'
        '<parent link="base"/><child link="tip"/></joint></robot>'
    )
    arm = Arm(path, "base", "tip")
    with pytest.raises(ArmError, match="free is a"):
        chain_of(arm.model, arm.joint_names, *map(arm.model.getFrameId, ("base", "tip")))


def test_a_model_of_example_robot_data_is_found_by_name(tmp_path, monkeypatch):
    """A distribution laid out as the wheel lays it out: files, and no module."""
    urdf = tmp_path / "cmeel.prefix/share/example-robot-data/robots/x/urdf/mixed_robot.urdf"
    info = tmp_path / "example_robot_data-6.0.0.dist-info"
    urdf.parent.mkdir(parents=True)
    info.mkdir()
    urdf.write_text(MIXED)
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: example-robot-data\nVersion: 6\n")
    (info / "RECORD").write_text(f"{urdf.relative_to(tmp_path).as_posix()},,\n")
    monkeypatch.setattr(sys, "path", [str(tmp_path)])
    assert find_urdf("example-robot-data:mixed") == urdf.resolve()
    with pytest.raises(ArmError, match=r"no ur5\.urdf.*mixed_robot"):
        find_urdf("example-robot-data:ur5")


def installed() -> bool:
    try:
        return bool(metadata.files("example-robot-data"))
    except metadata.PackageNotFoundError:
        return False


@pytest.mark.skipif(installed(), reason="example-robot-data is installed")
def test_without_example_robot_data_the_remedy_is_named():
    with pytest.raises(MissingLibraryError, match=r"lcdata\[arms\]"):
        find_urdf("example-robot-data:ur5")


@pytest.mark.skipif(not installed(), reason="example-robot-data (440 MB) is not installed")
@pytest.mark.parametrize(
    ("name", "base", "effector"),
    [("ur5", "base_link", "tool0"), ("kinova", "j2s6s200_link_base", "j2s6s200_end_effector")],
)
def test_arms_of_example_robot_data(name, base, effector):
    try:
        arm = Arm.load(f"example-robot-data:{name}", base_frame=base, effector_frame=effector)
    except LcdataError as error:
        pytest.fail(str(error))
    q = np.random.default_rng(2).uniform(-1, 1, (20, len(arm.joint_names)))
    expected = np.array([arm.forward(row) for row in q])
    np.testing.assert_allclose(arm.forward_many(q), expected, atol=1e-12)
    folder = mesh_folder(arm.urdf)  # which the review's meshes come from
    assert folder is not None and (folder / "example-robot-data" / "robots").is_dir()
