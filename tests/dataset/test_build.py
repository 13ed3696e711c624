"""Recordings in, data set out."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from recording.bags import MS, START, write

from lcdata.arm import Arm
from lcdata.dataset import BuildSummary, Dataset, build, schema, validate
from lcdata.dataset.journal import NAME
from lcdata.errors import DatasetError, LcdataError, RecordingError, RigError, TopicError
from lcdata.geometry import se3
from lcdata.rig import load_rig

from . import runs


def test_a_run_of_the_arm(tmp_path: Path) -> None:
    source = runs.recordings(tmp_path / "in", run=runs.run(poses=3, pairs=4))
    calls: list[tuple[str, int, int]] = []
    made = build(source, tmp_path / "out", progress=lambda *call: calls.append(call))
    assert made.failures == []
    assert made.poses == 3
    assert calls[-1] == ("packaging run", made.pairs, made.pairs)
    assert validate(tmp_path / "out") == []
    dataset = made.dataset
    assert dataset.info.simulated
    assert [pose.pose_id for pose in dataset.poses] == [f"run/pose_{i:03}" for i in range(3)]
    rig, arm = load_rig(source / "rig.yaml"), Arm.load()
    assert rig.T_camera_effector is not None and rig.T_base_lidar is not None
    for pose, q in zip(dataset.poses, runs.goals(3), strict=True):
        np.testing.assert_allclose(pose.joint_positions, q, atol=1e-6)
        expected = rig.T_camera_effector.T @ se3.inverse(arm.forward(q)) @ rig.T_base_lidar.T
        np.testing.assert_allclose(pose.T_camera_lidar, expected, atol=1e-5)
        assert np.isfinite(pose.covariance).all()
        assert pose.samples > 30
    assert dataset.info.arm is not None
    assert dataset.info.arm["sha256"] == arm.sha256
    for record in dataset.pairs:
        assert record.dt_ns == 7 * MS
        pair = dataset.load(record.pair_id)
        step = (record.stamp_lidar_ns - START) // (10 * MS)
        written = runs.records(step, 4, 32)
        assert pair.organised == (4, 32)
        np.testing.assert_array_equal(pair.ring, written["ring"])
        expected_points = np.stack([written[name] for name in "xyz"], 1)
        expected_points[~expected_points.any(1)] = np.nan
        np.testing.assert_array_equal(pair.points, expected_points)
        assert (tmp_path / "out" / record.image).read_bytes() == runs.jpeg(step)


def test_built_again_there_is_nothing_to_do(tmp_path: Path) -> None:
    source = runs.recordings(tmp_path / "in", run=runs.run())
    first = build(source, tmp_path / "out")
    stats = {path: path.stat().st_mtime_ns for path in (tmp_path / "out").rglob("*")}
    again = build(source, tmp_path / "out")
    assert (again.pairs, again.poses) == (first.pairs, first.poses)
    assert stats == {path: path.stat().st_mtime_ns for path in (tmp_path / "out").rglob("*")}
    (tmp_path / "out" / again.dataset.pairs[0].cloud).unlink()
    with pytest.raises(DatasetError, match=r"1 files are missing.*--force"):
        build(source, tmp_path / "out")
    assert build(source, tmp_path / "out", force=True).pairs == first.pairs
    assert validate(tmp_path / "out") == []


def test_few_pairs_of_each_pose(tmp_path: Path) -> None:
    source = runs.recordings(tmp_path / "in", run=runs.run(pairs=8))
    every = build(source, tmp_path / "all").dataset
    few = build(source, tmp_path / "few", pairs_per_pose=2).dataset
    assert [pair.pair_id for pair in few.pairs] == [
        f"run/pose_{pose:03}/{number:03}" for pose in range(2) for number in range(2)
    ]
    assert {p.stamp_lidar_ns for p in few.pairs} < {p.stamp_lidar_ns for p in every.pairs}
    with pytest.raises(DatasetError, match="--force"):
        build(source, tmp_path / "few", pairs_per_pose=3)


def test_without_an_arm(tmp_path: Path) -> None:
    source = runs.recordings(tmp_path / "in", runs.STATIC, street=runs.still(3))
    dataset = build(source, tmp_path / "out").dataset
    assert [pose.pose_id for pose in dataset.poses] == ["street/pose_000"]
    pose = dataset.poses[0]
    expected = se3.from_xyz_xyzw([0.1, 0.2, 0.3, 0.5, -0.5, 0.5, 0.5])
    np.testing.assert_allclose(pose.T_camera_lidar, expected, atol=1e-12)
    assert np.isnan(pose.covariance).all()
    assert pose.T_camera_effector is None
    assert dataset.info.arm is None
    assert len(dataset) == 3
    assert validate(tmp_path / "out") == []
    assert next(iter(dataset)).organised is None


def test_the_rig_may_give_the_extrinsic(tmp_path: Path) -> None:
    rig = (
        "ground_truth: static\nT_camera_lidar: {translation_m: [1, 2, 3], rotation_rpy_deg: "
        "[0, 0, 0], translation_std_m: 0.01, rotation_std_deg: 0.1}\n"
    )
    source = runs.recordings(tmp_path / "in", rig, street=runs.still(tf=False))
    pose = build(source, tmp_path / "out").dataset.poses[0]
    np.testing.assert_array_equal(pose.T_camera_lidar[:3, 3], [1, 2, 3])
    np.testing.assert_allclose(pose.covariance[0, 0], 1e-4)


def test_several_recordings_and_what_is_wrong_with_some(tmp_path: Path) -> None:
    def without_rest(topic: str, number: int, message: Any) -> Any:
        if topic == "/joint_states":  # always on the move
            message.position[:] = number * 0.003
        return message

    source = runs.recordings(
        tmp_path / "in",
        good=runs.run(),
        restless=runs.run(change=without_rest),
        blind=runs.run(change=lambda topic, _, message: message if "image" not in topic else None),
    )
    (source / "empty.bag").write_bytes(b"")
    cut = write(tmp_path, "cut", "ros1", runs.run(poses=4))
    (source / "cut.bag").write_bytes(cut.read_bytes()[: cut.stat().st_size // 2])
    made = build(source, tmp_path / "out")
    assert {pair.scenario for pair in made.dataset.pairs} == {"good", "cut"}
    assert set(made.dataset.info.scenarios) == {"good", "cut"}
    assert made.dataset.info.failures == tuple(made.failures)
    for name, words in (
        ("restless", "no dwell"),
        ("blind", "no image topic"),
        ("empty.bag", "0 bytes"),
        ("cut.bag", ""),
    ):
        named = [failure for failure in made.failures if str(source / name) in failure]
        assert named and words in named[0], made.failures
    assert all("\n" not in failure for failure in made.failures)
    assert validate(tmp_path / "out") == []
    assert build(source, tmp_path / "out").failures == made.failures


def pictures(change: Any) -> Any:
    """A run in which the image messages are changed."""
    return runs.run(change=lambda t, n, m: change(n, m) if t == "/image/compressed" else m)


def clouds(change: Any) -> Any:
    """A run in which the clouds are changed."""
    return runs.run(change=lambda t, n, m: change(n, m) if t == "/points" else m)


def other_size(number: int, message: Any) -> Any:
    if number == 3:
        message.data = np.frombuffer(runs.jpeg(0, 32, 24), np.uint8)
    return message


def not_an_image(number: int, message: Any) -> Any:
    if number == 3:
        message.data = np.zeros(100, np.uint8)
    return message


def no_return(number: int, message: Any) -> Any:
    if number == 3:
        message.data = np.zeros_like(message.data)
    return message


@pytest.mark.parametrize(
    ("stream", "words"),
    [
        (pictures(other_size), "topic /image/compressed: image of 32x24, the camera has 64x48"),
        (pictures(not_an_image), "neither JPEG nor PNG"),
        (clouds(no_return), "none of them finite"),
    ],
)
def test_one_bad_pair_costs_one_pair(tmp_path: Path, stream: Any, words: str) -> None:
    source = runs.recordings(tmp_path / "in", run=stream)
    made = build(source, tmp_path / "out")
    assert any(words in failure for failure in made.failures), made.failures
    whole = build(runs.recordings(tmp_path / "in2", run=runs.run()), tmp_path / "out2")
    assert made.pairs == whole.pairs - 1
    assert validate(tmp_path / "out") == []


def test_what_a_user_should_know_is_kept(tmp_path: Path) -> None:
    def plain(topic: str, number: int, message: Any) -> Any:
        if topic == "/points":
            for field in message.fields:
                field.name = {"intensity": "a", "reflectivity": "b"}.get(field.name, field.name)
        message.header.stamp.sec -= 1_600_000_000
        return message

    source = runs.recordings(tmp_path / "in", run=runs.run(change=plain))
    made = build(source, tmp_path / "out")
    assert made.failures == []
    assert any("no intensity" in warning for warning in made.warnings)
    assert any("stamps: bag" in warning for warning in made.warnings)
    assert next(iter(made.dataset)).intensity is None
    assert build(source, tmp_path / "out").warnings == made.warnings


def test_joints_outside_their_limits_cost_the_pose(tmp_path: Path) -> None:
    places = runs.goals(2)
    places[1, 0] = 3.0
    source = runs.recordings(tmp_path / "in", run=runs.run(places=places))
    made = build(source, tmp_path / "out")
    assert made.poses == 1
    assert any("outside its limits" in f and "run/pose_001" in f for f in made.failures)
    assert validate(tmp_path / "out") == []


def test_joints_a_little_outside_their_limits_are_believed_with_a_warning(tmp_path: Path) -> None:
    places = runs.goals(2)
    places[1, 5] = np.deg2rad(-157.1)
    source = runs.recordings(tmp_path / "in", run=runs.run(places=places))
    made = build(source, tmp_path / "out")
    assert made.poses == 2 and not made.failures
    (warning,) = made.warnings
    assert "run/pose_001: joint_6 is at -157.10 deg, outside its limits" in warning


def of_another_size(topic: str, number: int, message: Any) -> Any:
    """All images are of another size than CameraInfo."""
    if topic == "/image/compressed":
        message.data = np.frombuffer(runs.jpeg(0, 32, 24), np.uint8)
    return message


@pytest.mark.parametrize(
    ("rig", "stream", "error", "words"),
    [
        (runs.RIG + "pairing: {tolerance_ms: 1}\n", runs.run(), RecordingError, "7 ms away"),
        (runs.RIG + "topics: {lidar: /nope}\n", runs.run(), TopicError, "/points"),
        (runs.STATIC, runs.still(tf=False), RecordingError, "T_camera_lidar"),
        (
            runs.RIG,
            runs.run(change=of_another_size),
            DatasetError,
            r"and \d+ more: topic /image.*32x24",
        ),
        (runs.RIG, runs.still(), TopicError, "joint"),
        (runs.RIG + "colour: red\n", runs.run(), RigError, "colour"),
    ],
)
def test_nothing_usable_leaves_nothing(
    tmp_path: Path, rig: str, stream: Any, error: type[LcdataError], words: str
) -> None:
    source = runs.recordings(tmp_path / "in", rig, run=stream)
    with pytest.raises(error, match=words) as caught:
        build(source, tmp_path / "out")
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "out").exists()


def test_nothing_usable_in_several_names_each(tmp_path: Path) -> None:
    source = runs.recordings(tmp_path / "in", one=runs.still(), two=runs.still())
    with pytest.raises(DatasetError, match=r"one.*two"):
        build(source, tmp_path / "out")


def test_no_rig_is_answered_with_where_to_get_one(tmp_path: Path) -> None:
    source = runs.recordings(tmp_path / "in", run=runs.run())
    (source / "rig.yaml").unlink()
    with pytest.raises(RigError, match="lcdata info"):
        build(source, tmp_path / "out")
    (source / "run" / "rig.yaml").write_text(runs.RIG)
    assert build(source, tmp_path / "out").pairs > 0


def test_the_rig_lies_beside_a_recording(tmp_path: Path) -> None:
    source = runs.recordings(tmp_path / "in", run=runs.run())
    bare = next((source / "run").glob("*.mcap"))
    shutil.copy(bare, source / "bare.mcap")
    made = build(source / "bare.mcap", tmp_path / "out")
    assert made.dataset.scenarios == ("bare",)
    shutil.copytree(source, tmp_path / "in" / "other")
    with pytest.raises(RecordingError, match="same name"):
        build(source, tmp_path / "out2")
    shutil.rmtree(tmp_path / "in" / "other" / "run")
    (tmp_path / "in" / "other" / "bare.mcap").rename(tmp_path / "in" / "other" / "third.mcap")
    with pytest.raises(RigError, match="different rigs"):
        build(source, tmp_path / "out2")


def two_sources(tmp_path: Path) -> tuple[Path, Path]:
    first = runs.recordings(tmp_path / "a", one=runs.run(), both=runs.run())
    second = runs.recordings(tmp_path / "b", two=runs.run(), both=runs.run(pairs=6))
    return first, second


def test_another_data_set_is_replaced_only_by_force(tmp_path: Path) -> None:
    first, second = two_sources(tmp_path)
    out = tmp_path / "out"
    build(first, out)
    (out / "results").mkdir()
    (out / "results" / "old.parquet").write_text("stale")
    (out / "notes.txt").write_text("mine")
    before = runs.contents(out)
    with pytest.raises(DatasetError, match="--force"):
        build(second, out)
    assert runs.contents(out) == before
    made = build(second, out, force=True)
    assert made.dataset.scenarios == ("both", "two")
    assert validate(out) == []
    assert not (out / "one").exists()
    assert not (out / "results").exists()
    assert (out / "notes.txt").read_text() == "mine"
    names = set(runs.contents(out)) - {"notes.txt"}
    build(second, tmp_path / "fresh")
    assert names == set(runs.contents(tmp_path / "fresh"))


def test_an_unfinished_build_of_something_else_is_refused(tmp_path: Path) -> None:
    first, second = two_sources(tmp_path)
    out = tmp_path / "out"
    build(first, out)
    (out / schema.INFO).rename(tmp_path / "info.json")
    info = json.loads((tmp_path / "info.json").read_text())
    (out / NAME).write_text(json.dumps({"sources": info["sources"]}) + "\n")
    with pytest.raises(DatasetError, match="unfinished build"):
        build(second, out)
    build(second, out, force=True)
    assert validate(out) == []
    assert not (out / "one").exists()


def test_folders_of_others_are_left_alone(tmp_path: Path) -> None:
    source = runs.recordings(tmp_path / "in", run=runs.run())
    out = tmp_path / "out"
    out.mkdir()
    (out / "thesis.tex").write_text("years of work")
    for force in (False, True):
        with pytest.raises(DatasetError, match="not empty"):
            build(source, out, force=force)
    assert runs.contents(out) == {"thesis.tex": b"years of work"}
    with pytest.raises(DatasetError, match="is a file"):
        build(source, out / "thesis.tex")


def test_a_name_that_a_data_set_needs_itself(tmp_path: Path) -> None:
    source = runs.recordings(tmp_path / "in", results=runs.run())
    with pytest.raises(DatasetError, match="rename"):
        build(source, tmp_path / "out")


@pytest.fixture(scope="session")
def real(shared: Path, tmp_path_factory: pytest.TempPathFactory) -> BuildSummary:
    """The real recordings, packaged."""
    folder = tmp_path_factory.mktemp("real")
    (folder / "static.yaml").write_text(runs.STATIC)
    return build(shared / "recordings", folder / "out", folder / "static.yaml")


def test_real_recordings(real: BuildSummary, shared: Path) -> None:
    assert real.failures == []
    dataset = real.dataset
    assert not dataset.info.simulated
    assert validate(dataset.path) == []
    assert (len(dataset), len(dataset.poses)) == (11, 2)
    for scenario, folder in (
        ("kitti_road", "kitti_road"),
        ("opencalib_crossing", "opencalib_crossing"),
    ):
        reference = json.loads((shared / "data" / folder / "reference.json").read_text())
        T = dataset.pose(f"{scenario}/pose_000").T_camera_lidar
        np.testing.assert_allclose(T, reference["T_camera_lidar"], atol=1e-6)
        np.testing.assert_allclose(dataset.camera(scenario).intrinsics, reference["K"])
    image = shared / "data" / "kitti_road" / "000000.png"
    assert (dataset.path / dataset.pairs[0].image).read_bytes() == image.read_bytes()


def test_real_pairs_load(real: BuildSummary) -> None:
    pair = Dataset.open(real.dataset.path).load("kitti_road/pose_000/000")
    assert pair.organised is None
    assert pair.intensity is not None
    assert np.isfinite(pair.points).all()
    assert len(pair.points) > 100_000
