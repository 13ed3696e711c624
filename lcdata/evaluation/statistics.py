"""How far a finite number of trials pins down a rate, a median, a difference of two methods.

Trials on the same pair are not independent: they see the same image and cloud, and mostly end at
the same estimate. So pairs are what is resampled and counted here (the *unit* of each trial; a
group of pairs that was solved jointly is one unit), and a hundred initial guesses on one pair do
not pass for a hundred pairs. Where each unit has one trial all this is the textbook's.
"""

from __future__ import annotations

import math
from collections.abc import Hashable, Iterable, Sequence
from statistics import NormalDist
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

CONFIDENCE = 0.95
"""Of all intervals."""

RESAMPLES = 2000

FEWEST_UNITS = 6
"""Of fewer than this many independent values no interval of their median has 95 % (the widest,
from the smallest to the largest of n, has 1 - 2^(1-n)), and no signed rank test has p < 0.05."""

CHUNK = 4_000_000
"""Numbers that a bootstrap holds at a time."""


class Interval(NamedTuple):
    """95 % confidence interval; NaN where there are too few pairs for one."""

    low: float
    high: float


UNKNOWN = Interval(math.nan, math.nan)


def wilson(successes: float, trials: float) -> Interval:
    """Score interval of a rate (Wilson 1927): never below 0 or above 1, and no point at 100 %.

    Args:
        successes: Number of them.
        trials: Independent trials; need not be whole (see `rate_interval`).
    """
    if not trials > 0:
        return UNKNOWN
    z = NormalDist().inv_cdf(0.5 + CONFIDENCE / 2)
    rate = successes / trials
    middle = rate + z * z / (2 * trials)
    half = z * math.sqrt(rate * (1 - rate) / trials + (z / (2 * trials)) ** 2)
    scale = 1 + z * z / trials
    return Interval(max(0.0, (middle - half) / scale), min(1.0, (middle + half) / scale))


def rate_interval(outcomes: Iterable[bool], units: Sequence[Hashable]) -> Interval:
    """Wilson's interval of a rate over trials of which several may share a unit.

    Args:
        outcomes: Whether each trial succeeded.
        units: Unit of each trial.
    """
    made, (owner, count) = np.array(list(outcomes), float), _owners(units)
    if not made.size:
        return UNKNOWN
    effective = made.size / design_effect(made, owner, count)
    return wilson(float(made.mean()) * effective, effective)


def design_effect(outcomes: Array, owner: NDArray[np.int64], count: int) -> float:
    """How many trials weigh as much as one independent trial (Rao and Scott 1992).

    The variance of the rate between units over that of independent trials; at least 1. Where all
    trials agree nothing shows that those of one unit are independent, and they count as one.

    Args:
        outcomes: (N,) 1 for success, else 0.
        owner: (N,) number of each trial's unit.
        count: Number of units.
    """
    sizes = np.bincount(owner, minlength=count)
    most = float((sizes**2).sum() / sizes.sum())  # as if each unit were one trial
    rate = float(outcomes.mean())
    if count == 1 or rate in {0.0, 1.0} or most == 1:
        return most
    apart = np.bincount(owner, outcomes, count) - rate * sizes
    variance = count / (count - 1) * float((apart**2).sum()) / outcomes.size**2
    return min(most, max(1.0, outcomes.size * variance / (rate * (1 - rate))))


def median_interval(
    values: Iterable[float], units: Sequence[Hashable], *, seed: int = 0
) -> Interval:
    """Percentile bootstrap of a median: units are drawn with replacement, with all their values.

    Args:
        values: Infinite ones are allowed: a failed trial is infinitely wrong.
        units: Unit of each value.
        seed: Same seed, same interval.

    Returns:
        `UNKNOWN` for fewer than `FEWEST_UNITS` units.
    """
    sample, (owner, count) = np.array(list(values), float), _owners(units)
    if count < FEWEST_UNITS:
        return UNKNOWN
    order = np.argsort(sample, kind="stable")
    sample, owner = sample[order], owner[order]
    rng = np.random.default_rng(seed)
    medians, left = [], RESAMPLES
    while left:
        size = max(1, min(left, CHUNK // sample.size))
        medians.append(_resampled_medians(sample, owner, count, size, rng))
        left -= size
    ends = np.sort(np.concatenate(medians))
    cut = int((1 - CONFIDENCE) / 2 * RESAMPLES)
    return Interval(float(ends[cut]), float(ends[-1 - cut]))


def _resampled_medians(
    sample: Array, owner: NDArray[np.int64], count: int, size: int, rng: np.random.Generator
) -> Array:
    """(size,) medians of resamples, by how often each sorted value is in them."""
    drawn = rng.integers(count, size=(size, count)) + count * np.arange(size)[:, None]
    times = np.bincount(drawn.ravel(), minlength=size * count).reshape(size, count)
    parts = np.array_split(np.arange(sample.size), max(1, math.isqrt(sample.size)))
    each = [np.bincount(owner[part], minlength=count).astype(float) for part in parts]
    before: Array = np.cumsum(
        times.astype(float) @ np.stack(each, axis=1), axis=1
    )  # values up to the end of each part
    total = before[:, -1]
    low, high = ((total - 1) // 2, total // 2)  # two places in the middle, from zero
    below = _at(sample, owner, times, parts, before, low)
    above = _at(sample, owner, times, parts, before, high)
    with np.errstate(invalid="ignore"):
        middle: Array = (below + above) / 2
    middle[np.isnan(middle)] = 0.0  # between -inf and inf: even
    return middle


def _at(
    sample: Array,
    owner: NDArray[np.int64],
    times: NDArray[np.int64],
    parts: Sequence[NDArray[np.int64]],
    before: Array,
    place: Array,
) -> Array:
    """(R,) the value at a place of each resample: find its part first, then look only there.

    Args:
        sample: (N,) sorted values.
        owner: (N,) number of each value's unit.
        times: (R, units) how often each unit is in each resample.
        parts: Rows of `sample`, cut into consecutive parts.
        before: (R, parts) number of resampled values up to the end of each part.
        place: (R,) places, from zero.
    """
    found = np.empty(len(times))
    part_of = np.argmax(before > place[:, None], axis=1)
    for k in np.unique(part_of):
        rows, part = np.flatnonzero(part_of == k), parts[k]
        start = before[rows, k - 1] if k else np.zeros(len(rows))
        counted = start[:, None] + np.cumsum(times[np.ix_(rows, owner[part])], axis=1)
        found[rows] = sample[part[np.argmax(counted > place[rows, None], axis=1)]]
    return found


def signed_rank(differences: Iterable[float], units: Sequence[Hashable]) -> float:
    """Wilcoxon's signed rank test that paired differences are as often above zero as below.

    Each unit counts once, with the median of its differences. Infinite ones (one method failed)
    are larger than all others; zeros (both failed, say) speak for neither side.

    Returns:
        p of the two-sided test; 1 where there is nothing to test.
    """
    finite = _finite(np.array(list(differences), float))
    owner, count = _owners(units)
    if not count:
        return 1.0
    ranked = finite[np.lexsort((finite, owner))]  # unit by unit, each from small to large
    sizes = np.bincount(owner, minlength=count)
    starts = np.cumsum(sizes) - sizes
    each = (ranked[starts + (sizes - 1) // 2] + ranked[starts + sizes // 2]) / 2
    each = each[each != 0]
    if not each.size:
        return 1.0
    from scipy.stats import wilcoxon

    return float(wilcoxon(each).pvalue)


def _finite(differences: Array) -> Array:
    """Differences with infinite ones replaced by ones beyond all others."""
    known = np.abs(differences[np.isfinite(differences)])
    beyond = 2 * known.max(initial=0.0) + 1
    return np.clip(differences, -beyond, beyond)


def holm(p: Sequence[float]) -> list[float]:
    """p-values of several tests such that one in 20 families, not tests, is wrong (Holm 1979)."""
    order = np.argsort(p, kind="stable")
    corrected, highest = [math.nan] * len(p), 0.0
    for rank, i in enumerate(order):
        highest = max(highest, min(1.0, (len(p) - rank) * p[i]))
        corrected[i] = highest
    return corrected


def _owners(units: Sequence[Hashable]) -> tuple[NDArray[np.int64], int]:
    """(N,) number of each value's unit, and how many units there are."""
    numbers: dict[Hashable, int] = {}
    owner = [numbers.setdefault(unit, len(numbers)) for unit in units]
    return np.array(owner, np.int64), len(numbers)
