"""OpenCalib's and Calib-Anything's folders."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from lcdata.dataset import validate
from lcdata.dataset.importers import Choice, OpenCalib, import_dataset
from lcdata.errors import SourceError
from lcdata.geometry import se3

from . import layouts


def test_a_pair_with_its_mask(tmp_path: Path) -> None:
    K, T = layouts.opencalib(tmp_path / "data")
    mask = layouts.mask(tmp_path / "data" / "mask.jpg")
    made = import_dataset(OpenCalib(tmp_path / "data"), tmp_path / "out")
    assert (made.pairs, made.poses, made.failures, made.warnings) == (1, 1, [], [])
    assert validate(tmp_path / "out") == []
    (pair,) = made.dataset
    assert pair.pair_id == "data/pose_000/calib"
    np.testing.assert_allclose(pair.T_camera_lidar, T, atol=1e-12)
    points = pair.points.astype(float) @ T[:3, :3].T + T[:3, 3]
    D = np.array([-0.1, 0.05, 0.001, -0.002])
    expected, _ = cv2.projectPoints(points, np.zeros(3), np.zeros(3), K, D)
    pixels, inside = pair.camera.project(se3.apply(pair.T_camera_lidar, pair.points))
    np.testing.assert_allclose(pixels[inside], expected[inside, 0], atol=1e-6)
    assert inside.sum() > 10
    assert (tmp_path / "out" / "masks" / f"{pair.pair_id}.jpg").read_bytes() == mask


def calib_anything(folder: Path, text: str) -> None:
    layouts.image(folder / "1.png")
    layouts.pcd(folder / "000001.pcd", layouts.points())
    (folder / "calib.txt").write_text(text)
    for i in range(3):
        layouts.mask(folder / "masks" / f"{i:03}.png")


def test_folders_of_calib_anything(tmp_path: Path) -> None:
    R = layouts.small_rotation(np.random.default_rng(3)) @ layouts.LIDAR_TO_CAMERA
    T = np.column_stack([R, [0.1, -0.2, 0.3]])
    K = [55.0, 0, 31.5, 0, 56.0, 23.5, 0, 0, 1]
    D = [-0.1, 0.05, 0.001, -0.002]
    lines = [layouts.line(key, v) for key, v in (("K", K), ("D", D), ("T", T))]
    calib_anything(tmp_path / "data" / "st" / "2", "\n".join(lines))
    P = np.column_stack([np.reshape(K, (3, 3)), [5.0, -1.0, 0.01]])
    lines = [layouts.line("P2", P), layouts.line("Tr", T)]
    calib_anything(tmp_path / "data" / "kitti" / "1", "\n".join(lines))
    layouts.opencalib(tmp_path / "data" / "manual", "0")
    made = import_dataset(OpenCalib(tmp_path / "data"), tmp_path / "out")
    assert made.dataset.scenarios == ("kitti_1", "manual", "st_2")
    assert (made.pairs, made.poses, made.failures) == (3, 3, [])
    assert validate(tmp_path / "out") == []
    kitti, manual, st = made.dataset
    np.testing.assert_allclose(st.T_camera_lidar[:3], T, atol=1e-9)
    assert st.camera.distortion == tuple(D) and not kitti.camera.is_distorted
    X = np.column_stack([kitti.points, np.ones(60)]).astype(float)
    y = X @ (P @ np.vstack([T, [0, 0, 0, 1]])).T
    pixels, _ = kitti.camera.project(se3.apply(kitti.T_camera_lidar, kitti.points))
    np.testing.assert_allclose(pixels, y[:, :2] / y[:, 2:], atol=1e-6)
    segments = sorted((tmp_path / "out" / "masks" / st.pair_id).iterdir())
    assert [file.name for file in segments] == ["000.png", "001.png", "002.png"]
    # masks lie in folders of their own: they are no scenario
    assert not (tmp_path / "out" / "masks" / manual.pair_id).exists()
    one = import_dataset(OpenCalib(tmp_path / "data"), tmp_path / "one", choice=Choice(("st_2",)))
    assert one.dataset.scenarios == ("st_2",)


def test_a_configuration_names_its_files(tmp_path: Path) -> None:
    root, truth = tmp_path / "kitti", np.eye(4)
    truth[:3, :3], truth[:3, 3] = layouts.LIDAR_TO_CAMERA, (0.1, 0.2, 0.3)
    rough = truth.copy()
    rough[:3, 3] += 0.1
    for i in range(3):
        layouts.image(root / "images" / f"{i:06}.png", i)
        layouts.pcd(root / "pc" / f"{i:06}.pcd", layouts.points(i))
        for n in range(2):
            layouts.mask(root / "processed_masks" / f"{i:06}" / f"{n}.png")
    content = {
        "cam_K": layouts.matrix([[55.0, 0, 31.5], [0, 56.0, 23.5], [0, 0, 1]]),
        "cam_dist": {"cols": 5, "data": [-0.1, 0.05, 0.001, -0.002, 0]},
        "T_lidar_to_cam": layouts.matrix(rough),
        "T_lidar_to_cam_gt": {"available": True, **layouts.matrix(truth)},
        "img_folder": "images",
        "mask_folder": "processed_masks",
        "pc_folder": "pc",
        "img_format": ".png",
        "pc_format": ".pcd",
        "file_name": ["000000", "000002"],
        "params": {},
    }
    (root / "calib.json").write_text(json.dumps(content))
    made = import_dataset(OpenCalib(root), tmp_path / "out")
    assert [p.pair_id for p in made.dataset.pairs] == [
        "kitti/pose_000/000000",
        "kitti/pose_000/000002",
    ]
    np.testing.assert_allclose(made.dataset.poses[0].T_camera_lidar, truth)
    assert len(list((tmp_path / "out" / "masks").rglob("*.png"))) == 4
    content["T_lidar_to_cam_gt"]["available"] = False
    content["file_name"] = ["000001", "000007"]
    (root / "calib.json").write_text(json.dumps(content))
    with pytest.raises(SourceError, match="neither image nor cloud of 000007"):
        import_dataset(OpenCalib(root), tmp_path / "out", force=True)
    content["file_name"] = ["000001"]
    (root / "calib.json").write_text(json.dumps(content))
    made = import_dataset(OpenCalib(root), tmp_path / "out", force=True)
    assert "no ground truth (T_lidar_to_cam_gt)" in made.warnings[0]
    np.testing.assert_allclose(made.dataset.poses[0].T_camera_lidar, rough)
    assert len(list((tmp_path / "out" / "masks").rglob("*.png"))) == 2  # the old ones went


def test_bad_folders_are_named(tmp_path: Path) -> None:
    root = tmp_path / "data"
    layouts.opencalib(root)
    extrinsic = root / "top_center_lidar-to-center_camera-extrinsic.json"
    intrinsic = root / "center_camera-intrinsic.json"
    good = json.loads(extrinsic.read_text()), json.loads(intrinsic.read_text())

    def error() -> str:
        with pytest.raises(SourceError) as caught:
            import_dataset(OpenCalib(root), tmp_path / "out")
        assert not (tmp_path / "out").exists()
        return str(caught.value)

    content = json.loads(json.dumps(good[0]))
    (entry,) = content.values()
    entry["target_sensor_name"] = "left_camera"
    extrinsic.write_text(json.dumps(content))
    assert "its target_sensor_name is 'left_camera', the camera is 'center_camera'" in error()
    entry["target_sensor_name"] = "center_camera"
    entry["param"]["sensor_calib"]["data"][0][0] = 0.9
    extrinsic.write_text(json.dumps(content))
    assert "-extrinsic.json: data is not a rotation" in error()
    entry["param"]["sensor_calib"] = {}
    extrinsic.write_text(json.dumps(content))
    assert "no sensor_calib with data in it" in error()
    extrinsic.write_text(json.dumps(good[0]))
    content = json.loads(json.dumps(good[1]))
    (entry,) = content.values()
    entry["param"]["cam_K"]["data"].pop()
    intrinsic.write_text(json.dumps(content))
    assert "cam_K has 2x3 values: give fx fy cx cy, or 3x3" in error()
    intrinsic.unlink()
    assert "0 *-intrinsic.json and 1 *-extrinsic.json" in error()
    extrinsic.unlink()
    assert "no calibration of OpenCalib in it or below" in error()
    (root / "calib.txt").write_text("K: 1 2 3\n")
    assert "calib.txt: no T in it" in error()
    (root / "calib.txt").write_text("K: 1 2 3\nT: 1 0 0 0 0 1 0 0 0 0 1 0\n")
    assert "calib.txt: K has 3 values" in error()


def test_the_real_crossing(shared: Path, tmp_path: Path) -> None:
    """The reference was taken over from these two files of auto_calib."""
    source = shared / "data" / "opencalib_crossing"
    reference = json.loads((source / "reference.json").read_text())
    layouts.opencalib(tmp_path / "data")
    for name in ("calib.png", "calib.pcd", "mask.jpg"):
        (tmp_path / "data" / name).unlink(missing_ok=True)
        (tmp_path / "data" / name).symlink_to(source / name)
    fx, fy, cx, cy = reference["K"]
    for file, key, values in (
        ("center_camera-intrinsic", "cam_K", [[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]]),
        ("center_camera-intrinsic", "cam_dist", [reference["D"]]),
        (
            "top_center_lidar-to-center_camera-extrinsic",
            "sensor_calib",
            reference["T_camera_lidar"],
        ),
    ):
        path = tmp_path / "data" / f"{file}.json"
        content = json.loads(path.read_text())
        content[file]["param"][key] = layouts.matrix(values)
        content[file]["param"] |= {"img_dist_w": 1920, "img_dist_h": 1200}
        path.write_text(json.dumps(content))
    made = import_dataset(OpenCalib(tmp_path / "data"), tmp_path / "out")
    (pair,) = made.dataset
    _, inside = pair.camera.project(se3.apply(pair.T_camera_lidar, pair.points))
    assert inside.sum() > 5_000 and pair.ring is not None and pair.intensity is not None
    mask = tmp_path / "out" / "masks" / "data" / "pose_000" / "calib.jpg"
    assert mask.read_bytes() == (source / "mask.jpg").read_bytes()
