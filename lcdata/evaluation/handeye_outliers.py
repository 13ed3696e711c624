"""Which poses' own lines say that the links are wrong there: a pushed arm, a bad reading."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from lcdata.calibrators.lines import CORRELATION
from lcdata.features.line_features import LineFeatures
from lcdata.features.line_solver import solve_projection
from lcdata.features.matching import refine
from lcdata.geometry import se3
from lcdata.groundtruth.handeye_robust import ENOUGH, FALSE_ALARM, MEDIAN_6

Array = NDArray[np.float64]

MIN_LINES = 6
"""A pose with fewer matched lines in all its pairs does not count."""


def own_lines(features: Sequence[Sequence[LineFeatures]], T: Array) -> tuple[Array, Array]:
    """What each pose's own lines say, matched anew with wide gates.

    The joint solution's narrow gates would not let a wrong pose say that it is wrong.

    Args:
        features: Lines of each pair of each pose.
        T: (N, 4, 4) extrinsics by the links.

    Returns:
        (N, 6) perturbations of the extrinsics T and (N, 6, 6) their covariances; NaN without lines.
    """
    twists, covariances = np.full((len(T), 6), np.nan), np.full((len(T), 6, 6), np.nan)
    for i, pairs in enumerate(features):
        solution, matches = refine(pairs, T[i], solve_projection) if pairs else (None, None)
        if solution is None or matches is None or len(matches.pair) < MIN_LINES:
            continue
        if np.isfinite(solution.covariance).all():
            twists[i] = se3.log(solution.T_camera_lidar @ se3.inverse(T[i]))
            covariances[i] = CORRELATION * len(pairs) * solution.covariance
    return twists, covariances


def judge(own: tuple[Array, Array], encoders: Array) -> tuple[float, NDArray[np.bool_]]:
    """How far poses disagree with the links, and which fit.

    Args:
        own: What `own_lines` gives.
        encoders: (N, 6, 6) covariance of each extrinsic from encoder noise.

    Returns:
        By how much, in standard deviations, poses disagree more than predicted, at least 1; and
        (N,) bool, all of them if most would be wrong or there are too few to tell.
    """
    from scipy.special import chdtri

    twists, covariances = own
    said = np.isfinite(twists[:, 0])
    lengths = np.zeros(len(twists))
    solved = np.linalg.solve((covariances + encoders)[said], twists[said][..., None])[..., 0]
    lengths[said] = np.sqrt((twists[said] * solved).sum(axis=1))
    everyone = np.ones(len(twists), bool)
    if said.sum() < ENOUGH:
        return 1.0, everyone
    free = max(1.0 - 2.0 / said.sum(), 0.1)
    scale = max(1.0, float(np.median(lengths[said])) / MEDIAN_6 / np.sqrt(free))
    within = lengths < scale * np.sqrt(chdtri(6.0, FALSE_ALARM / said.sum()))
    return scale, within if 2 * within[said].sum() > said.sum() else everyone
