"""Any folder with a reference.json."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lcdata.dataset import Dataset, cloud_file, validate
from lcdata.dataset.importers import Choice, Folder, import_dataset
from lcdata.errors import DatasetError, SourceError
from lcdata.geometry import se3

from . import layouts


def test_pairs_of_equal_names(tmp_path: Path) -> None:
    reference = layouts.folder_of_pairs(tmp_path / "road")
    made = import_dataset(Folder(tmp_path / "road"), tmp_path / "out")
    assert (made.pairs, made.poses, made.failures) == (3, 1, [])
    assert "names of files are no stamps" in made.warnings[0]
    assert validate(tmp_path / "out") == []
    dataset = Dataset.open(tmp_path / "out")
    assert dataset.rig.ground_truth == "static"
    for n, (pair, record) in enumerate(zip(dataset, dataset.pairs, strict=True)):
        assert record.pair_id == f"road/pose_000/{n:06}"
        np.testing.assert_array_equal(pair.points, layouts.points(n)[:, :3])
        np.testing.assert_allclose(pair.T_camera_lidar, reference["T_camera_lidar"])
        assert np.isnan(pair.covariance).all()
        assert pair.camera.intrinsics == tuple(reference["K"])
        assert pair.camera.distortion == tuple(reference["D"])
        source = tmp_path / "road" / f"{n:06}.png"
        assert (tmp_path / "out" / record.image).read_bytes() == source.read_bytes()
    assert [record.stamp_image_ns for record in dataset.pairs] == [0, 10**8, 2 * 10**8]


def test_real_pairs(shared: Path, tmp_path: Path) -> None:
    made = import_dataset(
        Folder(shared / "data" / "kitti_road"), tmp_path / "out", choice=Choice(every=3, limit=2)
    )
    reference = json.loads((shared / "data" / "kitti_road" / "reference.json").read_text())
    assert [p.pair_id for p in made.dataset.pairs] == [
        "kitti_road/pose_000/000000",
        "kitti_road/pose_000/000278",
    ]
    pair = next(iter(made.dataset))
    np.testing.assert_allclose(pair.T_camera_lidar, reference["T_camera_lidar"], atol=1e-6)
    _, inside = pair.camera.project(se3.apply(pair.T_camera_lidar, pair.points))
    assert inside.sum() > 15_000 and pair.intensity is not None
    assert pair.image.shape == (376, 1241, 3)


def test_folders_of_pairs_are_scenarios(tmp_path: Path) -> None:
    T = np.eye(4)
    T[:3, :3] = layouts.LIDAR_TO_CAMERA
    for name, f in (("b", 50.0), ("a", 60.0)):
        K = [f, f, 31.0, 23.0]
        layouts.folder_of_pairs(tmp_path / "all" / name, 2, K=K, T_camera_lidar=T.tolist())
    (tmp_path / "all" / "notes").mkdir()
    made = import_dataset(Folder(tmp_path / "all"), tmp_path / "out")
    assert made.dataset.scenarios == ("a", "b") and (made.pairs, made.poses) == (4, 2)
    assert [made.dataset.camera(name).intrinsics[0] for name in "ab"] == [60.0, 50.0]
    assert validate(tmp_path / "out") == []
    one = import_dataset(Folder(tmp_path / "all"), tmp_path / "one", choice=Choice(("b",)))
    assert one.dataset.scenarios == ("b",)


def test_every_cloud_format_by_order_in_folders(tmp_path: Path) -> None:
    root = tmp_path / "mixed"
    reference = layouts.folder_of_pairs(root, pairs=0)
    for i in range(5):
        layouts.image(root / "left" / f"{1700000000 + i}.{i}00000000.jpg", i)
    values = layouts.points(0, columns=5)
    layouts.pcd(root / "lidar" / "a.pcd", values)
    np.save(root / "lidar" / "b.npy", values[:, :4])
    layouts.scan(root / "lidar" / "c.bin", values[:, :4])
    layouts.scan(root / "lidar" / "d.pcd.bin", values)
    head = "ply\nformat binary_little_endian 1.0\nelement vertex 60\n"
    names = ("x", "y", "z", "scalar_Intensity")
    head += "".join(f"property float {name}\n" for name in names) + "end_header\n"
    (root / "lidar" / "e.ply").write_bytes(head.encode() + values[:, :4].tobytes())
    with pytest.raises(SourceError, match=r"no image has the name of a cloud.*--by-order"):
        import_dataset(Folder(root), tmp_path / "out")
    made = import_dataset(Folder(root, by_order=True), tmp_path / "out")
    assert (made.pairs, made.failures, made.warnings) == (5, [], [])
    assert [r.stamp_image_ns for r in made.dataset.pairs] == [
        (1700000000 + i) * 10**9 + i * 10**8 for i in range(5)
    ]
    for pair in made.dataset:
        np.testing.assert_array_equal(pair.points, values[:, :3])
        np.testing.assert_array_equal(pair.intensity, values[:, 3])
        np.testing.assert_allclose(pair.T_camera_lidar, reference["T_camera_lidar"])
    assert validate(tmp_path / "out") == []


def test_masks_and_segments_go_with_their_pairs(tmp_path: Path) -> None:
    root = tmp_path / "road"
    layouts.folder_of_pairs(root)
    one = layouts.mask(root / "masks" / "000000.png")
    for n in range(2):
        layouts.mask(root / "masks" / "000001" / f"{n}.png")
    layouts.mask(root / "masks" / "000001" / "big.png", (10, 10))
    beside = layouts.mask(root / "000002_mask.jpg")
    made = import_dataset(Folder(root), tmp_path / "out")
    assert made.pairs == 3
    (failure,) = made.failures
    assert "000001: its mask big.png: mask of 10x10, its image has 64x48" in failure
    masks = tmp_path / "out" / "masks" / "road" / "pose_000"
    assert (masks / "000000.png").read_bytes() == one
    assert sorted(f.name for f in (masks / "000001").iterdir()) == ["0.png", "1.png"]
    assert (masks / "000002.jpg").read_bytes() == beside
    assert validate(tmp_path / "out") == []


def test_other_cameras(tmp_path: Path) -> None:
    for model, K, D in (
        ("fisheye", [30.0, 30, 31, 23], [0.1, 0, 0, 0]),
        ("omni", [1.2, 60, 60, 31, 23], [0.0, 0, 0, 0]),
        ("equirectangular", None, None),
        ("pinhole", [[55.0, 0, 31], [0, 55, 23], [0, 0, 1]], None),
    ):
        changes: dict[str, Any] = {"camera_model": model, "K": K, "D": D}
        if K is None:
            changes = {"camera_model": model, "D": []}
        root = tmp_path / model
        layouts.folder_of_pairs(root, 1, **changes)
        if K is None:
            content = json.loads((root / "reference.json").read_text())
            del content["K"]
            (root / "reference.json").write_text(json.dumps(content))
        made = import_dataset(Folder(root), tmp_path / f"out_{model}")
        assert made.dataset.camera(model).model == model
        assert validate(tmp_path / f"out_{model}") == []


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"K": [1.0, 2, 3]}, "K has 3 values: give fx fy cx cy, or 3x3"),
        ({"K": [[1.0, 2], [3, 4]]}, "K has 2x2 values"),
        ({"K": "wide"}, "K is wide: give numbers"),
        ({"K": [55.0, float("nan"), 30, 20]}, "K has values that are not finite"),
        ({"K": [0.0, 55, 30, 20]}, "must be positive"),
        ({"K": [700.0, 700, 600, 180]}, "principal point (600, 180) lies outside the images"),
        ({"K": [[55.0, 9, 31], [0, 55, 23], [0, 0, 1]]}, "no skew"),
        ({"camera_model": "omni"}, "K has 4 values: give xi fx fy cx cy"),
        ({"camera_model": "fishey"}, "unknown camera_model 'fishey'"),
        ({"D": [0.1, 0.2, 0.3]}, "3 distortion coefficients"),
        ({"T_camera_lidar": np.eye(3).tolist()}, "T_camera_lidar has 3x3 values"),
        ({"T_camera_lidar": np.diag([2.0, 1, 1, 1]).tolist()}, "T_camera_lidar is not a rotation"),
        ({"T_camera_lidar": np.diag([-1.0, 1, 1, 1]).tolist()}, "is a reflection"),
        ({"T_camera_lidr": 1}, "unknown key T_camera_lidr: did you mean T_camera_lidar?"),
        ({"width": 10}, "width and height are [10, None]"),
        ({"covariance": np.eye(5).tolist()}, "covariance has 25 values"),
        ({"covariance": (-np.eye(6)).tolist()}, "covariance is not symmetric, or has negative"),
    ],
)
def test_a_wrong_reference_is_named(tmp_path: Path, changes: dict[str, Any], words: str) -> None:
    layouts.folder_of_pairs(tmp_path / "road", 1, **changes)
    with pytest.raises(SourceError) as caught:
        import_dataset(Folder(tmp_path / "road"), tmp_path / "out")
    assert words in str(caught.value) and "reference.json" in str(caught.value)
    assert not (tmp_path / "out").exists()


def test_folders_that_are_not_clear_are_refused(tmp_path: Path) -> None:
    root = tmp_path / "road"

    def error(**options: Any) -> str:
        with pytest.raises(SourceError) as caught:
            import_dataset(Folder(root, **options), tmp_path / "out")
        return str(caught.value)

    root.mkdir()
    assert "no JSON file: write K, D and T_camera_lidar into reference.json" in error()
    layouts.folder_of_pairs(root, 0)
    assert "no image in it: images are .png" in error()
    (root / "reference.json").write_text("{")
    assert "reference.json: cannot be read (no JSON" in error()
    layouts.folder_of_pairs(root, 2)
    (root / "000001.pcd").unlink()
    assert "2 images and 1 clouds cannot be paired by order" in error(by_order=True)
    assert "elsewhere.json: cannot be read (No such file" in error(
        calibration=tmp_path / "elsewhere.json"
    )
    (root / "reference.json").rename(root / "a.json")
    (root / "b.json").write_text("{}")
    assert "2 JSON files, none of them reference.json" in error()
    (root / "b.json").unlink()
    layouts.image(root / "000000.jpg")
    assert "000000.jpg and 000000.png have the same name" in error()
    for folder in ("left", "right"):
        layouts.image(root / folder / "0.png")
    for file in [*root.glob("*.png"), *root.glob("*.jpg")]:
        file.unlink()
    assert "images in several folders: left, right: choose one with --images" in error()
    assert "up: no images in it" in error(images="up")


def test_bad_files_cost_their_own_pair(tmp_path: Path) -> None:
    root = tmp_path / "road"
    layouts.folder_of_pairs(root, 9)
    (root / "000000.pcd").write_bytes(b"no cloud")
    (root / "000001.png").write_bytes((root / "000001.png").read_bytes()[:300])
    (root / "000002.png").write_bytes(b"BM6")
    layouts.image(root / "000003.png", size=(32, 24))
    (root / "000004.pcd").unlink()
    np.save(root / "000005.npy", np.zeros((20, 4), np.float32))
    (root / "000005.pcd").unlink()
    np.save(root / "000006.npy", np.array([("a",)], dtype=[("name", "U4")]))
    (root / "000006.pcd").unlink()
    np.save(root / "000007.npy", np.zeros(4, dtype=[("x", "f4"), ("y", "f4")]))
    (root / "000007.pcd").unlink()
    made = import_dataset(Folder(root), tmp_path / "out")
    assert [r.pair_id[-6:] for r in made.dataset.pairs] == ["000008"]
    text = "\n".join(made.failures)
    for words in (
        "000000.pcd cannot be read",
        "000001.png: the image is cut off",
        "000002.png: neither PNG nor JPEG (its 3 bytes start with 424d36)",
        "000003.png: image of 32x24, its camera has 64x48",
        "000004: there is an image of this name, but no cloud",
        "000005.npy: 20 points, none of them finite",
        "000006.npy: field name is of type <U4, no number",
        "000007.npy: a cloud without x, y, z; its fields are x, y",
    ):
        assert words in text
    assert validate(tmp_path / "out") == []
    for file in root.glob("*8.pcd"):
        file.write_bytes(b"")
    with pytest.raises(DatasetError, match="no pair could be taken from"):
        import_dataset(Folder(root), tmp_path / "none")
    assert not (tmp_path / "none").exists()


def test_a_reference_the_wrong_way_round_is_doubted(tmp_path: Path) -> None:
    T = np.eye(4)
    T[:3, :3] = layouts.LIDAR_TO_CAMERA.T
    layouts.folder_of_pairs(tmp_path / "road", T_camera_lidar=T.tolist())
    made = import_dataset(Folder(tmp_path / "road"), tmp_path / "out")
    assert any("does T_camera_lidar map camera points to LiDAR points?" in w for w in made.warnings)


def test_covariance_of_file_and_options(tmp_path: Path) -> None:
    root = np.random.default_rng(0).normal(size=(6, 6)) * 1e-3
    full = root @ root.T
    layouts.folder_of_pairs(tmp_path / "full", covariance=full.tolist())
    made = import_dataset(Folder(tmp_path / "full"), tmp_path / "out", covariance=np.eye(6))
    np.testing.assert_allclose(made.dataset.poses[0].covariance, full)
    np.testing.assert_allclose(made.dataset.poses[0].budget["T_camera_lidar"], full)
    assert validate(tmp_path / "out") == []
    layouts.folder_of_pairs(tmp_path / "none")
    given = np.diag([1e-4, 1e-4, 1e-4, 1e-6, 1e-6, 1e-6])
    made = import_dataset(Folder(tmp_path / "none"), tmp_path / "out2", covariance=given)
    np.testing.assert_allclose(made.dataset.poses[0].covariance, given)
    link = made.dataset.rig.T_camera_lidar
    assert link is not None
    np.testing.assert_allclose(link.covariance, given)


def test_fields_of_a_cloud_are_kept(tmp_path: Path) -> None:
    root = tmp_path / "road"
    layouts.folder_of_pairs(root, 1)
    dtype = [
        ("x", "<f8"),
        ("y", "<f8"),
        ("z", "<f8"),
        ("ring", "<u2"),
        ("t", "<u4"),
        ("rgb", "<f4"),
    ]
    values = np.zeros((4, 8), dtype)
    for name in values.dtype.names or ():
        values[name] = np.arange(32).reshape(4, 8) + 1
    (root / "000000.pcd").unlink()
    np.save(root / "000000.npy", values)
    made = import_dataset(Folder(root), tmp_path / "out")
    records, height, width = cloud_file.read(tmp_path / "out" / made.dataset.pairs[0].cloud)
    assert (height, width) == (4, 8)
    assert records.dtype.descr == dtype
    np.testing.assert_array_equal(records, values.reshape(-1))
    assert any("no intensity" in warning for warning in made.warnings)


def test_names_that_are_no_utf_8_are_names_too(tmp_path: Path) -> None:
    root = tmp_path / "road"
    layouts.folder_of_pairs(root, 2)
    for suffix in (b".png", b".pcd"):
        file = root / f"000001{suffix.decode()}"
        file.rename(root / os.fsdecode(b"a \xff b" + suffix))
    layouts.image(root / os.fsdecode(b"\xfe.png"))
    made = import_dataset(Folder(root), tmp_path / "out")
    assert [r.pair_id for r in made.dataset.pairs] == [
        "road/pose_000/000000",
        "road/pose_000/a___b",
    ]
    assert "udcfe: there is an image of this name, but no cloud" in made.failures[0]
    assert validate(tmp_path / "out") == []
