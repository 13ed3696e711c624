"""PLK-Calib, Method II: rotation from co-perpendicularity, then translation, decoupled."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import ClassVar

from lcdata.calibrators.lines import LineCalibrator
from lcdata.features.line_solver import Solver, solve_decoupled, solve_pluecker


@dataclass(frozen=True)
class Plk(LineCalibrator):
    """Minimise the co-perpendicular and co-parallel constraints of Pluecker lines.

    Args:
        decoupled: As published: the rotation from the co-perpendicular constraint alone, then the
            translation by linear least squares. By default the co-parallel constraint, which
            holds the rotation as well, is used for both: several times as accurate on scenes of
            short lines.
    """

    name: ClassVar[str] = "plk"

    decoupled: bool = False

    @property
    def solver(self) -> Solver:
        """Method II."""
        return partial(solve_decoupled if self.decoupled else solve_pluecker, hold=self.hold)
