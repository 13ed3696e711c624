"""Where the uncertainty of an extrinsic comes from."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lcdata.geometry import se3

Array = NDArray[np.float64]

TITLES = {
    "encoders": "encoders",
    "joint_offsets": "joint offsets",
    "clock_offset": "clock offset",
    "T_camera_effector": "camera on effector",
    "T_base_lidar": "LiDAR on arm base",
    "links": "both links, refined",
    "links_and_joint_offsets": "links and joint offsets, refined",
    "T_camera_lidar": "static extrinsic",
}
"""Every source of uncertainty and what a reader calls it."""

SOURCES = tuple(TITLES)


class Variances(NamedTuple):
    """Expected squares of the two error norms: of the translation (m^2), the rotation (rad^2)."""

    translation: float
    rotation: float


def variances(T: ArrayLike, covariance: ArrayLike) -> Variances:
    """Expected squared norms of an extrinsic's errors; NaN where they are unknown.

    A left perturbation (u, w) turns the rotation by |w| and moves the translation p by
    u + w x p, so the translation's variance is that of [1, -[p]x] (u, w). Both are linear in
    the covariance: those of independent sources add up to those of the sum.

    Args:
        T: 4x4.
        covariance: 6x6, translation then rotation, left perturbation.
    """
    covariance = np.asarray(covariance, float)
    to_translation = np.hstack([np.eye(3), -se3.skew(np.asarray(T, float)[:3, 3])])
    moved = to_translation @ covariance @ to_translation.T
    return Variances(float(np.trace(moved)), float(np.trace(covariance[3:, 3:])))


def shares(T: ArrayLike, budget: Mapping[str, Array]) -> dict[str, Variances]:
    """Which part of both variances comes from each source; they add up to one.

    Args:
        T: 4x4 extrinsic.
        budget: 6x6 covariances by source.

    Returns:
        By source, in the order of `SOURCES`; NaN where any source is unknown.
    """
    parts = {name: variances(T, budget[name]) for name in SOURCES if name in budget}
    total = Variances(*np.sum(list(parts.values()), axis=0)) if parts else Variances(0.0, 0.0)
    return {
        name: Variances(
            *(a / b if b else 0.0 if b == 0 else np.nan for a, b in zip(part, total, strict=True))
        )
        for name, part in parts.items()
    }


def drift(scatter: ArrayLike, duration_s: ArrayLike) -> Array:
    """(..., n) joint velocities, rad/s, that a dwell may at most have had on average.

    A joint that moves evenly through a dwell of duration t scatters by v t / sqrt(12) about its
    mean. Taking all scatter for such motion bounds the velocity.

    Args:
        scatter: (..., n) standard deviation within the dwell, radians.
        duration_s: (...) how long it lasted; no velocity without a duration.
    """
    duration = np.asarray(duration_s, float)[..., None]
    rate = np.divide(np.sqrt(12.0), duration, out=np.zeros_like(duration), where=duration > 0)
    return np.asarray(np.asarray(scatter, float) * rate)
