from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from rosbags.highlevel import AnyReader

from lcdata.errors import SimulationError
from lcdata.geometry import se3
from lcdata.rig import load_rig
from lcdata.simulation import simulate
from lcdata.simulation.bag import CAMERA_INFO, COMPRESSED, FORMATS, JOINTS, LIDAR

SMALL = {"poses": 2, "pairs": 1, "columns": 512, "width": 160, "height": 90}


@pytest.fixture(scope="module", params=FORMATS)
def recording(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp(request.param)
    (path,) = simulate(out, scenario="yard", seed=7, format=request.param, **SMALL)
    return path


def _messages(path: Path, topic: str) -> list[tuple[int, object]]:
    with AnyReader([path]) as reader:
        chosen = [c for c in reader.connections if c.topic == topic]
        return [(t, reader.deserialize(raw, c.msgtype)) for c, t, raw in reader.messages(chosen)]


def _seconds(header: object) -> float:
    return header.stamp.sec + 1e-9 * header.stamp.nanosec


def test_rosbags_reads_it_back(recording: Path) -> None:
    with AnyReader([recording]) as reader:
        counts = {c.topic: c.msgcount for c in reader.connections}
    assert counts[LIDAR] == counts[COMPRESSED] == counts[CAMERA_INFO] == 3  # one while moving
    assert counts[JOINTS] > 400
    assert counts["/tf_static"] == 1


def test_clouds_have_the_drivers_layout(recording: Path) -> None:
    _, cloud = _messages(recording, LIDAR)[0]
    assert (cloud.height, cloud.width, cloud.point_step) == (128, 512, 48)
    assert cloud.row_step == 512 * 48
    layout = {f.name: (f.offset, f.datatype) for f in cloud.fields}
    assert layout["x"] == (0, 7)
    assert layout["t"] == (20, 6)
    assert layout["ring"] == (26, 4)
    points = np.frombuffer(cloud.data, np.uint8).reshape(-1, 48)
    xyz = points[:, :12].copy().view(np.float32)
    assert (xyz == 0).all(axis=1).any()
    assert np.isfinite(xyz).all()


def test_images_are_as_large_as_their_camera_info_says(recording: Path) -> None:
    import cv2

    _, image = _messages(recording, COMPRESSED)[0]
    _, info = _messages(recording, CAMERA_INFO)[0]
    pixels = cv2.imdecode(np.frombuffer(image.data, np.uint8), cv2.IMREAD_COLOR)
    assert pixels.shape == (info.height, info.width, 3) == (90, 160, 3)
    assert info.distortion_model == "plumb_bob"
    assert image.header.stamp == info.header.stamp


def test_encoders_read_the_truth_but_for_their_own_errors(recording: Path) -> None:
    truth = json.loads((recording.parent / "truth.json").read_text())
    states = _messages(recording, JOINTS)
    names = list(states[0][1].name)
    assert "right_finger_bottom_joint" in names
    assert names != sorted(names)
    order = [names.index(f"joint_{k}") for k in range(1, 7)]
    q = np.array([message.position[order] for _, message in states])
    stamps = np.array([t for t, _ in states]) * 1e-9
    assert np.diff(stamps).mean() == pytest.approx(0.01, rel=0.02)
    for part, pose in ((q[:80], "yard/pose_000"), (q[-60:], "yard/pose_001")):
        errors = np.rad2deg(part.mean(axis=0) - truth["poses"][pose]["joint_positions"])
        assert 1e-4 < np.abs(errors).max() < 5 * 0.02
        assert np.rad2deg(part.std(axis=0)).max() < 0.01


def test_clocks_are_the_sensors_own(recording: Path) -> None:
    for topic, low, high in (
        (LIDAR, 0.09, 0.12),
        (COMPRESSED, 0.015, 0.055),
        (JOINTS, -0.01, 0.01),
    ):
        late = np.array([1e-9 * t - _seconds(m.header) for t, m in _messages(recording, topic)])
        assert (late > low).all()
        assert (late < high).all()


def test_truth_and_rig_lie_beside_it(recording: Path) -> None:
    folder = recording.parent
    truth, rig = json.loads((folder / "truth.json").read_text()), load_rig(folder / "rig.yaml")
    assert truth["simulated"] is True
    assert rig.simulated
    assert list(truth["poses"]) == ["yard/pose_000", "yard/pose_001"]
    arm = rig.load_arm()
    for pose in truth["poses"].values():
        T_base_effector = arm.forward(pose["joint_positions"])
        T = truth["T_camera_effector"] @ se3.inverse(T_base_effector) @ truth["T_base_lidar"]
        np.testing.assert_allclose(T, pose["T_camera_lidar"], atol=1e-9)
    off = se3.log(np.array(truth["T_base_lidar"]) @ se3.inverse(rig.T_base_lidar.T))
    sigma = np.sqrt(np.diag(rig.T_base_lidar.covariance))
    assert (np.abs(off) > 0).all()
    assert (np.abs(off) < 4 * sigma).all()


@pytest.mark.slow
def test_scenarios_of_one_seed_share_a_folder_and_others_are_refused(tmp_path: Path) -> None:
    tiny = {**SMALL, "poses": 1, "width": 64, "height": 36}
    simulate(tmp_path, scenario="yard", seed=1, **tiny)
    first = json.loads((tmp_path / "truth.json").read_text())
    simulate(tmp_path, scenario="gym", seed=1, format="ros1", **tiny)
    both = json.loads((tmp_path / "truth.json").read_text())
    assert both["T_base_lidar"] == first["T_base_lidar"]
    assert list(both["poses"]) == ["gym/pose_000", "yard/pose_000"]
    with pytest.raises(SimulationError, match=r"gym\.bag exists"):
        simulate(tmp_path, scenario="gym", seed=1, **tiny)
    with pytest.raises(SimulationError, match=r"other mounts \(seed 1\)"):
        simulate(tmp_path, scenario="gym", seed=2, force=True, **tiny)
    simulate(tmp_path, scenario="gym", seed=1, force=True, **tiny)
    assert (tmp_path / "gym" / "metadata.yaml").exists()
    assert not (tmp_path / "gym.bag").exists()


def test_the_same_seed_writes_the_same_bytes(tmp_path: Path) -> None:
    tiny = {**SMALL, "poses": 1, "width": 64, "height": 36, "format": "ros1"}
    first, again = (
        simulate(tmp_path / name, scenario="yard", seed=9, **tiny)[0] for name in ("a", "b")
    )
    assert first.read_bytes() == again.read_bytes()


def test_nothing_is_left_of_an_interrupted_simulation(tmp_path: Path) -> None:
    def interrupt(stage: str, done: int, total: int) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        simulate(tmp_path, scenario="yard", progress=interrupt, **SMALL)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"scenario": "garden"}, "unknown scenario 'garden'"),
        ({"format": "csv"}, "unknown recording format 'csv'"),
        ({"columns": 100}, "unknown number of columns 100"),
        ({"poses": 0}, "0 poses"),
    ],
)
def test_wrong_choices_are_named(tmp_path: Path, wrong: dict[str, object], message: str) -> None:
    with pytest.raises(SimulationError, match=message):
        simulate(tmp_path, **{**SMALL, **wrong})


def test_a_file_in_the_way_is_named(tmp_path: Path) -> None:
    (tmp_path / "taken").touch()
    with pytest.raises(SimulationError, match="taken: cannot be written"):
        simulate(tmp_path / "taken", **SMALL)
