"""What methods found, weighed against each other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lcdata.calibrators.base import Calibration
from lcdata.geometry import se3

Array = NDArray[np.float64]

AGREE_M, AGREE_RAD = 0.1, np.deg2rad(0.5)
"""Methods agree that are no farther apart than a success may be off."""


@dataclass(frozen=True, eq=False)
class Finding:
    """What one method found.

    Args:
        by: Name of the method.
        result: Its result; None where it raised an error.
        error: What it raised.
    """

    by: str
    result: Calibration | None
    error: str = ""

    @property
    def trusted(self) -> bool:
        """Whether the method itself trusts it."""
        return self.result is not None and self.result.converged

    @property
    def usable(self) -> bool:
        """Whether there is a pose that means anything."""
        return self.result is not None and np.isfinite(self.result.cost_final)

    @property
    def words(self) -> str:
        """How it ended."""
        if self.trusted:
            return f"{self.by} converged"
        why = self.error if self.result is None else self.result.message
        return f"{self.by} did not converge ({why})"


def agreeing(findings: Sequence[Finding]) -> tuple[Finding, Finding] | None:
    """Two methods that see different things and come to the same pose."""
    usable = [f for f in findings if f.usable]
    for i, first in enumerate(usable):
        for second in usable[i + 1 :]:
            assert first.result is not None
            assert second.result is not None
            poses = first.result.T_camera_lidar, second.result.T_camera_lidar
            if se3.translation_error(*poses) < AGREE_M and se3.rotation_error(*poses) < AGREE_RAD:
                return first, second
    return None


def distance(T_a: Array, covariance_a: Array, T_b: Array, covariance_b: Array) -> float:
    """How far two independent estimates are apart, in standard deviations.

    Returns:
        Root mean square over six degrees of freedom; NaN where a covariance is unknown.
    """
    gap = se3.log(T_b @ se3.inverse(T_a))
    total = covariance_a + covariance_b
    if not np.isfinite(total).all():
        return float("nan")
    return float(np.sqrt(gap @ np.linalg.solve(total, gap) / 6.0))


def fused(T_a: Array, covariance_a: Array, T_b: Array, covariance_b: Array) -> tuple[Array, Array]:
    """Mean of two independent estimates, weighted by their information: pose and covariance."""
    gain = covariance_a @ np.linalg.inv(covariance_a + covariance_b)
    T = se3.exp(gain @ se3.log(T_b @ se3.inverse(T_a))) @ T_a
    covariance = covariance_a - gain @ covariance_a
    return T, np.asarray(0.5 * (covariance + covariance.T))
