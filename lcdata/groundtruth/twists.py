"""Logarithms, their Jacobians and adjoints of stacks of transforms; see `geometry.se3`."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lcdata.geometry import se3

Array = NDArray[np.float64]


def log_many(T: Array) -> Array:
    """(N, 6) twists of (N, 4, 4) transforms."""
    import pinocchio

    # One by one: in Pinocchio that is six times faster than stacks in NumPy and SciPy.
    return np.array([pinocchio.log6(one).vector for one in T]).reshape(-1, 6)


def linearised_log_many(T: Array) -> tuple[Array, Array]:
    """(N, 6) twists, and (N, 6, 6) with `log(exp(d) T) = log(T) + matrix @ d` to first order."""
    import pinocchio

    twists, J = np.empty((len(T), 6)), np.empty((len(T), 6, 6))
    for i, one in enumerate(T):
        M = pinocchio.SE3(one)
        twists[i], J[i] = pinocchio.log6(M).vector, pinocchio.Jlog6(M)
    return twists, J @ adjoint_many(se3.inverse(T))  # Pinocchio's d is on the right


def adjoint_many(T: Array) -> Array:
    """(N, 6, 6) adjoints of (N, 4, 4) transforms; see `se3.adjoint`."""
    R = T[:, :3, :3]
    result = np.zeros((len(T), 6, 6))
    result[:, :3, :3] = result[:, 3:, 3:] = R
    result[:, :3, 3:] = se3.skew(T[:, :3, 3]) @ R
    return result
