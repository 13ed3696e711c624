"""Initial guesses that do not come from the ground truth: from picks, or from matches in a file."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lcdata.errors import CalibrationError
from lcdata.evaluation.results import Guess, TrialResult
from lcdata.evaluation.task import Task
from lcdata.geometry.se3 import check_transform

if TYPE_CHECKING:
    from lcdata.dataset import Dataset

SAME = 1e-9
"""Guesses nearer than this in each number are one."""


def given_guesses(
    dataset: Dataset, source: str, note: Callable[[str], object] = lambda _: None
) -> tuple[str, dict[str, NDArray[np.float64]]]:
    """Initial guesses by name: `picks`, or the path of a CSV of matches or a toolbox's JSON.

    Args:
        dataset: Whose pairs.
        source: As a user names it.
        note: Called with what a user should know of a file, in words.

    Returns:
        Word that names the run, and 4x4 `T_camera_lidar` by pair_id.

    Raises:
        CalibrationError: Unknown source, no picks, or matches that give no pose.
    """
    from lcdata.dataset.picks import matched_extrinsics, picked_extrinsics
    from lcdata.dataset.toolbox import toolbox_extrinsics

    if source == "picks":
        return "picks", picked_extrinsics(dataset)
    if source.lower().endswith(".csv"):
        name = re.sub(r"[^\w+-]+", "-", Path(source).stem)
        return f"matches-{name}", matched_extrinsics(dataset, Path(source))
    if source.lower().endswith(".json"):
        path = Path(source)
        initial, words = toolbox_extrinsics(dataset, path)
        note(words)
        # All of them are called calib.json: the folder tells them apart.
        name = re.sub(r"[^\w+-]+", "-", f"{path.resolve().parent.name}-{path.stem}")
        return f"toolbox-{name}", initial
    raise CalibrationError(
        f"no initial guess {source!r}",
        "use truth, picks, auto, none, a CSV of matches (u,v,x,y,z), or the NID toolbox's "
        "calib.json or matches JSON",
    )


def having_guess(pair_ids: Sequence[str], initial: Mapping[str, ArrayLike]) -> list[str]:
    """Pairs that have an initial guess.

    Raises:
        CalibrationError: None has.
    """
    found = [pair_id for pair_id in pair_ids if pair_id in initial]
    if not found:
        raise CalibrationError("no pair has an initial guess", "pick some, or take other pairs")
    return found


def started_at(initial: Mapping[str, ArrayLike], tasks: Sequence[Task]) -> list[Task]:
    """Tasks from given guesses; pairs that are solved jointly start from their first one's."""

    def started(task: Task) -> Task:
        T = check_transform(initial[task.pair_ids[0]], "the initial guess")
        return dataclasses.replace(task, guesses={0: Guess(T, task.pose.pose_version)})

    return [started(task) for task in tasks]


def starts_there(trial: TrialResult, tasks: Sequence[Task]) -> bool:
    """Whether a stored trial started where its task starts now, or belongs to none of them."""
    for task in tasks:
        if task.pair_ids == trial.pair_ids:
            now, then = task.guess(trial.trial).T_camera_lidar, trial.T_camera_lidar_initial
            if now is None or then is None:
                return now is then
            return bool(np.abs(now - then).max() < SAME)
    return True
