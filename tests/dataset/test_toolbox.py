"""Initial guesses from the files of direct_visual_lidar_calibration."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from lcdata.dataset.toolbox import GUESSES, read_toolbox_json, toolbox_matches, toolbox_pose
from lcdata.errors import CalibrationError
from lcdata.geometry import se3

# From the toolbox's documentation: a LiDAR whose x axis points forward, a camera that looks along.
WRITTEN = [0.227550, 0.141804, 0.094825, -0.499984, 0.493175, -0.503761, 0.503011]


def test_the_pose_is_inverted_and_the_first_guess_is_taken(tmp_path: Path) -> None:
    path = tmp_path / "calib.json"
    results = {"T_lidar_camera": [9, 9, 9, 0, 0, 0, 1], "init_T_lidar_camera": WRITTEN}
    path.write_text(json.dumps({"camera": {}, "results": results}))
    name, T = toolbox_pose(read_toolbox_json(path), path)
    assert name == "init_T_lidar_camera"
    # The camera's centre in the LiDAR frame is what is written; it looks along the LiDAR's x.
    np.testing.assert_allclose(se3.inverse(T)[:3, 3], WRITTEN[:3], atol=1e-6)
    np.testing.assert_allclose(T[:3, :3] @ [1, 0, 0], [0, 0, 1], atol=0.03)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("{", "no JSON"),
        ("[]", "neither a calib.json"),
        ('{"camera": {}}', "neither a calib.json"),
        ('{"results": {}}', f"no {', '.join(GUESSES)}"),
        ('{"results": {"T_lidar_camera": [1, 2]}}', "T_lidar_camera is no pose"),
        ('{"results": {"T_lidar_camera": [0, 0, 0, 0, 0, 0, 0]}}', "T_lidar_camera is no pose"),
        ('{"results": {"T_lidar_camera": "x"}}', "T_lidar_camera is no pose"),
    ],
)
def test_a_damaged_calib_json_is_named(tmp_path: Path, content: str, message: str) -> None:
    path = tmp_path / "calib.json"
    path.write_text(content)
    with pytest.raises(CalibrationError, match=message):
        toolbox_pose(read_toolbox_json(path), path)
    with pytest.raises(CalibrationError, match="cannot be read"):
        read_toolbox_json(tmp_path / "none.json")


def toolbox_folder(path: Path) -> tuple[Path, np.ndarray]:
    """Five points, of which the LiDAR's image shows four."""
    points = np.arange(15, dtype=np.float32).reshape(5, 3)
    header = "\n".join(
        ["ply", "format ascii 1.0", "element vertex 5"]
        + [f"property float {name}" for name in "xyz"]
        + ["end_header", ""]
    )
    (path / "bag_1.ply").write_text(
        header + "\n".join(" ".join(map(str, p)) for p in points) + "\n"
    )
    index = np.full((6, 8), -1, "<i4")
    index[1, 2], index[3, 4], index[5, 7], index[0, 0] = 0, 1, 300 - 297, 4
    cv2.imwrite(str(path / "bag_1_lidar_indices.png"), index.view(np.uint8).reshape(6, 8, 4))
    matches = {
        "kpts0": [100, 50, 7, 8, 60.5, 40, 1, 2],
        "kpts1": [2, 1, 7, 5, 6, 0],
        "matches": [1, -1, 0, 2],  # the last shows no point
        "confidence": [0.9, 0, 0.2, 0.5],
    }
    file = path / "bag_1_matches.json"
    file.write_text(json.dumps(matches))
    return file, points


def test_matches_are_pixels_and_the_points_that_the_lidar_image_shows(tmp_path: Path) -> None:
    path, points = toolbox_folder(tmp_path)
    found = toolbox_matches(read_toolbox_json(path), path)
    np.testing.assert_allclose(found, [[100, 50, *points[3]], [60.5, 40, *points[0]]])


def test_files_that_do_not_belong_together_are_named(tmp_path: Path) -> None:
    path, _ = toolbox_folder(tmp_path)
    content = read_toolbox_json(path)
    with pytest.raises(CalibrationError, match="does not fit bag_1_lidar_indices"):
        toolbox_matches(content | {"kpts1": [200, 1, 7, 5, 6, 0]}, path)
    with pytest.raises(CalibrationError, match="has no match with a point"):
        toolbox_matches(content | {"matches": [-1, -1, -1, 2]}, path)
    (tmp_path / "bag_1.ply").unlink()
    with pytest.raises(CalibrationError, match=r"no bag_1\.ply"):
        toolbox_matches(content, path)
