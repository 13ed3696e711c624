from __future__ import annotations

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from lcdata.errors import ArmError, LcdataError, RigError
from lcdata.rig import Rig, load_rig

ARM = """\
ground_truth: arm
topics: {lidar: /ouster/points}
arm: {model: gen3_lite, effector_frame: tool_frame, encoder_std_deg: 0.05}
T_camera_effector:
  translation_m: [0.01, 0.02, -0.05]
  rotation_rpy_deg: [0, 0, 90]
  translation_std_m: 0.003
  rotation_std_deg: [0.1, 0.2, 0.3]
T_base_lidar:
  matrix: [[1, 0, 0, 0.1], [0, 1, 0, 0], [0, 0, 1, 0.4], [0, 0, 0, 1]]
  translation_std_m: [0.001, 0.002, 0.003]
  rotation_std_deg: 0.5
dwells: {max_velocity_deg_s: 1.0}
"""


def write(folder, text):
    path = folder / "rig.yaml"
    path.write_text(text)
    return path


def test_one_line_is_enough_without_an_arm(tmp_path):
    rig = load_rig(write(tmp_path, "ground_truth: static"))
    assert (rig.ground_truth, rig.topics.lidar, rig.camera_model()) == ("static", "auto", None)


def test_links_and_their_covariances(tmp_path):
    rig = load_rig(write(tmp_path, ARM))
    link = rig.T_camera_effector
    np.testing.assert_allclose(
        link.T[:3, :3], Rotation.from_rotvec([0, 0, np.pi / 2]).as_matrix(), atol=1e-12
    )
    np.testing.assert_allclose(link.T[:3, 3], [0.01, 0.02, -0.05])
    np.testing.assert_allclose(
        np.sqrt(np.diag(link.covariance)),
        [0.003, 0.003, 0.003, *np.deg2rad([0.1, 0.2, 0.3])],
    )
    assert rig.load_arm().effector_frame == "tool_frame"
    assert rig.dwells.max_velocity_deg_s == 1.0
    assert rig.dwells.min_duration_s == Rig(ground_truth="static").dwells.min_duration_s


def test_a_rig_written_and_read_again_is_the_same(tmp_path):
    rig = load_rig(write(tmp_path, ARM))
    again = load_rig(write(tmp_path, rig.to_yaml()))
    assert again.to_dict() == rig.to_dict()
    assert Rig.from_dict(rig.to_dict()).to_dict() == rig.to_dict()


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("ground_truth: static\ndwels: {}", r"rig.yaml:2: unknown key dwels: did you mean dwells"),
        (
            "ground_truth: static\n\ndwells:\n  max_velocty_deg_s: 3",
            r":4: unknown key dwells.max_velocty_deg_s: did you mean max_velocity_deg_s",
        ),
        ("ground_truth: static\nzebra: 1", r":2: unknown key zebra: known are ground_truth"),
        ("ground_truth: maybe", r":1: ground_truth is 'maybe': .*'arm' or 'static'"),
        (
            "ground_truth: static\npairing: {tolerance_ms: -4}",
            r":2: pairing.tolerance_ms is -4: .*greater than 0",
        ),
        ("ground_truth: static\npairing: {tolerance_ms: .nan}", "finite"),
        ("ground_truth: arm", "needs T_camera_effector and T_base_lidar"),
        ("", "needs T_camera_effector"),
        (ARM + "T_camera_lidar: [[1]]", "T_camera_lidar"),
        ("ground_truth: static\nT_camera_lidar: {matrix: [[1, 0], [0, 1]]}", "shape"),
        (
            "ground_truth: static\nT_camera_lidar:\n  matrix: "
            "[[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, -1, 0], [0, 0, 0, 1]]",
            "reflection",
        ),
        (
            "ground_truth: static\nT_camera_lidar: {translation_m: [0, 0, 0], "
            "rotation_xyzw: [0, 0, 0, 3]}",
            "norm 3",
        ),
        ("ground_truth: static\nT_camera_lidar: {translation_m: [0, 0, 0]}", "rotation_xyzw"),
        (
            "ground_truth: static\ncamera: {width: 9, height: 9, intrinsics: [1, 1, 1, 1], "
            "distortion: [1, 2]}",
            "2 distortion coefficients",
        ),
        ("ground_truth: [", r":1: not YAML"),
        ("- a\n- b", "holds list"),
    ],
)
def test_mistakes_name_place_value_and_what_is_allowed(tmp_path, text, words):
    with pytest.raises(RigError, match=words) as caught:
        load_rig(write(tmp_path, text))
    assert str(caught.value).count("\n") == 0
    assert "rig.yaml" in str(caught.value)


def test_a_missing_file_names_the_command_that_prints_one(tmp_path):
    with pytest.raises(RigError, match="lcdata info"):
        load_rig(tmp_path / "rig.yaml")
    (tmp_path / "binary.yaml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(RigError, match="cannot be read"):
        load_rig(tmp_path / "binary.yaml")


yaml_values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: (
        st.lists(inner, max_size=4)
        | st.dictionaries(
            st.sampled_from(["matrix", "model", "width", "unit", "field", "x"]), inner
        )
    ),
    max_leaves=6,
)


@given(st.dictionaries(st.sampled_from([*Rig.model_fields, "other"]), yaml_values, max_size=4))
def test_whatever_a_file_holds_the_answer_is_a_rig_or_one_line(content):
    try:
        Rig.from_dict(content)
    except LcdataError as error:
        assert "\n" not in str(error)


def correlated(size=12, seed=0):
    root = np.random.default_rng(seed).normal(size=(size, size)) * 1e-3
    return root @ root.T


def refined(covariance):
    content = yaml.safe_load(ARM)
    for name in ("T_camera_effector", "T_base_lidar"):
        for key in ("translation_std_m", "rotation_std_deg"):
            del content[name][key]
    return content | {"links_covariance": np.asarray(covariance).tolist()}


@pytest.mark.parametrize("size", [12, 18])
def test_links_with_a_covariance_of_their_own(tmp_path, size):
    C = correlated(size)
    rig = load_rig(write(tmp_path, yaml.safe_dump(refined(C))))
    np.testing.assert_allclose(rig.covariance_of_links(), C, rtol=1e-12, atol=1e-20)
    again = Rig.from_dict(rig.to_dict())
    np.testing.assert_array_equal(again.covariance_of_links(), rig.covariance_of_links())


@pytest.mark.parametrize(
    ("covariance", "words"),
    [
        (np.eye(6), "6 rows of 6 numbers; give 12x12"),
        (np.ones((12, 11)), "12 rows of 11 numbers"),
        (np.eye(12) + 1e-3 * np.eye(12, k=11), "not symmetric: 0.001 in row 1, column 12"),
        (correlated() - np.eye(12) * 1e-5, "must have none below 0"),
        (np.full((12, 12), np.nan), "finite"),
        ([], "0 rows"),
    ],
)
def test_a_covariance_that_is_none_is_refused(covariance, words):
    with pytest.raises(RigError, match=words) as caught:
        Rig.from_dict(refined(covariance))
    assert "\n" not in str(caught.value)


def test_a_covariance_and_deviations_of_the_same_link_are_refused():
    content = refined(correlated())
    content["T_base_lidar"] |= {"translation_std_m": 0.1, "rotation_std_deg": 0.1}
    with pytest.raises(RigError, match="standard deviations of T_base_lidar: give one"):
        Rig.from_dict(content)
    with pytest.raises(RigError, match="goes with ground_truth: arm"):
        Rig.from_dict({"ground_truth": "static", "links_covariance": correlated().tolist()})


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("ground_truth: arm\nnote: x\nground_truth: static", ":3: ground_truth is .* line 1"),
        (
            "ground_truth: static\ndwells:\n  settle_s: 1\n  settle_s: 2",
            ":4: dwells.settle_s is given twice, first in line 3",
        ),
        ("note: &a [*a]\nnote: *a", ":2: note is given twice"),
    ],
)
def test_a_key_given_twice_is_no_matter_of_chance(tmp_path, text, words):
    with pytest.raises(RigError, match=words):
        load_rig(write(tmp_path, text))


@pytest.mark.parametrize("offset", [0.012, -0.3, "estimate", None])
def test_the_clock_offset_is_a_number_or_left_to_the_images(offset):
    rig = Rig.from_dict(yaml.safe_load(ARM) | {"clock_offset_s": offset})
    assert rig.clock_offset_s == offset
    assert Rig.from_dict(rig.to_dict()).clock_offset_s == offset


@pytest.mark.parametrize("offset", ["auto", 1e6, True, float("nan"), [0.1]])
def test_other_clock_offsets_are_named(offset):
    with pytest.raises(RigError, match=r"clock_offset_s is .*: give the arm's clock minus"):
        Rig.from_dict(yaml.safe_load(ARM) | {"clock_offset_s": offset})


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("model", "gen9", r"arm\.model: no arm model 'gen9'"),
        ("base_frame", "floor", r"arm\.base_frame: gen3_lite\.urdf has no frame 'floor'"),
        ("effector_frame", "hand", r"arm\.effector_frame: gen3_lite\.urdf has no frame 'hand'"),
        ("joint_offsets", "gone.yaml", r"arm\.joint_offsets: .*gone\.yaml: cannot read"),
    ],
)
def test_an_arm_that_cannot_be_loaded_names_file_and_key(tmp_path, key, value, message):
    path = tmp_path / "rig.yaml"
    path.write_text(yaml.safe_dump(yaml.safe_load(ARM) | {"arm": {key: value}}))
    with pytest.raises(ArmError, match=rf"{path}: {message}"):
        load_rig(path).load_arm()


@pytest.mark.parametrize("bare", [True, False])
def test_scans_are_merged_as_the_rig_says(bare):
    content = {"ground_truth": "static"}
    content["integration"] = "dynamic" if bare else {"mode": "dynamic", "voxel_m": 0.02}
    rig = Rig.from_dict(content)
    assert rig.integration.mode == "dynamic"
    assert Rig.from_dict(rig.to_dict()) == rig
    assert "integration" not in Rig.from_dict({"ground_truth": "static"}).to_dict()


@pytest.mark.parametrize(
    ("section", "message"),
    [
        ({"mode": "moving"}, "integration.mode is 'moving'"),
        ({"voxel_m": 0}, "integration.voxel_m is 0"),
        ({"max_scans": 0}, "integration.max_scans is 0"),
        ({"voxels": 1}, "unknown key integration.voxels: did you mean voxel_m"),
    ],
)
def test_wrong_integration_is_named(section, message):
    with pytest.raises(RigError, match=message):
        Rig.from_dict({"ground_truth": "static", "integration": section})


def test_a_lidar_beside_an_arm_does_not_move():
    content = {"T_camera_effector": np.eye(4).tolist(), "T_base_lidar": np.eye(4).tolist()}
    with pytest.raises(RigError, match=r"integration: dynamic .* goes with ground_truth: static"):
        Rig.from_dict({**content, "integration": "dynamic"})
    assert Rig.from_dict({**content, "integration": "static"}).integration.mode == "static"
