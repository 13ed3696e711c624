"""LiDAR-camera calibration data sets with ground truth from a robot arm.

Transforms are named by their frames: `T_camera_lidar` maps LiDAR points to camera points.
Metres and radians everywhere; degrees only where a person reads or types.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"

if TYPE_CHECKING:
    from lcdata.calibrators import Calibration, Calibrator, calibrate
    from lcdata.dataset import Dataset
    from lcdata.errors import LcdataError
    from lcdata.geometry.camera import Camera
    from lcdata.pair import Pair

__all__ = [
    "Calibration",
    "Calibrator",
    "Camera",
    "Dataset",
    "LcdataError",
    "Pair",
    "__version__",
    "calibrate",
]

_HOMES = {
    "Calibration": "lcdata.calibrators",
    "Calibrator": "lcdata.calibrators",
    "Camera": "lcdata.geometry.camera",
    "Dataset": "lcdata.dataset",
    "LcdataError": "lcdata.errors",
    "Pair": "lcdata.pair",
    "calibrate": "lcdata.calibrators",
}


def __getattr__(name: str) -> Any:
    """Import public names on first use: `lcdata --help` must not wait for NumPy."""
    from importlib import import_module

    if name == "handeye":
        return import_module("lcdata.handeye")
    if name not in _HOMES:
        raise AttributeError(f"module 'lcdata' has no attribute {name!r}")
    return getattr(import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *_HOMES, "handeye"})
