"""Numbers in words."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from lcdata.evaluation.metrics import Sigma


def number_text(value: float) -> str:
    """A number with three significant digits; a dash where there is none."""
    if not math.isfinite(value):
        return "–"
    if value == 0 or abs(value) < 1e-4:
        return "0" if value == 0 else f"{value:.1e}"
    digits = max(0, 2 - math.floor(math.log10(abs(value))))
    return f"{value:.{min(digits, 5)}f}"


def error_text(rotation_deg: float, translation_m: float) -> str:
    """Both errors of an extrinsic."""
    return f"{number_text(rotation_deg)} deg, {number_text(translation_m)} m"


def uncertainty_text(sigma: Sigma) -> str:
    """How far a ground truth itself may be off."""
    if not math.isfinite(sigma.rotation_deg):
        return "uncertainty unknown"
    millimetres = number_text(sigma.translation_m * 1e3)
    return f"known to {number_text(sigma.rotation_deg)} deg, {millimetres} mm"


def count_text(count: int, noun: str) -> str:
    """A number of things."""
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"
