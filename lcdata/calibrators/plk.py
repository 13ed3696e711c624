"""PLK-Calib, Method II: rotation from co-perpendicularity, then translation, decoupled."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from lcdata.calibrators.lines import LineCalibrator
from lcdata.features.line_solver import Solver, solve_decoupled


@dataclass(frozen=True)
class Plk(LineCalibrator):
    """Minimise the co-perpendicular residuals, eq. (11), then solve for the translation."""

    name: ClassVar[str] = "plk"

    @property
    def solver(self) -> Solver:
        """Method II."""
        return solve_decoupled
