"""What is written comes back; damage, age and absence are named."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import lcdata
from lcdata.dataset import Dataset, atomic, cloud_file, schema, writer
from lcdata.dataset.journal import NAME
from lcdata.errors import DatasetError, MessageError
from lcdata.recording.messages import Cloud, Image

from . import small_dataset as small


def test_index_comes_back(folder: Path) -> None:
    dataset = Dataset.open(folder)
    assert [record.pair_id for record in dataset.pairs][:3] == [
        "a/pose_000/000",
        "a/pose_000/001",
        "a/pose_001/000",
    ]
    assert len(dataset) == 8
    assert dataset.scenarios == ("a", "b")
    assert dataset.info.simulated
    assert dataset.info.scenarios["a"].warnings == ("odd",)
    assert dataset.rig.T_base_lidar is not None
    assert dataset.camera("a") == small.CAMERA
    expected, found = small.pose("a/pose_001", seed=1), dataset.pose("a/pose_001")
    for name in ("T_camera_lidar", *schema.LINKS, "covariance", "joint_positions"):
        np.testing.assert_allclose(getattr(found, name), getattr(expected, name), atol=1e-14)
    assert found.groundtruth_version == dataset.info.groundtruth_version != ""
    assert dataset.results() is None


def test_pairs_come_back(folder: Path) -> None:
    pairs = list(lcdata.Dataset.open(folder))
    assert [pair.pair_id for pair in pairs] == [r.pair_id for r in Dataset.open(folder).pairs]
    organised, listed = pairs[0], pairs[4]
    assert organised.organised == (4, 50)
    assert np.isnan(organised.points[::10]).all()
    records = small.records(200, 0)
    np.testing.assert_array_equal(organised.points[1], [records[n][1] for n in "xyz"])
    np.testing.assert_array_equal(organised.intensity, records["intensity"])
    np.testing.assert_array_equal(organised.ring, records["ring"])
    assert listed.organised is None
    assert listed.points.shape == (180, 3)
    assert np.isfinite(listed.points).all()
    assert listed.intensity is not None and listed.intensity.shape == (180,)
    data = np.frombuffer(small.jpeg(0).data, np.uint8)
    np.testing.assert_array_equal(organised.image, cv2.imdecode(data, cv2.IMREAD_COLOR)[..., ::-1])
    assert organised.camera == small.CAMERA
    assert organised.T_camera_lidar is not None
    assert organised.scenario == "a"


def test_the_cloud_file_keeps_every_field(tmp_path: Path) -> None:
    dtype = np.dtype([("x", "f8"), ("y", "f4"), ("z", "f4"), ("n", "f4", (3,)), ("tag id", "i2")])
    records = np.zeros(12, dtype)
    records["x"], records["n"] = np.arange(12), np.arange(36).reshape(12, 3)
    records["tag id"] = -np.arange(12)
    atomic.write_bytes(tmp_path / "c.pcd", *cloud_file.encode(records, 3, 4))
    found, height, width = cloud_file.read(tmp_path / "c.pcd")
    assert (height, width) == (3, 4)
    np.testing.assert_array_equal(found["x"], records["x"])
    np.testing.assert_array_equal(found["n__0002"], records["n"][:, 2])
    np.testing.assert_array_equal(found["tag_id"], records["tag id"])


def test_the_cloud_file_opens_in_open3d(folder: Path) -> None:
    o3d = pytest.importorskip("open3d", exc_type=ImportError)
    path = folder / Dataset.open(folder).pairs[0].cloud
    cloud = o3d.t.io.read_point_cloud(str(path))
    records = small.records(200, 0)
    np.testing.assert_array_equal(
        cloud.point["positions"].numpy(), np.stack([records[n] for n in "xyz"], 1)
    )
    np.testing.assert_array_equal(cloud.point["ring"].numpy()[:, 0], records["ring"])


def test_the_image_keeps_its_bytes(folder: Path) -> None:
    path = folder / Dataset.open(folder).pairs[0].image
    assert path.suffix == ".jpg"
    assert path.read_bytes() == bytes(small.jpeg(0).data)


def test_raw_pixels_become_png(tmp_path: Path) -> None:
    pixels = np.random.default_rng(0).integers(0, 255, (48, 64, 3), np.uint8)
    image = Image(0, 0, "c", memoryview(pixels.tobytes()), "bgr8", False, 48, 64, 192)
    name, _ = writer.write_image(tmp_path, "s/pose_000/000", *image.encoded())
    assert name == "s/pose_000/000.png"
    np.testing.assert_array_equal(cv2.imread(str(tmp_path / name)), pixels)


@pytest.mark.parametrize("records", [small.records(0), np.zeros(10, small.OUSTER)])
def test_an_empty_cloud_is_refused(tmp_path: Path, records: np.ndarray) -> None:
    with pytest.raises(MessageError, match="none of them"):
        writer.write_cloud(tmp_path, "s/pose_000/000", Cloud(0, 0, "l", records, 1, len(records)))
    assert list(tmp_path.iterdir()) == []


def test_unknown_names_are_answered_with_known_ones(folder: Path) -> None:
    dataset = Dataset.open(folder)
    with pytest.raises(DatasetError, match=r"no pair 'x'.*a/pose_000/000"):
        dataset.load("x")
    with pytest.raises(DatasetError, match="no pose"):
        dataset.pose("x")
    with pytest.raises(DatasetError, match="no scenario"):
        dataset.camera("x")


@pytest.mark.parametrize(
    ("version", "words"), [(99, "upgrade"), (0, "older"), (None, "no schema_version")]
)
def test_other_schema_versions(folder: Path, version: int | None, words: str) -> None:
    path = folder / schema.INFO
    path.write_text(json.dumps({**json.loads(path.read_text()), "schema_version": version}))
    with pytest.raises(DatasetError, match=words):
        Dataset.open(folder)


def test_no_data_set(tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match="no such folder"):
        Dataset.open(tmp_path / "not there")
    with pytest.raises(DatasetError, match="no data set"):
        Dataset.open(tmp_path)
    (tmp_path / NAME).write_text("{}\n")
    with pytest.raises(DatasetError, match="has not finished"):
        Dataset.open(tmp_path)


def damage_json(folder: Path) -> None:
    (folder / schema.INFO).write_text('{"schema_version": 1')


def damage_info(folder: Path) -> None:
    (folder / schema.INFO).write_text('{"schema_version": 1}')


def damage_pairs(folder: Path) -> None:
    (folder / schema.PAIRS).write_bytes((folder / schema.PAIRS).read_bytes()[:200])


def drop_poses(folder: Path) -> None:
    (folder / schema.POSES).unlink()


def drop_column(folder: Path) -> None:
    table = pq.ParquetFile(folder / schema.PAIRS).read()
    pq.write_table(table.drop_columns(["cloud"]), folder / schema.PAIRS)


@pytest.mark.parametrize(
    "damage", [damage_json, damage_info, damage_pairs, drop_poses, drop_column]
)
def test_a_damaged_index_is_named(folder: Path, damage: Callable[[Path], None]) -> None:
    damage(folder)
    with pytest.raises(DatasetError, match=str(folder)) as caught:
        Dataset.open(folder)
    assert "\n" not in str(caught.value)


def test_columns_of_others_do_no_harm(folder: Path) -> None:
    for name in (schema.PAIRS, schema.POSES):
        table = pq.ParquetFile(folder / name).read()
        table = table.append_column("weather", pa.array(["dry"] * len(table)))
        pq.write_table(table, folder / name)
    assert len(Dataset.open(folder)) == 8


def test_damaged_files_are_named_on_load(folder: Path) -> None:
    dataset = Dataset.open(folder)
    first, second, third, fourth = dataset.pairs[:4]
    (folder / first.cloud).write_bytes((folder / first.cloud).read_bytes()[:1000])
    (folder / second.cloud).unlink()
    (folder / third.image).write_bytes(b"\xff\xd8\xff and no more")
    (folder / fourth.image).unlink()
    for record in (first, second, third, fourth):
        with pytest.raises(DatasetError, match=record.pair_id) as caught:
            dataset.load(record.pair_id)
        assert "\n" not in str(caught.value)


def test_results_are_one_table(folder: Path) -> None:
    (folder / "results").mkdir()
    for run in ("r1", "r2"):
        table = pa.table({"run": [run], "error": [0.5]})
        atomic.write_parquet(folder / "results" / f"{run}.parquet", table)
    results = Dataset.open(folder).results()
    assert results.column("run").to_pylist() == ["r1", "r2"]


def test_a_data_set_can_be_moved(folder: Path, tmp_path: Path) -> None:
    shutil.move(folder, tmp_path / "elsewhere")
    assert len(list(Dataset.open(tmp_path / "elsewhere"))) == 8


def test_versions_name_the_values() -> None:
    poses = [small.pose("a/pose_000", 0), small.pose("a/pose_001", 1)]
    other = [small.pose("a/pose_000", 0), small.pose("a/pose_001", 2)]
    assert schema.groundtruth_version(poses) == schema.groundtruth_version(poses[::-1])
    assert schema.groundtruth_version(poses) != schema.groundtruth_version(other)


def test_numbers_in_names_count_as_numbers() -> None:
    names = [f"run_{k}/pose_{p:03}/{n:03}" for k in (9, 10) for p in (0, 1) for n in (999, 1000)]
    assert sorted(set(names), key=schema.in_order) == names
