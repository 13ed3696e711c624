"""Calibration methods, one file each, found by name."""

from __future__ import annotations

from lcdata.calibrators.base import Calibration, Calibrator, LineMatches
from lcdata.calibrators.registry import available, calibrate, create

__all__ = ["Calibration", "Calibrator", "LineMatches", "available", "calibrate", "create"]
