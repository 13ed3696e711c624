from __future__ import annotations

import cv2
import numpy as np
import pytest

from lcdata.dataset import Dataset
from lcdata.evaluation import read_results
from lcdata.report.distributions import (
    binned_medians,
    ecdf,
    ecdf_plot,
    start_plot,
    start_varies,
)
from lcdata.report.plots import DARK, LIGHT


def test_ecdf_counts_failed_trials() -> None:
    x, share = ecdf(np.array([3.0, np.inf, 1.0, 2.0]))
    np.testing.assert_array_equal(x, [1, 2, 3])
    np.testing.assert_array_equal(share, [0.25, 0.5, 0.75])
    assert not ecdf(np.array([np.inf]))[0].size


def test_medians_at_each_initial_error_or_in_equal_shares() -> None:
    starts = np.repeat([8.66, 1.73], 4)
    errors = np.array([1, 2, 3, 4, np.inf, np.inf, 1, 1.0])
    x, medians = binned_medians(starts, errors)
    np.testing.assert_array_equal(x, [1.73, 8.66])
    np.testing.assert_array_equal(medians, [np.inf, 2.5])  # half of them failed
    rng = np.random.default_rng(0)
    starts = rng.uniform(0, 25, 600)
    x, medians = binned_medians(starts, 2 * starts)
    assert len(x) == 6 and medians == pytest.approx(2 * x)
    assert binned_medians(np.array([np.nan]), np.array([1.0]))[0].size == 0


def test_plots(calibrated: Dataset) -> None:
    trials = read_results(calibrated).trials
    assert not start_varies(trials)  # one protocol: errors of one size
    for draw in (ecdf_plot, start_plot):
        light = draw(trials, LIGHT)
        image = cv2.imdecode(np.frombuffer(light, np.uint8), cv2.IMREAD_COLOR)
        assert image.shape[1] > 1200 and light != draw(trials, DARK)
    failed = [t for t in trials if t.failed]
    assert ecdf_plot(failed, LIGHT).startswith(b"\x89PNG")
    assert start_plot(failed, LIGHT).startswith(b"\x89PNG")
