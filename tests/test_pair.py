"""Arrays that a person may give: refused with the remedy, or calibrated without NaN."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
import pytest

import lcdata
from lcdata.errors import CalibrationError

CAMERA = lcdata.Camera(
    model="pinhole", width=320, height=240, intrinsics=(250.0, 250.0, 160.0, 120.0), distortion=()
)
RNG = np.random.default_rng(0)
IMAGE = RNG.integers(0, 255, (240, 320), np.uint8)
POINTS = RNG.normal((0, 0, 5), 3, (1200, 3))


def pair(**changes: Any) -> lcdata.Pair:
    given = {"image": IMAGE, "points": POINTS, "intensity": None, "camera": CAMERA}
    return lcdata.Pair(**(given | changes))


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"image": IMAGE.tolist()}, "image of type list"),
        ({"image": IMAGE / 255.0}, "image of type float64"),
        ({"image": IMAGE[..., None]}, r"shape \(240, 320, 1\)"),
        ({"image": np.dstack([IMAGE] * 4)}, r"shape \(240, 320, 4\)"),
        ({"image": IMAGE[::2]}, "320x120 for a camera of 320x240"),
        ({"points": None}, "points of type NoneType"),
        ({"points": POINTS.astype(complex)}, "points of type complex128"),
        ({"points": POINTS[:, :2]}, r"points of shape \(1200, 2\)"),
        ({"intensity": [1.0] * 1200}, "intensity of type list"),
        ({"intensity": np.zeros(7)}, r"intensity of shape \(7,\)"),
        ({"organised": (-30, -40)}, "not -30 rings x -40 columns"),
        ({"organised": (30.0, 40.0)}, "not 30.0 rings x 40.0 columns"),
        ({"camera": None}, "camera of type NoneType"),
    ],
)
def test_what_does_not_fit_is_refused(changes: dict[str, Any], words: str) -> None:
    with pytest.raises(CalibrationError, match=words):
        pair(**changes)


@pytest.mark.parametrize(
    "changes",
    [
        {"points": POINTS * np.nan},
        {"points": POINTS[:0]},
        {"points": POINTS * [1, 1, -1]},
        {"points": POINTS.astype(np.float16)},
        {"points": np.asfortranarray(POINTS)},
        {"points": POINTS * 1e9},
        {"points": POINTS * np.nan, "organised": (30, 40)},
        {"image": IMAGE * 0},
        {"intensity": np.arange(1200)},
    ],
)
def test_input_without_lines_does_not_converge(changes: dict[str, Any]) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        result = lcdata.calibrate(pair(**changes), np.eye(4), method="projection")
    assert not result.converged
    assert result.message
    assert np.isfinite(result.T_camera_lidar).all()


def test_only_pairs_are_calibrated() -> None:
    with pytest.raises(CalibrationError, match="cannot calibrate int '3': give lcdata"):
        lcdata.calibrate([pair(), 3], np.eye(4))  # type: ignore[list-item]
