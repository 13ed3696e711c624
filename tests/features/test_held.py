"""Half of an extrinsic held while the other half is estimated."""

from __future__ import annotations

import numpy as np
import pytest
from line_scene import random_problem

from lcdata.features.held import HOLDS, NOTHING, ROTATION, TRANSLATION, free_directions, stepped
from lcdata.features.line_solver import solve_decoupled, solve_pluecker, solve_projection
from lcdata.geometry import se3

SOLVERS = (solve_projection, solve_decoupled, solve_pluecker)


def moved(T, hold):
    """The part that is not held set off by 2 deg and 0.1 m."""
    T = T.copy()
    if hold != ROTATION:
        T[:3, :3] = se3.exp([0, 0, 0, 0.02, -0.02, 0.02])[:3, :3] @ T[:3, :3]
    if hold != TRANSLATION:
        T[:3, 3] += [0.1, -0.1, 0.1]
    return T


@pytest.mark.parametrize("hold", HOLDS)
def test_free_directions_leave_what_is_held(hold):
    T = se3.exp([0.4, -1.2, 0.7, 0.3, 1.1, -0.6])
    directions = free_directions(T, hold)
    assert np.linalg.matrix_rank(directions) == (6 if hold == NOTHING else 3)
    for direction in directions.T:
        small = (se3.exp(1e-6 * direction) @ T - T) / 1e-6
        large = stepped(T, 0.5 * direction, hold)
        if hold == ROTATION:
            assert np.abs(small[:3, :3]).max() < 1e-9
            np.testing.assert_allclose(large[:3, :3], T[:3, :3], atol=1e-15)
        if hold == TRANSLATION:
            assert np.abs(small[:3, 3]).max() < 1e-5
            assert np.array_equal(large[:3, 3], T[:3, 3])
        assert np.abs(large - T).max() > 0.01


@pytest.mark.parametrize("solve", SOLVERS)
@pytest.mark.parametrize("hold", [ROTATION, TRANSLATION])
def test_exact_lines_give_the_other_half_exactly(solve, hold):
    rng = np.random.default_rng(6)
    for _ in range(5):
        T, problem = random_problem(rng, 6, noise=0.0)
        start = moved(T, hold)
        found = solve(problem, start, 60, hold=hold)
        np.testing.assert_allclose(found.T_camera_lidar, T, atol=1e-6)
        part = np.s_[:3, :3] if hold == ROTATION else np.s_[:3, 3]
        np.testing.assert_allclose(found.T_camera_lidar[part], start[part], atol=1e-12)
        assert np.linalg.matrix_rank(found.covariance, tol=1e-12) == 3


@pytest.mark.parametrize("solve", SOLVERS)
@pytest.mark.parametrize("hold", [ROTATION, TRANSLATION])
def test_covariance_of_the_other_half_agrees_with_monte_carlo(solve, hold):
    """Three degrees of freedom; the scatter is floored, so that it may be below three."""
    rng = np.random.default_rng(8)
    squared = []
    for _ in range(60):
        T, problem = random_problem(rng, 20)
        found = solve(problem, moved(T, hold), hold=hold)
        error = se3.log(found.T_camera_lidar @ se3.inverse(T))
        squared.append(error @ np.linalg.pinv(found.covariance, rcond=1e-10) @ error)
    assert 1.0 < np.mean(squared) < 4.0
