from __future__ import annotations

import numpy as np
import pytest

from lcdata.errors import SimulationError
from lcdata.geometry import se3
from lcdata.rig import Rig
from lcdata.simulation import SCENARIOS, World, render_pair
from lcdata.simulation.mounts import default_rig, true_mounts
from lcdata.simulation.poses import min_jerk

SMALL = {"columns": 512, "width": 320, "height": 180}


@pytest.fixture(scope="module", params=SCENARIOS)
def scenario(request: pytest.FixtureRequest) -> str:
    return request.param


def test_a_pair_repeats_with_its_seed_and_only_with_it() -> None:
    scenario = "yard"
    first, again = (render_pair(scenario, seed=3, **SMALL) for _ in range(2))
    np.testing.assert_array_equal(first.image, again.image)
    np.testing.assert_array_equal(first.points, again.points)
    next_pair = render_pair(scenario, seed=3, pair_index=1, **SMALL)
    np.testing.assert_array_equal(first.T_camera_lidar, next_pair.T_camera_lidar)
    assert (first.image != next_pair.image).mean() > 0.1
    other = render_pair(scenario, seed=4, **SMALL)
    assert np.abs(np.nan_to_num(first.points) - np.nan_to_num(other.points)).mean() > 0.3


def test_the_camera_sees_what_the_lidar_sees(scenario: str) -> None:
    """Points that the camera sees lie in the picture, and glowing or dark where it is so."""
    pair = render_pair(scenario, seed=1, pose_index=2, **SMALL)
    assert pair.organised == (128, 512)
    points = pair.points[np.isfinite(pair.points[:, 0])]
    assert len(points) > 30_000
    _, inside = pair.camera.project(se3.apply(pair.T_camera_lidar, points))
    assert inside.sum() > 5000
    assert np.linalg.norm(points, axis=1).min() > 0.3
    assert pair.image.std() > 15


def test_the_extrinsic_is_the_chain_of_true_links() -> None:
    world = World("gym", 5, default_rig())
    q = world.pose(1)
    X, Z = world.mounts.T_camera_effector, world.mounts.T_base_lidar
    expected = X @ se3.inverse(world.arm.forward(q)) @ Z
    np.testing.assert_allclose(world.T_camera_lidar(q), expected, atol=1e-12)
    pair = render_pair("gym", seed=5, pose_index=1, **SMALL)
    np.testing.assert_allclose(pair.T_camera_lidar, expected, atol=1e-12)


def test_poses_are_reachable_and_turn_the_camera_about_several_axes(scenario: str) -> None:
    world = World(scenario, 2, default_rig())
    poses = [world.pose(k) for k in range(5)]
    for q in poses:
        world.arm.check_limits(q)
    rotations = [world.T_base_camera(q)[:3, :3] for q in poses]
    turns = np.array([se3.log(_homogeneous(R @ rotations[0].T))[3:] for R in rotations[1:]])
    assert np.rad2deg(np.linalg.norm(turns, axis=1)).max() > 30
    spread = np.rad2deg(np.linalg.svd(turns, compute_uv=False))
    assert spread[1] > 15, "two axes"
    forward = np.array([R[:, 2] for R in rotations])
    assert (forward[:, 0] > 0.7).all(), "the camera looks ahead"


def _homogeneous(R: np.ndarray) -> np.ndarray:
    T = np.eye(4)
    T[:3, :3] = R
    return T


def test_true_mounts_are_off_by_the_rigs_deviations() -> None:
    rig = default_rig()
    errors = np.array(
        [
            se3.log(true_mounts(rig, seed).T_camera_effector @ se3.inverse(rig.T_camera_effector.T))
            for seed in range(400)
        ]
    )
    expected = np.sqrt(np.diag(rig.T_camera_effector.covariance))
    np.testing.assert_allclose(errors.std(axis=0), expected, rtol=0.15)
    assert (np.abs(errors.mean(axis=0)) < 0.2 * expected).all()


def test_a_rig_without_deviations_cannot_be_simulated() -> None:
    content = default_rig().to_dict()
    for key in ("translation_std_m", "rotation_std_deg"):
        del content["T_base_lidar"][key]
    with pytest.raises(SimulationError, match="T_base_lidar has no standard deviations"):
        true_mounts(Rig.from_dict(content), 0)


def test_an_unknown_scenario_is_named() -> None:
    with pytest.raises(SimulationError, match=r"'garden'.*parking_lot, gym, yard"):
        render_pair("garden", **SMALL)


def test_motion_is_smooth_and_ends_at_rest() -> None:
    share = np.linspace(0, 1, 1001)
    way = min_jerk(np.zeros(1), np.ones(1), share)[:, 0]
    speed = np.gradient(way, share)
    assert way[0] == 0
    assert way[-1] == 1
    assert (speed >= 0).all()
    assert speed.max() == pytest.approx(1.875, rel=1e-3)
    assert max(speed[0], speed[-1]) < 1e-3
