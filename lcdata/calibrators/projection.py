"""PLK-Calib, Method I: end points of image lines onto projected cloud lines, all jointly."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import ClassVar

from lcdata.calibrators.lines import LineCalibrator
from lcdata.features.line_solver import Solver, solve_projection


@dataclass(frozen=True)
class Projection(LineCalibrator):
    """Minimise the projection residuals, eq. (4), by Levenberg-Marquardt.

    Always a little more accurate than Method II, because it uses the whole of each line; the
    paper's claim of the opposite did not reproduce.
    """

    name: ClassVar[str] = "projection"

    @property
    def solver(self) -> Solver:
        """Method I."""
        return partial(solve_projection, hold=self.hold)
