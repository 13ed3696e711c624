"""How wrong an estimate is, how much of that the ground truth itself may be, and summaries."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from lcdata.evaluation.statistics import UNKNOWN, Interval, median_interval, rate_interval
from lcdata.geometry import se3
from lcdata.groundtruth.budget import variances

if TYPE_CHECKING:
    from lcdata.evaluation.results import TrialResult

SUCCESS_ROTATION_DEG = 0.5
SUCCESS_TRANSLATION_M = 0.1
"""A trial succeeds if both its errors are below these."""

EXPLAINED_SIGMA = 3.55
"""95 % of exactly right estimates are nearer to the ground truth than this: the square root of
the chi-squared distribution's quantile with 6 degrees of freedom."""

ALL_SCENARIOS = "all"
"""What the summary over every scenario is called."""


def rotation_error_deg(T_estimate: ArrayLike, T_reference: ArrayLike) -> float:
    """Geodesic angle between two rotations, degrees."""
    return math.degrees(se3.rotation_error(T_estimate, T_reference))


def translation_error_m(T_estimate: ArrayLike, T_reference: ArrayLike) -> float:
    """L2 norm of the difference of two translations, metres."""
    return se3.translation_error(T_estimate, T_reference)


def is_success(rotation_deg: float, translation_m: float) -> bool:
    """Whether errors are below 0.5 deg and 0.1 m; NaN (no estimate) is not."""
    return rotation_deg < SUCCESS_ROTATION_DEG and translation_m < SUCCESS_TRANSLATION_M


class Sigma(NamedTuple):
    """Root mean square error that the ground truth itself may have; NaN where unknown."""

    rotation_deg: float
    translation_m: float


def groundtruth_sigma(T_reference: ArrayLike, covariance: ArrayLike | None) -> Sigma:
    """The two error norms that a perfect estimate is expected to have (root mean square).

    Args:
        T_reference: 4x4 ground truth.
        covariance: 6x6, translation then rotation; None or NaN where unknown.
    """
    if covariance is None or not np.isfinite(np.asarray(covariance, float)).all():
        return Sigma(math.nan, math.nan)
    translation, rotation = variances(T_reference, covariance)
    return Sigma(math.degrees(math.sqrt(max(0.0, rotation))), math.sqrt(max(0.0, translation)))


class Quartiles(NamedTuple):
    """25 %, 50 % and 75 % of a sample; infinite where that many trials gave no estimate."""

    q1: float
    median: float
    q3: float


def quartiles(values: Iterable[float]) -> Quartiles:
    """Quartiles in which a missing value (NaN: a failed trial) counts as infinitely wrong.

    Dropping failures would make the method that fails on every hard pair look the best.

    Returns:
        Linear interpolation between order statistics; NaN for an empty sample.
    """
    sample = np.array(list(values), float)
    if not sample.size:
        return Quartiles(math.nan, math.nan, math.nan)
    huge = 1e30  # in place of infinity, for inf - inf has no value
    sample[~np.isfinite(sample)] = huge
    q = np.quantile(sample, [0.25, 0.5, 0.75])
    return Quartiles(*(math.inf if value > 1e20 else float(value) for value in q))


@dataclass(frozen=True)
class Summary:
    """Trials of one method in one scenario, or in all of them.

    Args:
        run: Name of the run.
        scenario: Name of the scenario, or `ALL_SCENARIOS`.
        method: Name of the method.
        trials: Number of trials.
        failed: Trials that gave no estimate: an error was raised or the process died.
        successes: Trials below 0.5 deg and 0.1 m.
        converged: Trials whose method calls its estimate usable.
        misled: Converged trials that are no success, by more than the ground truth's own
            uncertainty explains: errors without a warning.
        explained: Trials that the ground truth cannot tell from exactly right ones.
        degenerate: Trials whose method says that the data do not determine the extrinsic.
        rotation_deg: Quartiles of the rotation error.
        translation_m: Quartiles of the translation error.
        sigma_distance: Median distance in ground-truth standard deviations; NaN if unknown.
        seconds: Median time of one calibration, features included.
        groundtruth: Root mean square uncertainty of the ground truth of these trials.
        success_interval: 95 % confidence interval of the success rate.
        rotation_deg_interval: The same of the median rotation error.
        translation_m_interval: The same of the median translation error.
    """

    run: str
    scenario: str
    method: str
    trials: int
    failed: int
    successes: int
    converged: int
    misled: int
    explained: int
    degenerate: int
    rotation_deg: Quartiles
    translation_m: Quartiles
    sigma_distance: float
    seconds: float
    groundtruth: Sigma
    success_interval: Interval = UNKNOWN
    rotation_deg_interval: Interval = UNKNOWN
    translation_m_interval: Interval = UNKNOWN

    @property
    def explained_rate(self) -> float:
        """Share of all trials that may be exactly right; NaN where that cannot be known."""
        unknown = math.isnan(self.groundtruth.rotation_deg) or not self.trials
        return math.nan if unknown else self.explained / self.trials

    @property
    def success_rate(self) -> float:
        """Share of all trials that succeeded."""
        return self.successes / self.trials if self.trials else math.nan


def summarise(trials: Sequence[TrialResult]) -> list[Summary]:
    """One summary a run, scenario and method, then over all scenarios if there are several.

    Rows come in the order: run, scenario (all last), method in order of first appearance.
    """
    summaries = []
    for run in sorted({t.run for t in trials}):
        of_run = [t for t in trials if t.run == run]
        methods = list(dict.fromkeys(t.method for t in of_run))
        scenarios = sorted({t.scenario for t in of_run})
        for scenario in [*scenarios, *([ALL_SCENARIOS] if len(scenarios) > 1 else [])]:
            here = [t for t in of_run if scenario in (t.scenario, ALL_SCENARIOS)]
            for method in methods:
                if chosen := [t for t in here if t.method == method]:
                    summaries.append(_summarise(run, scenario, method, chosen))
    return summaries


def _summarise(run: str, scenario: str, method: str, trials: Sequence[TrialResult]) -> Summary:
    distances = [t.sigma_distance for t in trials]
    units = [t.pair_ids for t in trials]
    rotations, translations = errors(trials, "rotation_deg"), errors(trials, "translation_m")
    known = any(math.isfinite(t.groundtruth_rotation_sigma_deg) for t in trials)
    return Summary(
        run=run,
        scenario=scenario,
        method=method,
        trials=len(trials),
        failed=sum(t.failed for t in trials),
        successes=sum(t.success for t in trials),
        converged=sum(t.converged for t in trials),
        misled=sum(t.converged and not (t.success or is_explained(t)) for t in trials),
        explained=sum(is_explained(t) for t in trials),
        degenerate=sum(t.degenerate for t in trials),
        rotation_deg=quartiles(rotations),
        translation_m=quartiles(translations),
        sigma_distance=quartiles(distances).median if known else math.nan,
        seconds=quartiles(t.seconds for t in trials).median,
        groundtruth=Sigma(
            rms([t.groundtruth_rotation_sigma_deg for t in trials]),
            rms([t.groundtruth_translation_sigma_m for t in trials]),
        ),
        success_interval=rate_interval((t.success for t in trials), units),
        rotation_deg_interval=median_interval(rotations, units),
        translation_m_interval=median_interval(translations, units),
    )


def errors(trials: Iterable[TrialResult], quantity: str) -> list[float]:
    """Errors of trials, infinite where there is no estimate.

    Args:
        trials: The trials.
        quantity: "rotation_deg" or "translation_m".
    """
    kind, _, unit = quantity.partition("_")
    found = (float(getattr(t, f"{kind}_error_{unit}")) for t in trials)
    return [error if math.isfinite(error) else math.inf for error in found]


def rms(values: Sequence[float]) -> float:
    """Root mean square; NaN if any value is unknown."""
    return float(np.sqrt(np.mean(np.square(values)))) if values else math.nan


def is_explained(trial: TrialResult) -> bool:
    """Whether the ground truth's own uncertainty explains an error; never where it is unknown."""
    return trial.sigma_distance <= EXPLAINED_SIGMA


def indistinguishable(a: float, b: float, sigma: float) -> bool:
    """Whether two median errors differ by less than the ground truth's own uncertainty.

    Where that uncertainty is unknown nothing can be ranked. Two methods of which neither has
    an estimate are not ranked either.
    """
    if math.isinf(a) and math.isinf(b):
        return True
    return not abs(a - b) >= sigma
