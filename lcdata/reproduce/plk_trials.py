"""Trials of PLK-Calib's figures on one pair: features once, every method from every start."""

from __future__ import annotations

import math
import time
from collections.abc import Container, Hashable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import lcdata
from lcdata.calibrators.base import Calibration, Calibrator
from lcdata.evaluation import metrics
from lcdata.evaluation.results import TrialResult
from lcdata.evaluation.worker import front_end, parameters
from lcdata.geometry import se3
from lcdata.pair import Pair
from lcdata.reproduce.kept import KeptRows
from lcdata.reproduce.plk_pairs import PairName
from lcdata.reproduce.plk_starts import Offset, RandomSigns

Array = NDArray[np.float64]

Key = tuple[str, str, str, str, str]


@dataclass(frozen=True)
class Work:
    """One method from one start.

    Args:
        test: Part of the experiment that it belongs to.
        label: What tables call the method.
        method: The method.
        start: Where it starts.
    """

    test: str
    label: str
    method: Calibrator
    start: RandomSigns | Offset

    def key(self, pair: PairName) -> Key:
        """Of its row: all that the result depends on."""
        method = f"{self.method.name} {self.method.version} {parameters(self.method)}"
        return pair.content, pair.pair_id, self.test, f"{self.label}: {method}", self.start.name


@dataclass(frozen=True)
class Task:
    """Work on one pair."""

    pair: PairName
    work: tuple[Work, ...]

    @property
    def keys(self) -> list[Key]:
        """Of its rows."""
        return [work.key(self.pair) for work in self.work]

    def only(self, keys: Container[Hashable]) -> Task:
        """The task without the work of other rows."""
        return replace(self, work=tuple(w for w in self.work if w.key(self.pair) in keys))


@dataclass(frozen=True)
class Row:
    """What became of one trial; NaN where there is no estimate.

    Args:
        key: Of what it is a row, see `Work.key`.
        scenario: Of the pair.
        pose_id: Of the pair.
        label: Of the method.
        metres: Offset of the initial guess along one axis, where the start is one.
        degrees: Offset about one axis.
        initial: (7,) initial guess: x y z (m), quaternion x y z w.
        estimated: (7,) estimate; empty if there is none.
        truth: (7,) ground truth.
        sigma: Uncertainty of the ground truth: degrees, metres.
        sigma_distance: Error in standard deviations of the ground truth.
        converged: The method's own verdict.
        degenerate: The same.
        seconds: Processor time of the estimate, without features.
        features_seconds: Processor time of the pair's features for this method, which all its
            trials share.
        message: What went wrong.
    """

    key: Key
    scenario: str
    pose_id: str
    label: str
    metres: float
    degrees: float
    initial: tuple[float, ...]
    estimated: tuple[float, ...]
    truth: tuple[float, ...]
    sigma: tuple[float, float]
    sigma_distance: float = math.nan
    converged: bool = False
    degenerate: bool = False
    seconds: float = math.nan
    features_seconds: float = math.nan
    message: str = ""

    @property
    def test(self) -> str:
        """Part of the experiment."""
        return self.key[2]

    @property
    def rotation_error_deg(self) -> float:
        """Geodesic angle, degrees; infinite without an estimate."""
        return self._error(metrics.rotation_error_deg)

    @property
    def translation_error_m(self) -> float:
        """L2 norm, metres; infinite without an estimate."""
        return self._error(metrics.translation_error_m)

    def _error(self, measure: Any) -> float:
        if not self.estimated:
            return math.inf
        return float(measure(*map(se3.from_xyz_xyzw, (self.estimated, self.truth))))

    @property
    def success(self) -> bool:
        """Whether both errors are below 0.5 deg and 0.1 m."""
        return metrics.is_success(self.rotation_error_deg, self.translation_error_m)

    def result(self) -> TrialResult:
        """The same as `lcdata calibrate` would store it."""
        T, T_initial = se3.from_xyz_xyzw(self.truth), se3.from_xyz_xyzw(self.initial)
        made = bool(self.estimated)
        return TrialResult(
            run=self.test,
            method=self.label,
            method_version=0,
            parameters=self.key[3],
            lcdata_version=lcdata.__version__,
            pair_ids=(self.key[1],),
            scenario=self.scenario,
            pose_id=self.pose_id,
            trial=0,
            seed=0,
            group="pair",
            init_rotation_deg=self.degrees,
            init_translation_m=self.metres,
            T_camera_lidar_initial=T_initial,
            groundtruth_version="",
            T_camera_lidar_estimated=se3.from_xyz_xyzw(self.estimated) if made else None,
            initial_rotation_error_deg=metrics.rotation_error_deg(T_initial, T),
            initial_translation_error_m=metrics.translation_error_m(T_initial, T),
            rotation_error_deg=self.rotation_error_deg if made else math.nan,
            translation_error_m=self.translation_error_m if made else math.nan,
            sigma_distance=self.sigma_distance,
            groundtruth_rotation_sigma_deg=self.sigma[0],
            groundtruth_translation_sigma_m=self.sigma[1],
            converged=self.converged,
            degenerate=self.degenerate,
            failed=not made,
            seconds=self.features_seconds + self.seconds,
            features_seconds=self.features_seconds,
            message=self.message,
        )


class Kept(KeptRows[Row]):
    """Rows that are done.

    Args:
        path: Their file; None keeps none.
    """

    def __init__(self, path: Path | None) -> None:
        super().__init__(path, _parsed)


def _parsed(line: dict[str, Any]) -> Row:
    names = ("key", "initial", "estimated", "truth", "sigma")
    return Row(**{**line, **{name: tuple(line[name]) for name in names}})


def run_task(task: Task) -> Iterator[Row]:
    """A row for each piece of work; features are made once for all methods of a front end."""
    import cv2

    cv2.setNumThreads(1)
    pair = task.pair.load()
    ready: dict[str, tuple[Any, float]] = {}
    for work in task.work:
        blank = _blank(task.pair, pair, work)
        try:
            front = front_end(work.method)
            if front not in ready:
                _warm_up(work, pair, blank)
                started = time.process_time()
                ready[front] = work.method.prepare(pair), time.process_time() - started
            features, seconds = ready[front]
            started = time.process_time()
            T_initial = se3.from_xyz_xyzw(blank.initial)
            found = work.method.calibrate([pair], T_initial, [features])
            taken = time.process_time() - started
            yield _filled(blank, found, pair, taken, seconds)
        except Exception as error:  # whatever a third party's method raises is its result
            text = " ".join(str(error).split())
            yield replace(blank, message=f"{type(error).__name__}: {text}")


_WARM: set[str] = set()


def _warm_up(work: Work, pair: Pair, blank: Row) -> None:
    """Once a process, uncounted: compile, or read what was compiled before."""
    if work.method.name not in _WARM:
        _WARM.add(work.method.name)
        T_initial = se3.from_xyz_xyzw(blank.initial)
        work.method.calibrate([pair], T_initial, [work.method.prepare(pair)])


def _blank(name: PairName, pair: Pair, work: Work) -> Row:
    T = pair.T_camera_lidar
    assert T is not None
    offset = work.start if isinstance(work.start, Offset) else None
    initial = work.start.guess(T, name.pair_id)
    return Row(
        work.key(name),
        name.scenario,
        name.pose_id,
        work.label,
        offset.metres if offset else math.nan,
        offset.degrees if offset else math.nan,
        _flat(initial),
        (),
        _flat(T),
        (*metrics.groundtruth_sigma(T, pair.covariance),),
    )


def _filled(blank: Row, found: Calibration, pair: Pair, taken: float, features: float) -> Row:
    T, covariance = se3.check_transform(found.T_camera_lidar, "the estimate"), pair.covariance
    distance = math.nan
    if covariance is not None and np.isfinite(covariance).all() and covariance.any():
        distance = se3.sigma_distance(T, se3.from_xyz_xyzw(blank.truth), covariance)
    return replace(
        blank,
        estimated=_flat(T),
        sigma_distance=distance,
        converged=bool(found.converged),
        degenerate=bool(found.degenerate),
        seconds=taken,
        features_seconds=features,
        message=found.message,
    )


def _flat(T: Array) -> tuple[float, ...]:
    return tuple(float(v) for v in se3.to_xyz_xyzw(T))
