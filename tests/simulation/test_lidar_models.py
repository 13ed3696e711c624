from __future__ import annotations

import numpy as np
import pytest

from lcdata.errors import SimulationError
from lcdata.geometry import se3
from lcdata.geometry.camera import Camera
from lcdata.simulation import World, render_pair
from lcdata.simulation.lidars import make_lidar
from lcdata.simulation.livox import LASERS, MIN_RANGE_M, Avia
from lcdata.simulation.mesh import Material, quad
from lcdata.simulation.motion import HandMotion
from lcdata.simulation.mounts import default_rig
from lcdata.simulation.pandar import Pandar
from lcdata.simulation.raycast import RayCaster

WHITE = Material("#ffffff", noise=0.0)
SMALL = {"width": 160, "height": 90, "seed": 2}


@pytest.fixture(scope="module")
def wall() -> RayCaster:
    """A large wall at x = 6 m."""
    return RayCaster(quad([6, 60, -30], [6, -60, -30], [6, -60, 30], [6, 60, 30], WHITE))


def _cells(direction: np.ndarray) -> int:
    """How many cells of a quarter of a degree the beams pass through."""
    angles = np.rad2deg([np.arctan2(direction[:, 1], direction[:, 0]), np.arcsin(direction[:, 2])])
    return len(np.unique(np.floor(angles.T * 4), axis=0))


def test_the_rosette_fills_its_oval_and_does_not_repeat() -> None:
    avia = Avia()
    direction, t, line = avia.beams()
    assert len(direction) == 24_000
    assert t.max() < avia.scan_ns
    assert set(line) == set(range(LASERS))
    scans = [avia.beams(0.1 * k)[0] for k in range(20)]
    together = np.concatenate(scans)
    azimuth = np.rad2deg(np.arctan2(together[:, 1], together[:, 0]))
    elevation = np.rad2deg(np.arcsin(together[:, 2]))
    assert np.ptp(azimuth) == pytest.approx(70.4, abs=0.2)
    assert np.ptp(elevation) == pytest.approx(77.2, abs=0.2)
    oval = np.pi / 4 * 70.4 * 77.2 * 16
    shares = [_cells(np.concatenate(scans[:k])) / oval for k in (1, 5, 20)]
    print(f"\nshare of the field of view after 0.1, 0.5 and 2 s: {np.round(shares, 2)}")
    assert shares[0] < 0.3
    assert shares[1] > 2 * shares[0]
    assert shares[2] > 0.9


def test_an_avia_measures_a_wall(wall: RayCaster) -> None:
    avia = Avia(noisy=False)
    records = avia.scan(wall, np.eye(4), 1.0, np.random.default_rng(0))
    direction, _, _ = avia.beams()
    np.testing.assert_allclose(records["x"], 6.0, atol=6e-4)
    np.testing.assert_allclose(records["y"], direction[:, 1] / direction[:, 0] * 6.0, atol=1e-3)
    assert records["reflectivity"].max() > 100, "white, from the front"
    middle = np.hypot(records["y"], records["z"]) < 0.5
    assert records["reflectivity"][middle].min() > records["reflectivity"].min()
    near = RayCaster(quad([0.5, 9, -9], [0.5, -9, -9], [0.5, -9, 9], [0.5, 9, 9], WHITE))
    assert MIN_RANGE_M > 0.6
    middle = np.abs(direction[:, 0]) > 0.9
    assert (avia.scan(near, np.eye(4), 1.0, np.random.default_rng(0))["x"][middle] == 0).all()


def test_an_os1_64_has_64_rings_in_33_degrees(wall: RayCaster) -> None:
    lidar = make_lidar("os1_64", 512)
    records = lidar.scan(wall, np.eye(4), 1.0, np.random.default_rng(0))
    assert len(records) == 64 * 512
    ahead = records[records["range"] > 0]
    elevation = np.rad2deg(np.arctan2(ahead["z"], np.hypot(ahead["x"], ahead["y"])))
    assert np.ptp(elevation) == pytest.approx(33.2, abs=0.2)


@pytest.mark.parametrize("lidar", ["os1_64", "avia"])
def test_motion_distorts_scans_and_its_truth_puts_them_right(wall: RayCaster, lidar: str) -> None:
    model = make_lidar(lidar)
    motion = HandMotion.draw(np.random.default_rng(3))
    np.testing.assert_allclose(motion([0.0])[0], np.eye(4), atol=1e-12)
    late = 0.7  # well under way

    def pose(times: np.ndarray) -> np.ndarray:
        return motion(late + times)

    records = model.scan(wall, pose, 1.0, np.random.default_rng(0))
    time = records["t" if "t" in records.dtype.names else "offset_time"]
    points = np.stack([records[axis] for axis in "xyz"], 1)
    there = np.linalg.norm(points, axis=1) > 0
    T = pose(time * 1e-9)
    right = np.einsum("nij,nj->ni", T[:, :3, :3], points) + T[:, :3, 3]
    stiff = se3.apply(pose(np.array([0.05]))[0], points)
    error = np.median(np.abs(right[there, 0] - 6.0))
    assert error < 0.02
    assert np.abs(stiff[there] - right[there]).max() > 0.03


def test_hands_start_from_rest_and_move_smoothly() -> None:
    motion = HandMotion.draw(np.random.default_rng(5))
    T = motion(np.arange(0, 5, 0.01))
    way = T[:, :3, 3]
    speed = np.linalg.norm(np.diff(way, axis=0), axis=1) / 0.01
    assert speed[0] < 0.02
    assert 0.2 < speed.max() < 1.0
    assert np.abs(np.diff(speed)).max() < 0.05
    assert np.ptp(way[:, 2]) > 0.25


@pytest.mark.parametrize(
    ("choice", "points"),
    [
        ({"lidar": "avia"}, 300_000),
        ({"lidar": "avia", "scans": 1}, 15_000),
        ({"lidar": "os1_64", "moving": True, "scans": 3}, 80_000),
        ({"lidar": "os1_64", "scans": 2}, 50_000),
    ],
    ids=str,
)
def test_pairs_are_dense_and_without_order(choice: dict[str, object], points: int) -> None:
    pair = render_pair("gym", **choice, **SMALL)
    assert pair.organised is None
    assert pair.ring is None
    assert len(pair.points) > points
    assert np.isfinite(pair.points).all()
    assert pair.points.dtype == pair.intensity.dtype == np.float32
    assert pair.intensity.std() > 1
    again = render_pair("gym", **choice, **SMALL)
    np.testing.assert_array_equal(pair.points, again.points)


def test_a_moved_lidar_sees_the_same_scene_in_the_frame_it_started_from() -> None:
    """Its merged points lie on the surfaces that a still one sees."""
    from scipy.spatial import cKDTree

    still = render_pair("gym", lidar="os1_64", scans=1, **SMALL)
    moved = render_pair("gym", lidar="os1_64", scans=12, moving=True, **SMALL)
    there = still.points[np.isfinite(still.points[:, 0])]
    near = there[np.linalg.norm(there, axis=1) < 8]
    distance, _ = cKDTree(moved.points).query(near)
    assert np.quantile(distance, 0.9) < 0.06


def test_pairs_of_one_pose_have_other_phases_of_the_rosette() -> None:
    first, second = (
        render_pair("gym", lidar="avia", scans=1, pair_index=k, **SMALL).points for k in (0, 1)
    )
    unit = [p / np.linalg.norm(p, axis=1, keepdims=True) for p in (first, second)]
    assert _cells(np.concatenate(unit)) > 1.5 * _cells(unit[0])


def test_a_spinning_lidar_that_stands_keeps_its_order() -> None:
    pair = render_pair("gym", lidar="os1_64", **SMALL)
    assert pair.organised == (64, 1024)
    assert pair.ring is not None
    assert render_pair("gym", columns=512, **SMALL).organised == (128, 512)


def test_a_pair_may_be_of_any_camera() -> None:
    camera = Camera("fisheye", 160, 120, (52, 52, 80, 60), (0.02, -0.005, 0.001, 0.0))
    pair = render_pair("gym", lidar="os1_64", camera=camera, seed=2)
    assert pair.image.shape == (120, 160, 3)
    assert pair.camera == camera


def test_wrong_choices_of_lidar_are_named() -> None:
    with pytest.raises(SimulationError, match=r"'hdl_64'.*os1_128, os1_64, avia"):
        render_pair("gym", lidar="hdl_64")
    with pytest.raises(SimulationError, match="an Avia has neither columns"):
        render_pair("gym", lidar="avia", columns=512)
    with pytest.raises(SimulationError, match="unknown number of columns 100"):
        render_pair("gym", columns=100)


def test_hand_motion_differs_from_pair_to_pair() -> None:
    world = World("gym", 2, default_rig())
    first, second = (world.hand_motion(0, k)(np.array([1.0])) for k in (0, 1))
    assert np.abs(first - second).max() > 0.01


def test_a_camera_fixed_to_the_lidar_has_the_extrinsic_that_was_asked_for():
    turned = np.array([[0, -1, 0, 0.05], [0, 0, -1, 0.12], [1, 0, 0, -0.08], [0, 0, 0, 1.0]])
    small = {"lidar": "os1_64", "columns": 512, "width": 320, "height": 180}
    first, second = (
        render_pair(scene, seed=seed, T_camera_lidar=turned, **small)
        for scene, seed in (("gym", 3), ("yard", 4))
    )
    for pair in (first, second):
        np.testing.assert_array_equal(pair.T_camera_lidar, turned)
        _, inside = pair.camera.project(pair.points @ turned[:3, :3].T + turned[:3, 3])
        assert inside.mean() > 0.15
    on_arm = render_pair("gym", seed=3, **small)
    again = render_pair("gym", seed=3, T_camera_lidar=on_arm.T_camera_lidar, **small)
    assert np.mean(again.image != on_arm.image) < 0.001


def test_a_pandar_reports_reflectivity_whatever_the_range() -> None:
    strengths = []
    for distance in (5.0, 20.0):
        corners = [[distance, y, z] for y, z in ((-9, -9), (9, -9), (9, 9), (-9, 9))]
        plate = RayCaster(quad(*corners, Material("#808080", noise=0.0)))
        records = make_lidar("pandar_64").scan(plate, np.eye(4), 1.0, np.random.default_rng(0))
        ahead = (np.abs(records["y"]) < 1) & (np.abs(records["z"]) < 1) & (records["x"] > 0)
        strengths.append(np.median(records["intensity"][ahead]))
    grey = 255 * (128 / 255) ** 2.2
    np.testing.assert_allclose(strengths, grey, rtol=0.05)


def test_a_pandars_rings_are_densest_where_the_road_is() -> None:
    pandar = make_lidar("pandar_64")
    assert isinstance(pandar, Pandar)
    _, direction, _, _ = pandar.beams()
    elevation = np.rad2deg(np.arcsin(direction[:, 2])).reshape(64, 1800)
    assert np.ptp(elevation, axis=1).max() < 1e-3
    steps = -np.diff(elevation[:, 0])
    assert (steps > 0).all()
    road = (elevation[1:, 0] < -1) & (elevation[1:, 0] > -6)
    np.testing.assert_allclose(steps[road], 1 / 6, atol=1e-3)
    with pytest.raises(SimulationError, match="1800 columns"):
        make_lidar("pandar_64", columns=512)
