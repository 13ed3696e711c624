"""Two methods on the same trials: which one is better, and whether that can be said at all."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import KeysView, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

from lcdata.evaluation import metrics
from lcdata.evaluation.statistics import (
    CONFIDENCE,
    FEWEST_UNITS,
    Interval,
    holm,
    median_interval,
    signed_rank,
)

if TYPE_CHECKING:
    from lcdata.evaluation.results import TrialResult

QUANTITIES = {"rotation_deg": "deg", "translation_m": "m"}
"""What is compared, and its unit."""

Place = tuple[tuple[str, ...], int]
"""Pairs and number of the trial: where two methods start from the same guess."""


@dataclass(frozen=True)
class Comparison:
    """Two methods, by one error, on the trials that both have made.

    A failed trial is infinitely wrong: it loses against any estimate, and is even with another
    failure.

    Args:
        run: Name of the run.
        scenario: Name of the scenario, or `ALL_SCENARIOS`.
        quantity: One of `QUANTITIES`.
        first: Name of one method.
        second: Name of the other one.
        trials: Trials that both have made.
        units: Pairs, or groups of pairs that were solved jointly, among these.
        left_out: Trials that only one of them has made.
        first_smaller: Trials in which the first one's error is smaller.
        second_smaller: Trials in which the second one's is.
        first_failed: Trials in which the first one gave no estimate.
        second_failed: Trials in which the second one gave none.
        medians: Median error of each of them in these trials.
        difference: Median of first minus second, trial by trial.
        difference_interval: Its 95 % confidence interval.
        p: Of Wilcoxon's signed rank test.
        p_corrected: The same, corrected (Holm) for all comparisons of the run and scenario.
        sigma: The ground truth's own uncertainty (root mean square) in these trials.
    """

    run: str
    scenario: str
    quantity: str
    first: str
    second: str
    trials: int
    units: int
    left_out: int
    first_smaller: int
    second_smaller: int
    first_failed: int
    second_failed: int
    medians: tuple[float, float]
    difference: float
    difference_interval: Interval
    p: float
    p_corrected: float
    sigma: float

    @property
    def equal(self) -> int:
        """Trials in which both have the same error, or none has an estimate."""
        return self.trials - self.first_smaller - self.second_smaller

    @property
    def significant(self) -> bool:
        """Whether chance alone would hardly give such differences."""
        return self.p_corrected < 1 - CONFIDENCE

    @property
    def indistinguishable(self) -> bool:
        """Whether the ground truth cannot tell them apart, or has no known uncertainty."""
        apart = metrics.indistinguishable(*self.medians, self.sigma)
        return apart or not abs(self.difference) >= self.sigma

    @property
    def smaller(self) -> str:
        """The method with the smaller errors, as the sample has it; empty for neither."""
        by_median = np.sign(self.medians[0] - self.medians[1]) if any(self._finite) else 0
        if self.difference == 0 or by_median != np.sign(self.difference):
            return ""
        return self.first if self.difference < 0 else self.second

    @property
    def better(self) -> str:
        """The method that is better; empty where neither chance nor ground truth let one say so."""
        return self.smaller if self.significant and not self.indistinguishable else ""

    @property
    def too_few(self) -> bool:
        """Whether no differences whatever could have been significant."""
        return self.units < FEWEST_UNITS

    @property
    def _finite(self) -> list[bool]:
        return [math.isfinite(median) for median in self.medians]


def compare(trials: Sequence[TrialResult]) -> list[Comparison]:
    """Each two methods of each run, scenario by scenario, then over all of them if several."""
    found = []
    for run in sorted({t.run for t in trials}):
        of_run = [t for t in trials if t.run == run]
        scenarios = sorted({t.scenario for t in of_run})
        for scenario in [*scenarios, *([metrics.ALL_SCENARIOS] if len(scenarios) > 1 else [])]:
            here = [t for t in of_run if scenario in (t.scenario, metrics.ALL_SCENARIOS)]
            found += _corrected(_pairwise(run, scenario, here))
    return found


@dataclass(frozen=True)
class _Made:
    """Trials of one method, by place: errors by quantity, and the ground truth's uncertainty."""

    errors: dict[str, dict[Place, float]]
    sigmas: dict[str, dict[Place, float]]

    @classmethod
    def of(cls, trials: Sequence[TrialResult]) -> _Made:
        errors, sigmas = {}, {}
        places = [(t.pair_ids, t.trial) for t in trials]
        for quantity in QUANTITIES:
            kind, _, unit = quantity.partition("_")
            name = f"groundtruth_{kind}_sigma_{unit}"
            errors[quantity] = dict(zip(places, metrics.errors(trials, quantity), strict=True))
            found = (float(getattr(t, name)) for t in trials)
            sigmas[quantity] = dict(zip(places, found, strict=True))
        return cls(errors, sigmas)

    @property
    def places(self) -> KeysView[Place]:
        """Where it has made trials."""
        return next(iter(self.errors.values())).keys()


def _pairwise(run: str, scenario: str, trials: Sequence[TrialResult]) -> list[Comparison]:
    of_method: dict[str, list[TrialResult]] = {}
    for t in trials:
        of_method.setdefault(t.method, []).append(t)
    made = {method: _Made.of(mine) for method, mine in of_method.items()}
    found = []
    for first, second in combinations(made, 2):
        places = [place for place in made[first].places if place in made[second].places]
        if places:
            found += [
                _compared(run, scenario, quantity, (first, second), made, places)
                for quantity in QUANTITIES
            ]
    return found


def _compared(
    run: str,
    scenario: str,
    quantity: str,
    methods: tuple[str, str],
    made: dict[str, _Made],
    places: Sequence[Place],
) -> Comparison:
    a, b = (made[method] for method in methods)
    numbers: dict[tuple[str, ...], int] = {}
    units = [numbers.setdefault(pair_ids, len(numbers)) for pair_ids, _ in places]
    firsts = [a.errors[quantity][place] for place in places]
    seconds = [b.errors[quantity][place] for place in places]
    differences = [0.0 if x == y else x - y for x, y in zip(firsts, seconds, strict=True)]
    return Comparison(
        run=run,
        scenario=scenario,
        quantity=quantity,
        first=methods[0],
        second=methods[1],
        trials=len(places),
        units=len(numbers),
        left_out=len(a.places ^ b.places),
        first_smaller=sum(d < 0 for d in differences),
        second_smaller=sum(d > 0 for d in differences),
        first_failed=sum(map(math.isinf, firsts)),
        second_failed=sum(map(math.isinf, seconds)),
        medians=(metrics.quartiles(firsts).median, metrics.quartiles(seconds).median),
        difference=_median(differences),
        difference_interval=median_interval(differences, units),
        p=(p := signed_rank(differences, units)),
        p_corrected=p,
        sigma=metrics.rms([a.sigmas[quantity][place] for place in places]),
    )


def _median(values: Sequence[float]) -> float:
    """Median of values of which some are infinite; between both infinities it is zero."""
    ranked = sorted(values)
    middle = (ranked[(len(values) - 1) // 2] + ranked[len(values) // 2]) / 2
    return 0.0 if math.isnan(middle) else middle


def _corrected(comparisons: Sequence[Comparison]) -> list[Comparison]:
    corrected = holm([c.p for c in comparisons])
    return [
        dataclasses.replace(c, p_corrected=p) for c, p in zip(comparisons, corrected, strict=True)
    ]
