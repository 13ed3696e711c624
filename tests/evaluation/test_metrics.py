from __future__ import annotations

import dataclasses
import math
import statistics
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from lcdata.evaluation import metrics
from lcdata.evaluation.comparison import compare
from lcdata.evaluation.results import TrialResult
from lcdata.evaluation.text import not_ranked, verdicts
from lcdata.geometry import se3


def trial(method: str, rotation: float, translation: float, **fields: Any) -> TrialResult:
    values: dict[str, Any] = {
        "run": "r",
        "method": method,
        "method_version": 1,
        "parameters": "{}",
        "lcdata_version": "0",
        "pair_ids": ("s/pose_000/000",),
        "scenario": "s",
        "pose_id": "s/pose_000",
        "trial": 0,
        "seed": 0,
        "group": "pair",
        "init_rotation_deg": 5.0,
        "init_translation_m": 0.5,
        "T_camera_lidar_initial": np.eye(4),
        "groundtruth_version": "v",
        "failed": math.isnan(rotation),
        "rotation_error_deg": rotation,
        "translation_error_m": translation,
        "groundtruth_rotation_sigma_deg": 0.2,
        "groundtruth_translation_sigma_m": 0.01,
        "seconds": 1.0,
    }
    return TrialResult(**values | fields)


def test_errors_against_scipy() -> None:
    rng = np.random.default_rng(0)
    for _ in range(20):
        a, b = se3.exp(rng.normal(size=6)), se3.exp(rng.normal(size=6))
        turn = Rotation.from_matrix(a[:3, :3]).inv() * Rotation.from_matrix(b[:3, :3])
        assert metrics.rotation_error_deg(a, b) == pytest.approx(math.degrees(turn.magnitude()))
        assert metrics.translation_error_m(a, b) == pytest.approx(math.dist(a[:3, 3], b[:3, 3]))


def test_groundtruth_sigma_is_the_error_of_samples() -> None:
    rng = np.random.default_rng(1)
    T = se3.exp([2.0, -1.0, 3.0, 0.3, 0.2, -0.4])
    root = rng.normal(size=(6, 6)) * 0.003
    covariance = root @ root.T
    samples = rng.multivariate_normal(np.zeros(6), covariance, 4000)
    truths = [se3.exp(xi) @ T for xi in samples]
    rotation = np.sqrt(np.mean([metrics.rotation_error_deg(T, t) ** 2 for t in truths]))
    translation = np.sqrt(np.mean([metrics.translation_error_m(T, t) ** 2 for t in truths]))
    sigma = metrics.groundtruth_sigma(T, covariance)
    assert sigma.rotation_deg == pytest.approx(rotation, rel=0.04)
    assert sigma.translation_m == pytest.approx(translation, rel=0.04)


def test_no_covariance_no_sigma() -> None:
    for covariance in (None, np.full((6, 6), np.nan)):
        assert all(map(math.isnan, metrics.groundtruth_sigma(np.eye(4), covariance)))


@given(st.lists(st.floats(0, 1e6), min_size=2, max_size=60))
def test_quartiles_against_the_standard_library(values: list[float]) -> None:
    expected = statistics.quantiles(values, n=4, method="inclusive")
    np.testing.assert_allclose(metrics.quartiles(values), expected, rtol=1e-9, atol=1e-9)


def test_failed_trials_count_as_infinitely_wrong() -> None:
    nan = math.nan
    assert metrics.quartiles([1, 2, 3, 4, nan]) == (2, 3, 4)
    assert metrics.quartiles([1, 2, nan, nan]) == (1.75, math.inf, math.inf)
    assert all(map(math.isnan, metrics.quartiles([])))


def test_success_needs_both() -> None:
    assert metrics.is_success(0.49, 0.099)
    assert not metrics.is_success(0.5, 0.05)
    assert not metrics.is_success(0.1, 0.1)
    assert not metrics.is_success(math.nan, math.nan)


def test_summary_counts() -> None:
    rng = np.random.default_rng(3)
    trials = []
    for scenario in "st":
        for method, scale in (("good", 0.2), ("bad", 2.0)):
            errors = rng.exponential(scale, 11)
            trials += [
                trial(
                    method,
                    e,
                    e / 10,
                    scenario=scenario,
                    converged=bool(e < 0.5),
                    degenerate=i == 0,
                    sigma_distance=3 * e,
                    seconds=float(i),
                )
                for i, e in enumerate(errors)
            ]
    trials.append(trial("bad", math.nan, math.nan, scenario="t"))
    rows = metrics.summarise(trials)
    order = [(s, m) for s in ("s", "t", "all") for m in ("good", "bad")]
    assert [(r.scenario, r.method) for r in rows] == order
    for row in rows:
        mine = [t for t in trials if t.method == row.method and row.scenario in (t.scenario, "all")]
        made = [t for t in mine if not t.failed]
        assert row.trials == len(mine)
        assert row.failed == len(mine) - len(made)
        assert row.successes == sum(t.rotation_error_deg < 0.5 for t in made)
        assert row.success_rate == row.successes / len(mine)
        assert row.converged == sum(t.converged for t in made)
        assert row.degenerate == len({t.scenario for t in made})
        if row.failed == 0:
            median = statistics.median(t.rotation_error_deg for t in mine)
            assert row.rotation_deg.median == pytest.approx(median)
            assert row.sigma_distance == pytest.approx(3 * median)
        assert row.groundtruth.rotation_deg == pytest.approx(0.2)
    failed = rows[3]
    made = [t.rotation_error_deg for t in trials if t.scenario == "t" and t.method == "bad"]
    ranked = sorted(math.inf if math.isnan(error) else error for error in made)
    assert failed.rotation_deg.median == pytest.approx((ranked[5] + ranked[6]) / 2)


def test_methods_closer_than_the_ground_truth_are_not_ranked() -> None:
    trials = [trial("a", 0.10, 0.020), trial("b", 0.25, 0.045), trial("c", math.nan, math.nan)]
    rows = metrics.summarise(trials)
    a, _, c = rows
    assert not_ranked(a, rows, "rotation_deg") == ["b"]
    assert not_ranked(a, rows, "translation_m") == []
    assert not_ranked(c, rows, "rotation_deg") == []
    text = verdicts(compare(trials[:2]))
    assert "not ranked" in text[0] and "0.150 deg" in text[0] and "0.200 deg" in text[0]
    assert "a has the smaller median by 0.025 m" in text[1]
    assert (
        "a has the smaller median (the other fails)" in verdicts(compare([trials[0], trials[2]]))[0]
    )


def test_nothing_is_ranked_without_a_known_uncertainty() -> None:
    unknown = {"groundtruth_rotation_sigma_deg": math.nan, "sigma_distance": math.nan}
    trials = [trial("a", 0.1, 0.02, **unknown), trial("b", 9.0, 0.02, **unknown)]
    rows = metrics.summarise(trials)
    assert not_ranked(rows[0], rows, "rotation_deg") == ["b"]
    assert math.isnan(rows[0].sigma_distance)
    assert "no known uncertainty" in verdicts(compare(trials))[0]


def test_runs_are_not_mixed() -> None:
    first = trial("a", 0.1, 0.02)
    rows = metrics.summarise([first, dataclasses.replace(first, run="q", rotation_error_deg=3.0)])
    assert [(r.run, r.rotation_deg.median) for r in rows] == [("q", 3.0), ("r", 0.1)]


def test_what_the_ground_truth_explains_is_not_held_against_a_method() -> None:
    from scipy.stats import chi

    assert pytest.approx(chi(6).ppf(0.95), abs=0.005) == metrics.EXPLAINED_SIGMA
    converged = {"converged": True}
    trials = [
        trial("a", 0.6, 0.02, sigma_distance=2.0, **converged),  # no success, explained
        trial("a", 0.6, 0.02, sigma_distance=9.0, **converged),  # a wrong one without a warning
        trial("a", 0.6, 0.02, sigma_distance=9.0),  # with a warning
        trial("a", 0.1, 0.02, sigma_distance=9.0, **converged),  # a success, not exact
        trial("a", math.nan, math.nan, sigma_distance=math.nan),
    ]
    (row,) = metrics.summarise(trials)
    assert (row.successes, row.explained, row.converged, row.misled) == (1, 1, 3, 1)
    assert row.explained_rate == 0.2
    unknown = trial("a", 0.1, 0.02, groundtruth_rotation_sigma_deg=math.nan)
    assert math.isnan(metrics.summarise([unknown])[0].explained_rate)
