from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from nid_scene import textured_pair

from lcdata.errors import CalibrationError
from lcdata.features.nid_landscape import landscape
from lcdata.features.nid_objective import nid_features, objective
from lcdata.geometry import se3

BESIDE = np.array([0.05, 0, 0, 0, 0, 0])


@pytest.fixture(scope="module")
def pair():
    return textured_pair(2, points=8000)


@pytest.fixture(scope="module")
def around(pair):
    T = pair.T_camera_lidar
    off = se3.exp([0.04, -0.03, 0.02, 0.01, 0.005, -0.01]) @ T
    poses = {"truth": T, "beside": se3.exp(BESIDE) @ T, "off": off}
    return landscape(pair, poses, "truth", steps=41)


def test_the_truth_is_the_bottom_of_a_valley_on_every_axis(around):
    lowest = around.lowest("truth")
    assert np.abs(lowest[:3]).max() < 0.02
    assert np.abs(lowest[3:]).max() < np.deg2rad(0.15)
    truth = around.slices["truth"]
    assert (truth.soft.max(axis=1) > truth.cost + 0.02).all()
    assert truth.cost < min(around.slices[name].cost for name in ("beside", "off"))


def test_lines_pass_through_their_pose(around):
    for one in around.slices.values():
        for axis in range(6):
            found = np.interp(one.at[axis], around.offsets[axis], one.soft[axis])
            assert found == pytest.approx(one.cost, abs=2e-3)


def test_poses_that_differ_along_an_axis_share_its_line(around):
    beside = around.slices["beside"]
    np.testing.assert_allclose(beside.at, BESIDE, atol=1e-9)
    np.testing.assert_allclose(beside.soft[0], around.slices["truth"].soft[0], atol=1e-9)
    assert np.abs(beside.soft[1] - around.slices["truth"].soft[1]).max() > 1e-3


def test_it_is_the_cost_that_the_method_minimises(pair, around):
    T = pair.T_camera_lidar
    current = objective([nid_features(pair, False)], T, False)
    for axis, step in ((2, 5), (4, 35)):
        xi = np.zeros(6)
        xi[axis] = around.offsets[axis, step]
        pose = se3.exp(xi) @ T
        assert around.slices["truth"].soft[axis, step] == pytest.approx(current.soft(pose)[0])
        assert around.slices["truth"].hard[axis, step] == pytest.approx(current.hard(pose[None])[0])


def test_the_reach_is_that_asked_for(pair):
    found = landscape(
        pair, {"a": pair.T_camera_lidar}, "a", reach_m=0.5, reach_deg=4, steps=4, with_edges=True
    )
    assert found.offsets.shape == (6, 5)
    np.testing.assert_allclose(found.offsets[:, -1], np.repeat([0.5, np.deg2rad(4)], 3))
    assert found.offsets[0, 2] == 0
    assert found.slices["a"].cost > 1  # NID / 0.01


@pytest.mark.parametrize(
    "options", [{"reach_m": 0.0}, {"reach_deg": 90.0}, {"reach_m": float("nan")}, {"steps": 2}]
)
def test_impossible_options_are_refused(pair, options):
    with pytest.raises(CalibrationError, match="landscape"):
        landscape(pair, {"a": pair.T_camera_lidar}, "a", **options)


def test_a_pose_that_sees_nothing_says_where_the_points_are(pair):
    T = np.diag([-1.0, 1, -1, 1]) @ pair.T_camera_lidar
    with pytest.raises(CalibrationError, match="no point in view: points are 100% behind"):
        landscape(pair, {"away": T}, "away")


def test_a_cloud_without_intensities_has_none(pair):
    dark = replace(pair, intensity=None)
    with pytest.raises(CalibrationError, match="no intensity"):
        landscape(dark, {"a": pair.T_camera_lidar}, "a")
