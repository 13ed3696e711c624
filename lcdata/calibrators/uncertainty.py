"""Whether a predicted covariance is small enough for a result to be of use."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def too_uncertain(
    covariance: NDArray[np.float64], max_translation_m: float, max_rotation_deg: float
) -> list[str]:
    """Why a covariance is too large, in words.

    Args:
        covariance: 6x6, translation (m) then rotation (rad).
        max_translation_m: Largest standard deviation of the translation's norm, metres.
        max_rotation_deg: Largest standard deviation of the rotation's angle, degrees.

    Returns:
        One sentence where it is, or is not known; none where it is small enough.
    """
    if not np.isfinite(covariance).all():
        return ["no predicted standard deviation"]
    sigma = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    metres, degrees = np.linalg.norm(sigma[:3]), np.rad2deg(np.linalg.norm(sigma[3:]))
    if metres <= max_translation_m and degrees <= max_rotation_deg:
        return []
    return [f"predicted standard deviation of {degrees:.2g} deg, {metres:.2g} m"]
