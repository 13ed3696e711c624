"""Data sets whose clouds are of several scans, from simulated recordings."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import yaml

from lcdata.dataset import Dataset, build, regenerate, schema, validate
from lcdata.dataset.reader import read_table
from lcdata.errors import LcdataError, MissingLibraryError
from lcdata.geometry import se3
from lcdata.open3d_loader import open3d
from lcdata.recording import fields
from lcdata.recording.messages import Cloud, xyz
from lcdata.recording.source import open_recording
from lcdata.rig import load_rig
from lcdata.simulation import World, simulate, simulate_hand_held
from lcdata.simulation.bag import LIDAR
from lcdata.simulation.mounts import default_rig

try:
    open3d()
except MissingLibraryError as error:
    pytest.skip(str(error), allow_module_level=True)

pytest.importorskip("small_gicp")


@pytest.fixture(scope="module")
def avia(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A Livox beside an arm with two poses of five scans."""
    out = tmp_path_factory.mktemp("avia")
    simulate(out, scenario="gym", poses=2, pairs=5, seed=4, lidar="avia", width=64, height=36)
    return out


def with_integration(recordings: Path, section: object, folder: Path) -> Path:
    content = yaml.safe_load((recordings / "rig.yaml").read_text())
    path = folder / "integrated.yaml"
    path.write_text(yaml.safe_dump({**content, "integration": section}))
    return path


def cells(points: np.ndarray) -> int:
    """Cells of a quarter of a degree that points lie in."""
    unit = points / np.linalg.norm(points, axis=1, keepdims=True)
    angles = np.rad2deg([np.arctan2(unit[:, 1], unit[:, 0]), np.arcsin(unit[:, 2])])
    return len(np.unique(np.floor(4 * angles.T), axis=0))


def test_a_dwell_of_a_livox_is_one_dense_pair(avia: Path, tmp_path: Path) -> None:
    single = build(avia, tmp_path / "single", with_integration(avia, "none", tmp_path)).dataset
    made = build(avia, tmp_path / "merged")
    assert made.failures == []
    merged = made.dataset
    assert validate(merged.path) == []
    assert [pair.pair_id for pair in merged.pairs] == ["gym/pose_000/000", "gym/pose_001/000"]
    assert [pair.scans for pair in merged.pairs] == [5, 5]
    assert {pair.scans for pair in single.pairs} == {1}
    dense, sparse = merged.load("gym/pose_000/000"), single.load("gym/pose_000/000")
    print(f"\ncells seen: {cells(sparse.points)} by one scan, {cells(dense.points)} by five")
    assert cells(dense.points) > 2.5 * cells(sparse.points)
    assert dense.organised is None
    assert dense.ring is None
    assert np.isfinite(dense.points).all()
    assert dense.intensity.std() > 1
    np.testing.assert_array_equal(dense.T_camera_lidar, sparse.T_camera_lidar)
    record = merged.pairs[0]
    others = {(p.stamp_lidar_ns, p.stamp_image_ns) for p in single.pairs}
    assert (record.stamp_lidar_ns, record.stamp_image_ns) in others
    image = next(p for p in single.pairs if p.stamp_image_ns == record.stamp_image_ns)
    assert image.image_sha256 == record.image_sha256


def test_an_interrupted_build_goes_on(avia: Path, tmp_path: Path) -> None:
    rig = with_integration(avia, {"mode": "static", "max_scans": 2}, tmp_path)
    whole = build(avia, tmp_path / "whole", rig).dataset
    assert [pair.scans for pair in whole.pairs] == [2, 2, 1, 2, 2, 1]

    def interrupt(stage: str, done: int, total: int) -> None:
        if done == 3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        build(avia, tmp_path / "cut", rig, progress=interrupt)
    seen: list[int] = []
    again = build(
        avia, tmp_path / "cut", rig, progress=lambda stage, done, total: seen.append(done)
    )
    assert seen[0] >= 3
    assert again.dataset.pairs == whole.pairs


def test_data_sets_from_before_count_one_scan_a_pair(avia: Path, tmp_path: Path) -> None:
    import pyarrow.parquet as pq

    made = build(avia, tmp_path / "out", pairs_per_pose=1).dataset
    path = made.path / schema.PAIRS
    pq.write_table(read_table(path).drop_columns(["scans"]), path)
    assert {pair.scans for pair in Dataset.open(made.path).pairs} == {1}


@pytest.fixture(scope="module")
def hand_held(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("moving")
    simulate_hand_held(
        out,
        scenario="yard",
        seconds=1.6,
        seed=4,
        columns=512,
        width=64,
        height=36,
        format="sqlite3",
    )
    return out


def true_points(recordings: Path) -> tuple[np.ndarray, np.ndarray]:
    """All points in the frame of the image's moment by the true motion, and as they came."""
    motion = World("yard", 4, default_rig()).hand_motion(0, 0)
    right, raw = [], []
    with open_recording(recordings / "yard") as recording:
        for number, (_, cloud) in enumerate(recording.messages([LIDAR])):
            assert isinstance(cloud, Cloud)
            points = xyz(cloud)
            there = np.isfinite(points[:, 0])
            time = fields.point_time(cloud.records).since(cloud.records, cloud.stamp_ns)[there]
            T = se3.inverse(motion(0.02)) @ motion(0.1 * number + time)
            points = points[there].astype(float)
            right.append(np.einsum("nij,nj->ni", T[:, :3, :3], points) + T[:, :3, 3])
            raw.append(points)
    return np.concatenate(right), np.concatenate(raw)


@pytest.mark.slow
def test_a_moved_lidar_becomes_the_cloud_of_its_true_motion(
    hand_held: Path, tmp_path: Path
) -> None:
    from scipy.spatial import cKDTree

    stages: set[str] = set()
    made = build(hand_held, tmp_path / "out", progress=lambda stage, *_: stages.add(stage))
    assert made.failures == []
    assert stages == {"registering yard", "packaging yard"}
    assert validate(made.dataset.path) == []
    (record,) = made.dataset.pairs
    assert record.scans == 16
    pair = made.dataset.load(record.pair_id)
    right, raw = true_points(hand_held)
    near = pair.points[np.linalg.norm(pair.points, axis=1) < 6]
    # every cell of 1 cm has its point again in the cloud that the true motion makes
    off = cKDTree(right).query(near)[0]
    as_they_came = cKDTree(raw).query(near)[0]
    print(
        f"\noff the true cloud by {1000 * np.median(off):.1f} mm (median), "
        f"{1000 * np.quantile(off, 0.95):.1f} mm (95 %); unregistered "
        f"{1000 * np.median(as_they_came):.0f} mm"
    )
    assert np.median(off) < 0.01
    assert np.quantile(off, 0.95) < 0.03
    truth = json.loads((hand_held / "truth.json").read_text())
    rig = load_rig(hand_held / "rig.yaml")
    np.testing.assert_allclose(pair.T_camera_lidar, rig.T_camera_lidar.T, atol=1e-9)
    assert np.abs(pair.T_camera_lidar - truth["T_camera_lidar"]).max() < 0.05


def test_a_lidar_that_stood_still_is_named_with_its_pair(avia: Path, tmp_path: Path) -> None:
    """Those that can be used are; here there are none, and the one reason is the error."""
    static = {"ground_truth": "static", "T_camera_lidar": np.eye(4).tolist()}
    rig = tmp_path / "rig.yaml"
    rig.write_text(yaml.safe_dump({**static, "integration": {"mode": "dynamic", "max_scans": 5}}))
    with pytest.raises(LcdataError, match=r"gym/pose_000/000.*cannot be registered: .*moved only"):
        build(avia, tmp_path / "out", rig)
    assert not (tmp_path / "out").exists()


def test_an_arm_and_a_moving_lidar_are_refused(avia: Path, tmp_path: Path) -> None:
    rig = with_integration(avia, "dynamic", tmp_path)
    with pytest.raises(LcdataError, match=r"integration: dynamic .* ground_truth: static"):
        build(avia, tmp_path / "out", rig)


def test_the_ground_truth_can_be_computed_anew(avia: Path, tmp_path: Path) -> None:
    rig = with_integration(avia, "static", tmp_path)
    out = tmp_path / "out"
    before = build(avia, out, rig).dataset
    content = yaml.safe_load(rig.read_text())
    content["T_base_lidar"]["translation_m"][0] += 0.01
    changed = tmp_path / "changed.yaml"
    changed.write_text(yaml.safe_dump(content))
    regenerate(before, changed)
    after = Dataset.open(out)
    assert after.pairs == before.pairs
    assert after.info.groundtruth_version != before.info.groundtruth_version
