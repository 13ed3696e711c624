from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from box_room import BAD, GOOD, RUN, add_results, make

from lcdata.dataset import Dataset
from lcdata.evaluation.results import results_path, write_run
from lcdata.geometry import se3
from lcdata.review.errors import axis_top
from lcdata.review.shown import Shown
from lcdata.review.summary import pair_text, summary
from lcdata.review.text import number_text
from lcdata.review.trials import choose_trials, outcome


def test_the_summary_says_what_fails_where(dataset):
    text = summary(Shown(dataset, choose_trials(dataset)))
    assert "**Simulated**" in text
    assert "8 pairs in 4 poses of 2 scenarios (den, lab)" in text
    assert dataset.info.groundtruth_version in text
    assert f"| den | {BAD} | **1/3**" in text
    assert f"| all | {GOOD} | **8/8**" in text
    assert f"**{BAD}**: wrong on 2 of 8 pairs" in text
    first, second = (text.index(f"- pair {number} ") for number in (1, 2))
    assert first < second  # no estimate is worse than a wrong one
    assert f"**{GOOD}**: wrong on no pair" in text
    assert "no image within 50 ms" in text


def test_the_text_of_a_pair_has_its_errors_and_messages(dataset):
    trials = choose_trials(dataset)
    record = dataset.pairs[1]
    text = pair_text(1, record, Shown(dataset, trials))
    assert record.pair_id in text
    assert "8.66 deg, 0.866 m" in text
    assert f"{BAD}: no lines in the image" in text
    assert f"| {GOOD} | **right**" in text


def test_real_data_is_not_called_simulated(dataset):
    real = replace(dataset, info=replace(dataset.info, simulated=False))
    text = summary(Shown(real, choose_trials(real)))
    assert "Real recordings." in text
    assert "Simulated" not in text


def test_of_several_trials_the_first_is_shown_and_the_text_says_so(tmp_path):
    dataset = make(tmp_path / "set", pairs=1)
    add_results(dataset, trials=3)
    trials = choose_trials(dataset)
    shown = trials.of_pair(dataset.pairs[0].pair_id)
    assert {trial.trial for trial in shown.values()} == {0}
    text = summary(Shown(dataset, trials))
    assert "up to 3 trials: pictures and series show the first" in text
    assert f"| all | {GOOD} | **12/12**" in text


def test_the_run_that_was_written_last_is_shown(tmp_path):
    dataset = make(tmp_path / "set", pairs=1)
    results = add_results(dataset)
    write_run(results_path(dataset, "another"), [replace(r, run="another") for r in results])
    assert choose_trials(dataset).run == "another"
    assert choose_trials(dataset).other_runs == (RUN,)
    assert choose_trials(dataset, RUN).run == RUN
    assert "Not shown: another." in summary(Shown(dataset, choose_trials(dataset, RUN)))


def test_results_against_another_ground_truth_are_renewed_and_named(tmp_path):
    dataset = make(tmp_path / "set", pairs=1)
    add_results(dataset)
    moved = [
        replace(
            pose,
            T_camera_lidar=se3.exp([0.05, 0, 0, 0, 0, 0]) @ pose.T_camera_lidar,
            pose_version="later",
        )
        for pose in dataset.poses
    ]
    dataset = Dataset(dataset.path, dataset.info, dataset.pairs, tuple(moved))
    trials = choose_trials(dataset)
    assert trials.stale == len(trials.all)
    trial = trials.of_pair(dataset.pairs[0].pair_id)[GOOD]
    truth = dataset.pose(trial.pose_id).T_camera_lidar
    expected = se3.translation_error(trial.T_camera_lidar_estimated, truth)
    assert trial.translation_error_m == expected > 0.04
    assert "made against another ground truth" in summary(Shown(dataset, trials))


def test_outcomes(dataset):
    trial = choose_trials(dataset).of_pair(dataset.pairs[0].pair_id)[GOOD]
    assert outcome(trial) == "right"
    assert outcome(replace(trial, converged=False)) == "right, but flagged"
    wrong = replace(trial, rotation_error_deg=0.6, sigma_distance=3.6)
    assert outcome(wrong) == "wrong, not flagged"
    assert outcome(replace(wrong, degenerate=True)) == "wrong, flagged"
    assert outcome(replace(wrong, sigma_distance=3.4)) == "undecided"
    assert outcome(replace(wrong, sigma_distance=np.nan)) == "wrong, not flagged"
    assert outcome(replace(wrong, failed=True)) == "no estimate"


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (8.6603, "8.66"),
        (0.0123456, "0.0123"),
        (123.4, "123"),
        (0, "0"),
        (np.nan, "–"),
        (2e-6, "2.0e-06"),
    ],
)
def test_numbers(value, text):
    assert number_text(value) == text


def test_axes_tell_small_errors_apart_and_never_end_below_the_limit():
    assert axis_top([0.1, 0.1, 0.12], 0.5) == 0.75
    assert axis_top([0.1] * 5 + [40.0] * 5, 0.5) == 3.0
    assert axis_top([8.0, 9.0], 0.5) > 8.0
