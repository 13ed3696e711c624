from __future__ import annotations

import numpy as np
import pytest

from lcdata.errors import SimulationError
from lcdata.geometry import se3
from lcdata.pair import Pair
from lcdata.simulation import World, render_pair, semantic_masks
from lcdata.simulation.mounts import car_extrinsic, default_rig
from lcdata.simulation.scenes import street

SMALL = {"width": 320, "height": 180}
SEEDS = (0, 6)


@pytest.fixture(scope="module", params=SEEDS)
def seed(request: pytest.FixtureRequest) -> int:
    return request.param


@pytest.fixture(scope="module")
def stop(seed: int) -> tuple[Pair, World]:
    pair = render_pair("road", seed=seed, lidar="os1_64", width=640, height=360)
    return pair, World("road", seed, default_rig(), stop=0)


def test_a_car_sees_the_road_as_cars_do(seed: int, stop: tuple[Pair, World]) -> None:
    """LiDAR 1.7 to 2 m above a flat road along x, camera below it, looking ahead."""
    pair, world = stop
    assert 1.6 < world.T_world_lidar[2, 3] < 2.05
    T = world.T_world_lidar @ se3.inverse(car_extrinsic(seed))
    assert 1.2 < T[2, 3] < world.T_world_lidar[2, 3]
    assert T[0, 2] > np.cos(np.deg2rad(12)), "the optical axis points along the road"
    points = se3.apply(world.T_world_lidar, pair.points[np.isfinite(pair.points[:, 0])])
    near = points[(np.abs(points[:, 1]) < 1.2) & (points[:, 0] > 4) & (points[:, 0] < 12)]
    assert len(near) > 200
    assert np.abs(np.median(near[:, 2])) < 0.02, "the world's ground is z = 0"


def test_stops_of_a_car_share_its_extrinsic_and_are_different_places(
    seed: int, stop: tuple[Pair, World]
) -> None:
    first, _ = stop
    second = render_pair("road", seed=seed, pose_index=1, lidar="os1_64", **SMALL)
    np.testing.assert_array_equal(first.T_camera_lidar, second.T_camera_lidar)
    np.testing.assert_array_equal(first.T_camera_lidar, car_extrinsic(seed))
    assert first.pose_id != second.pose_id
    moved = np.abs(np.nan_to_num(first.points) - np.nan_to_num(second.points))
    assert moved.mean() > 0.5


def test_masks_are_what_the_image_shows(seed: int, stop: tuple[Pair, World]) -> None:
    """Markings are on the ground, and brighter than the road beside them."""
    pair, world = stop
    masks = semantic_masks(seed=seed, width=640, height=360)
    assert masks.lane.shape == masks.pole.shape == (360, 640)
    assert not (masks.lane & masks.pole).any()
    assert masks.lane.sum() > 500
    assert masks.pole.sum() > 100
    T = world.T_world_lidar @ se3.inverse(pair.T_camera_lidar)
    rows, columns = np.nonzero(masks.lane)
    rays = pair.camera.unproject(np.column_stack([columns, rows]).astype(float)) @ T[:3, :3].T
    assert (rays[:, 2] < 0).all(), "markings are on the ground"
    x = T[:3, 3] + rays * (street.PAINT_HEIGHT_M - T[2, 3]) / rays[:, 2:]
    light = pair.image.mean(axis=2)
    near = x[:, 0] < 25
    for side in (-0.5, 0.5):
        beside, seen = pair.camera.project(
            se3.apply(se3.inverse(T), x[near] + np.array([0.0, side, 0.0]))
        )
        at = np.rint(beside[seen]).astype(int)
        inside = masks.lane[at[:, 1], at[:, 0]]
        road = light[at[:, 1], at[:, 0]][~inside]
        paint = light[rows[near], columns[near]][seen][~inside]
        assert np.median(paint - road) > 25


def test_paint_is_stronger_than_asphalt_at_a_mean_and_a_sigma(
    seed: int, stop: tuple[Pair, World]
) -> None:
    """CRLF's threshold on a LiDAR whose intensity does not fall with range."""
    _, world = stop
    pair = render_pair("road", seed=seed, lidar="avia", scans=4, **SMALL)
    around = world.surroundings(0, 0)
    origin = np.broadcast_to(world.T_world_lidar[:3, 3], pair.points.shape)
    ahead = se3.apply(world.T_world_lidar, pair.points) - origin
    ahead /= np.linalg.norm(ahead, axis=1, keepdims=True)
    hits = around.cast(np.ascontiguousarray(np.hstack([origin, ahead]), np.float32))
    z = se3.apply(world.T_world_lidar, pair.points)[:, 2]
    ground, lane = np.abs(z) < 0.1, around.of_kind("lane", hits)
    strength = pair.intensity[ground]
    bright = strength > strength.mean() + strength.std()
    assert bright[lane[ground]].mean() > 0.75
    assert bright[~lane[ground]].mean() < 0.1
    ratio = np.median(strength[lane[ground]]) / np.median(strength[~lane[ground]])
    assert 2.0 < ratio < 8.0


def test_markings_keep_clear_of_crossings() -> None:
    spans = list(street.pieces(0.0, 50.0, [(10.0, 14.0), (45.0, 60.0)], 20.0))
    assert spans == [(0.0, 10.0), (14.0, 29.5), (29.5, 45.0)]
    dashes = street.dashed_line(0.0, 40.0, 0.0, 0.15, street.YELLOW_LINE, (3.0, 6.0), [(10, 14)])
    x = np.array([[p.corners[..., 0].min(), p.corners[..., 0].max()] for p in dashes])
    np.testing.assert_allclose(np.diff(x), 3.0)
    assert not ((x[:, 0] < 14) & (x[:, 1] > 10)).any()
    assert len(dashes) == 4


def test_the_arm_stands_on_the_road_too() -> None:
    pair = render_pair("road", seed=1, pose_index=1, mount="arm", columns=512, **SMALL)
    world = World("road", 1, default_rig())
    np.testing.assert_allclose(pair.T_camera_lidar, world.T_camera_lidar(world.pose(1)), atol=1e-12)
    masks = semantic_masks(seed=1, pose_index=1, mount="arm", **SMALL)
    assert masks.lane.any()


def test_other_places_have_cars_but_no_markings_of_a_road() -> None:
    first, second = (
        render_pair("gym", seed=1, pose_index=k, mount="car", columns=512, **SMALL)
        for k in range(2)
    )
    np.testing.assert_array_equal(first.T_camera_lidar, second.T_camera_lidar)
    assert (first.image != second.image).mean() > 0.1
    assert not semantic_masks("gym", seed=1, mount="car", **SMALL).lane.any()


def test_an_unknown_mount_is_named() -> None:
    with pytest.raises(SimulationError, match=r"'boat'.*arm, car"):
        render_pair("road", mount="boat", **SMALL)
