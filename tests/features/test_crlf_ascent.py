"""The compiled ascent of CRLF's agreement against the same in numpy and a general minimiser."""

import numpy as np
import pytest
from test_road_cost import T, view

from lcdata.features import crlf_refine as refine
from lcdata.features.crlf_ascent import agreement_slope, displace
from lcdata.features.nid_search import bfgs
from lcdata.features.road_cost import flat_poses
from lcdata.features.road_view import COARSE, FINE, stack, together
from lcdata.geometry import se3


@pytest.fixture(scope="module")
def data():
    return stack(together([view(3), view(4)]), T[None], (10_000,) * 3)


@pytest.mark.parametrize("kind", [FINE, COARSE])
def test_slopes_are_those_of_the_groups_together(data, kind):
    value, gradients = refine.slopes(data, T, kind)
    gradient = np.empty(6)
    found = agreement_slope(flat_poses(T)[0], refine.compared(data, kind), gradient)
    np.testing.assert_allclose(found, value, rtol=1e-6)
    np.testing.assert_allclose(gradient, gradients.sum(0), rtol=1e-4, atol=1e-5)
    np.testing.assert_array_equal(refine.slope(data, T, kind), gradient)


@pytest.mark.parametrize("size", [0.0, 1e-6, 1e-3, 0.5, 3.0])
def test_displaced_poses_are_those_of_the_exponential(size):
    twist = size * np.array([0.3, -0.5, 0.2, 0.4, -0.1, 0.6])
    result = np.empty(12)
    displace(flat_poses(T)[0], twist, result)
    np.testing.assert_allclose(result, flat_poses(se3.exp(twist) @ T)[0], atol=1e-12)


def test_the_top_is_as_high_as_a_general_minimiser_finds(data):
    rng = np.random.default_rng(1)

    def cost(pose):
        value, gradients = refine.slopes(data, pose, COARSE)
        return -value, -gradients.sum(0)

    for _ in range(5):
        start = se3.exp(rng.normal(size=6) * np.repeat([0.02, 0.003], 3)) @ T
        expected = -bfgs(cost, start, refine.REACH, 60, 1e-7)[1]
        found = refine.polished(data, start, (COARSE,))
        top, before = (refine.agreement(data, pose[None], COARSE)[0] for pose in (found, start))
        assert top > before + 0.8 * (expected - before)
        moved = se3.log(found @ se3.inverse(start))
        assert (np.abs(moved) < 1.05 * refine.REACH).all()
        np.testing.assert_allclose(found[:3, :3] @ found[:3, :3].T, np.eye(3), atol=1e-9)


def test_the_reach_is_kept(data):
    start = se3.exp([0.05, 0.0, 0.0, 0.0, 0.01, 0.0]) @ T
    reach = np.repeat([0.002, 1e-4], 3)
    found = refine.polished(data, start, (COARSE,), reach)
    assert (np.abs(se3.log(found @ se3.inverse(start))) < 1.01 * reach).all()
