"""Stored results after the ground truth has moved: whose errors, whose initial guesses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pyarrow.parquet as pq
import pytest
import toy_dataset
from toy_methods import Biased, Blobs

from lcdata.dataset import Dataset, schema
from lcdata.evaluation import read_results, run_trials, stale_trials, update_results

NEAR, FAR = np.array([0.02, 0, 0, 0, 0, 0.002]), np.array([0.4, 0, 0, 0, 0, 0])
"""Twists by which a ground truth is off: known to some millimetres, and plainly wrong."""


def test_a_pose_that_moves_leaves_the_trials_of_others_as_they_are(dataset: Dataset) -> None:
    run_trials(dataset, [Blobs()], jobs=0)
    first, *others = dataset.poses
    poses = [replace(first, covariance=2 * first.covariance), *others]
    moved = toy_dataset.write_truth(dataset.path, dataset.info, poses)
    assert moved.info.groundtruth_version != dataset.info.groundtruth_version
    assert stale_trials(moved) == 2  # its pairs
    Blobs.prepared.clear()
    run_trials(moved, [Blobs()], jobs=0)
    assert len(Blobs.prepared) == 2
    assert stale_trials(moved) == 0


def test_a_pose_that_is_added_makes_no_trial_stale(dataset: Dataset) -> None:
    run_trials(dataset, [Blobs()], jobs=0)
    later = replace(dataset.poses[0], pose_id="hall/pose_009")
    more = toy_dataset.write_truth(dataset.path, dataset.info, [*dataset.poses, later])
    assert more.info.groundtruth_version != dataset.info.groundtruth_version
    assert stale_trials(more) == 0


def test_a_data_set_without_versions_of_poses_has_one_for_all(dataset: Dataset) -> None:
    path = dataset.path / schema.POSES
    pq.write_table(pq.read_table(path).drop_columns(["pose_version"]), path)
    old = Dataset.open(dataset.path)
    assert {p.pose_version for p in old.poses} == {old.info.groundtruth_version}
    run_trials(old, [Blobs()], jobs=0)
    assert stale_trials(old) == 0
    Blobs.prepared.clear()
    run_trials(old, [Blobs()], jobs=0)
    assert not Blobs.prepared


def test_guesses_that_are_still_as_far_off_count_and_other_methods_share_them(
    dataset: Dataset,
) -> None:
    run_trials(dataset, [Blobs()], jobs=0)
    before = {t.pair_ids: t.T_camera_lidar_initial for t in read_results(dataset).trials}
    moved = toy_dataset.move_truth(dataset, NEAR)
    assert update_results(moved) == (8, 0)
    stored = read_results(moved).trials
    assert all(t.rebased for t in stored)
    assert stored[0].initial_translation_error_m != pytest.approx(np.sqrt(3) * 0.5, abs=1e-6)
    Blobs.prepared.clear()
    both = run_trials(moved, [Blobs(), Biased(smallest=3)], jobs=0).trials
    assert len(Blobs.prepared) == 8  # for the other method alone
    assert len(both) == 16 and all(t.rebased for t in both)
    for t in both:
        np.testing.assert_allclose(t.T_camera_lidar_initial, before[t.pair_ids], atol=1e-12)
    back = toy_dataset.write_truth(dataset.path, dataset.info, list(dataset.poses))
    update_results(back)
    assert not any(t.rebased for t in read_results(back).trials if t.method == "blobs")


def test_guesses_of_a_ground_truth_that_was_plainly_wrong_are_made_again(dataset: Dataset) -> None:
    run_trials(dataset, [Blobs()], jobs=0)
    moved = toy_dataset.move_truth(dataset, FAR)
    assert update_results(moved) == (8, 0)
    errors = [t.initial_translation_error_m for t in read_results(moved).trials]
    assert np.ptp(errors) > 0.3
    again = run_trials(moved, [Blobs()], jobs=0).trials
    assert not any(t.rebased for t in again)
    np.testing.assert_allclose([t.initial_translation_error_m for t in again], 0.5 * np.sqrt(3))
