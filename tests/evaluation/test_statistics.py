from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from lcdata.evaluation.statistics import (
    FEWEST_UNITS,
    RESAMPLES,
    holm,
    median_interval,
    rate_interval,
    signed_rank,
    wilson,
)


@given(st.integers(1, 500), st.floats(0, 1))
def test_wilson_against_scipy(trials: int, share: float) -> None:
    successes = round(share * trials)
    expected = stats.binomtest(successes, trials).proportion_ci(method="wilson")
    assert wilson(successes, trials) == pytest.approx((expected.low, expected.high), abs=1e-9)
    outcomes = [True] * successes + [False] * (trials - successes)
    assert rate_interval(outcomes, range(trials)) == pytest.approx(wilson(successes, trials))


def test_no_trials_no_interval() -> None:
    for interval in (wilson(0, 0), rate_interval([], []), median_interval([], [])):
        assert math.isnan(interval.low) and math.isnan(interval.high)


def test_repeating_a_trial_on_a_pair_proves_nothing() -> None:
    outcomes, units = [True] * 7 + [False] * 3, list(range(10))
    once = rate_interval(outcomes, units)
    often = rate_interval(outcomes * 5, units * 5)
    assert often == pytest.approx(once, abs=1e-9)
    values = np.random.default_rng(0).exponential(size=10)
    assert median_interval(values, units) == median_interval(np.tile(values, 5), units * 5)
    assert signed_rank(values, units) == signed_rank(np.tile(values, 5), units * 5)
    # one pair a hundred times is one pair, all right or not
    assert rate_interval([True] * 100, [0] * 100) == pytest.approx(wilson(1, 1))
    assert rate_interval([True] * 60 + [False] * 40, [0] * 100) == pytest.approx(wilson(0.6, 1))


def test_the_median_of_an_odd_sample_in_closed_form() -> None:
    """P(median of a resample <= x_k) = P(more than half of n draws are among the first k)."""
    n, values = 15, np.sort(np.random.default_rng(1).exponential(size=15))
    below = stats.binom.sf(n // 2, n, np.arange(1, n + 1) / n)
    low, high = median_interval(values, range(n))
    # the sampled quantile lies where the exact distribution passes 2.5 %, give or take its noise
    for end, level in ((low, 0.025), (high, 0.975)):
        k = int(np.flatnonzero(values == end)[0])
        before = below[k - 1] if k else 0.0
        assert before - 0.012 <= level <= below[k] + 0.012
    expected = stats.bootstrap(
        (values,), np.median, method="percentile", n_resamples=4000, rng=np.random.default_rng(0)
    ).confidence_interval
    assert (low, high) == pytest.approx(tuple(expected), abs=0.15)


def test_same_seed_same_interval_and_order_does_not_matter() -> None:
    values = np.random.default_rng(2).exponential(size=40)
    first = median_interval(values, range(40), seed=3)
    assert first == median_interval(values, range(40), seed=3)
    assert first.low < np.median(values) < first.high


def test_failures_are_infinite_in_medians_and_never_dropped() -> None:
    values = [0.1] * 6 + [math.inf] * 4
    low, high = median_interval(values, range(10))
    assert low == 0.1 and high == math.inf
    assert median_interval([math.inf] * 8, range(8)) == (math.inf, math.inf)
    assert all(map(math.isnan, median_interval([1.0] * 50, [0] * 50)))
    few = median_interval(np.arange(FEWEST_UNITS - 1.0), range(FEWEST_UNITS - 1))
    assert all(map(math.isnan, few))
    both = median_interval([-math.inf] * 4 + [math.inf] * 4, range(8))
    assert both == (-math.inf, math.inf)


def test_coverage_where_trials_share_a_pair() -> None:
    """24 pairs of 5 trials that hardly differ: as independent trials the interval holds in 60 %."""
    rng, hits, naive, rounds = np.random.default_rng(4), 0, 0, 120
    units = np.repeat(np.arange(24), 5).tolist()
    for seed in range(rounds):
        values = np.repeat(rng.normal(size=24), 5) + 0.3 * rng.normal(size=120)
        low, high = median_interval(values, units, seed=seed)
        hits += low <= 0 <= high
        low, high = median_interval(values, range(120), seed=seed)
        naive += low <= 0 <= high
    assert hits / rounds > 0.88 and naive / rounds < 0.75


def test_coverage_of_a_rate_where_trials_share_a_pair() -> None:
    rng, hits, naive, rounds = np.random.default_rng(5), 0, 0, 400
    units = np.repeat(np.arange(20), 4).tolist()
    for _ in range(rounds):
        of_pair = np.repeat(rng.random(20) < 0.5, 4)
        outcomes = np.where(rng.random(80) < 0.8, of_pair, rng.random(80) < 0.5)
        low, high = rate_interval(outcomes, units)
        hits += low <= 0.5 <= high
        low, high = rate_interval(outcomes, range(80))
        naive += low <= 0.5 <= high
    assert hits / rounds > 0.91 and naive / rounds < 0.85


def test_signed_rank_against_scipy() -> None:
    differences = np.random.default_rng(6).normal(0.3, 1, 30)
    assert signed_rank(differences, range(30)) == stats.wilcoxon(differences).pvalue
    assert signed_rank(np.arange(1, 7), range(6)) == pytest.approx(2 / 2**6)
    assert signed_rank([0.0] * 9, range(9)) == 1.0
    assert signed_rank([], []) == 1.0


def test_signed_rank_takes_failures_as_the_largest_differences() -> None:
    some = [-0.3, 0.2, 0.5, -0.1, 0.4, 0.6, 0.7]
    failing = signed_rank([*some, math.inf, math.inf], range(9))
    assert failing == pytest.approx(stats.wilcoxon([*some, 99, 99]).pvalue)
    assert failing < stats.wilcoxon(some).pvalue
    assert signed_rank([math.inf] * 8, range(8)) < 0.05
    assert signed_rank([math.inf, -math.inf] * 6, range(12)) == 1.0


def test_false_alarms_of_the_signed_rank_test_where_trials_share_a_pair() -> None:
    rng, alarms, naive, rounds = np.random.default_rng(7), 0, 0, 200
    units = np.repeat(np.arange(12), 5).tolist()
    for _ in range(rounds):
        values = np.repeat(rng.normal(size=12), 5) + 0.3 * rng.normal(size=60)
        alarms += signed_rank(values, units) < 0.05
        naive += stats.wilcoxon(values).pvalue < 0.05
    assert alarms / rounds < 0.1 and naive / rounds > 0.25


def test_holm_by_hand() -> None:
    assert holm([0.01, 0.04, 0.03, 0.005]) == pytest.approx([0.03, 0.06, 0.06, 0.02])
    assert holm([0.6, 0.7]) == [1.0, 1.0]
    assert holm([]) == []


def test_median_interval_is_that_of_medians_of_whole_resamples() -> None:
    """Ties, infinite values and units of different sizes; each resample written out."""
    rng = np.random.default_rng(3)
    units = [unit for unit in range(9) for _ in range(1 + unit % 4)]
    values = np.round(rng.lognormal(size=len(units)), 1)
    values[rng.random(len(units)) < 0.3] = np.inf
    of_unit = [values[np.array(units) == unit] for unit in range(9)]
    drawn = np.random.default_rng(0).integers(9, size=(RESAMPLES, 9))
    medians = np.sort([np.median(np.concatenate([of_unit[u] for u in row])) for row in drawn])
    cut = int(0.025 * RESAMPLES)
    assert median_interval(values, units) == (medians[cut], medians[-1 - cut])
