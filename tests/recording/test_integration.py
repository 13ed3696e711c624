"""Scans merged as real bags are streamed."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lcdata.errors import IntegrationError, MissingLibraryError
from lcdata.geometry import se3
from lcdata.recording.integration import Merger, point_times
from lcdata.recording.messages import Cloud
from lcdata.recording.plan import PosePlan, RecordedPair, plan_poses
from lcdata.recording.source import open_recording
from lcdata.recording.summary import summarise
from lcdata.recording.survey import survey
from lcdata.recording.topics import choose_topics
from lcdata.rig import PointTime, Rig
from lcdata.rig_integration import IntegrationSection

from .bags import MS, START, Messages, write
from .moving_room import motion, scan

KINDS = [("x", "f4"), ("y", "f4"), ("z", "f4"), ("intensity", "f4"), ("t", "u4"), ("ring", "u2")]
SCANS = 8
IMAGES_MS = (31, 431)


def records(number: int, *, moving: bool, start_s: float = 0.0) -> np.ndarray:
    """A scan; its intensity is the height above the floor, in mm, and so tells of every shift."""
    points, seconds = scan(number if moving else 0, start_s=start_s)
    result = np.zeros(len(points), KINDS)
    for k, axis in enumerate("xyz"):
        result[axis] = points[:, k]
    T = motion((number if moving else 0) * 0.1 + seconds, start_s)
    room = np.einsum("nij,nj->ni", T[:, :3, :3], points) + T[:, :3, 3]
    result["intensity"] = 1000 * (room[:, 2] + 1.2)
    result["t"] = np.rint(seconds * 1e9)
    for axis in "xyz":
        result[axis][::50] = 0  # no return
    result["x"][7] = np.nan
    return result


def recording(folder: Path, *, moving: bool, fields: list[str] | None = None, **how: Any) -> Path:
    damaged, empty = how.pop("damaged", ()), how.pop("empty", ())
    untimed = how.pop("untimed", False)
    folder.mkdir(exist_ok=True)

    def stream(messages: Messages) -> Any:
        pixels = np.zeros((48, 64), np.uint8)
        for k in range(SCANS):
            stamp, points = START + 100 * k * MS, records(k, moving=moving, **how)
            if k in empty:
                for axis in "xyz":
                    points[axis] = 0
            if untimed:
                points = points.astype([(n, "f8" if n == "t" else kind) for n, kind in KINDS])
                points["t"][::9] = np.nan
            if fields:
                points = np.array(
                    points[fields].tolist(), [kind for kind in KINDS if kind[0] in fields]
                )
            message = messages.cloud(stamp, points)
            if k in damaged:
                message.data = message.data[:1000]
            yield "/lidar/points", stamp + 110 * MS, message
            for at in IMAGES_MS:
                if 100 * k < at < 100 * (k + 1):
                    taken = START + at * MS
                    yield "/camera/image", taken + 120 * MS, messages.image(taken, pixels, "mono8")
                    info = messages.camera_info(taken, 64, 48)
                    yield "/camera/camera_info", taken + 120 * MS, info

    return write(folder, "run", "mcap", stream)


def merge(
    path: Path, mode: str, skip: tuple[str, ...] = (), **rules: Any
) -> tuple[list[RecordedPair], dict[str, str], list[PosePlan]]:
    section = IntegrationSection(mode=mode, **rules)
    with open_recording(path) as opened:
        topics = choose_topics(opened)
        plan = plan_poses("run", survey(opened, topics), None, tolerance_ms=50, integration=section)
        merger = Merger(opened, topics, section, PointTime())
        return list(merger.pairs(plan, skip)), merger.failures, plan


def points_of(pair: RecordedPair) -> np.ndarray:
    return np.stack([pair.cloud.records[axis] for axis in "xyz"], 1).astype(float)


def test_scans_of_a_lidar_that_stands_still_add_up(tmp_path: Path) -> None:
    path = recording(tmp_path, moving=False)
    (pair,), failures, (plan,) = merge(path, "static")
    assert failures == {}
    assert (pair.pair_id, pair.scans) == ("run/pose_000/000", SCANS)
    assert pair.cloud.organised is None
    assert pair.cloud.records.dtype.names == ("x", "y", "z", "intensity")
    assert pair.image.stamp_ns == START + 31 * MS
    assert pair.cloud.stamp_ns == START == plan.lidar_ns[0]
    points = points_of(pair)
    assert np.isfinite(points).all()
    assert np.linalg.norm(points, axis=1).min() > 0.5
    single = records(0, moving=False)
    returned = np.isfinite(single["x"]) & (single["x"] != 0)
    assert 0.6 * returned.sum() < len(points) <= returned.sum(), "all scans are the same here"
    np.testing.assert_allclose(
        pair.cloud.records["intensity"].mean(), single["intensity"][returned].mean(), rtol=0.05
    )


def test_long_dwells_become_several_pairs_and_known_ones_are_skipped(tmp_path: Path) -> None:
    path = recording(tmp_path, moving=False)
    pairs, _, (plan,) = merge(path, "static", max_scans=4)
    assert [(pair.pair_id, pair.scans) for pair in pairs] == [
        ("run/pose_000/000", 4),
        ("run/pose_000/001", 4),
    ]
    assert [pair.image.stamp_ns for pair in pairs] == [START + at * MS for at in IMAGES_MS]
    rest, _, _ = merge(path, "static", skip=("run/pose_000/000",), max_scans=4)
    assert [pair.pair_id for pair in rest] == ["run/pose_000/001"]
    np.testing.assert_array_equal(rest[0].cloud.records, pairs[1].cloud.records)
    assert [len(run) for run in plan.merged_ns] == [4, 4]


def test_a_damaged_scan_is_left_out_of_its_cloud(tmp_path: Path) -> None:
    (pair,), failures, _ = merge(recording(tmp_path, moving=False, damaged=(0, 3)), "static")
    assert pair.scans == SCANS - 2
    assert failures == {}


def test_scans_of_a_moving_lidar_are_brought_to_the_moment_of_the_image(tmp_path: Path) -> None:
    """Every point's intensity is its true height: the map's heights must agree with it."""
    pytest.importorskip("small_gicp")
    path = recording(tmp_path, moving=True, start_s=0.7)
    (pair,), failures, _ = merge(path, "dynamic", voxel_m=0.02)
    assert failures == {}
    assert pair.scans == SCANS
    assert pair.cloud.stamp_ns == START
    T = motion(np.array(0.031), 0.7)
    height = 1000 * (se3.apply(T, points_of(pair))[:, 2] + 1.2)
    off = height - pair.cloud.records["intensity"]
    stiff = np.concatenate([records(k, moving=True, start_s=0.7) for k in range(SCANS)])
    stiff = stiff[np.isfinite(stiff["x"]) & (stiff["x"] != 0)]
    naive = 1000 * (se3.apply(T, np.stack([stiff[a] for a in "xyz"], 1))[:, 2] + 1.2)
    naive = naive - stiff["intensity"]
    print(
        f"\nheights off by {off.mean():.1f} +- {off.std():.1f} mm; as they came {naive.std():.0f}"
    )
    assert abs(off.mean()) < 15
    assert off.std() < 15
    assert naive.std() > 30


def test_empty_scans_and_points_without_a_time_do_no_harm(tmp_path: Path) -> None:
    pytest.importorskip("small_gicp")
    good = recording(tmp_path / "good", moving=True, start_s=0.7)
    bad = recording(tmp_path / "bad", moving=True, start_s=0.7, empty=(3,), untimed=True)
    (first,), _, _ = merge(good, "dynamic", voxel_m=0.05)
    (pair,), failures, _ = merge(bad, "dynamic", voxel_m=0.05)
    assert failures == {}
    assert pair.scans == SCANS
    assert 0.7 * len(first.cloud.records) < len(pair.cloud.records) < len(first.cloud.records)
    T = motion(np.array(0.031), 0.7)
    off = 1000 * (se3.apply(T, points_of(pair))[:, 2] + 1.2) - pair.cloud.records["intensity"]
    assert off.std() < 15
    nothing = recording(tmp_path / "nothing", moving=True, empty=range(SCANS))
    pairs, failures, _ = merge(nothing, "dynamic")
    assert pairs == []
    assert "none of them has points farther than 1 m" in failures["run/pose_000/000"]


def test_a_lidar_that_did_not_move_is_named(tmp_path: Path) -> None:
    pytest.importorskip("small_gicp")
    pairs, failures, _ = merge(recording(tmp_path, moving=False), "dynamic", max_scans=4)
    assert pairs == []
    assert set(failures) == {"run/pose_000/000", "run/pose_000/001"}
    assert "the LiDAR moved only" in failures["run/pose_000/000"]
    assert "integration: none" in failures["run/pose_000/000"]


def test_points_without_times_are_named(tmp_path: Path) -> None:
    path = recording(tmp_path, moving=False, fields=["x", "y", "z", "intensity"])
    with pytest.raises(
        IntegrationError, match=r"topic /lidar/points: .* have only x, y, z, intensity: .* static"
    ):
        merge(path, "dynamic")
    (pair,), _, _ = merge(path, "static")
    assert pair.scans == SCANS
    rig = Rig.from_dict(
        {"ground_truth": "static", "T_camera_lidar": np.eye(4).tolist(), "integration": "dynamic"}
    )
    obstacles = summarise(path, rig).obstacles
    assert "topic /lidar/points: integration: dynamic needs a time of each point" in obstacles[0]
    assert "build would stop:" in summarise(path, rig).lines()


def test_times_that_do_not_pass_are_named(tmp_path: Path) -> None:
    """Some drivers have the field and leave it empty."""
    cloud = Cloud(0, 0, "lidar", records(0, moving=False), 1, 1)
    cloud.records["t"] = 0
    with pytest.raises(IntegrationError, match="field t spans only 0 us"):
        point_times(cloud, PointTime(), "run: topic /lidar")


def test_clouds_without_intensity_are_merged(tmp_path: Path) -> None:
    (pair,), _, _ = merge(recording(tmp_path, moving=False, fields=["x", "y", "z"]), "static")
    assert pair.cloud.records.dtype.names == ("x", "y", "z")


def test_the_missing_library_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "small_gicp", None)
    with pytest.raises(MissingLibraryError, match=r"small_gicp.*pip install 'lcdata\[dynamic\]'"):
        merge(recording(tmp_path, moving=True), "dynamic")
