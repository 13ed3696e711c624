"""Methods as a third party would write them: one that works, others with every bad habit."""

from __future__ import annotations

import ctypes
import os
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import cv2
import numpy as np

from lcdata.calibrators.base import Calibration, Calibrator, LineMatches
from lcdata.errors import CalibrationError
from lcdata.geometry import se3
from lcdata.pair import Pair


@dataclass(frozen=True)
class Blobs(Calibrator):
    """Pose from the blobs of `toy_dataset`, by PnP from the initial guess."""

    name: ClassVar[str] = "blobs"
    prepared: ClassVar[list[str]] = []
    smallest: int = 20

    def prepare(self, pair: Pair) -> Any:
        self.prepared.append(pair.pair_id)
        assert pair.intensity is not None
        pixels, points = [], []
        for value, point in zip(pair.intensity, pair.points, strict=True):
            rows, columns = np.nonzero(pair.image == value)
            if len(rows) >= self.smallest:
                pixels.append([columns.mean(), rows.mean()])
                points.append(point)
        return np.array(pixels, float), np.array(points, float)

    def calibrate(
        self,
        pairs: Sequence[Pair],
        initial: Any,
        prepared: Sequence[Any] | None = None,
    ) -> Calibration:
        start = time.perf_counter()
        features = prepared or [self.prepare(pair) for pair in pairs]
        pixels = np.concatenate([f[0] for f in features])
        points = np.concatenate([f[1] for f in features])
        rotation, translation = cv2.Rodrigues(initial[:3, :3])[0], initial[:3, 3].copy()
        _, rotation, translation = cv2.solvePnP(
            points, pixels, pairs[0].camera.K, None, rotation, translation, True
        )
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = cv2.Rodrigues(rotation)[0], np.ravel(translation)
        segments = points[: len(points) // 2 * 2].reshape(-1, 2, 3)
        return Calibration(
            T_camera_lidar=T,
            converged=True,
            degenerate=False,
            covariance=np.eye(6) * 1e-6,
            seconds=time.perf_counter() - start,
            cost_initial=_cost(initial, points, pixels, pairs[0]),
            cost_final=_cost(T, points, pixels, pairs[0]),
            matches=LineMatches(
                segments,
                pixels[: len(segments) * 2].reshape(-1, 2, 2),
                np.zeros(len(segments), np.int64),
            ),
        )


@dataclass(frozen=True)
class Biased(Blobs):
    """The same front end; its estimates are off by a constant."""

    name: ClassVar[str] = "biased"
    bias_m: float = 0.05

    def calibrate(
        self, pairs: Sequence[Pair], initial: Any, prepared: Sequence[Any] | None = None
    ) -> Calibration:
        good = super().calibrate(pairs, initial, prepared)
        T = se3.exp([self.bias_m, 0, 0, 0, 0, 0]) @ good.T_camera_lidar
        return Calibration(T, True, True, good.covariance, good.seconds, message="off on purpose")


@dataclass(frozen=True)
class Habit(Blobs):
    """Does something bad on the pairs whose name ends in `where`, in every trial or one."""

    name: ClassVar[str] = "habit"
    habit: str = "raise"
    where: str = "001"
    in_prepare: bool = False

    def prepare(self, pair: Pair) -> Any:
        if self.in_prepare and pair.pair_id.endswith(self.where):
            self.misbehave()
        return super().prepare(pair)

    def calibrate(
        self, pairs: Sequence[Pair], initial: Any, prepared: Sequence[Any] | None = None
    ) -> Calibration:
        good = super().calibrate(pairs, initial, prepared)
        if not self.in_prepare and pairs[0].pair_id.endswith(self.where):
            if self.habit == "nan":
                return Calibration(np.full((4, 4), np.nan), True, False, np.eye(6), 0.0)
            if self.habit == "none":
                return None  # type: ignore[return-value]
            self.misbehave()
        return good

    def misbehave(self) -> None:
        if self.habit == "raise":
            raise ZeroDivisionError("a line of\nno length")
        if self.habit == "refuse":
            raise CalibrationError("too few lines", "use another scene")
        if self.habit == "segfault":
            ctypes.string_at(0)
        if self.habit == "exit":
            os._exit(3)
        if self.habit == "sleep":
            time.sleep(600)


@dataclass(frozen=True)
class Slow(Blobs):
    """Takes its time for each estimate."""

    name: ClassVar[str] = "slow"
    seconds: float = 0.3

    def calibrate(
        self, pairs: Sequence[Pair], initial: Any, prepared: Sequence[Any] | None = None
    ) -> Calibration:
        time.sleep(self.seconds)
        return super().calibrate(pairs, initial, prepared)


@dataclass(frozen=True)
class Masked(Blobs):
    """Reads a folder that a parameter names."""

    name: ClassVar[str] = "masked"
    masks: str = ""

    def calibrate(
        self, pairs: Sequence[Pair], initial: Any, prepared: Sequence[Any] | None = None
    ) -> Calibration:
        names = sorted(path.name for path in Path(self.masks).rglob("*"))
        good = super().calibrate(pairs, initial, prepared)
        return Calibration(good.T_camera_lidar, True, False, good.covariance, 0, message=str(names))


@dataclass(frozen=True)
class Threads(Blobs):
    """Says how many threads it may use."""

    name: ClassVar[str] = "threads"

    def calibrate(
        self, pairs: Sequence[Pair], initial: Any, prepared: Sequence[Any] | None = None
    ) -> Calibration:
        import numba

        threads = [cv2.getNumThreads(), numba.get_num_threads()]
        threads += [int(os.environ[name]) for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS")]
        return Calibration(np.array(initial), True, False, np.eye(6), 0.0, message=str(threads))


def _cost(T: Any, points: Any, pixels: Any, pair: Pair) -> float:
    projected, _ = pair.camera.project(se3.apply(T, points))
    return float(np.nanmean((projected - pixels) ** 2))
