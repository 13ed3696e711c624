"""Tests of PLK-Calib's Figure 6: what is offset, what is held, and how methods are told."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from lcdata.calibrators.base import Calibrator
from lcdata.reproduce.plk_starts import Offset

WIDER = 1.2
"""Half-width of a search over the largest offset."""

SAMPLES = 100_000
"""First poses of a search whose box is wide in the translation and open in the rotation."""


@dataclass(frozen=True)
class Sweep:
    """Sizes and axes of the offsets.

    Args:
        metres: Largest offset.
        metres_step: From one to the next.
        degrees: The same, of the turn.
        degrees_step: The same.
        translation_axis: x, y or z of the LiDAR.
        rotation_axis: The same.
    """

    metres: float = 5.0
    metres_step: float = 1.0
    degrees: float = 25.0
    degrees_step: float = 5.0
    translation_axis: str = "y"
    rotation_axis: str = "z"


@dataclass(frozen=True)
class Test:
    """A panel of the figure, or one that nobody published.

    Args:
        title: In tables.
        moves: Whether the translation is offset.
        turns: Whether the rotation is offset.
        hold: What is held at the truth.
        published: Whether the paper has it.
    """

    title: str
    moves: bool
    turns: bool
    hold: str
    published: bool = False

    def offsets(self, sweep: Sweep) -> list[Offset]:
        """Starts, from the most negative offset to the largest."""
        steps = _steps(sweep.metres, sweep.metres_step)
        if not self.moves:
            steps = _steps(sweep.degrees, sweep.degrees_step)
        starts = []
        for step in steps:
            metres, degrees = (step, 0.0) if self.moves else (0.0, step)
            if self.moves and self.turns:  # both in proportion
                degrees = step / sweep.metres * sweep.degrees
            axes = sweep.translation_axis, sweep.rotation_axis
            starts.append(Offset(metres, degrees, *axes, any_sign=self.moves and self.turns))
        return starts

    def method(self, method: Calibrator, sweep: Sweep) -> Calibrator:
        """A method that is told what is held, and a box that contains the offsets.

        Methods without such parameters stay as they are: they estimate all of the extrinsic, from
        a guess that is right in what is held.
        """
        wanted: dict[str, Any] = {"hold": self.hold}
        if self.moves:
            wanted["search_translation_m"] = WIDER * sweep.metres
        if self.turns:
            wanted["search_rotation_deg"] = WIDER * sweep.degrees
        if self.moves and self.hold == "nothing":
            wanted["search_samples"] = SAMPLES
        assert dataclasses.is_dataclass(method)
        has = {field.name for field in dataclasses.fields(method)}
        if "hold" not in has:
            return method
        return replace(method, **wanted)


TESTS = {
    "translation": Test("translation offset, rotation held", True, False, "rotation", True),
    "rotation": Test("rotation offset, translation held", False, True, "translation", True),
    "translation-free": Test("translation offset, both estimated", True, False, "nothing"),
    "rotation-free": Test("rotation offset, both estimated", False, True, "nothing"),
    "both-free": Test("both offset, both estimated", True, True, "nothing"),
}


def _steps(largest: float, step: float) -> list[float]:
    count = int(np.floor(largest / step + 1e-9))
    return [round(step * k, 9) for k in range(-count, count + 1)]
