"""Validation finds each kind of damage, and none where there is none."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from lcdata.dataset import Dataset, PairRecord, PoseRecord, atomic, schema, validate


def test_a_whole_data_set_has_no_problems(folder: Path) -> None:
    calls: list[tuple[str, int, int]] = []
    assert validate(folder, progress=lambda *call: calls.append(call)) == []
    assert calls[-1] == ("checking", 8, 8)


def test_not_a_data_set(tmp_path: Path) -> None:
    (problem,) = validate(tmp_path)
    assert "no data set" in problem


def flip_bit(path: Path) -> None:
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(data)


def test_damaged_files(folder: Path) -> None:
    first, second, third = Dataset.open(folder).pairs[:3]
    flip_bit(folder / first.cloud)
    flip_bit(folder / second.image)
    (folder / third.cloud).unlink()
    (folder / "a" / "stray.txt").write_text("?")
    (folder / "a" / f".000{atomic.MARK}77.pcd").write_text("?")
    (folder / "results").mkdir()
    (folder / "results" / "run.parquet").write_text("?")
    problems = validate(folder)
    assert len(problems) == 6
    for words in (
        f"{first.cloud}: checksum differs",
        f"{second.image}: checksum differs",
        f"{third.cloud}: not there",
        "stray.txt: file that is not in",
        "unfinished file",
        "run.parquet: cannot be read",
    ):
        assert any(words in problem for problem in problems), words


def change_pose(folder: Path, **changes: object) -> None:
    poses = list(Dataset.open(folder).poses)
    poses[0] = dataclasses.replace(poses[0], **changes)
    atomic.write_parquet(folder / schema.POSES, schema.poses_table(poses))


def change_pair(folder: Path, **changes: object) -> None:
    pairs = list(Dataset.open(folder).pairs)
    pairs[0] = dataclasses.replace(pairs[0], **changes)
    atomic.write_parquet(folder / schema.PAIRS, schema.pairs_table(pairs))


def shifted(pose: PoseRecord) -> dict[str, object]:
    T = pose.T_camera_lidar.copy()
    T[0, 3] += 1e-3
    return {"T_camera_lidar": T}


def not_symmetric(pose: PoseRecord) -> dict[str, object]:
    covariance = pose.covariance.copy()
    covariance[0, 1] *= 1.001
    return {"covariance": covariance}


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (shifted, "product of its links"),
        (lambda pose: {"T_base_lidar": None}, "links of the chain are missing"),
        (not_symmetric, "not symmetric"),
        (lambda pose: {"covariance": -pose.covariance}, "negative eigenvalue"),
        (lambda pose: {"covariance": np.diag([np.nan] + [1.0] * 5)}, "not finite"),
        (lambda pose: {"start_ns": pose.end_ns + 1}, "before it starts"),
        (lambda pose: {"joint_positions": np.zeros(5)}, "joint positions for"),
        (lambda pose: {"groundtruth_version": "0"}, "ground truth version"),
        (lambda pose: {"pose_id": "a/pose_001"}, "is there 2 times"),
    ],
)
def test_damaged_poses(
    folder: Path, change: Callable[[PoseRecord], dict[str, object]], words: str
) -> None:
    change_pose(folder, **change(Dataset.open(folder).poses[0]))
    problems = validate(folder)
    assert any(words in problem for problem in problems), problems


def test_an_unknown_covariance_is_none_of_them(folder: Path) -> None:
    change_pose(folder, covariance=np.full((6, 6), np.nan))
    assert validate(folder) == []


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda pair: {"dt_ns": 0}, "its stamps say"),
        (
            lambda pair: {"stamp_image_ns": pair.stamp_lidar_ns + 51_000_000, "dt_ns": 51_000_000},
            "51.0 ms from the scan",
        ),
        (lambda pair: {"stamp_lidar_ns": 1, "stamp_image_ns": 1, "dt_ns": 0}, "outside its dwell"),
        (lambda pair: {"points": 199}, "200 points"),
        (lambda pair: {"pose_id": "a/pose_009"}, "not in poses.parquet"),
        (lambda pair: {"scenario": "c"}, "not in dataset.json"),
        (lambda pair: {"pair_id": "a/pose_000/001"}, "is there 2 times"),
    ],
)
def test_damaged_pairs(
    folder: Path, change: Callable[[PairRecord], dict[str, object]], words: str
) -> None:
    change_pair(folder, **change(Dataset.open(folder).pairs[0]))
    problems = validate(folder)
    assert any(words in problem for problem in problems), problems


def change_info(folder: Path, **changes: object) -> None:
    path = folder / schema.INFO
    path.write_text(json.dumps({**json.loads(path.read_text()), **changes}))


def test_a_rig_that_is_none(folder: Path) -> None:
    change_info(folder, rig={"ground_truth": "arm"})
    assert any("needs T_camera_effector" in problem for problem in validate(folder))


def test_a_camera_of_another_size(folder: Path) -> None:
    scenarios = json.loads((folder / schema.INFO).read_text())["scenarios"]
    scenarios["a"]["camera"]["width"] = 65
    change_info(folder, scenarios=scenarios)
    problems = validate(folder)
    assert len(problems) == 4
    assert "64x48, the camera has 65x48" in problems[0]
