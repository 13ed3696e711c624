"""Recordings without a bag: images, clouds and a joint log in a folder."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from lcdata.dataset import build
from lcdata.errors import LcdataError, MessageError, RecordingError
from lcdata.recording.cloud_files import read_cloud
from lcdata.recording.messages import xyz
from lcdata.recording.source import find_recordings, open_recording
from lcdata.recording.summary import summarise
from lcdata.rig import load_rig

from .bags import JOINTS, MS, START

CAMERA = {"width": 32, "height": 24, "intrinsics": [40.0, 40.0, 15.5, 11.5]}
LINK = {"translation_m": [0, 0, 0], "rotation_rpy_deg": [0, 0, 0]}
POINTS = np.random.default_rng(0).normal(0, 5, (50, 4)).astype("<f4")


def write_image(path: Path, seed: int = 0) -> None:
    import cv2

    pixels = np.random.default_rng(seed).integers(0, 255, (24, 32, 3), np.uint8)
    cv2.imwrite(str(path), pixels)


def write_pcd(path: Path, points: Any = POINTS) -> None:
    from pypcd4 import PointCloud

    PointCloud.from_xyzi_points(points).save(path)


def write_ply(path: Path, kind: str, dtype: str = "float") -> None:
    names = ("x", "y", "z", "intensity")
    lines = ["ply", f"format {kind} 1.0", "comment made by a test", f"element vertex {len(POINTS)}"]
    lines += [f"property {dtype} {name}" for name in names]
    lines += ["element face 0", "property list uchar int vertex_indices", "end_header"]
    head = "\n".join(lines).encode() + b"\n"
    if kind == "ascii":
        body = "\n".join(" ".join(map(repr, row)) for row in POINTS.tolist()).encode()
    else:
        order = "<" if "little" in kind else ">"
        body = POINTS.astype(order + ("f4" if dtype == "float" else "f8")).tobytes()
    path.write_bytes(head + body)


def as_bin(path: Path) -> None:
    path.write_bytes(POINTS.tobytes())


CLOUDS = {
    "a.pcd": write_pcd,
    "a.bin": as_bin,
    "a.npy": lambda path: np.save(path, POINTS),
    "b.npy": lambda path: np.save(path, POINTS.reshape(5, 10, 4)),
    "c.npy": lambda path: np.save(
        path, POINTS.view([(n, "<f4") for n in ("x", "y", "z", "intensity")])[:, 0]
    ),
    "a.ply": lambda path: write_ply(path, "ascii"),
    "b.ply": lambda path: write_ply(path, "binary_little_endian"),
    "c.ply": lambda path: write_ply(path, "binary_big_endian", "double"),
}


@pytest.mark.parametrize("name", CLOUDS)
def test_clouds_of_every_kind_have_their_points_and_intensity(tmp_path: Path, name: str) -> None:
    CLOUDS[name](tmp_path / name)
    records, height, width = read_cloud(tmp_path / name)
    assert (height, width) == ((5, 10) if name == "b.npy" else (1, 50))
    for i, field in enumerate(("x", "y", "z", "intensity")):
        np.testing.assert_array_equal(records[field], POINTS[:, i])


def test_clouds_of_nuscenes_have_rings(tmp_path: Path) -> None:
    rings = np.arange(50, dtype="<f4")[:, None] % 32
    for name in ("a.pcd.bin", "a.bin"):  # 50 points: as many bytes as 62.5 of KITTI's
        (tmp_path / name).write_bytes(np.hstack([POINTS, rings]).tobytes())
        records, _, _ = read_cloud(tmp_path / name)
        np.testing.assert_array_equal(records["intensity"], POINTS[:, 3])
        np.testing.assert_array_equal(records["ring"], rings[:, 0])
    # 48 points are as many bytes as 60 of KITTI's, and the other way round
    (tmp_path / "b.bin").write_bytes(np.hstack([POINTS, rings])[:48].tobytes())
    assert read_cloud(tmp_path / "b.bin").records.dtype.names[-1] == "ring"
    (tmp_path / "c.bin").write_bytes(np.tile(POINTS, (2, 1))[:60].tobytes())
    assert read_cloud(tmp_path / "c.bin").records.dtype.names[-1] == "intensity"
    np.save(tmp_path / "d.npy", np.hstack([POINTS, rings]))
    assert read_cloud(tmp_path / "d.npy").records.dtype.names[-1] == "ring"
    np.save(tmp_path / "e.npy", np.hstack([POINTS, rings + 0.5]))
    assert read_cloud(tmp_path / "e.npy").records.dtype.names[-1] == "column_5"


def test_padding_and_foreign_byte_order_are_left_out(tmp_path: Path) -> None:
    padded = np.dtype(
        [
            ("x", "f4"),
            ("y", "f4"),
            ("z", "f4"),
            ("pad", "u1", 4),
            ("intensity", "f4"),
            ("tail", "u1", 3),
        ]
    )
    values = np.zeros(50, padded)
    for i, name in enumerate(("x", "y", "z", "intensity")):
        values[name] = POINTS[:, i]
    header = (
        "VERSION 0.7\nFIELDS x y z _ intensity _\nSIZE 4 4 4 1 4 1\nTYPE F F F U F U\n"
        "COUNT 1 1 1 4 1 3\nWIDTH 50\nHEIGHT 1\nPOINTS 50\nDATA binary\n"
    )
    (tmp_path / "a.pcd").write_bytes(header.encode() + values.tobytes())
    np.save(
        tmp_path / "b.npy",
        values[["x", "y", "z", "intensity"]].astype(
            padded[["x", "y", "z", "intensity"]].newbyteorder(">")
        ),
    )
    for name in ("a.pcd", "b.npy"):
        records, _, _ = read_cloud(tmp_path / name)
        assert records.dtype == np.dtype([(n, "f4") for n in ("x", "y", "z", "intensity")])
        np.testing.assert_array_equal(records["intensity"], POINTS[:, 3])


def test_damaged_clouds_are_named(tmp_path: Path) -> None:
    for name, content in {
        "a.bin": b"123",
        "a.pcd": b"no header",
        "a.npy": b"",
        "a.ply": b"ply\nformat ascii 1.0\n",
        "b.ply": b"ply\nformat binary_little_endian 1.0\nelement vertex 9\nproperty float x\n"
        b"end_header\n123",
    }.items():
        (tmp_path / name).write_bytes(content)
        with pytest.raises(MessageError, match=name):
            read_cloud(tmp_path / name)
    np.save(tmp_path / "b.npy", np.zeros((3, 7)))
    with pytest.raises(MessageError, match=r"shape \(3, 7\)"):
        read_cloud(tmp_path / "b.npy")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A simulated arm between two poses: images and clouds once in each dwell, joints at 50 Hz."""
    run = tmp_path / "run"
    for name in ("images", "clouds"):
        (run / name).mkdir(parents=True)
    goals = np.random.default_rng(1).uniform(-1, 1, (2, 6))
    rows = []
    for i in range(200):
        blend = np.clip((i - 75) / 50, 0, 1)
        q = goals[0] + blend * (goals[1] - goals[0])
        rows.append(f"{(START + i * 20 * MS) / 1e9:.3f}," + ",".join(map(repr, q.tolist())))
    (run / "joints.csv").write_text("\n".join(["stamp," + ",".join(JOINTS), *rows]))
    for second in (1, 3):
        stamp = START + second * 10**9
        write_pcd(run / f"clouds/{stamp}.pcd")
        # The same time in seconds, 3 ms later.
        write_image(run / f"images/{(stamp + 3 * MS) // 10**9}.003000000.png", second)
    rig = {"camera": CAMERA, "T_camera_effector": LINK, "T_base_lidar": LINK}
    (tmp_path / "rig.yaml").write_text(yaml.safe_dump(rig))
    return run


def test_a_folder_is_a_recording(folder: Path, tmp_path: Path) -> None:
    assert find_recordings(tmp_path) == [folder]
    with open_recording(folder) as recording:
        clouds = [message for _, message in recording.messages(["clouds"])]
        images = [message for _, message in recording.messages(["images"])]
    np.testing.assert_array_equal(xyz(clouds[0]), POINTS[:, :3])  # type: ignore[arg-type]
    assert [m.stamp_ns - START for m in images] == [1003 * MS, 3003 * MS]
    found = summarise(folder, load_rig(tmp_path / "rig.yaml"))
    assert found.obstacles == [] and found.problems == [] and found.clocks == []
    assert [pose.pairs for pose in found.poses] == [1, 1]
    assert "joints.csv: 200 samples" in "\n".join(found.lines())
    assert "CALIBRATE" in summarise(folder).rig_yaml


def test_a_folder_builds_and_keeps_its_images(folder: Path, tmp_path: Path) -> None:
    built = build(folder, tmp_path / "out")
    assert built.pairs == 2 and built.poses == 2 and built.failures == []
    (image,) = (folder / "images").glob("*1.003*")
    assert (tmp_path / "out" / built.dataset.pairs[0].image).read_bytes() == image.read_bytes()
    np.testing.assert_array_equal(next(iter(built.dataset)).points, POINTS[:, :3])
    # One changed cloud is another recording.
    write_pcd(sorted((folder / "clouds").iterdir())[0], POINTS * 2)
    with pytest.raises(LcdataError, match="other recordings"):
        build(folder, tmp_path / "out")


def test_a_damaged_file_costs_its_own_pair(folder: Path, tmp_path: Path) -> None:
    first, second = sorted((folder / "clouds").iterdir())
    second.write_bytes(second.read_bytes()[:200])
    (folder / "clouds" / "scan_7.pcd").write_bytes(first.read_bytes())
    built = build(folder, tmp_path / "out")
    assert built.pairs == 1
    text = "\n".join(built.failures)
    assert second.name in text and "not named by a stamp, the first is scan_7.pcd" in text


def test_real_frames_in_a_folder(shared: Path, tmp_path: Path) -> None:
    source = shared / "data" / "kitti_road"
    reference = json.loads((source / "reference.json").read_text())
    run = tmp_path / "road"
    for name in ("images", "clouds"):
        (run / name).mkdir(parents=True)
    clouds = sorted(source.glob("*.pcd"))[:2]
    for i, cloud in enumerate(clouds):
        stamp = START + i * 10**9
        (run / "clouds" / f"{stamp}.pcd").symlink_to(cloud)
        (run / "images" / f"{stamp}.png").symlink_to(cloud.with_suffix(".png"))
    width, height = 1241, 376
    camera = {"width": width, "height": height, "intrinsics": reference["K"]}
    rig = {
        "ground_truth": "static",
        "camera": camera | {"distortion": reference["D"]},
        "T_camera_lidar": reference["T_camera_lidar"],
    }
    (tmp_path / "rig.yaml").write_text(yaml.safe_dump(rig))
    built = build(run, tmp_path / "out")
    assert built.pairs == 2 and built.failures == []
    pair = next(iter(built.dataset))
    assert pair.image.shape == (height, width, 3) and pair.intensity is not None
    _, inside = pair.camera.project(pair.points @ pair.T_camera_lidar[:3, :3].T)
    assert inside.sum() > 10_000


def test_files_without_stamps_are_no_recording(folder: Path) -> None:
    for image in (folder / "images").iterdir():
        image.rename(image.with_name(f"left_{image.name[-5]}.png"))
    with pytest.raises(RecordingError, match="no file named by its stamp"):
        open_recording(folder)
