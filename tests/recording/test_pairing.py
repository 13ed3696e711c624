from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from lcdata.recording.dwells import Dwell
from lcdata.recording.pairing import pair_stamps, select
from lcdata.recording.plan import plan_poses
from lcdata.recording.survey import Survey

MS = 1_000_000
stamps = st.lists(st.integers(0, 1000), max_size=30)


@given(stamps, stamps, st.integers(0, 100))
def test_pairs_are_near_unique_and_none_is_missed(
    lidar: list[int], image: list[int], tolerance: int
) -> None:
    found = pair_stamps(lidar, image, tolerance)
    dt = np.array(image, int)[found.image] - np.array(lidar, int)[found.lidar]
    assert (dt == found.dt_ns).all() and (np.abs(dt) <= tolerance).all()
    assert len(set(found.lidar)) == len(set(found.image)) == len(found.lidar)
    assert (np.diff(np.array(lidar, int)[found.lidar]) >= 0).all()
    distances = np.abs(np.subtract.outer(np.array(lidar, int), np.array(image, int)))
    if distances.size:
        assert found.nearest_ns == distances.min()
        left = np.delete(np.delete(distances, found.lidar, 0), found.image, 1)
        assert left.size == 0 or left.min() > tolerance
    else:
        assert found.nearest_ns is None


def test_each_scan_gets_its_nearest_image() -> None:
    found = pair_stamps([0, 100, 200], [205, 95, 4, 150], 50)
    assert found.image.tolist() == [2, 1, 0]
    assert found.dt_ns.tolist() == [4, -5, 5]


def test_two_scans_of_one_image() -> None:
    # 10 is nearer to the image at 12 than 15 is; 15 then takes the free one.
    found = pair_stamps([10, 15], [12, 40], 30)
    assert found.image.tolist() == [0, 1]
    assert pair_stamps([10, 15], [12, 60], 30).lidar.tolist() == [0]


def test_the_reason_says_how_near_the_nearest_image_was() -> None:
    found = pair_stamps([0, 1000 * MS], [83 * MS], 50 * MS)
    assert found.reason() == "nearest image was 83 ms away (limit 50 ms)"
    assert pair_stamps([0], [], 50).reason() == "no image to pair a scan with"


@given(st.integers(0, 200), st.one_of(st.none(), st.integers(1, 200)))
def test_a_selection_is_evenly_spread(count: int, wanted: int | None) -> None:
    chosen = select(count, wanted)
    assert len(chosen) == (count if wanted is None else min(count, wanted))
    steps = np.diff(chosen)
    assert (steps >= 1).all()
    assert len(steps) == 0 or steps.max() - steps.min() <= 1
    if len(chosen):
        assert chosen[0] >= 0 and chosen[-1] < count
        assert abs(chosen[0] - (count - 1 - chosen[-1])) <= 1


def surveyed(lidar_ms: list[float], image_ms: list[float]) -> Survey:
    as_ns = [np.array([round(v * MS) for v in values], np.int64) for values in (lidar_ms, image_ms)]
    return Survey(as_ns[0], as_ns[1], np.empty(0, np.int64), np.empty((0, 6)), None)


def dwell(index: int, start_ms: int, end_ms: int) -> Dwell:
    zero = np.zeros(6)
    return Dwell(index, start_ms * MS, end_ms * MS, zero, zero, 10)


def test_poses_are_numbered_by_dwell_and_say_why_they_have_no_pair() -> None:
    read = surveyed(
        [*range(0, 1000, 100), *range(5000, 6000, 100), *range(7000, 8000, 100)],
        [*range(5, 1000, 100), 2500, *range(7083, 8000, 1000)],
    )
    dwells = [dwell(0, 0, 1000), dwell(1, 2000, 3000), dwell(2, 5000, 6000), dwell(3, 7000, 7100)]
    poses = plan_poses("yard", read, dwells, tolerance_ms=50)
    assert [p.pose_id for p in poses] == [f"yard/pose_00{i}" for i in range(4)]
    # The scan that begins at 900 ms ends when the dwell does.
    assert [(p.scans, p.images, p.paired) for p in poses] == [
        (10, 10, 10),
        (0, 1, 0),
        (10, 0, 0),
        (1, 1, 0),
    ]
    assert [p.reason for p in poses] == [
        "",
        "no scan while the arm stood still",
        "no image while the arm stood still",
        "nearest image was 83 ms away (limit 50 ms)",
    ]
    assert poses[0].pair_id(7) == "yard/pose_000/007"


def test_a_scan_that_ends_in_motion_is_left_out() -> None:
    read = surveyed([*range(0, 1000, 100)], [*range(0, 1000, 100)])
    (pose,) = plan_poses("yard", read, [dwell(0, 0, 450)], tolerance_ms=50)
    assert (pose.lidar_ns / MS).tolist() == [0, 100, 200, 300]


def test_a_recording_without_an_arm_is_one_pose() -> None:
    read = surveyed([*range(0, 1000, 100)], [*range(3, 1000, 100)])
    (pose,) = plan_poses("road", read, None, tolerance_ms=50, pairs_per_pose=3)
    assert pose.pose_id == "road/pose_000" and pose.dwell is None
    assert (pose.lidar_ns / MS).tolist() == [100, 500, 800]
    assert pose.paired == 10
    assert plan_poses("road", surveyed([], []), None, tolerance_ms=50) == []
