"""CRLF's steps one by one, each with its processor time."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lcdata.calibrators.base import Calibration, Calibrator
from lcdata.calibrators.crlf import CANDIDATES, KEPT, Crlf
from lcdata.calibrators.registry import create
from lcdata.errors import CalibrationError
from lcdata.features.crlf_coarse import coarse, ranked
from lcdata.features.road_view import together
from lcdata.reproduce.crlf_frames import Frame

Array = NDArray[np.float64]

REFINEMENTS: dict[str, dict[str, Any]] = {
    "Algorithm 1": {"refine": "random"},
    "as printed": {"refine": "random", "random_rotation_deg": 0.1},
    "crlf": {"refine": "search"},
}
"""Parameters by name: Algorithm 1 with theta0 of 0.1 rad and of the printed 0.1 deg, and ours."""

WIDE = {"search_rotation_deg": 6.0, "search_translation_m": 1.0}
"""Reach of ours where starts are as far off as in Figure 7."""


@dataclass(frozen=True, eq=False)
class Found:
    """An extrinsic, or none.

    Args:
        T_camera_lidar: 4x4; None where there is none.
        seconds: Processor time.
        converged: The method's own verdict.
        message: Its words.
    """

    T_camera_lidar: Array | None
    seconds: float
    converged: bool = False
    message: str = ""


@dataclass(frozen=True, eq=False)
class Steps:
    """A frame with its line features.

    Args:
        frame: The frame.
        masks: File of its masks; "" for none: then they are searched for at an initial guess.
        features: Of `Crlf.prepare`.
        feature_seconds: Processor time.
    """

    frame: Frame
    masks: str
    features: Any
    feature_seconds: float

    def coarse(self) -> Found:
        """Three lines, from nothing."""
        return self._run(None, {"refine": "none"})

    def coarse_seconds(self) -> float:
        """What the coarse calibration alone takes, without the verdict on it."""
        view = self.features.view
        method = _method(self.frame, self.masks, {})
        assert isinstance(method, Crlf)
        started = time.process_time()
        poses, _ = coarse(view, method.reach_m, CANDIDATES)
        if len(poses):
            ranked(together([view]), poses, KEPT)
        return time.process_time() - started

    def verdict_seconds(self, T: Array) -> float:
        """What judging an extrinsic takes, which every run ends with.

        Where there are no masks, the search for them, which every run begins with, is in it.
        """
        return self._run(T, {"refine": "none", "coarse": "never"}).seconds

    def refined(self, name: str, start: Array | None, wide: bool = False) -> Found:
        """One of `REFINEMENTS` from a start; `crlf` also from nothing.

        Args:
            name: Which.
            start: 4x4, or None.
            wide: Whether ours searches as far as `WIDE`.
        """
        far = WIDE if wide and name == "crlf" else {}
        return self._run(start, {**REFINEMENTS[name], **far})

    def _run(self, start: Array | None, parameters: dict[str, Any]) -> Found:
        started = time.process_time()
        try:
            found: Calibration = _method(self.frame, self.masks, parameters).calibrate(
                [self.frame.pair], start, [self.features]
            )
        except CalibrationError as error:
            return Found(None, time.process_time() - started, message=str(error))
        seconds = time.process_time() - started
        return Found(found.T_camera_lidar, seconds, found.converged, found.message)


@contextmanager
def steps(frame: Frame) -> Iterator[Steps]:
    """Line features of a frame; its masks lie in a file for as long."""
    with tempfile.TemporaryDirectory() as folder:
        masks = _stored(frame, Path(folder))
        started = time.process_time()
        features = _method(frame, masks, {}).prepare(frame.pair)
        yield Steps(frame, masks, features, time.process_time() - started)


def _stored(frame: Frame, folder: Path) -> str:
    """The file with lanes and poles; "" where there are no masks."""
    import cv2

    if frame.lane is None:
        return ""
    mask = frame.lane if frame.pole is None else frame.lane | frame.pole
    path = folder / "mask.png"
    cv2.imwrite(str(path), mask.astype(np.uint8) * np.uint8(255))
    return str(path)


def _method(frame: Frame, masks: str, parameters: dict[str, Any]) -> Calibrator:
    exact = frame.pole is not None  # then nothing is to be moved onto edges of the image
    return create("crlf", masks=masks, contours="never" if exact else "always", **parameters)
