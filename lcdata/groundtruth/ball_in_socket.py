"""Where the ball is for given joints, offsets and links, and the fit to sockets that stand still.

A ball at b on the effector sits in socket s while the arm moves around it, so that

    T_base_effector(q_i + dq) b = p_s    for every reading i of that socket.

Unknown are b, the joint offsets dq, if asked for a small twist of each link, and the p_s, which
are the (weighted) means and are taken out of the problem.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from lcdata.arm import Arm
from lcdata.arm.chain import Chain
from lcdata.geometry import se3
from lcdata.groundtruth.least_squares import minimise
from lcdata.groundtruth.sockets import Socket

Array = NDArray[np.float64]

BALL_STD_M = 1.0
"""The ball is not farther from the effector: says nothing, keeps the covariance finite."""

NOISE_FLOOR_M = 1e-9
"""Exact readings must not make rounding errors into outliers."""

MEDIAN_3 = 1.538
"""Median of chi with 3 degrees of freedom."""

CAUCHY = 2.5
"""Length in standard deviations at which Cauchy's loss halves a reading's weight."""


@dataclass(frozen=True, eq=False)
class Model:
    """The arm with its unknowns: ball (3), joint offsets (n), twists of the links 1 to n - 1.

    Link 0 stands before the first joint: with the sockets unknown as well, moving the whole arm
    changes nothing.

    Args:
        arm: Arm; its joint offsets are where the search starts.
        offset_std: Prior standard deviation of the offsets, rad; 0 keeps them.
        link_std: Prior standard deviations of the links, m and rad; None keeps them.
    """

    arm: Arm
    offset_std: float
    link_std: tuple[float, float] | None = None

    @cached_property
    def chain(self) -> Chain:
        """The arm as arrays."""
        return self.arm.chain()

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.arm.joint_names)

    @property
    def std(self) -> Array:
        """Prior standard deviations of the unknowns."""
        parts = [np.full(3, BALL_STD_M)]
        if self.offset_std > 0:
            parts.append(np.full(self.n, self.offset_std))
        if self.link_std:
            parts.append(np.tile(np.repeat(self.link_std, 3), self.n - 1))
        return np.concatenate(parts)

    def offsets(self, x: Array) -> Array:
        """(n,) joint offsets in a vector of unknowns, rad."""
        return x[3 : 3 + self.n] if self.offset_std > 0 else np.zeros(self.n)

    def twists(self, x: Array) -> Array:
        """(n + 1, 6) left twists of the links in a vector of unknowns."""
        twists = np.zeros((self.n + 1, 6))
        if self.link_std:
            twists[1:-1] = x[-6 * (self.n - 1) :].reshape(-1, 6)
        return twists

    def balls(self, positions: Array, x: Array) -> tuple[Array, Array]:
        """Ball in the base frame, (N, 3) m, and its Jacobian (N, 3, len(x))."""
        chain = self.chain
        twists = self.twists(x) if self.link_std else None
        before, fixed = chain.frames(self.arm.with_offsets(positions) + self.offsets(x), twists)
        effector = before[:, -1]
        balls = effector[:, :3, :3] @ x[:3] + effector[:, :3, 3]
        parts = [effector[:, :3, :3]]
        if self.offset_std > 0:
            axes, arms = before[:, :-1, :3, 2], balls[:, None] - before[:, :-1, :3, 3]
            moved = np.where(chain.slides[:, None], axes, np.cross(axes, arms))
            parts.append(np.swapaxes(moved, 1, 2))
        if self.link_std:
            for k in range(1, self.n):
                R, p = fixed[:, k, :3, :3], fixed[:, k, :3, 3]
                parts += [R, -se3.skew(balls - p) @ R]
        return balls, np.concatenate(parts, axis=2)


@dataclass(frozen=True, eq=False)
class BallFit:
    """A fitted model.

    Args:
        x: Unknowns, in the model's order.
        covariance: Of x, with readings independent of each other.
        noise: Standard deviation of a reading on each axis, m.
    """

    x: Array
    covariance: Array
    noise: float


def fit(
    model: Model,
    sockets: Sequence[Socket],
    distances: Sequence[tuple[int, int]] = (),
    distance: tuple[float, float] = (0.05, 5e-4),
    rounds: int = 15,
) -> BallFit:
    """Robust maximum a posteriori of a model.

    Args:
        model: Arm and priors.
        sockets: Readings.
        distances: Pairs of sockets (indices) that are `distance` apart.
        distance: That distance and its standard deviation, m.
        rounds: Of reweighting, with Cauchy's loss and the scale from the median.
    """
    x, std = np.zeros(len(model.std)), model.std
    positions = np.concatenate([s.positions for s in sockets])
    of = np.repeat(np.arange(len(sockets)), [len(s.positions) for s in sockets])
    member = (of == np.arange(len(sockets))[:, None]).astype(float)
    noise, weights = 3e-3, np.ones(len(of))

    def evaluate(x: Array) -> tuple[Array, Array]:
        balls, J = model.balls(positions, x)
        share = member * weights / (member @ weights)[:, None]
        means, mean_J = share @ balls, np.tensordot(share, J, 1)
        root = np.sqrt(weights) / noise
        rows = [((balls - means[of]) * root[:, None]).ravel(), x / std]
        jacobians = [
            ((J - mean_J[of]) * root[:, None, None]).reshape(-1, len(x)),
            np.diag(1 / std),
        ]
        for a, b in distances:
            apart, apart_J = means[a] - means[b], mean_J[a] - mean_J[b]
            length = float(np.linalg.norm(apart))
            rows.append(np.array([(length - distance[0]) / distance[1]]))
            jacobians.append((apart @ apart_J / length / distance[1])[None])
        return np.concatenate(rows), np.concatenate(jacobians)

    # A socket's place takes a reading's worth of residuals with it, the model a few more.
    free = max(1.0 - (len(sockets) + len(x) / 3) / len(of), 0.1)
    for _ in range(rounds):
        previous = x
        x = minimise(evaluate, np.add, x, iterations=10)
        balls, _ = model.balls(positions, x)
        means = (member * weights) @ balls / (member @ weights)[:, None]
        lengths = np.linalg.norm(balls - means[of], axis=1)
        noise = max(float(np.median(lengths)) / MEDIAN_3 / np.sqrt(free), NOISE_FLOOR_M)
        weights = 1 / (1 + (lengths / CAUCHY / noise) ** 2)
        if np.abs(x - previous).max() < 1e-7:
            break
    _, J = evaluate(x)
    covariance = np.linalg.inv(J.T @ J)
    return BallFit(x, (covariance + covariance.T) / 2, noise)
