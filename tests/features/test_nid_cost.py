from __future__ import annotations

import numpy as np
import pytest
from nid_scene import CAMERA, textured_pair

from lcdata.features.nid_cost import cost_of, cost_slopes, nid
from lcdata.features.nid_kernels import BINS, count_hard, count_soft
from lcdata.features.nid_objective import nid_features, objective
from lcdata.features.nid_views import equalised, equalised_levels, flat
from lcdata.geometry import se3


def test_identical_intensities_have_distance_0_and_independent_ones_1():
    assert nid(np.diag([3, 5, 7, 1])) == pytest.approx(0.0, abs=1e-12)
    assert nid(np.outer([1, 2, 3], [4, 5, 6])) == pytest.approx(1.0, abs=1e-12)


def test_a_half_shared_bit():
    """Two fair bits that agree in 3 of 4: H = 2 log 2 - I with I from the printed formula."""
    counts = np.array([[3, 1], [1, 3]])
    p = counts / 8
    joint = -(p * np.log(p)).sum()
    assert nid(counts) == pytest.approx((joint - (2 * np.log(2) - joint)) / joint)
    assert nid(7 * counts) == pytest.approx(float(nid(counts)))


def test_empty_and_constant_histograms_say_nothing():
    assert nid(np.zeros((4, 4))) == 1.0
    assert nid(np.eye(4)[:1] * 9) == 1.0


def test_leaving_the_image_costs():
    counts = np.diag([10.0] * 8)
    assert cost_of(counts, 80) == pytest.approx(0.0, abs=1e-12)
    assert cost_of(counts, 160) == pytest.approx(1 - np.sqrt(0.5))


def test_slopes_of_the_cost_are_its_derivatives():
    rng = np.random.default_rng(0)
    counts = rng.uniform(1, 20, (BINS, BINS))
    cost, slopes = cost_slopes(counts, 4000.0)
    assert cost == pytest.approx(float(cost_of(counts, 4000.0)))
    for a, b in rng.integers(0, BINS, (10, 2)):
        step = np.zeros_like(counts)
        step[a, b] = 1e-2
        change = cost_of(counts + step, 4000.0) - cost_of(counts - step, 4000.0)
        assert slopes[a, b] == pytest.approx(change / 2e-2, abs=1e-4 * np.abs(slopes).max())


def test_equal_values_share_a_rank():
    np.testing.assert_allclose(
        equalised(np.array([5, 1, 1, 9])), [0.625, 0.25, 0.25, 0.875], atol=1e-6
    )
    ranks = equalised(np.random.default_rng(0).normal(size=10_000))
    assert ranks.min() >= 0
    assert ranks.max() < 1
    assert np.histogram(ranks, 16, (0, 1))[0] == pytest.approx(625, abs=1)


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e6])
def test_ranks_of_levels_are_those_of_sorted_values(scale):
    values = (np.random.default_rng(0).normal(size=(200, 300)) * scale).astype(np.float32)
    np.testing.assert_allclose(equalised_levels(values), equalised(values), atol=2e-4)
    values[:, :100] = values.max()  # an overexposed third
    np.testing.assert_allclose(equalised_levels(values), equalised(values), atol=2e-4)
    assert equalised_levels(values).max() == pytest.approx(1 - 1 / 6, abs=1e-3)


@pytest.fixture(scope="module")
def scene():
    pair = textured_pair(0)
    features = nid_features(pair, False)
    return pair.T_camera_lidar, objective([features], pair.T_camera_lidar, False)


def test_histograms_count_each_point_once(scene):
    T, cost = scene
    (v,) = cost.views
    camera = v.image.model, v.image.parameters
    hard = np.zeros((1, BINS, BINS), np.int32)
    count_hard(*camera, flat(T[None]), v.cloud.points, v.cloud.bins, v.image.hard, hard)
    soft, kept = np.zeros((BINS, BINS)), np.zeros((len(v.cloud.points), 11), np.float32)
    pose = flat(T[None])[0]
    count_soft(*camera, pose, v.cloud.points, v.cloud.bins, v.image.soft, 2.0, soft, kept)
    _, inside = CAMERA.project(se3.apply(T, v.cloud.points))
    assert hard.sum() == inside.sum()
    # Every point's four weights sum to its own, 1 away from the border.
    assert soft.sum() == pytest.approx(kept[:, 1].sum(), rel=1e-5)
    assert soft.sum() == pytest.approx(inside.sum(), rel=0.02)
    np.testing.assert_array_equal(soft.sum(1).round() <= np.bincount(v.cloud.bins), True)


@pytest.mark.parametrize("with_edges", [False, True])
def test_gradient_is_the_derivative_by_a_left_perturbation(with_edges):
    pair = textured_pair(1)
    features = nid_features(pair, with_edges)
    T = se3.exp([0.03, -0.02, 0.05, 0.01, -0.008, 0.006]) @ pair.T_camera_lidar
    cost = objective([features], T, with_edges)
    gradient = cost.slope(T)[1]
    scale = np.abs(gradient[:3]).max(), np.abs(gradient[3:]).max()
    for k in range(6):
        twist = np.zeros(6)
        twist[k] = 2e-5
        ahead, back = (cost.slope(se3.exp(s * twist) @ T)[0] for s in (1, -1))
        # Interpolation has kinks at the pixels' borders, which a finite step may cross.
        assert gradient[k] == pytest.approx((ahead - back) / 4e-5, abs=0.02 * scale[k // 3])


def test_the_gradient_of_one_pair_is_the_sum_of_its_parts(scene):
    T, cost = scene
    parts = cost.soft(T)[1]
    np.testing.assert_allclose(parts.sum(0), cost.slope(T)[1])
    assert (np.abs(parts).sum(1) > 0).sum() > 40


def test_a_monotone_map_of_the_intensities_changes_nothing():
    pairs = [
        textured_pair(2, map_intensity=f) for f in (lambda x: x, np.exp, lambda x: 5 * x**3 - 100)
    ]
    T = pairs[0].T_camera_lidar
    costs = [objective([nid_features(p, False)], T, False).slope(T)[0] for p in pairs]
    np.testing.assert_allclose(costs, costs[0], atol=2e-4)


def test_the_truth_costs_less_than_poses_around(scene):
    T, cost = scene
    rng = np.random.default_rng(0)
    twists = rng.choice([-1, 1], (50, 6)) * np.repeat([0.05, np.deg2rad(0.5)], 3)
    costs = cost.hard(np.array([T, *(se3.exp(x) @ T for x in twists)]))
    assert costs[0] < costs[1:].min()
    assert np.isfinite(costs).all()


def test_a_pose_that_loses_the_view_is_no_answer(scene):
    T, cost = scene
    away = se3.exp([0, 0, 0, 0, 1.0, 0]) @ T
    assert cost.hard(away[None])[0] == np.inf
    assert cost.slope(away)[0] > cost.slope(T)[0]
