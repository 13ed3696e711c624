"""Joint positions from logs beside real bags that have no JointState."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from lcdata.dataset import build
from lcdata.errors import LcdataError
from lcdata.recording.joint_log import open_joint_log
from lcdata.recording.summary import summarise
from lcdata.rig import Rig, load_rig

from .bags import JOINTS, MS, START, Messages, arm_stream, write

LINK = {"translation_m": [0, 0, 0], "rotation_rpy_deg": [0, 0, 0]}
ARM = {"T_camera_effector": LINK, "T_base_lidar": LINK}
UR = "timestamp," + ",".join(f"actual_q_{i}" for i in range(6))
KUKA = "Zeit;" + ";".join(f"A{i}" for i in range(1, 7))

Samples = list[tuple[int, list[float]]]


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path, Samples]:
    """The same run with JointState and without, and its joints: stamps in ns and radians."""
    folder = tmp_path_factory.mktemp("bags")
    samples: Samples = []

    def without(m: Messages) -> Any:
        for topic, stamp, message in arm_stream(poses=3)(m):
            if topic == "/joint_states":
                names, header = list(message.name), message.header.stamp
                order = [names.index(name) for name in JOINTS]
                taken = header.sec * 10**9 + header.nanosec
                samples.append((taken, [float(message.position[i]) for i in order]))
            else:
                yield topic, stamp, message

    whole = write(folder, "whole", "mcap", arm_stream(poses=3))
    return whole, write(folder, "run", "ros1", without), samples


def seconds(stamp: int) -> str:
    return f"{stamp // 10**9}.{stamp % 10**9:09d}"


def as_ur(samples: Samples) -> str:
    rows = (",".join([seconds(t), *map(repr, q)]) for t, q in samples)
    return "\n".join([UR, *rows])


def as_rtde(samples: Samples) -> str:
    """The RTDE recorder separates by spaces."""
    return as_ur(samples).replace(",", " ")


def as_kuka(samples: Samples) -> str:
    rows = (";".join([seconds(t), *map(repr, np.rad2deg(q).tolist())]) for t, q in samples)
    return "\n".join([KUKA, *(row.replace(".", ",") + ";" for row in rows)])


def as_names(samples: Samples) -> str:
    """Other columns among them, joints in another order, degrees by name, comments."""
    names = [f"{name} [deg]" for name in JOINTS[::-1]]
    rows = (f"{t},{','.join(map(repr, np.rad2deg(q[::-1]).tolist()))},auto" for t, q in samples)
    return "\n".join(["# stamp_ns," + ",".join([*names, "mode"]), "# by hand", *rows])


def as_list(samples: Samples) -> str:
    return json.dumps([{"stamp_ns": t, "positions": q} for t, q in samples])


def as_object(samples: Samples) -> str:
    kept = [{"stamp_ns": t, "positions": [*np.rad2deg(q[::-1]), 0.5]} for t, q in samples]
    names = [*JOINTS[::-1], "gripper"]
    return json.dumps({"names": names, "unit": "deg", "samples": kept})


KINDS = {
    "ur": (as_ur, ".csv", "angles in rad (nothing says degrees)"),
    "rtde": (as_rtde, ".csv", "UR columns"),
    "kuka": (as_kuka, ".csv", "angles in deg (KUKA's controllers write degrees)"),
    "names": (as_names, ".csv", "angles in deg (the columns' names)"),
    "list": (as_list, ".json", "stamps stamp_ns in ns"),
    "object": (as_object, ".json", "angles in deg (the file's unit)"),
}


def beside(recorded: tuple[Path, Path, Samples], text: str, suffix: str = ".csv") -> Path:
    """The recording without JointState, with a log beside it."""
    _, bag, _ = recorded
    for old in bag.parent.glob("run.joints.*"):
        old.unlink()
    (bag.parent / f"run.joints{suffix}").write_text(text)
    return bag


@pytest.mark.parametrize("kind", KINDS)
def test_a_log_gives_the_poses_that_joint_states_give(
    recorded: tuple[Path, Path, Samples], kind: str
) -> None:
    writer, suffix, said = KINDS[kind]
    whole, _, samples = recorded
    rig = Rig.from_dict(ARM)
    path = beside(recorded, writer(samples), suffix)
    found, expected = summarise(path, rig), summarise(whole, rig)
    assert found.obstacles == [] and found.pairs == expected.pairs > 40
    for a, b in zip(found.poses, expected.poses, strict=True):
        np.testing.assert_allclose(a.joints_deg, b.joints_deg, atol=1e-9)
        assert a.start_s == pytest.approx(b.start_s, abs=1e-6)
    assert said in found.joint_log
    assert said in "\n".join(found.lines())
    json.dumps(found.to_dict(), allow_nan=False)


def test_a_build_takes_the_log_and_its_checksum(
    recorded: tuple[Path, Path, Samples], tmp_path: Path
) -> None:
    whole, _, samples = recorded
    rig = tmp_path / "rig.yaml"
    rig.write_text(yaml.safe_dump(ARM))
    path = beside(recorded, as_kuka(samples))
    made = build(path, tmp_path / "a", rig)
    same = build(whole, tmp_path / "b", rig)
    assert made.pairs == same.pairs > 40 and made.failures == []
    for a, b in zip(made.dataset.poses, same.dataset.poses, strict=True):
        np.testing.assert_allclose(a.T_camera_lidar, b.T_camera_lidar, atol=1e-12)
    (source,) = made.dataset.info.sources
    log = path.parent / "run.joints.csv"
    assert source["joint_log"] == {
        "name": "run.joints.csv",
        "sha256": hashlib.sha256(log.read_bytes()).hexdigest(),
    }
    assert made.dataset.info.scenarios["run"].topics["joint_states"] == "run.joints.csv"
    # Another log is another build.
    beside(recorded, as_kuka(samples[:-1]))
    with pytest.raises(LcdataError, match="already holds a data set of other recordings"):
        build(path, tmp_path / "a", rig)


def test_a_rig_names_the_log_its_columns_units_and_clock(
    recorded: tuple[Path, Path, Samples], tmp_path: Path
) -> None:
    whole, bag, samples = recorded
    beside(recorded, "not looked at")
    rows = [",".join([f"{(t - START) / 1e6:.6f}", "9", *map(repr, q)]) for t, q in samples]
    header = "clock,x," + ",".join(f"axis{i}" for i in range(6))
    (tmp_path / "run.log").write_text("\n".join([header, *rows]))
    (tmp_path / "rig.yaml").write_text(
        yaml.safe_dump(
            ARM
            | {
                "joint_log": {
                    "file": "{recording}.log",
                    "stamp_column": "clock",
                    "stamp_unit": "ms",
                    "epoch_s": START * 1e-9,
                    "columns": [f"axis{i}" for i in range(6)],
                    "unit": "rad",
                }
            }
        )
    )
    rig = load_rig(tmp_path / "rig.yaml")
    found, expected = summarise(bag, rig), summarise(whole, Rig.from_dict(ARM))
    assert found.obstacles == [] and found.pairs == expected.pairs
    assert (
        "columns of the rig" in found.joint_log
        and "counted from 1700000000.000000 s" in found.joint_log
    )
    assert Rig.from_dict(rig.to_dict()).joint_log == rig.joint_log


def test_without_a_rig_dwells_are_found_all_the_same(
    recorded: tuple[Path, Path, Samples],
) -> None:
    _, _, samples = recorded
    known = summarise(beside(recorded, as_object(samples), ".json"))
    assert known.arm_model == "gen3_lite" and known.pairs > 40
    unknown = summarise(beside(recorded, as_ur(samples)))
    assert unknown.arm_model is None and len(unknown.poses) == 3 and unknown.pairs > 40
    assert "NAME: your arm's URDF file" in unknown.rig_yaml


def test_a_log_beside_joint_states_is_ambiguous_until_the_rig_chooses(
    recorded: tuple[Path, Path, Samples], tmp_path: Path
) -> None:
    _, _, samples = recorded
    path = write(tmp_path, "both", "mcap", arm_stream(poses=2))
    (path / "joints.csv").write_text(as_ur(samples))
    (obstacle,) = summarise(path, Rig.from_dict(ARM)).obstacles
    assert "2 topics could be joint_states: /joint_states" in obstacle
    assert "set topics.joint_states in the rig" in obstacle
    topics = {"topics": {"joint_states": "/joint_states"}}
    assert summarise(path, Rig.from_dict(ARM | topics)).joint_log == ""
    chosen = summarise(path, Rig.from_dict(ARM | {"joint_log": {"unit": "rad"}}))
    assert chosen.joint_log.startswith("joints.csv: 800 samples")
    assert open_joint_log(path, Rig.from_dict({"ground_truth": "static"})) is None


ROW = "1700000000.5" + ",0.1" * 6
BAD: dict[str, tuple[str, str]] = {
    "empty": ("", "is empty"),
    "no rows": (UR, "has no samples"),
    "no header": (ROW, "no header row, it begins with '1700000000.5'"),
    "no stamp": (UR.replace("timestamp", "when") + f"\n{ROW}", "no column of stamps"),
    "a joint left out": (
        UR.replace("actual_q_3", "other") + f"\n{ROW}",
        "one joint is missing or there twice: actual_q_0, actual_q_1",
    ),
    "five joints": (
        UR.replace(",actual_q_5", "") + f"\n{ROW[:-4]}",
        "5 joints (actual_q_0, actual_q_1, actual_q_2, actual_q_3, actual_q_4), gen3_lite has 6",
    ),
    "other names": (
        f"stamp,a,b\n{ROW[:20]}",
        "lacks joint_1, joint_2, joint_3, joint_4, joint_5, joint_6; it has a, b",
    ),
    "short row": (f"{UR}\n{ROW}\n{ROW[:-8]}", ":3: 5 values for 7 columns"),
    "NaN": (f"{UR}\n{ROW[:-3]}nan", ":2: actual_q_5 is 'nan'"),
    "a word": (f"{UR}\n{ROW[:-3]}off", ":2: actual_q_5 is 'off'"),
    "a stamp that is none": (f"{UR}\nnow{ROW[12:]}", ":2: stamp 'now' is not a number"),
    "a stamp twice": (f"{UR}\n{ROW}\n{ROW}", ":3: stamp 1700000000.5 is there twice"),
    "back in time": (
        f"{UR}\n{ROW}\n{ROW.replace('0.5', '0.25')}",
        ":3: stamp 1700000000.25 goes back by 0.25 s",
    ),
    "nanoseconds as seconds": (
        f"{UR}\n{ROW.replace('.5', '500000000')}",
        "would be the year 5000 in s: set joint_log.stamp_unit in the rig",
    ),
    "degrees as radians": (
        f"{UR}\n{ROW}\n1700000000.6,0.1,33,0,0,0,0",
        ":3: joint_2 is at 1890.76 deg, outside its limits",
    ),
    "of another time": (
        f"{UR}\n{ROW.replace('1700000000', '55')}",
        "set joint_log.epoch_s in the rig: the sensors' time at the log's 0",
    ),
}


@pytest.mark.parametrize("what", BAD)
def test_a_bad_log_is_named_in_one_line(
    recorded: tuple[Path, Path, Samples], tmp_path: Path, what: str
) -> None:
    text, expected = BAD[what]
    path = beside(recorded, text)
    (tmp_path / "rig.yaml").write_text(yaml.safe_dump(ARM))
    with pytest.raises(LcdataError) as raised:
        build(path, tmp_path / "out", tmp_path / "rig.yaml")
    said = str(raised.value)
    assert "run.joints.csv" in said and expected in said and "\n" not in said
    assert raised.value.remedy
    assert not (tmp_path / "out").exists()
    shown = summarise(path, Rig.from_dict(ARM))
    assert any(expected in obstacle for obstacle in shown.obstacles)


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        ("{", "not JSON"),
        ("{}", "holds no list of samples"),
        ('[{"stamp": 1}]', "sample 0 has no list of positions"),
        ('[{"positions": [1]}]', "sample 0 has no stamp_ns or stamp"),
        ('[{"stamp": 1, "positions": [1]}, {"stamp": 2, "positions": []}]', "0 positions, not 1"),
        ('[{"stamp": 1, "positions": [null]}]', "1 joints"),
        ('{"unit": "gon", "samples": []}', "its unit is 'gon'"),
        ("[]", "has no samples"),
    ],
)
def test_bad_json_is_named(
    recorded: tuple[Path, Path, Samples], content: str, expected: str
) -> None:
    shown = summarise(beside(recorded, content, ".json"), Rig.from_dict(ARM))
    assert any(expected in obstacle for obstacle in shown.obstacles), shown.obstacles


def test_two_logs_or_none_where_the_rig_wants_one(
    recorded: tuple[Path, Path, Samples], tmp_path: Path
) -> None:
    _, _, samples = recorded
    path = write(tmp_path, "run", "mcap", arm_stream(poses=1))
    rig = Rig.from_dict(ARM | {"joint_log": {}})
    assert any("no joint log beside" in o for o in summarise(path, rig).obstacles)
    named = Rig.from_dict(ARM | {"joint_log": "gone.csv"})
    assert any("correct joint_log.file" in o for o in summarise(path, named).obstacles)
    (tmp_path / "run.joints.csv").write_text(as_ur(samples))
    (tmp_path / "run.joints.json").write_text(as_list(samples))
    assert any("are both joint logs" in o for o in summarise(path, rig).obstacles)


def test_degrees_by_rule_that_look_like_radians_are_pointed_out(
    recorded: tuple[Path, Path, Samples],
) -> None:
    _, _, samples = recorded
    text = as_ur(samples).replace(UR, KUKA.replace(";", ","))
    shown = summarise(beside(recorded, text), Rig.from_dict(ARM))
    assert "set joint_log.unit: rad in the rig" in shown.joint_log_note
    assert shown.joint_log_note in "\n".join(shown.lines())


@pytest.mark.parametrize(
    ("header", "names", "style", "unit"),
    [
        ("t [ms];A1;A2;A3", ("A1", "A2", "A3"), "KUKA", "deg"),
        ("Zeit;$AXIS_ACT.A2;$AXIS_ACT.A1", ("$AXIS_ACT.A1", "$AXIS_ACT.A2"), "KUKA", "deg"),
        ("time,A1 [rad],A2 [rad]", ("A1", "A2"), "KUKA", "rad"),
        ("time,joint_a1,joint_a2", ("joint_a1", "joint_a2"), "names", "rad"),
        ("stamp_ns,joint_1_s,joint_2_l", ("joint_1_s", "joint_2_l"), "names", "rad"),
        ("stamp,j1_deg,j2_deg", ("j1", "j2"), "names", "deg"),
        ("timestamp actual_q_1 target_q_0 actual_q_0", ("actual_q_0", "actual_q_1"), "UR", "rad"),
    ],
)
def test_headers_decide(
    tmp_path: Path, header: str, names: tuple[str, ...], style: str, unit: str
) -> None:
    delimiter = next((mark for mark in ";," if mark in header), " ")
    row = delimiter.join(str(i + 1) for i in range(len(header.split(delimiter))))
    (tmp_path / "run.joints.csv").write_text(f"{header}\n{row}")
    log = open_joint_log(tmp_path / "run.bag")
    assert log is not None
    assert (log.names, log.table.style, log.unit[0]) == (names, style, unit)


def test_nanoseconds_are_exact(tmp_path: Path) -> None:
    stamps = START + np.arange(20_000) * 2 * MS + 1
    rows = [f"{t}" + ",0.25,-0.5,0.125,1.0,0.0,2.0" for t in stamps]
    header = UR.replace("timestamp", "timestamp_ns")
    (tmp_path / "run.joints.csv").write_text("\n".join([header, *rows]))
    log = open_joint_log(tmp_path / "run.bag")
    assert log is not None
    samples = log.samples()
    assert np.array_equal(samples.stamps_ns, stamps)
    assert np.array_equal(samples.positions[-1], [0.25, -0.5, 0.125, 1.0, 0.0, 2.0])
