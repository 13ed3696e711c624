from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lcdata.recording.summary import Summary, summarise
from lcdata.rig import Rig, load_rig

from .bags import JOINTS, MS, START, Messages, arm_stream, write

LINK = {"translation_m": [0, 0, 0], "rotation_rpy_deg": [0, 0, 0]}
ARM = {"T_camera_effector": LINK, "T_base_lidar": LINK}


def check(summary: Summary, tmp_path: Path) -> str:
    """Render it every way; its rig must load."""
    json.dumps(summary.to_dict(), allow_nan=False)
    if summary.rig_yaml:
        (tmp_path / "rig.yaml").write_text(summary.rig_yaml)
        load_rig(tmp_path / "rig.yaml")
    return "\n".join(summary.lines())


def static_stream(*, stamps: str = "header", size: tuple[int, int] = (32, 24), tf: bool = True):
    """A recording without an arm: 10 scans and images."""

    def stream(m: Messages) -> Any:
        rng = np.random.default_rng(0)
        for i in range(10):
            bag = START + i * 100 * MS
            stamp = {"header": bag - 4 * MS, "zero": 0, "boot": bag - START + 55 * 10**9}[stamps]
            yield "/camera_info", bag, m.camera_info(stamp, *size)
            yield "/image", bag, m.image(stamp, np.zeros((24, 32), np.uint8), "mono8")
            points = np.zeros(9, [(n, "f4") for n in "xyz"])
            points["x"] = rng.normal(size=9)
            yield "/points", bag, m.cloud(stamp, points)
        if tf:
            edge = ("camera", "lidar", (0.1, 0, 0), (0, 0, 0, 1))
            yield "/tf_static", bag, m.transforms(bag, [edge])

    return stream


def test_a_run_of_an_arm_without_a_rig(tmp_path: Path) -> None:
    path = write(tmp_path, "run", "mcap", arm_stream(poses=3))
    summary = summarise(path)
    text = check(summary, tmp_path)
    assert summary.ground_truth == "arm" and summary.arm_model == "gen3_lite"
    assert len(summary.poses) == 3 and summary.pairs > 40
    assert summary.obstacles == [] and summary.problems == []
    assert "8 rings x 16 columns" in text
    assert "time t in ns (a scan takes 0.0875 s), relative" in text
    assert "header -3 ms from the recorder's stamp (median)" in text
    assert "100 Hz" in text
    assert f"build would take {summary.pairs} pairs, at 3 of 3 poses" in text
    assert "T_base_lidar:  # MEASURE" in text
    rig = load_rig(tmp_path / "rig.yaml")
    assert summarise(path, rig).pairs == summary.pairs
    assert summarise(path, rig).rig_yaml == ""


def test_a_static_recording_needs_one_line(tmp_path: Path) -> None:
    summary = summarise(write(tmp_path, "road", "ros1", static_stream()))
    text = check(summary, tmp_path)
    assert summary.pairs == 10 and summary.T_camera_lidar is not None
    lines = [line for line in summary.rig_yaml.splitlines() if not line.startswith("#")]
    assert len(lines) == 1 and lines[0].startswith("ground_truth: static ")
    assert "xyz 0.1000 0.0000 0.0000 m" in text
    assert "intensity none, ring none" in text


def test_without_transforms_the_extrinsic_is_to_be_measured(tmp_path: Path) -> None:
    path = write(tmp_path, "road", "mcap", static_stream(tf=False))
    summary = summarise(path)
    check(summary, tmp_path)
    assert "T_camera_lidar:  # MEASURE" in summary.rig_yaml
    summary = summarise(path, Rig(ground_truth="static"))
    assert "give T_camera_lidar in the rig" in check(summary, tmp_path)


@pytest.mark.parametrize(
    ("stamps", "note"),
    [
        ("zero", "its header stamps are all 0: set `stamps: bag`"),
        ("boot", "its clock does not start in 1970, the first stamp is 55.000 s"),
    ],
)
def test_clocks_that_cannot_be_right(tmp_path: Path, stamps: str, note: str) -> None:
    path = write(tmp_path, "road", "mcap", static_stream(stamps=stamps))
    summary = summarise(path)
    assert note in check(summary, tmp_path)
    rig = load_rig(tmp_path / "rig.yaml")
    assert rig.stamps == "bag"
    assert summarise(path, rig).pairs == 10


def test_images_of_another_size_than_camera_info(tmp_path: Path) -> None:
    summary = summarise(write(tmp_path, "road", "mcap", static_stream(size=(64, 48))))
    assert "images of 32x24, CameraInfo is for 64x48" in check(summary, tmp_path)


def test_ambiguous_topics_make_a_rig_with_the_first(tmp_path: Path) -> None:
    def stream(m: Messages) -> Any:
        yield from static_stream()(m)
        yield "/another", START, m.cloud(START, np.zeros(2, [(n, "f4") for n in "xyz"]))

    summary = summarise(write(tmp_path, "road", "mcap", stream))
    assert "2 topics could be lidar" in check(summary, tmp_path)
    assert load_rig(tmp_path / "rig.yaml").topics.lidar == "/another"
    assert "# NAME: or /points" in summary.rig_yaml


def test_an_arm_that_never_stops(tmp_path: Path) -> None:
    path = write(tmp_path, "run", "mcap", arm_stream(poses=4, dwell_s=0.0))
    text = check(summarise(path, Rig.from_dict(ARM)), tmp_path)
    assert "no dwell: the joints never stay below 0.5 deg/s for 0.7 s; the slowest moment" in text


def test_an_arm_of_other_joints_or_outside_its_limits(tmp_path: Path) -> None:
    def stream(names: list[str], angle: float):
        def messages(m: Messages) -> Any:
            yield from static_stream()(m)
            for i in range(100):
                yield (
                    "/joint_states",
                    START + i,
                    m.joints(START + i * 10 * MS - 4 * MS, names, [angle] * len(names)),
                )

        return messages

    path = write(tmp_path, "other", "mcap", stream(["a1", "a2"], 0.0))
    summary = summarise(path, Rig.from_dict(ARM))
    assert "joint states lack joint_1" in check(summary, tmp_path)
    assert summarise(path).joint_names == ["a1", "a2"]
    summary = summarise(write(tmp_path, "bent", "mcap", stream(JOINTS, 3.0)), Rig.from_dict(ARM))
    assert "outside its limits" in check(summary, tmp_path)
    assert summary.pairs == 0


def test_no_image_near_a_scan(tmp_path: Path) -> None:
    path = write(tmp_path, "run", "mcap", arm_stream(image_delay_ms=30))
    rig = Rig.from_dict({**ARM, "pairing": {"tolerance_ms": 10}})
    assert "nearest image was 30 ms away (limit 10 ms)" in check(summarise(path, rig), tmp_path)


def test_real_recordings(shared: Path, tmp_path: Path) -> None:
    road = summarise(shared / "recordings" / "kitti_road")
    crossing = summarise(shared / "recordings" / "opencalib_crossing.bag")
    for summary, pairs, size in ((road, 10, (1241, 376)), (crossing, 1, (1920, 1200))):
        check(summary, tmp_path)
        assert summary.pairs == pairs
        assert summary.image is not None
        assert (summary.image.width, summary.image.height) == size
        assert summary.problems == summary.obstacles == []
        assert summary.rig_yaml.count("\n") == 2  # a comment and one line
    assert road.T_camera_lidar is not None
    reference = json.loads((shared / "data" / "kitti_road" / "reference.json").read_text())
    np.testing.assert_allclose(road.T_camera_lidar, reference["T_camera_lidar"], atol=1e-5)
