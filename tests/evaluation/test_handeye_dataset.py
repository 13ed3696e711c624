"""Hand-eye refinement of a data set on disk."""

from __future__ import annotations

import dataclasses
import json
from dataclasses import replace

import handeye_dataset
import numpy as np
import pytest

from lcdata.dataset import schema
from lcdata.dataset.atomic import write_json
from lcdata.errors import DatasetError, GroundTruthError
from lcdata.evaluation.handeye import gather, refine
from lcdata.evaluation.refinement import describe
from lcdata.evaluation.results import read_run, results_path, write_run
from lcdata.geometry import se3


@pytest.fixture
def dataset(tmp_path):
    made = handeye_dataset.make(tmp_path / "dataset")
    handeye_dataset.store(made)
    return made


def off(T, true):
    """Median (mm, deg)."""
    errors = [
        (1e3 * se3.translation_error(a, b), np.rad2deg(se3.rotation_error(a, b)))
        for a, b in zip(T, true, strict=True)
    ]
    return np.median(errors, axis=0)


def test_the_ground_truth_error_falls_to_a_third(dataset):
    true = handeye_dataset.truth(dataset)
    before = off([pose.T_camera_lidar for pose in dataset.poses], true)
    found = refine(dataset)
    assert (off(found.extrinsics(), true) < before / 3).all()
    assert found.source == "projection"
    now, refined = found.sigma()
    assert refined < now


def test_wrong_poses_are_named_and_failed_ones_too(dataset):
    handeye_dataset.store(dataset, wrong=(3,))
    path = results_path(dataset, "projection")
    trials = read_run(path).trials
    write_run(
        path,
        [replace(t, converged=t.converged and t.pose_id != "gym/pose_005") for t in trials],
    )
    content = describe(refine(dataset))
    assert content["outliers"] == ["gym/pose_003"]
    assert content["failed"] == ["gym/pose_005"]
    assert content["residuals"][3]["mm"] > 400
    json.dumps(content)


def test_one_estimate_a_pose_is_the_one_that_most_trials_have(dataset):
    path = results_path(dataset, "projection")
    trials = read_run(path).trials
    far = se3.exp([1, 0, 0, 0, 0, 0.2])
    odd = replace(
        trials[0], trial=9, T_camera_lidar_estimated=far @ trials[0].T_camera_lidar_estimated
    )
    before = gather(dataset, dataset.poses, None, None)
    write_run(path, [*trials, odd])
    after = gather(dataset, dataset.poses, None, None)
    np.testing.assert_allclose(after.T, before.T, atol=1e-9)
    np.testing.assert_allclose(after.covariances[0], np.diag(handeye_dataset.STD**2))


def test_the_method_with_most_poses_is_taken_unless_one_is_named(dataset):
    handeye_dataset.store(dataset, "other")
    path = results_path(dataset, "other")
    write_run(path, read_run(path).trials[:10])
    assert refine(dataset).source == "projection"
    assert refine(dataset, method="other").source == "other"
    assert refine(dataset, run="other").source == "other"


def test_a_method_without_covariances_counts_all_poses_alike(dataset):
    path = results_path(dataset, "projection")
    unknown = np.full((6, 6), np.nan)
    write_run(path, [replace(t, covariance=unknown) for t in read_run(path).trials])
    true = handeye_dataset.truth(dataset)
    before = off([pose.T_camera_lidar for pose in dataset.poses], true)
    assert (off(refine(dataset).extrinsics(), true) < before / 2).all()


def test_what_cannot_be_refined_is_named(dataset):
    with pytest.raises(GroundTruthError, match="no stored estimates of plk"):
        refine(dataset, method="plk")
    with pytest.raises(GroundTruthError, match="joint_offset_std_deg is 0"):
        refine(dataset, joint_offsets=True)
    path = results_path(dataset, "projection")
    trials = read_run(path).trials
    write_run(path, [replace(t, converged=False) for t in trials])
    with pytest.raises(GroundTruthError, match="all 12 estimates failed"):
        refine(dataset)
    write_run(path, trials[:2])
    with pytest.raises(GroundTruthError, match="1 of 12 poses"):
        refine(dataset)
    path.unlink()
    with pytest.raises(GroundTruthError, match="lcdata calibrate"):
        refine(dataset)


def test_a_data_set_without_an_arm_is_refused(tmp_path):
    from toy_dataset import make

    with pytest.raises(GroundTruthError, match="without an arm"):
        refine(make(tmp_path / "static"))


def test_an_arm_model_that_changed_since_is_refused(dataset):
    changed = {**dataset.info.arm, "sha256": "0" * 64}
    info = dataclasses.replace(dataset.info, arm=changed)
    write_json(dataset.path / schema.INFO, info.to_dict())
    with pytest.raises(DatasetError, match="000000"):
        refine(type(dataset).open(dataset.path))
