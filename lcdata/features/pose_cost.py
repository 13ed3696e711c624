"""What searches and verdicts ask of a cost of poses, whatever it compares."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol, Self

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class PoseCost(Protocol):
    """Cost of poses over pairs that share their extrinsic; see `nid_objective.Objective`."""

    @property
    def views(self) -> Sequence[Any]:
        """One a pair."""

    def hard(self, poses: Array, levels: Sequence[int] = ...) -> Array:
        """Costs of (P, 4, 4) poses, fast: (P,)."""

    def soft(self, T: Array, levels: Sequence[int] = ...) -> tuple[float, Array]:
        """Smooth cost of a pose, and the (clusters, 6) shares of its gradient."""

    def slope(self, T: Array) -> tuple[float, Array]:
        """Smooth cost of a pose, and its (6,) gradient by a left perturbation."""

    def thinned(self, count: int, rng: np.random.Generator) -> Self:
        """The cost of so many points."""

    def sampled(self, share: float, rng: np.random.Generator) -> Self:
        """The cost of a random share of the data."""

    def half(self, odd: int) -> Self:
        """The cost of one half of the data."""
