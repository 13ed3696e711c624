"""The edge-based columns of the NID table: `edge` on the same scenes, from the exact extrinsic.

Koide et al. gave the edge-based method (Yuan et al. 2021) their reference as its initial guess, "an
almost ideal initial guess", and print what came of it in Tables I and II.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from lcdata.calibrators.registry import create
from lcdata.errors import CalibrationError
from lcdata.geometry import se3
from lcdata.reproduce.experiment import Table
from lcdata.reproduce.nid_scenes import COMBINATIONS, scene
from lcdata.reproduce.nid_trials import Task

PAPER_SINGLE = {0: (0.236, 1.329), 1: (0.323, 3.497)}
"""Average errors of the edge-based method in Tables I and II: metres, degrees."""

PARAMETERS = {"search_rotation_deg": 1.0, "search_translation_m": 0.1}
"""A search as wide as the guess is good."""


@dataclass(frozen=True)
class EdgeRow:
    """What `edge` made of one scene, or of all scenes together.

    Args:
        combination: Number of the sensors.
        scenes: Numbers of the scenes.
        seed: Of the scenes.
        error_m: Error of the extrinsic, metres; that of the guess where it cannot run.
        error_deg: The same, degrees.
        converged: What the method says of itself.
        seconds: Wall time.
        message: What went wrong, in words.
    """

    combination: int
    scenes: tuple[int, ...]
    seed: int
    error_m: float
    error_deg: float
    converged: bool
    seconds: float
    message: str = ""

    @property
    def key(self) -> tuple[int, tuple[int, ...], int]:
        """What it is a row of."""
        return self.combination, self.scenes, self.seed


def run_edge_task(task: Task) -> Iterator[EdgeRow]:
    """Solve one task."""
    import cv2

    cv2.setNumThreads(1)
    combination = COMBINATIONS[task.combination]
    truth = combination.T_camera_lidar
    pairs = [scene(combination, number, task.seed) for number in task.scenes]
    started = time.perf_counter()
    try:
        found = create("edge", **PARAMETERS).calibrate(pairs, truth)
    except CalibrationError as error:
        seconds = time.perf_counter() - started
        yield EdgeRow(*_place(task), 0.0, 0.0, False, seconds, str(error))
        return
    yield EdgeRow(
        *_place(task),
        se3.translation_error(found.T_camera_lidar, truth),
        float(np.rad2deg(se3.rotation_error(found.T_camera_lidar, truth))),
        found.converged,
        time.perf_counter() - started,
        found.message,
    )


def _place(task: Task) -> tuple[int, tuple[int, ...], int]:
    return task.combination, task.scenes, task.seed


def edge_table(rows: Sequence[EdgeRow], chosen: Sequence[int]) -> Table:
    """Our errors beside the paper's."""
    header = (
        "Combination",
        "Single, average: edge-based in the paper (m / deg)",
        "`edge`, average",
        "`edge`, median",
        "All together: `edge`",
        "Called converged",
        "Wrong but converged",
        "Seconds, one pair",
    )
    lines = []
    for c in chosen:
        single = [r for r in rows if r.combination == c and len(r.scenes) == 1]
        joint = [r for r in rows if r.combination == c and len(r.scenes) > 1]
        metres, degrees = (
            np.array([getattr(r, f"error_{u}") for r in single]) for u in ("m", "deg")
        )
        sure = np.array([r.converged for r in single])
        paper = PAPER_SINGLE.get(c)
        lines.append(
            (
                COMBINATIONS[c].name,
                _error(*paper) if paper else "not printed",
                _error(float(metres.mean()), float(degrees.mean())),
                _error(float(np.median(metres)), float(np.median(degrees))),
                _error(joint[0].error_m, joint[0].error_deg) if joint else "none",
                f"{int(sure.sum())} / {len(single)}",
                str(int((sure & ((metres > 0.1) | (degrees > 0.5))).sum())),
                f"{np.median([r.seconds for r in single]):.1f}",
            )
        )
    note = (
        "Initial guess: the exact extrinsic, as the paper gave its reference to the edge-based "
        f"method; then a search of {PARAMETERS['search_rotation_deg']:g} deg and "
        f"{PARAMETERS['search_translation_m']:g} m about it. Where the method cannot run, the "
        "error is 0, that of the guess, and it does not count as converged."
    )
    return Table("Edge-based", header, tuple(lines), note)


def _error(metres: float, degrees: float) -> str:
    return f"{metres:.3f} / {degrees:.3f}"
