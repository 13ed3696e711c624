"""Lanes and poles of a made-up road, and clouds that show none."""

from dataclasses import replace

import numpy as np
import pytest
import road_world as world

from lcdata.errors import CalibrationError
from lcdata.features.road_cloud import CloudOptions, road_cloud
from lcdata.geometry import se3

SEED = 3


@pytest.fixture(scope="module")
def pair():
    return world.made(SEED)[0]


@pytest.fixture(scope="module")
def cloud(pair):
    return road_cloud(pair)


def in_world(points):
    return se3.apply(world.mount(SEED)[0], points.reshape(-1, 3)).reshape(points.shape)


def test_the_ground_is_under_the_lidar(cloud):
    T_world_lidar = world.mount(SEED)[0]
    assert abs(cloud.height - T_world_lidar[2, 3]) < 0.02
    assert np.degrees(np.arccos(cloud.R_ground_lidar[2] @ T_world_lidar[2, :3])) < 0.1


def test_x_is_along_the_lanes(cloud):
    along = world.mount(SEED)[0][:3, :3] @ cloud.R_ground_lidar[0]
    assert np.degrees(np.arccos(abs(along[0]))) < 0.3


def test_lanes_lie_where_they_were_painted(cloud):
    painted = {round((m[2] + m[3]) / 2, 3) for m in world.road(SEED).marks if m[3] - m[2] < 0.2}
    lines = in_world(cloud.lane_lines)
    run = lines[:, 1] - lines[:, 0]
    found = lines[np.abs(run[:, 0]) > 10 * np.abs(run[:, 1])].mean(1)[:, 1]
    for y in painted:
        assert np.abs(found - y).min() < 0.1
    marks = np.array(world.road(SEED).marks)
    x, y, _ = in_world(cloud.lanes).T
    inside = (x[:, None] > marks[:, 0] - 0.1) & (x[:, None] < marks[:, 1] + 0.1)
    inside &= (y[:, None] > marks[:, 2] - 0.1) & (y[:, None] < marks[:, 3] + 0.1)
    on_road = np.abs(y) < 7
    assert inside.any(1)[on_road].mean() > 0.8


def test_poles_stand_where_they_were_put(cloud):
    placed = np.array(world.road(SEED).poles)
    found = in_world(cloud.pole_lines).mean(1)
    near = np.linalg.norm(found[:, None, :2] - placed[:, :2], axis=2)
    assert (near.min(1) < 0.25).all()
    assert np.count_nonzero(near.min(0) < 0.25) >= 5
    lines = in_world(cloud.pole_lines)
    run = lines[:, 1] - lines[:, 0]
    assert (run[:, 2] > 0.99 * np.linalg.norm(run, axis=1)).all()


def test_indices_name_the_lines(cloud):
    assert len(cloud.lane_of) == len(cloud.lanes)
    assert len(cloud.pole_of) == len(cloud.poles)
    assert set(cloud.pole_of) == set(range(len(cloud.pole_lines)))


def test_missing_returns_are_left_out(pair, cloud):
    nothing = np.full((500, 3), np.nan, np.float32)
    nothing[::2] = 0
    points = np.concatenate([pair.points, nothing])
    light = np.concatenate([pair.intensity, np.zeros(500, np.float32)])
    found = road_cloud(replace(pair, points=points, intensity=light, ring=None))
    np.testing.assert_allclose(found.height, cloud.height, atol=0.01)
    assert len(found.pole_lines) == len(cloud.pole_lines)


def test_only_bright_ground_is_lane(pair):
    few = road_cloud(pair, CloudOptions(lane_sigmas=4.0))
    assert len(few.lanes) < len(road_cloud(pair).lanes)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda p: replace(p, intensity=None), "without intensity"),
        (lambda p: replace(p, intensity=np.full(len(p.points), 7.0)), "intensity 7"),
        (lambda p: replace(p, points=p.points[:, [2, 0, 1]]), "no ground seen"),
        (lambda p: replace(p, points=p.points * np.nan), "no ground seen"),
        (lambda p: replace(p, points=hilly(p.points)), "not flat"),
    ],
)
def test_clouds_without_a_road_are_refused(pair, change, said):
    with pytest.raises(CalibrationError, match=said) as raised:
        road_cloud(change(pair))
    assert f"road/{SEED}" in raised.value.message
    assert raised.value.remedy


def hilly(points):
    """The same ground in waves of 0.5 m."""
    moved = points.copy()
    moved[:, 2] += 0.5 * np.sin(0.5 * points[:, 0]) + 0.5 * np.sin(0.5 * points[:, 1])
    return moved
