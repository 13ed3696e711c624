"""Which directions of the two hand-measured links the arm's motion leaves undetermined.

X and Z can be traded along a direction v of the base if X A_i turns v the same way in every pose:
turning Z about v (or shifting it along v) and X the other way about the common image of v changes
no extrinsic. The mean rotation R of the A_i has singular values s_k = 1 for just these
directions, and the singular values of the linearised rotations, the rows [1, R_i], are
sqrt(1 - s_k) and sqrt(1 + s_k): the ratio sqrt((1 - s_k) / (1 + s_1)) says how well v is
determined, without units. Translations have the same rows, hence the same ratios.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

OBSERVABLE_RATIO = 0.03
"""Smaller ratios are called unobservable: about 3 degrees RMS about the second axis."""


@dataclass(frozen=True, eq=False)
class Observability:
    """Observability of X and Z by the arm's rotations.

    Args:
        ratios: (3,) singular-value ratios, least determined first.
        axes_base: (3, 3) unit directions in the base frame, a row each.
        spread_deg: (3,) RMS angle by which the arm turned each direction.
    """

    ratios: Array
    axes_base: Array
    spread_deg: Array

    @property
    def observable(self) -> bool:
        """Whether every direction is determined by the data."""
        return bool(self.ratios[0] >= OBSERVABLE_RATIO)

    def names(self) -> tuple[str, ...]:
        """A sentence for each undetermined direction."""
        return tuple(
            f"T_base_lidar against T_camera_effector: rotation about and translation along "
            f"{_direction(axis)} of the base, which the arm turned by "
            f"{spread:.2g} deg only"
            for ratio, axis, spread in zip(
                self.ratios, self.axes_base, self.spread_deg, strict=True
            )
            if ratio < OBSERVABLE_RATIO
        )

    def summary(self) -> str:
        """What the arm did wrong, in one phrase."""
        bad = int((self.ratios < OBSERVABLE_RATIO).sum())
        if bad == 0:
            return "the arm turned about several axes"
        if bad == 1:
            axis = _direction(self.axes_base[0])
            return f"the arm turned about one axis only, {axis} of the base"
        return f"the arm hardly turned: {self.spread_deg[-1]:.2g} deg in all"


def _direction(axis: Array) -> str:
    """An axis for people: of v and -v the one whose largest component is positive."""
    axis = axis * np.sign(axis[np.argmax(np.abs(axis))])
    return f"({', '.join(f'{round(x, 2) + 0.0:.2f}' for x in axis)})"


def observability(T_effector_base: Array) -> Observability:
    """Observability of X and Z from (N, 4, 4) poses of the arm."""
    rotations = T_effector_base[:, :3, :3]
    # Without X and about the mean: 1 - s_k loses its digits, so it is taken from the spread.
    left, s, right = np.linalg.svd(rotations.mean(axis=0))
    common = left.T  # images of the rows of `right`
    turned = np.einsum("nij,kj->nki", rotations, right)
    apart = np.square(turned - common).sum(axis=2).mean(axis=0)  # = 2 (1 - s_k)
    order = np.argsort(apart)
    ratios = np.sqrt(apart[order] / 2 / (1 + s[0]))
    return Observability(ratios, right[order], np.rad2deg(np.sqrt(apart[order])))
