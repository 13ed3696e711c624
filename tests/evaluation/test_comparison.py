from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pytest
from scipy import stats
from test_metrics import trial

from lcdata.evaluation.comparison import Comparison, compare
from lcdata.evaluation.results import Results, TrialResult
from lcdata.evaluation.text import verdicts


def trials_of(method: str, errors: Sequence[float], scenario: str = "s") -> list[TrialResult]:
    """One trial a pair: rotation errors, and a tenth of them as translation errors in metres."""
    return [
        trial(method, e, e / 10, pair_ids=(f"{scenario}/pose_000/{i:03d}",), scenario=scenario)
        for i, e in enumerate(errors)
    ]


def rotation(comparisons: Sequence[Comparison]) -> Comparison:
    return next(c for c in comparisons if c.quantity == "rotation_deg")


def test_the_better_one_is_found_and_told() -> None:
    errors = np.random.default_rng(0).exponential(0.2, 20)
    trials = trials_of("a", errors) + trials_of("b", errors + 0.5)
    c = rotation(compare(trials))
    assert (c.trials, c.units, c.left_out, c.first_smaller, c.equal) == (20, 20, 0, 20, 0)
    assert c.difference == pytest.approx(-0.5)
    assert c.difference_interval == pytest.approx((-0.5, -0.5))
    assert c.p == pytest.approx(stats.wilcoxon(errors - (errors + 0.5)).pvalue, rel=1e-6)
    assert c.p_corrected == pytest.approx(2 * c.p)  # two errors are compared
    assert c.better == "a"
    (sentence, _) = verdicts(compare(trials))
    assert "a has the smaller median by 0.500 deg" in sentence
    assert "in 20 of 20 trials against b (p < 0.001)" in sentence
    assert rotation(compare(trials_of("b", errors + 0.5) + trials_of("a", errors))).better == "a"


def test_never_ranked_inside_the_ground_truths_uncertainty() -> None:
    errors = np.random.default_rng(1).exponential(0.2, 40)
    c = rotation(compare(trials_of("a", errors) + trials_of("b", errors + 0.1)))
    assert c.significant and c.p < 1e-6  # beyond all chance, but less than 0.2 deg
    assert c.indistinguishable and c.better == ""
    assert "less than the ground truth's own 0.200 deg" in verdicts([c])[0]


def test_medians_apart_but_trials_alike_are_not_ranked() -> None:
    """The medians differ by a gap in the sample while nearly every trial differs by little."""
    first = [0.1] * 10 + [1.0] + [2.0] * 10
    second = [0.15] * 10 + [1.9] + [2.05] * 10
    c = rotation(compare(trials_of("a", first) + trials_of("b", second)))
    assert abs(c.medians[0] - c.medians[1]) > c.sigma > abs(c.difference)
    assert c.better == "" and "trial by trial they differ by 0.050 deg" in verdicts([c])[0]


def test_what_chance_may_do_is_not_ranked() -> None:
    rng = np.random.default_rng(2)
    c = rotation(
        compare(
            trials_of("a", [0.3, 2, 0.1, 0.2, 4, 0.2, 3, 0.1])
            + trials_of("b", [3.0, 0.2, 1.2, 1.5, 0.3, 0.9, 0.1, 2.0])
        )
    )
    assert not c.significant and not c.indistinguishable and c.better == ""
    assert "chance may do that too" in verdicts([c])[0]
    few = rotation(compare(trials_of("a", rng.random(4)) + trials_of("b", rng.random(4) + 9)))
    assert few.too_few and few.better == ""
    assert "4 pairs or groups are too few" in verdicts([few])[0]


def test_failures_lose_and_are_counted() -> None:
    errors = [0.1 + 0.01 * i for i in range(12)]
    failing = [math.nan if i < 9 else e for i, e in enumerate(errors)]
    c = rotation(compare(trials_of("a", errors) + trials_of("b", failing)))
    assert (c.first_failed, c.second_failed, c.first_smaller, c.equal) == (0, 9, 9, 3)
    assert c.difference == -math.inf and c.better == "a"
    assert c.difference_interval.low == -math.inf
    both = rotation(compare(trials_of("a", failing) + trials_of("b", failing)))
    assert both.equal == 12 and both.p == 1 and both.better == ""
    assert (
        "no estimate in half of their trials or more (9 and 9 of 12 failed)" in verdicts([both])[0]
    )


def test_unknown_uncertainty_ranks_nothing() -> None:
    errors = np.linspace(0.1, 0.3, 20)
    trials = [
        trial(m, e + shift, e, pair_ids=(str(i),), groundtruth_rotation_sigma_deg=math.nan)
        for m, shift in (("a", 0.0), ("b", 5.0))
        for i, e in enumerate(errors)
    ]
    c = rotation(compare(trials))
    assert c.significant and c.better == ""
    assert "no known uncertainty" in verdicts([c])[0]


def test_only_trials_of_both_are_compared_and_others_are_counted() -> None:
    a, b = trials_of("a", [0.1] * 8), trials_of("b", [0.2] * 12)
    c = rotation(compare(a + b))
    assert (c.trials, c.left_out) == (8, 4)
    elsewhere = trials_of("b", [0.2] * 5, "t")
    assert [c.scenario for c in compare(a + elsewhere)] == []


def test_scenarios_runs_and_methods_each_have_their_comparisons() -> None:
    rng = np.random.default_rng(3)
    trials = [t for s in "st" for m in "abc" for t in trials_of(m, rng.random(7), s)]
    found = compare(trials)
    assert len(found) == 3 * 3 * 2
    assert [c.scenario for c in found] == ["s"] * 6 + ["t"] * 6 + ["all"] * 6
    assert found[-1].units == 14
    for i in range(0, 18, 6):  # the smallest p of a scenario is taken times six
        smallest = min(found[i : i + 6], key=lambda c: c.p)
        assert smallest.p_corrected == pytest.approx(min(1, 6 * smallest.p))
    plain = Results(tuple(trials)).to_dict()
    assert len(plain["comparisons"]) == 18 and plain["comparisons"][0]["first"] == "a"
    assert plain["summary"][0]["success_interval"][0] < plain["summary"][0]["success_rate"]
