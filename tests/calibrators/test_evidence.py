from __future__ import annotations

import numpy as np
import pytest

from lcdata.calibrators.base import Calibration
from lcdata.calibrators.evidence import Finding, agreeing, distance, fused
from lcdata.geometry import se3


def random_covariance(rng, scale):
    A = rng.normal(size=(6, 6)) * scale
    return A @ A.T + 1e-3 * scale**2 * np.eye(6)


def finding(by, T, converged=False, cost=1.0):
    return Finding(by, Calibration(T, converged, False, np.eye(6), 0.1, cost_final=cost))


def test_fused_estimates_are_as_good_as_their_covariance_says():
    """Monte Carlo: 2,000 pairs of estimates drawn about one truth."""
    rng = np.random.default_rng(0)
    truth = se3.exp(rng.normal(size=6))
    a, b = random_covariance(rng, 0.01), random_covariance(rng, 0.02)
    twists = []
    for _ in range(2000):
        T_a = se3.exp(rng.multivariate_normal(np.zeros(6), a)) @ truth
        T_b = se3.exp(rng.multivariate_normal(np.zeros(6), b)) @ truth
        T, covariance = fused(T_a, a, T_b, b)
        twists.append(se3.log(T @ se3.inverse(truth)))
    np.testing.assert_allclose(
        covariance, np.linalg.inv(np.linalg.inv(a) + np.linalg.inv(b)), rtol=1e-6, atol=1e-12
    )
    errors = np.linalg.solve(np.linalg.cholesky(covariance), np.array(twists).T)
    assert np.mean(errors**2) == pytest.approx(1.0, abs=0.05)


def test_distance_of_independent_estimates_has_a_mean_square_of_one():
    rng = np.random.default_rng(1)
    truth = se3.exp(rng.normal(size=6))
    a, b = random_covariance(rng, 0.01), random_covariance(rng, 0.02)
    squares = [
        distance(
            se3.exp(rng.multivariate_normal(np.zeros(6), a)) @ truth,
            a,
            se3.exp(rng.multivariate_normal(np.zeros(6), b)) @ truth,
            b,
        )
        ** 2
        for _ in range(2000)
    ]
    assert np.mean(squares) == pytest.approx(1.0, abs=0.05)
    assert np.isnan(distance(truth, np.full((6, 6), np.nan), truth, b))


def test_two_methods_agree_within_what_a_success_may_be_off():
    T = se3.exp([1.0, 2, 3, 0.1, 0.2, 0.3])
    near = se3.exp([0.0, 0, 0, 0, 0, np.deg2rad(0.4)]) @ T
    far = se3.exp([0.15, 0, 0, 0, 0, 0]) @ T
    one, two, three = finding("one", far), finding("two", T), finding("three", near)
    both = agreeing([one, two, three])
    assert both is not None
    assert [f.by for f in both] == ["two", "three"]
    assert agreeing([one, two]) is None
    assert agreeing([two, Finding("gone", None, "no lines")]) is None
    # One that gave up returns its initial guess: two of those agree on nothing.
    assert agreeing([two, finding("gave up", T, cost=np.nan)]) is None


def test_words_say_why():
    T = np.eye(4)
    assert finding("one", T, converged=True).words == "one converged"
    assert Finding("one", None, "no lines").words == "one did not converge (no lines)"
