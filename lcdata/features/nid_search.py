"""Minimisers of a cost of poses: bounded BFGS, Nelder-Mead, and a shrinking random search."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lcdata.features.chamfer_search import displaced, low_discrepancy
from lcdata.geometry import se3

Array = NDArray[np.float64]

Costs = Callable[[Array], Array]
"""(P, 4, 4) poses to (P,) costs."""

Slope = Callable[[Array], tuple[float, Array]]
"""4x4 pose to its cost and (6,) gradient by a left perturbation."""

UNIT = np.repeat([0.01, np.deg2rad(0.1)], 3)
"""Metres and radians that matter alike: minimisers work in these units."""


def bfgs(
    slope: Slope, T: Array, reach: Array, iterations: int = 60, tolerance: float = 1e-8
) -> tuple[Array, float]:
    """Minimise by L-BFGS-B with the analytic gradient.

    Args:
        slope: Cost and gradient.
        T: 4x4 start.
        reach: (6,) largest twist from the start, metres then radians.
        iterations: At most.
        tolerance: Relative gain in a step that is not worth another.

    Returns:
        4x4 and its cost.
    """
    import pinocchio
    from scipy.optimize import minimize

    def function(x: Array) -> tuple[float, Array]:
        twist = x * UNIT
        cost, gradient = slope(se3.exp(twist) @ T)
        # exp(twist + d) = exp(Jl d) exp(twist), and the left Jacobian is the right one of -twist.
        J = np.asarray(pinocchio.Jexp6(pinocchio.Motion(-twist)))
        return cost, J.T @ gradient * UNIT

    bounds = [(-r, r) for r in reach / UNIT]
    found = minimize(
        function,
        np.zeros(6),
        jac=True,
        method="L-BFGS-B",
        bounds=bounds,
        options={"maxiter": iterations, "ftol": tolerance, "gtol": 1e-7},
    )
    return se3.exp(found.x * UNIT) @ T, float(found.fun)


def nelder_mead(costs: Costs, T: Array, step: Array, iterations: int = 400) -> tuple[Array, float]:
    """Minimise without gradients, as the paper does.

    Args:
        costs: Costs of poses.
        T: 4x4 start.
        step: (6,) edges of the first simplex, metres then radians. The published code's default
            barely moves.
        iterations: At most.

    Returns:
        4x4 and its cost.
    """
    from scipy.optimize import minimize

    def function(x: Array) -> float:
        return float(costs((se3.exp(x * UNIT) @ T)[None])[0])

    simplex = np.concatenate([np.zeros((1, 6)), np.diag(step / UNIT)])
    found = minimize(
        function,
        np.zeros(6),
        method="Nelder-Mead",
        options={"initial_simplex": simplex, "maxiter": iterations, "xatol": 0.02, "fatol": 1e-7},
    )
    return se3.exp(found.x * UNIT) @ T, float(found.fun)


@dataclass(frozen=True)
class Stage:
    """One round of the shrinking search.

    Args:
        level: Which of the costs counts, fast and blunt ones first.
        spread: Standard deviation of the children, in half-widths of the box.
        keep: Poses that have children.
        children: Children of all of them together.
    """

    level: int
    spread: float
    keep: int
    children: int


def different(poses: Array, count: int, apart: Array) -> Array:
    """The first poses that are not near an earlier one.

    Args:
        poses: (P, 4, 4) best first.
        count: At most so many.
        apart: (6,) twist, metres then radians, within which poses are the same.
    """
    chosen: list[Array] = []
    for T in poses:
        if all((np.abs(se3.log(T @ se3.inverse(other))) > apart).any() for other in chosen):
            chosen.append(T)
            if len(chosen) == count:
                break
    return np.array(chosen)


def shrinking_search(
    costs: Sequence[Costs],
    T: Array,
    half_width: Array,
    samples: int,
    stages: Sequence[Stage],
    rng: np.random.Generator,
) -> tuple[Array, Array]:
    """Sample the box about a pose, keep the best, and sample ever closer around them.

    Args:
        costs: Costs by level; the first samples are judged by the first.
        T: 4x4 middle of the box.
        half_width: (6,) rotation vector (rad) and translation (m) of the box.
        samples: Poses in the first round.
        stages: The rounds that follow.
        rng: Of the children's offsets.

    Returns:
        (K, 4, 4) last generation, best first, and its (K,) costs.
    """
    places = (2 * low_discrepancy(samples, int(rng.integers(1 << 30))) - 1) * half_width
    places[0] = 0.0
    values = costs[0](displaced(T, places))
    level = 0
    for stage in stages:
        order = np.argsort(values, kind="stable")[: stage.keep]
        parents, values = places[order], values[order]
        if stage.level != level:
            level = stage.level
            values = costs[level](displaced(T, parents))
        many = rng.integers(0, len(parents), stage.children)
        offsets = rng.normal(size=(stage.children, 6)) * stage.spread * half_width
        # Half of them along the difference of two others: down the valleys in which rotation
        # makes up for translation.
        half = stage.children // 2
        first, second = rng.integers(0, len(parents), (2, half))
        offsets[:half] *= 0.3
        offsets[:half] += rng.uniform(0.3, 1.0, (half, 1)) * (parents[first] - parents[second])
        children = np.clip(parents[many] + offsets, -1.2 * half_width, 1.2 * half_width)
        places = np.concatenate([parents, children])
        values = np.concatenate([values, costs[level](displaced(T, children))])
    order = np.argsort(values, kind="stable")
    return displaced(T, places[order]), values[order]
