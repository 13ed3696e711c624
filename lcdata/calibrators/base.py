"""What a calibration method is, and what it returns."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from lcdata.errors import CalibrationError
from lcdata.pair import Pair

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class LineMatches:
    """Line correspondences that an estimate rests on.

    Args:
        points_lidar: (M, 2, 3) end points of the 3D segments in the LiDAR frame, metres.
        points_image: (M, 2, 2) end points of the 2D segments in the undistorted image, pixels.
        pair_index: (M,) which of the given pairs a match belongs to.
    """

    points_lidar: Array
    points_image: Array
    pair_index: NDArray[np.int64]

    @classmethod
    def empty(cls) -> LineMatches:
        """No matches."""
        return cls(np.zeros((0, 2, 3)), np.zeros((0, 2, 2)), np.zeros(0, np.int64))


@dataclass(frozen=True, eq=False)
class Calibration:
    """An estimate of one extrinsic.

    Args:
        T_camera_lidar: 4x4, maps LiDAR points to camera points. Where a method gave up, the
            best it had (at least the initial guess), never NaN.
        converged: The method's own verdict that the estimate can be used.
        degenerate: The data do not determine all six degrees of freedom.
        covariance: 6x6 predicted covariance: translation (m) then rotation (rad), left
            perturbation in the camera frame (see `lcdata.geometry.se3`); NaN where unknown.
        seconds: Wall time of the estimate, features included unless they were prepared.
        cost_initial: The method's cost at the initial guess.
        cost_final: The method's cost at the estimate; larger than before means diverged.
        message: What went wrong or should be known, in words; empty if nothing.
        matches: The lines that were matched, in line methods.
    """

    T_camera_lidar: Array
    converged: bool
    degenerate: bool
    covariance: Array
    seconds: float
    cost_initial: float = float("nan")
    cost_final: float = float("nan")
    message: str = ""
    matches: LineMatches = field(default_factory=LineMatches.empty)


class Calibrator(ABC):
    """A calibration method: a name, frozen parameters and `calibrate`.

    A subclass is a frozen dataclass whose fields are its parameters, with its paper's values as
    defaults.
    """

    name: ClassVar[str]
    """What users call the method."""

    version: ClassVar[int] = 1
    """Raised whenever the method's results change for the same input."""

    needs_initial: ClassVar[bool] = True
    """Whether `calibrate` needs an initial guess."""

    def prepare(self, pair: Pair) -> Any:
        """Features of one pair that do not depend on the initial guess.

        Computed once a pair and used in all its trials. The result can be pickled.
        """
        return None

    @abstractmethod
    def calibrate(
        self,
        pairs: Sequence[Pair],
        initial: Array | None,
        prepared: Sequence[Any] | None = None,
    ) -> Calibration:
        """Estimate the extrinsic that all the pairs share.

        Args:
            pairs: One pair or more with the same `T_camera_lidar`.
            initial: 4x4 initial guess of `T_camera_lidar`.
            prepared: Result of `prepare` for each pair; computed where it is None.

        Returns:
            The estimate. A failure on usable input is a `Calibration` that is not converged
            and says why.

        Raises:
            CalibrationError: Input that no estimate can be made from.
        """

    def _check_numbers(self, highest: Mapping[str, float], whole: Sequence[str]) -> None:
        """Refuse parameters that are no numbers, or not ones that make sense.

        Args:
            highest: Names of parameters above 0, and their largest values.
            whole: Names of those that are whole numbers, 0 or more.

        Raises:
            CalibrationError: Naming method, parameter and value.
        """
        for name, limit in highest.items():
            value = getattr(self, name)
            number = isinstance(value, int | float) and not isinstance(value, bool)
            if not (number and 0 < value <= limit):
                raise CalibrationError(
                    f"method {self.name!r}: {name} is {value!r}",
                    f"give a number above 0, at most {limit:g}",
                )
        for name in whole:
            value = getattr(self, name)
            if not isinstance(value, int) or value < 0:
                raise CalibrationError(
                    f"method {self.name!r}: {name} is {value!r}", "give a whole number"
                )

    def _ready(
        self, pairs: Sequence[Pair], initial: Array | None, prepared: Sequence[Any] | None
    ) -> tuple[Array, list[Any]]:
        """The initial guess of a method that needs one, and the features of all pairs.

        Raises:
            CalibrationError: No pairs, or no initial guess.
        """
        if initial is None or not pairs:
            raise CalibrationError(
                f"method {self.name!r} got {len(pairs)} pairs and initial guess {initial}",
                "give one pair or more and a 4x4 T_camera_lidar",
            )
        done = prepared or [None] * len(pairs)
        return np.array(initial, float), [
            self.prepare(pair) if features is None else features
            for pair, features in zip(pairs, done, strict=True)
        ]
