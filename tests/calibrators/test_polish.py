from __future__ import annotations

import numpy as np
import pytest
from line_scene import errors, perturbed

from lcdata.calibrators import create
from lcdata.calibrators.polish import polish
from lcdata.geometry import se3
from lcdata.simulation import render_pair


@pytest.fixture(scope="module")
def pair():
    return render_pair("yard", seed=32, columns=1024, width=960, height=540)


@pytest.fixture(scope="module")
def features(pair):
    return [create("nid_edge").prepare(pair)]


def test_a_pose_that_is_nearly_right_becomes_better_and_stands_out(pair, features):
    start = perturbed(pair.T_camera_lidar, np.random.default_rng(0), 0.2, 0.02)
    found = polish(features, start)
    before, after = (errors(T, pair.T_camera_lidar) for T in (start, found.T))
    assert after[0] < 0.5 * before[0]
    assert after[1] < 0.5 * before[1]
    assert found.cost < found.cost_before
    assert found.contrast > 4.0
    assert se3.sigma_distance(found.T, pair.T_camera_lidar, found.covariance) < 2 * np.sqrt(6)


def test_a_wrong_pose_does_not_stand_out(pair, features):
    for seed in range(3):
        start = perturbed(pair.T_camera_lidar, np.random.default_rng(seed), 5.0, 0.3)
        found = polish(features, start)
        assert found is None or found.contrast < 3.0


def test_a_camera_that_looks_up_has_nothing_to_polish(pair, features):
    turned = se3.exp([0, 0, 0, -np.pi / 2, 0, 0]) @ pair.T_camera_lidar
    assert polish(features, turned) is None
