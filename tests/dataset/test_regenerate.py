from __future__ import annotations

import copy
import errno
import hashlib
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from lcdata.arm import find_urdf
from lcdata.dataset import (
    Dataset,
    atomic,
    build,
    poses_of,
    regenerate,
    schema,
    validate,
    versions,
    writer,
)
from lcdata.errors import ArmError, DatasetError, RigError
from lcdata.evaluation import update_results
from lcdata.geometry import se3
from lcdata.groundtruth.chain import arm_truth
from lcdata.rig import Rig

from . import arm_dataset, runs, small_dataset


@pytest.fixture
def dataset(tmp_path: Path) -> Dataset:
    return arm_dataset.write(tmp_path / "set")


@pytest.fixture
def write_rig(tmp_path: Path):
    """A rig file like the data set's, changed by a function."""

    def write(change=lambda content: None, **values) -> Path:
        content = copy.deepcopy(arm_dataset.RIG)
        change(content)
        path = tmp_path / "rig.yaml"
        path.write_text(yaml.safe_dump(content | values))
        return path

    return write


def farther(content):
    content["T_base_lidar"]["translation_m"] = [0.1, 0.2, 0.35]


def checksums(folder: Path) -> dict[str, str]:
    files = [p for p in folder.rglob("*") if p.is_file()]
    return {str(p.relative_to(folder)): hashlib.sha256(p.read_bytes()).hexdigest() for p in files}


def write_offsets(path: Path, **content) -> Path:
    path.write_text(yaml.safe_dump({"offsets_deg": {"joint_2": 0.5}} | content))
    return path


def test_the_stored_rig_gives_the_same_ground_truth_and_nothing_is_written(dataset):
    before = checksums(dataset.path)
    result = regenerate(dataset)
    assert result.before == result.after
    assert not result.inputs
    assert result.moved["max_mm"] < 1e-9
    assert checksums(dataset.path) == before


def test_another_rig_makes_another_version_and_leaves_the_pairs_alone(dataset, write_rig):
    before = checksums(dataset.path)
    result = regenerate(dataset, write_rig(farther))
    after = checksums(dataset.path)
    touched = {name for name in after if after[name] != before.get(name)}
    assert touched == {
        "dataset.json",
        "poses.parquet",
        f"groundtruth/{result.before}.parquet",
        f"groundtruth/{result.after}.parquet",
    }
    again = Dataset.open(dataset.path)
    assert versions(again) == [result.before, result.after]
    assert result.moved["median_mm"] == pytest.approx(50, abs=1e-6)
    assert result.moved["max_deg"] == pytest.approx(0, abs=1e-6)
    assert result.inputs == ("rig.T_base_lidar.translation_m: [0.1, 0.2, 0.3] -> [0.1, 0.2, 0.35]",)
    assert validate(dataset.path) == []
    for pose in again.poses:
        assert pose.groundtruth_version == again.info.groundtruth_version == result.after
        chain = pose.T_camera_effector @ pose.T_effector_base @ pose.T_base_lidar
        np.testing.assert_allclose(chain, pose.T_camera_lidar, atol=1e-12)


def test_history_keeps_old_extrinsics_and_what_they_were_made_of(dataset, write_rig):
    result = regenerate(dataset, write_rig(farther))
    again = Dataset.open(dataset.path)
    (entry,) = again.info.groundtruth_history
    assert entry["rig"] == dataset.info.rig
    assert entry["moved"]["max_mm"] == pytest.approx(50, abs=1e-6)
    for old, kept in zip(dataset.poses, poses_of(again, result.before), strict=True):
        np.testing.assert_allclose(kept.T_camera_lidar, old.T_camera_lidar, atol=1e-12)
        np.testing.assert_array_equal(kept.covariance, old.covariance)
    with pytest.raises(DatasetError, match="no ground truth version 'nope'"):
        poses_of(again, "nope")
    back = regenerate(again, write_rig())
    assert back.after == result.before
    assert versions(Dataset.open(dataset.path)) == [back.after, result.after, back.after]
    assert validate(dataset.path) == []


def test_a_dry_run_writes_nothing(dataset, write_rig):
    before = checksums(dataset.path)
    result = regenerate(dataset, write_rig(farther), dry_run=True)
    assert result.before != result.after
    assert len(result.to_dict()["poses"]) == 4
    assert checksums(dataset.path) == before


def test_joint_offsets_are_stored_with_the_data_set(dataset, tmp_path):
    path = write_offsets(tmp_path / "arm.yaml", offsets_std_deg={"joint_2": 0.05}, serial="G7")
    result = regenerate(dataset, arm_offsets=path)
    path.unlink()
    again = Dataset.open(dataset.path)
    arm = again.load_arm()
    assert arm.joint_offsets == {"joint_2": pytest.approx(np.deg2rad(0.5))}
    assert arm.serial == "G7"
    q = again.poses[1].joint_positions.copy()
    q[1] += np.deg2rad(0.5)
    nominal = arm_truth(again.rig, replace(arm, joint_offsets={}), q)
    np.testing.assert_allclose(again.poses[1].T_camera_lidar, nominal.T_camera_lidar, atol=1e-12)
    assert "arm_model.joint_offsets.joint_2: none -> 0.00872665" in result.inputs
    variance = [np.trace(p.poses[1].budget["joint_offsets"]) for p in (dataset, again)]
    assert variance[1] < variance[0]
    assert regenerate(again).after == result.after  # from what is stored
    with pytest.raises(ArmError, match=r"serial B2, the rig's arm\.serial is G7"):
        regenerate(again, arm_offsets=write_offsets(path, serial="B2"))


def test_a_rig_that_names_stored_files_which_are_gone_uses_the_stored_ones(tmp_path):
    urdf = tmp_path / "own" / "robot.urdf"
    urdf.parent.mkdir()
    shutil.copy(find_urdf("gen3_lite"), urdf)
    write_offsets(tmp_path / "own" / "arm.yaml")
    content = copy.deepcopy(arm_dataset.RIG)
    content["arm"] |= {"model": "robot.urdf", "joint_offsets": "arm.yaml"}
    rig = Rig.from_dict(content)
    rig._path = tmp_path / "own" / "rig.yaml"
    dataset = arm_dataset.write(tmp_path / "set", rig)
    shutil.rmtree(tmp_path / "own")
    assert dataset.load_arm().urdf.is_relative_to(dataset.path.resolve())
    assert regenerate(dataset).before == regenerate(dataset).after
    farther(content)
    (tmp_path / "rig.yaml").write_text(yaml.safe_dump(content))
    result = regenerate(dataset, tmp_path / "rig.yaml")
    assert result.moved["max_mm"] == pytest.approx(50, abs=1e-6)
    assert validate(dataset.path) == []


CAMERA = {"width": 64, "height": 48, "intrinsics": [50.0, 50.0, 32.0, 24.0]}
CAMERA["distortion"] = [0.1, -0.05, 0.0, 0.0, 0.0]


@pytest.mark.parametrize(
    ("change", "error", "named"),
    [
        ({"camera": CAMERA | {"intrinsics": [51.0, 50.0, 32.0, 24.0]}}, RigError, "51, 50, 32"),
        ({"camera": CAMERA | {"width": 640}}, RigError, "width 640, not 64"),
        (
            {"ground_truth": "static", "arm": {}, "T_camera_effector": None, "T_base_lidar": None},
            RigError,
            "ground_truth: static",
        ),
        ({"clock_offset_s": 0.02}, RigError, "clock_offset_s: 0.02, .* was built with none"),
        ({"clock_offset_s": "estimate"}, RigError, "build the data set again"),
        ({"arm": {"effector_frame": "forearm_link"}}, ArmError, "has positions of"),
        ({"arm": {"effector_frame": "nose"}}, ArmError, r"rig.yaml: arm\.effector_frame: .*nose"),
        ({"arm": {"model": "ur99"}}, ArmError, r"rig.yaml: arm\.model: .*ur99"),
        ({"arm": {"joint_offsets": "gone.yaml"}}, ArmError, "gone.yaml"),
    ],
)
def test_a_rig_of_another_camera_or_arm_is_refused(dataset, write_rig, change, error, named):
    before = checksums(dataset.path)
    with pytest.raises(error, match=named):
        regenerate(dataset, write_rig(**change))
    assert checksums(dataset.path) == before


def test_the_same_camera_is_taken_and_parts_that_chose_the_pairs_are_named(dataset, write_rig):
    path = write_rig(camera=CAMERA, dwells={"settle_s": 0.4}, note="new")
    result = regenerate(dataset, path)
    assert result.ignored == ("dwells",)
    assert Dataset.open(dataset.path).rig.dwells.settle_s == 0.2
    assert Dataset.open(dataset.path).rig.note == "new"


def test_a_camera_of_the_rig_cannot_be_dropped(dataset, write_rig):
    arm_dataset.edit_info(dataset.path, rig=dataset.info.rig | {"camera": CAMERA})
    with pytest.raises(RigError, match="gives no camera"):
        regenerate(Dataset.open(dataset.path), write_rig())


def test_joint_offsets_of_another_arm_are_refused(dataset, tmp_path):
    before = checksums(dataset.path)
    for content, named in (({"model": "ur5"}, "ur5"), ({"model_sha256": "00"}, "sha256")):
        with pytest.raises(ArmError, match=named):
            regenerate(dataset, arm_offsets=write_offsets(tmp_path / "a.yaml", **content))
    assert checksums(dataset.path) == before


def test_a_newer_schema_is_refused(dataset):
    arm_dataset.edit_info(dataset.path, schema_version=schema.SCHEMA_VERSION + 1)
    with pytest.raises(DatasetError, match="upgrade lcdata"):
        Dataset.open(dataset.path)


def test_static_extrinsics_are_recomputed_from_a_rig_only(tmp_path):
    folder = tmp_path / "set"
    small_dataset.write(folder)
    static = Dataset.open(folder)
    unknown = np.full((6, 6), np.nan)
    poses = [replace(p, joint_positions=np.empty(0), covariance=unknown) for p in static.poses]
    info = replace(static.info, rig=Rig(ground_truth="static").to_dict(), arm=None)
    writer.write_index(folder, info, static.pairs, poses)
    dataset = Dataset.open(folder)
    with pytest.raises(DatasetError, match="give --rig with T_camera_lidar"):
        regenerate(dataset)
    with pytest.raises(RigError, match="has no arm"):
        regenerate(dataset, arm_offsets=tmp_path / "arm.yaml")
    T = se3.exp([0.1, 0.2, 0.3, 0.1, 0, 0])
    link = {"matrix": T.tolist(), "translation_std_m": 0.01, "rotation_std_deg": 0.1}
    rig = Rig.from_dict({"ground_truth": "static", "T_camera_lidar": link})
    regenerate(dataset, rig)
    again = Dataset.open(folder)
    np.testing.assert_allclose(again.poses[0].T_camera_lidar, T, atol=1e-12)
    assert list(again.poses[0].budget) == ["T_camera_lidar"]
    assert regenerate(again).before == regenerate(again).after


@pytest.mark.parametrize("name", ["dataset.json", "poses.parquet", "groundtruth"])
def test_a_disk_that_fills_up_leaves_the_former_version(dataset, write_rig, monkeypatch, name):
    before = checksums(dataset.path)
    force = atomic._force_to_disk

    def full(path: Path) -> None:
        if path.is_file() and name.split(".")[0] in str(path.relative_to(dataset.path)):
            raise OSError(errno.ENOSPC, "No space left on device", str(path))
        force(path)

    monkeypatch.setattr(atomic, "_force_to_disk", full)
    with pytest.raises(DatasetError, match="no space left"):
        regenerate(dataset, write_rig(farther))
    monkeypatch.undo()
    again = Dataset.open(dataset.path)
    assert again.info.groundtruth_version == dataset.info.groundtruth_version
    assert {p.groundtruth_version for p in again.poses} == {again.info.groundtruth_version}
    after = checksums(dataset.path)
    assert after["dataset.json"] == before["dataset.json"]
    result = regenerate(again, write_rig(farther))
    assert versions(Dataset.open(dataset.path)) == [result.before, result.after]
    assert validate(dataset.path) == []


def test_a_kill_before_the_last_file_leaves_the_former_version(dataset, write_rig):
    info = (dataset.path / schema.INFO).read_bytes()
    regenerate(dataset, write_rig(farther))
    (dataset.path / schema.INFO).write_bytes(info)
    again = Dataset.open(dataset.path)
    np.testing.assert_allclose(
        again.poses[0].T_camera_lidar, dataset.poses[0].T_camera_lidar, atol=1e-12
    )
    assert any("lcdata groundtruth" in problem for problem in validate(dataset.path))
    assert regenerate(again).before == again.info.groundtruth_version
    assert validate(dataset.path) == []


def test_data_sets_without_a_budget_get_one(dataset):
    table = schema.poses_table(dataset.poses).drop_columns(list(schema.BUDGET.values()))
    atomic.write_parquet(dataset.path / schema.POSES, table)
    old = Dataset.open(dataset.path)
    assert old.poses[0].budget == {}
    regenerate(old)
    assert set(Dataset.open(dataset.path).poses[0].budget) == set(dataset.poses[0].budget)


def test_a_build_of_the_same_recordings_leaves_the_new_ground_truth(tmp_path):
    source = runs.recordings(tmp_path / "in", run=runs.run(poses=2, pairs=2))
    urdf = source / "robot.urdf"
    shutil.copy(find_urdf("gen3_lite"), urdf)
    content = yaml.safe_load((source / "rig.yaml").read_text())
    content.setdefault("arm", {})["model"] = urdf.name
    (source / "rig.yaml").write_text(yaml.safe_dump(content))
    built = build(source, tmp_path / "out").dataset
    assert built.load_arm().urdf.parent.parent == (tmp_path / "out/groundtruth").resolve()
    changed = regenerate(built, arm_offsets=write_offsets(tmp_path / "arm.yaml"))
    before = checksums(tmp_path / "out")
    again = build(source, tmp_path / "out").dataset
    assert again.info.groundtruth_version == changed.after
    assert checksums(tmp_path / "out") == before
    forced = build(source, tmp_path / "out", force=True).dataset
    assert versions(forced) == [changed.before]
    assert validate(tmp_path / "out") == []


HOLD = """
import sys, time
from pathlib import Path
from lcdata.dataset.lock import locked
with locked(Path(sys.argv[1])):
    print("held", flush=True)
    time.sleep(60)
"""


@pytest.fixture
def writer_at_work(dataset):
    """Another process that is writing the data set."""
    command = [sys.executable, "-c", HOLD, str(dataset.path)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None and process.stdout.readline() == "held\n"
    yield process
    process.kill()
    process.communicate()


def test_two_processes_do_not_write_one_data_set(dataset, write_rig, writer_at_work):
    before = checksums(dataset.path)
    rig = write_rig(farther)
    with pytest.raises(DatasetError, match=r"another lcdata command is writing .*: wait for it"):
        regenerate(dataset, rig)
    with pytest.raises(DatasetError, match="another lcdata command is writing"):
        update_results(dataset)
    regenerate(dataset, rig, dry_run=True)
    assert checksums(dataset.path) == before
    writer_at_work.kill()
    writer_at_work.wait()
    regenerate(dataset, rig)
    assert checksums(dataset.path).keys() - before.keys()


def test_a_ground_truth_of_what_another_process_has_changed_is_not_written(dataset, write_rig):
    late = Dataset.open(dataset.path)
    regenerate(dataset, write_rig(farther))
    before = checksums(dataset.path)
    with pytest.raises(DatasetError, match="was changed by another lcdata command meanwhile"):
        regenerate(late, write_rig(clock_offset_std_s=0.5))
    assert checksums(dataset.path) == before
