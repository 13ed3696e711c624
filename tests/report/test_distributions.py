from __future__ import annotations

import dataclasses

import cv2
import numpy as np
import pytest

from lcdata.calibrators.base import LineMatches
from lcdata.dataset import Dataset
from lcdata.evaluation import read_results
from lcdata.evaluation.results import TrialResult
from lcdata.report.dependence import (
    binned_medians,
    dependence_plot,
    in_view,
    initial_errors,
    matched_lines,
    varies,
)
from lcdata.report.distributions import ecdf, ecdf_plot
from lcdata.report.plots import box_plots
from lcdata.report.pose_plot import pose_plot
from lcdata.report.shared_view import shares_in_view
from lcdata.report.theme import DARK, LIGHT, PANELS


def start_plot(trials: list[TrialResult], theme: object) -> bytes:
    return dependence_plot(trials, theme, initial_errors, "its initial size ({unit})")


def decoded(png: bytes) -> np.ndarray:
    return cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR)


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


def test_plots_in_both_themes_also_of_failures_alone(calibrated: Dataset) -> None:
    trials = list(read_results(calibrated).trials)
    assert not varies(trials, initial_errors)  # one protocol: errors of one size
    for draw in (ecdf_plot, start_plot, pose_plot, box_plots):
        light = draw(trials, LIGHT)
        assert decoded(light).shape[1] > 1200 and light != draw(trials, DARK)
        assert draw([t for t in trials if t.failed], LIGHT).startswith(b"\x89PNG")


def test_a_palette_keeps_the_methods_colours(calibrated: Dataset) -> None:
    trials = list(read_results(calibrated).trials)
    image = decoded(ecdf_plot(trials, LIGHT)).reshape(-1, 3)[:, ::-1].astype(int)
    for j in range(3):
        wanted = [int(LIGHT.method(j)[k : k + 2], 16) for k in (1, 3, 5)]
        assert (np.abs(image - wanted).max(axis=1) <= 6).sum() > 200, LIGHT.method(j)


def test_lines_of_methods_that_match_some(calibrated: Dataset) -> None:
    trials = read_results(calibrated).trials
    counts = matched_lines(trials, PANELS[0])
    for trial, count in zip(trials, counts, strict=True):
        if trial.method == "biased" or trial.failed:  # matches none; or nobody knows
            assert np.isnan(count)
        else:
            assert count == len(trial.matches.pair_index) == 8
    assert not varies(trials, matched_lines)  # always eight
    fewer = [dataclasses.replace(t, matches=LineMatches.empty()) for t in trials[:1]]
    assert fewer[0].method == "blobs"
    assert varies([*fewer, *trials[1:]], matched_lines)
    assert matched_lines([*fewer, *trials[1:]], PANELS[0])[0] == 0


def test_share_in_view_is_what_the_camera_sees(calibrated: Dataset, tmp_path) -> None:
    pair_ids = [pair.pair_id for pair in calibrated.pairs]
    shares = shares_in_view(calibrated, pair_ids)
    assert shares == dict.fromkeys(pair_ids, 1.0)  # the toy's blobs are all in the image
    turned = [
        dataclasses.replace(p, T_camera_lidar=np.diag([-1.0, 1, -1, 1]) @ p.T_camera_lidar)
        for p in calibrated.poses
    ]
    behind = dataclasses.replace(calibrated, poses=tuple(turned))
    assert set(shares_in_view(behind, pair_ids).values()) == {0.0}
    gone = dataclasses.replace(calibrated, path=tmp_path)
    assert shares_in_view(gone, pair_ids) == {}
    trials = read_results(calibrated).trials
    values = in_view({**shares, trials[0].pair_ids[0]: 0.5})(trials, PANELS[0])
    assert values[0] == 50 and set(values.tolist()) == {50.0, 100.0}
    assert np.isnan(in_view({})(trials, PANELS[0])).all()
    assert varies(trials, in_view({**shares, trials[0].pair_ids[0]: 0.5}))
    assert not varies(trials, in_view({}))
