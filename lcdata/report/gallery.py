"""Which trials are worth a picture, and the pictures."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lcdata.dataset import Dataset
from lcdata.errors import DatasetError
from lcdata.evaluation.metrics import SUCCESS_ROTATION_DEG, SUCCESS_TRANSLATION_M
from lcdata.evaluation.results import TrialResult
from lcdata.report.overlay import depth_range, draw_overlay

PICTURE_WIDTH = 720
JPEG_QUALITY = 80
PICTURES = ("Initial guess", "Estimate", "Ground truth")


@dataclass(frozen=True)
class Exhibit:
    """A trial with its pictures.

    Args:
        rank: "best", "median" or "worst".
        trial: The trial.
        pictures: JPEG files, in the order of `PICTURES`; fewer where there is no estimate.
    """

    rank: str
    trial: TrialResult
    pictures: dict[str, bytes]


def badness(trial: TrialResult) -> float:
    """The larger of the two errors, each in units of its limit of success."""
    if trial.failed:
        return math.inf
    return max(
        trial.rotation_error_deg / SUCCESS_ROTATION_DEG,
        trial.translation_error_m / SUCCESS_TRANSLATION_M,
    )


def choose(trials: Sequence[TrialResult]) -> dict[str, TrialResult]:
    """Best, median and worst trial of one method; of few trials, those that differ."""
    ranked = sorted(trials, key=badness)
    places = {"best": 0, "median": len(ranked) // 2, "worst": len(ranked) - 1}
    chosen: dict[str, TrialResult] = {}
    for rank, place in places.items():
        if not any(ranked[place] is other for other in chosen.values()):
            chosen[rank] = ranked[place]
    return chosen


def exhibits(dataset: Dataset, trials: Sequence[TrialResult]) -> list[Exhibit]:
    """Best, median and worst trial of one method, drawn on their first pair.

    A pair whose files can no longer be read is shown without pictures.
    """
    return [
        Exhibit(rank, trial, _pictures(dataset, trial)) for rank, trial in choose(trials).items()
    ]


def _pictures(dataset: Dataset, trial: TrialResult) -> dict[str, bytes]:
    try:
        pair = dataset.load(trial.pair_ids[0])
    except DatasetError:
        return {}
    truth = dataset.pose(trial.pose_id).T_camera_lidar
    depths = depth_range(pair, truth)
    poses = (trial.T_camera_lidar_initial, trial.T_camera_lidar_estimated, truth)
    width = min(PICTURE_WIDTH, pair.camera.width)
    return {
        name: _jpeg(draw_overlay(pair, T, width=width, depths=depths))
        for name, T in zip(PICTURES, poses, strict=True)
        if T is not None
    }


def _jpeg(picture: NDArray[np.uint8]) -> bytes:
    import cv2

    bgr = np.ascontiguousarray(picture[..., ::-1])
    full_colour = cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444  # dots of one pixel keep their colour
    options = [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY]
    options += [cv2.IMWRITE_JPEG_SAMPLING_FACTOR, full_colour]
    return bytes(cv2.imencode(".jpg", bgr, options)[1])
