"""nuScenes, against the steps of its devkit."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from lcdata.dataset import cloud_file, validate
from lcdata.dataset.importers import Choice, NuScenes, import_dataset
from lcdata.errors import DatasetError, SourceError
from lcdata.geometry import se3

from . import layouts


def forward(points: np.ndarray, row: dict[str, Any]) -> np.ndarray:
    """Points of a row's frame in the frame above."""
    w, x, y, z = row["rotation"]
    return Rotation.from_quat([x, y, z, w]).apply(points) + row["translation"]


def backward(points: np.ndarray, row: dict[str, Any]) -> np.ndarray:
    w, x, y, z = row["rotation"]
    return Rotation.from_quat([x, y, z, w]).inv().apply(points - row["translation"])


@pytest.mark.parametrize("camera", ["CAM_FRONT", "CAM_BACK"])
def test_points_project_as_in_the_devkit(tmp_path: Path, camera: str) -> None:
    made_files = layouts.NuScenesFiles(tmp_path / "nuscenes")
    made = import_dataset(NuScenes(tmp_path / "nuscenes", camera), tmp_path / "out")
    assert (made.pairs, made.poses, made.failures) == (3, 1, [])
    assert validate(tmp_path / "out") == []
    for n, (pair, record) in enumerate(zip(made.dataset, made.dataset.pairs, strict=True)):
        scan, picture = (
            made_files.row("sample_data", f"scene-0000-{n}-{channel}")
            for channel in ("LIDAR_TOP", camera)
        )
        raw = np.fromfile(tmp_path / "nuscenes" / scan["filename"], "<f4").reshape(-1, 5)
        # LiDAR to vehicle, to world at the scan's time; to vehicle at the image's time, to camera
        points = forward(
            raw[:, :3].astype(float),
            made_files.row("calibrated_sensor", scan["calibrated_sensor_token"]),
        )
        points = forward(points, made_files.row("ego_pose", scan["ego_pose_token"]))
        points = backward(points, made_files.row("ego_pose", picture["ego_pose_token"]))
        points = backward(
            points, made_files.row("calibrated_sensor", picture["calibrated_sensor_token"])
        )
        of_camera = se3.apply(pair.T_camera_lidar, pair.points)
        np.testing.assert_allclose(of_camera, points, atol=2e-5)
        y = points @ made_files.K.T
        pixels, inside = pair.camera.project(of_camera)
        front = points[:, 2] > 1
        np.testing.assert_allclose(pixels[front], (y[:, :2] / y[:, 2:])[front], atol=1e-3)
        assert inside.sum() > 20 or camera == "CAM_BACK"
        np.testing.assert_array_equal(pair.intensity, raw[:, 3])
        np.testing.assert_array_equal(pair.ring, raw[:, 4])
        assert record.stamp_lidar_ns == scan["timestamp"] * 1000
        assert record.stamp_image_ns == picture["timestamp"] * 1000
        assert np.abs(pair.points - raw[:, :3]).max() > 0.05  # the vehicle drove in between
        image = (tmp_path / "nuscenes" / picture["filename"]).read_bytes()
        assert (tmp_path / "out" / record.image).read_bytes() == image


def test_points_without_return_stay_at_the_origin(tmp_path: Path) -> None:
    made_files = layouts.NuScenesFiles(tmp_path / "nuscenes", samples=1)
    name = made_files.row("sample_data", "scene-0000-0-LIDAR_TOP")["filename"]
    values = np.fromfile(tmp_path / "nuscenes" / name, "<f4").reshape(-1, 5)
    values[::7, :3] = 0
    layouts.scan(tmp_path / "nuscenes" / name, values)
    made = import_dataset(NuScenes(tmp_path / "nuscenes"), tmp_path / "out")
    records, _, _ = cloud_file.read(tmp_path / "out" / made.dataset.pairs[0].cloud)
    assert records.dtype.names == ("x", "y", "z", "intensity", "ring")
    assert not records["x"][::7].any() and not records["z"][::7].any()


def test_scenes_are_chosen_by_name(tmp_path: Path) -> None:
    layouts.NuScenesFiles(tmp_path / "nuscenes", scenes=3)
    importer = NuScenes(tmp_path / "nuscenes" / "v1.0-mini")
    choice = Choice(only=("scene-0002", "scene-0000"), limit=2)
    made = import_dataset(importer, tmp_path / "out", choice=choice)
    assert made.dataset.scenarios == ("scene-0000", "scene-0002")
    assert (made.pairs, made.poses) == (4, 2)


def test_another_calibration_is_another_data_set(tmp_path: Path) -> None:
    made_files = layouts.NuScenesFiles(tmp_path / "nuscenes", scenes=2, samples=1)
    import_dataset(NuScenes(tmp_path / "nuscenes"), tmp_path / "out")
    mounted = made_files.row("calibrated_sensor", "scene-0001-CAM_FRONT")
    mounted["translation"][0] += 1e-3
    made_files.write()
    with pytest.raises(DatasetError, match="already holds a data set"):
        import_dataset(NuScenes(tmp_path / "nuscenes"), tmp_path / "out")


def test_rows_and_files_that_are_missing_cost_their_own_pair(tmp_path: Path) -> None:
    made_files = layouts.NuScenesFiles(tmp_path / "nuscenes", samples=6)
    tables = made_files.tables

    def drop(table: str, token: str) -> None:
        tables[table] = [row for row in tables[table] if row["token"] != token]

    drop("ego_pose", "pose-scene-0000-1-CAM_FRONT")
    drop("sample_data", "scene-0000-2-LIDAR_TOP")
    gone = made_files.row("sample_data", "scene-0000-3-CAM_FRONT")["filename"]
    (tmp_path / "nuscenes" / gone).unlink()
    cut = made_files.row("sample_data", "scene-0000-4-LIDAR_TOP")["filename"]
    (tmp_path / "nuscenes" / cut).write_bytes(b"1234567")
    made_files.row("sample_data", "scene-0000-5-CAM_FRONT")["calibrated_sensor_token"] = "other"
    made_files.write()
    made = import_dataset(NuScenes(tmp_path / "nuscenes"), tmp_path / "out")
    assert made.pairs == 1
    text = "\n".join(made.failures)
    assert "no pose-scene-0000-1-CAM_FRONT, which scene-0000-1-CAM_FRONT refers to" in text
    assert "sample scene-0000-2: no key frame of LIDAR_TOP" in text
    assert gone in text and "is not there" in text
    assert cut in text and "7 bytes" in text
    assert "calibrated_sensor.json: no other, which scene-0000-5-CAM_FRONT refers to" in text
    assert len(made.failures) == 5
    assert validate(tmp_path / "out") == []


def test_tables_that_do_not_belong_together_are_refused(tmp_path: Path) -> None:
    root = tmp_path / "nuscenes"
    made_files = layouts.NuScenesFiles(root)

    def error(**options: Any) -> str:
        with pytest.raises(SourceError) as caught:
            import_dataset(NuScenes(root, **options), tmp_path / "out")
        assert not (tmp_path / "out").exists()
        return str(caught.value)

    assert "no channel 'CAM_TOP': there are CAM_BACK, CAM_FRONT, LIDAR_TOP" in error(
        camera="CAM_TOP"
    )
    assert "v1.0-test: no such folder" in error(version="v1.0-test")
    for row in made_files.tables["sample_data"]:
        row["sample_token"] += "-of-another-version"
    made_files.write()
    assert "no key frame of CAM_FRONT of this sample" in error()
    (root / "v1.0-mini" / "ego_pose.json").write_text("[{")
    made_files.tables["sample_data"][0]["sample_token"] = "scene-0000-0"
    made_files.tables["sample_data"][1]["sample_token"] = "scene-0000-0"
    made_files.tables.pop("ego_pose")
    made_files.write()
    assert "ego_pose.json: cannot be read (no JSON" in error()
    layouts.NuScenesFiles(root)
    (root / "v1.0-mini" / "sample.json").unlink()
    assert "sample.json: cannot be read (No such file" in error()
    layouts.NuScenesFiles(root)
    (root / "v1.0-trainval").mkdir()
    (root / "v1.0-trainval" / "sample_data.json").write_text("[]")
    assert "several versions: v1.0-mini, v1.0-trainval" in error()
    root = tmp_path / "empty"
    root.mkdir()
    assert "no tables of nuScenes in it" in error()
