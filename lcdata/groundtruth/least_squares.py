"""Levenberg-Marquardt for small dense problems, on manifolds or off them."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
State = TypeVar("State")


def minimise(
    evaluate: Callable[[State], tuple[Array, Array]],
    retract: Callable[[State, Array], State],
    state: State,
    *,
    iterations: int = 50,
    tolerance: float = 1e-12,
) -> State:
    """State with the least sum of squared residuals near the given one.

    Args:
        evaluate: Residuals (m,), already divided by their standard deviations, and their
            Jacobian (m, n) with respect to the step that `retract` takes.
        retract: State moved by a step (n,).
        state: Where to start.
        iterations: Most evaluations that may follow the first.
        tolerance: Stop when a step's largest component, or the relative fall of the cost, is
            below it.

    Returns:
        The best state found. Directions that the residuals do not determine stay as they were.
    """
    residuals, J = evaluate(state)
    cost, damping = float(residuals @ residuals), 1e-6
    for _ in range(iterations):
        H, gradient = J.T @ J, J.T @ residuals
        scale = np.maximum(np.diag(H), 1e-12 * float(np.diag(H).max(initial=1e-300)))
        step = -np.asarray(np.linalg.solve(H + damping * np.diag(scale), gradient), float)
        candidate = retract(state, step)
        new_residuals, new_J = evaluate(candidate)
        new_cost = float(new_residuals @ new_residuals)
        if not new_cost <= cost:
            if np.abs(step).max() < tolerance or damping > 1e12:
                break
            damping *= 10.0
            continue
        fall, cost = cost - new_cost, new_cost
        state, residuals, J = candidate, new_residuals, new_J
        damping = max(damping / 10.0, 1e-12)
        if np.abs(step).max() < tolerance or fall <= tolerance * cost:
            break
    return state
