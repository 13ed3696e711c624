"""How often 95 % intervals hold, and how often a test raises a false alarm, on simulated trials.

    python benchmarks/intervals.py

Trials of one pair differ little (0.3 of the deviation between pairs), as those of a method that
ends at one estimate from most initial guesses do. Each line has what lcdata does, which counts
pairs, and the textbook's, which counts trials.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from scipy.stats import wilcoxon

from lcdata.evaluation.statistics import median_interval, rate_interval, signed_rank

ROUNDS = 1000
WITHIN = 0.3


def share(outcome: Callable[[int], bool]) -> str:
    return f"{100 * np.mean([outcome(seed) for seed in range(ROUNDS)]):5.1f} %"


def values(seed: int, pairs: int, trials: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return np.repeat(rng.normal(size=pairs), trials) + WITHIN * rng.normal(size=pairs * trials)


def outcomes(seed: int, pairs: int, trials: int, rate: float) -> np.ndarray:
    """Trials of a pair agree, but for one in five."""
    rng = np.random.default_rng(seed)
    of_pair = np.repeat(rng.random(pairs) < rate, trials)
    own = rng.random(pairs * trials) < rate
    return np.where(rng.random(pairs * trials) < 0.8, of_pair, own)


def inside(interval: tuple[float, float], truth: float) -> bool:
    return interval[0] <= truth <= interval[1]


def main() -> None:
    print(f"{Path(__file__).name}: {ROUNDS} rounds each; 95 % intervals should hold in 95 %")
    for pairs, trials in ((6, 1), (12, 1), (24, 1), (12, 5), (24, 5)):
        units, alone = np.repeat(np.arange(pairs), trials).tolist(), range(pairs * trials)
        ours = share(
            lambda s, p=pairs, t=trials, u=units: inside(
                median_interval(values(s, p, t), u, seed=s), 0.0
            )
        )
        naive = share(
            lambda s, p=pairs, t=trials, a=alone: inside(
                median_interval(values(s, p, t), a, seed=s), 0.0
            )
        )
        print(f"median interval  {pairs:3} pairs x {trials} trials  {ours}   by trials {naive}")
    for pairs, trials, rate in ((20, 1, 0.9), (20, 4, 0.5), (20, 4, 0.9), (50, 4, 0.9)):
        units, alone = np.repeat(np.arange(pairs), trials).tolist(), range(pairs * trials)
        ours = share(
            lambda s, p=pairs, t=trials, r=rate, u=units: inside(
                rate_interval(outcomes(s, p, t, r), u), r
            )
        )
        naive = share(
            lambda s, p=pairs, t=trials, r=rate, a=alone: inside(
                rate_interval(outcomes(s, p, t, r), a), r
            )
        )
        print(
            f"rate {100 * rate:.0f} %        {pairs:3} pairs x {trials} trials  {ours}   "
            f"by trials {naive}"
        )
    print("false alarms of the signed rank test; 5 % are allowed")
    for pairs, trials in ((12, 1), (12, 5), (24, 5)):
        units = np.repeat(np.arange(pairs), trials).tolist()
        ours = share(lambda s, p=pairs, t=trials, u=units: signed_rank(values(s, p, t), u) < 0.05)
        naive = share(lambda s, p=pairs, t=trials: wilcoxon(values(s, p, t)).pvalue < 0.05)
        print(f"signed rank      {pairs:3} pairs x {trials} trials  {ours}   by trials {naive}")
    for count in (600, 10_000):
        sample = np.random.default_rng(0).random(count)
        start = time.process_time()
        median_interval(sample, range(count))
        print(f"one interval of the median of {count} pairs: {time.process_time() - start:.2f} s")


if __name__ == "__main__":
    main()
