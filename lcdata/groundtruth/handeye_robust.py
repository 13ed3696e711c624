"""The robust fit behind `handeye.solve`."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lcdata.groundtruth.handeye_input import Weights
from lcdata.groundtruth.handeye_problem import Problem, State, whitening
from lcdata.groundtruth.least_squares import minimise

Array = NDArray[np.float64]

MEDIAN_3, MEDIAN_6 = 1.538, 2.313
"""Medians of chi with 3 and 6 degrees of freedom: a residual's length in standard deviations."""

HUBER, CAUCHY = 3.0, 3.5
"""Lengths, in standard deviations, at which the losses begin to bend: 13 % and 6 % of good
residuals are longer."""

GATE = 4.74
"""Length that one good residual in a thousand exceeds (chi with 6 degrees of freedom)."""

FALSE_ALARM = 1e-3
"""Chance that any good pose at all is taken for wrong, however many there are."""

ENOUGH = 5
"""From so many poses on, residuals say which pose is wrong and how good the estimates are."""

USUAL_STD = (0.03, np.deg2rad(0.3))
"""Metres and radians of a line method on one pair, for fewer poses than that."""

MOST_TURNS = 8
"""Of choosing the good poses and solving with them; few settle in more than four."""

STD_FLOOR = 1e-9
"""Exact data must not make rounding errors into outliers."""

FAR = 10.0
"""Metres: no link is longer. Keeps the covariance finite where nothing determines it."""


@dataclass(frozen=True, eq=False)
class Fit:
    """Solution, covariance, and what became of each pose.

    Args:
        state: Links and offsets.
        covariance: (12 + extra, 12 + extra).
        inliers: (N,) bool.
        scale: Standard deviations of the residuals in units of the weights.
        left_out_steps: (N, 12 + extra) from the solution to the one without the pose.
    """

    state: State
    covariance: Array
    inliers: NDArray[np.bool_]
    scale: float
    left_out_steps: Array


def fit(problem: Problem, weights: Weights, state: State) -> Fit:
    """Solve from a start, with and then without the poses that do not fit."""
    enough = len(problem.T) >= ENOUGH
    noise = _Noise(problem, weights, enough)
    everyone = np.ones(len(problem.T), bool)
    for loss in (_huber,) * 3 + (_cauchy,) * 5 if enough else ():
        lengths = noise.update(state, everyone, robust=True)
        state = _minimise(problem, noise.whiten, loss(lengths), state, iterations=1)
    inliers = everyone
    for turn in range(MOST_TURNS):
        before, robust = noise.std, turn == 0  # at first the wrong ones are still in
        lengths = noise.update(state, inliers, robust=robust)
        if not robust:
            lengths = lengths * noise.without_own(state, inliers)
        within = lengths < _gate(len(lengths), int(inliers.sum())) if enough else everyone
        if not within.sum() >= min(4, len(within)):
            within = everyone  # more wrong than right: no majority to trust
        state = _minimise(problem, noise.whiten, within.astype(float), state)
        settled = np.allclose(noise.std, before, rtol=1e-3) and not robust
        if np.array_equal(within, inliers) and settled:
            break
        inliers = within
    noise.update(state, inliers, robust=False)
    return _finish(problem, noise, state, inliers)


def _gate(poses: int, inliers: int) -> float:
    """Length that the longest residual of all good poses exceeds once in `1 / FALSE_ALARM` times.

    The noise is learnt from few residuals itself, so a squared length is F-, not chi-distributed.
    """
    from scipy.special import fdtri

    freedom = 6.0 * max(1, inliers - 2)
    return float(np.sqrt(6 * fdtri(6.0, freedom, 1 - FALSE_ALARM / poses)))


def _huber(lengths: Array) -> Array:
    return np.asarray(np.minimum(1.0, HUBER / np.maximum(lengths, 1e-300)))


def _cauchy(lengths: Array) -> Array:
    return np.asarray(1 / (1 + (lengths / CAUCHY) ** 2))


class _Noise:
    """Standard deviations of the estimates, as far as the weights leave them open."""

    def __init__(self, problem: Problem, weights: Weights, enough: bool) -> None:
        self.problem, self.absolute, self.enough = problem, weights.absolute, enough
        self.unit = whitening(weights.covariances)
        self.std = (1.0, 1.0) if weights.absolute else USUAL_STD
        self.whiten = self._scaled()

    def _scaled(self) -> Array:
        t, r = self.std
        return self.unit / t if self.absolute else self.unit / np.repeat([t, r], 3)

    def update(self, state: State, inliers: NDArray[np.bool_], *, robust: bool) -> Array:
        """Learn the noise from residuals; their (N,) lengths in standard deviations."""
        raw = self.problem.residuals(state)
        residuals = np.einsum("nij,nj->ni", self.unit, raw)
        free = self._freedom(int(inliers.sum()))
        if free > 0 and (self.enough or not (self.absolute or self.problem.prior)):
            parts = (residuals,) if self.absolute else (residuals[:, :3], residuals[:, 3:])
            stds = [_spread(part[inliers], free, robust) for part in parts]
            self.std = (
                (max(1.0, stds[0]),) * 2
                if self.absolute
                else (max(STD_FLOOR, stds[0]), max(STD_FLOOR, stds[1]))
            )
            self.whiten = self._scaled()
        return np.asarray(np.linalg.norm(np.einsum("nij,nj->ni", self.whiten, raw), axis=1))

    def without_own(self, state: State, inliers: NDArray[np.bool_]) -> Array:
        """(N,) factors by which lengths grow if a pose has no part in the noise it is held to.

        One wrong pose among few would otherwise make room for itself.
        """
        whitened = np.einsum("nij,nj->ni", self.whiten, self.problem.residuals(state))
        squares = np.square(whitened).sum(axis=1) * inliers
        left = 1 - squares / max(float(squares.sum()), 1e-300)
        count = float(inliers.sum())
        return np.where(inliers, np.sqrt((1 - 1 / count) / np.maximum(left, 1e-9)), 1.0)

    def _freedom(self, count: int) -> float:
        """Share of the residuals' squares that the solution has not taken for itself."""
        return 1.0 - 2.0 / count if count > 2 else 0.0


def _spread(residuals: Array, free: float, robust: bool) -> float:
    """Standard deviation of (M, k) residuals, by the median of their lengths or the RMS."""
    if robust:
        median = MEDIAN_3 if residuals.shape[1] == 3 else MEDIAN_6
        return float(np.median(np.linalg.norm(residuals, axis=1)) / median / np.sqrt(free))
    return float(np.sqrt(np.square(residuals).mean() / free))


def _minimise(
    problem: Problem, whiten: Array, weights: Array, state: State, iterations: int = 20
) -> State:
    root = whiten * np.sqrt(weights)[:, None, None]

    def evaluate(state: State) -> tuple[Array, Array]:
        residuals, J = problem.linearise(state)
        prior, prior_J = problem.prior_rows(state)
        return (
            np.concatenate([np.einsum("nij,nj->ni", root, residuals).ravel(), prior]),
            np.concatenate([(root @ J).reshape(-1, J.shape[2]), prior_J]),
        )

    return minimise(evaluate, State.moved, state, iterations=iterations)


def _finish(problem: Problem, noise: _Noise, state: State, inliers: NDArray[np.bool_]) -> Fit:
    residuals, J = problem.linearise(state)
    residuals = np.einsum("nij,nj->ni", noise.whiten, residuals)
    J = noise.whiten @ J
    _, prior_J = problem.prior_rows(state)
    size = J.shape[2]
    weak = np.zeros(size)
    weak[:12] = np.tile(np.repeat([1 / FAR**2, 1 / np.pi**2], 3), 2)
    H = np.diag(weak) + prior_J.T @ prior_J
    blocks = np.einsum("nki,nkj->nij", J, J) * inliers[:, None, None]
    H = H + blocks.sum(axis=0)
    enough = inliers.sum() > 3 or problem.prior is not None
    gradients = np.einsum("nki,nk->ni", J, residuals) * inliers[:, None]
    steps = np.full((len(J), size), 0.0 if enough else np.nan)
    if enough:
        # One Gauss-Newton step: the other poses' gradient is minus this one's at the solution.
        steps = np.linalg.solve(H - blocks, gradients[:, :, None])[:, :, 0]
    covariance = np.linalg.inv(H)
    scale = noise.std[0] if noise.absolute else 1.0
    return Fit(state, (covariance + covariance.T) / 2, inliers, float(scale), steps)
