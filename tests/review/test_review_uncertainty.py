from __future__ import annotations

from dataclasses import replace

import numpy as np
from box_room import load_arm
from scipy.spatial.transform import Rotation

from lcdata.geometry import se3
from lcdata.groundtruth.chain import arm_truth
from lcdata.review import names, uncertainty


def test_ellipsoids_are_three_sigma_of_the_cameras_place_by_the_stated_scale(rrd, dataset):
    half = rrd.rows("/" + names.UNCERTAINTY, "Ellipsoids3D:half_sizes")
    turned = rrd.rows("/" + names.UNCERTAINTY, "Ellipsoids3D:quaternions")
    scale = uncertainty.scale_of(dataset.poses)
    for number, record in enumerate(dataset.pairs):
        R = Rotation.from_quat(turned[number][0]).as_matrix()
        covariance = R @ np.diag(np.square(np.array(half[number][0]) / (3 * scale))) @ R.T
        expected = dataset.pose(record.pose_id).covariance[:3, :3]
        np.testing.assert_allclose(covariance, expected, atol=1e-3 * expected.max())
    assert 0.1 <= np.median([np.max(h) for h in half.values()]) < 1.0
    text = rrd.static("/summary", "TextDocument:text")[0]
    assert f"3 sigma of the ground truth's own uncertainty, drawn {scale} times" in text


def test_samples_of_the_camera_lie_in_the_ellipsoid(dataset):
    """The covariance of the camera's place, from perturbed extrinsics."""
    pose = dataset.poses[0]
    rng = np.random.default_rng(0)
    places = []
    for xi in rng.multivariate_normal(np.zeros(6), pose.covariance, 4000):
        T_camera_true = pose.T_camera_lidar @ se3.inverse(se3.exp(xi) @ pose.T_camera_lidar)
        places.append(T_camera_true[:3, 3])
    axes, R = uncertainty.ellipsoid(pose.covariance)
    inside = np.linalg.norm(np.array(places) @ R / axes, axis=1) < 3
    assert 0.96 < inside.mean() < 0.98  # 97.1 % of a normal distribution in three dimensions


def test_the_text_says_where_it_comes_from_where_that_is_known(dataset):
    pose = dataset.poses[0]
    assert uncertainty.budget_text(pose) == ""
    truth = arm_truth(dataset.rig, load_arm(dataset.rig), pose.joint_positions)
    text = uncertainty.budget_text(replace(pose, budget=truth.budget))
    assert "joint offsets" in text
    assert "clock" not in text


def test_nothing_is_drawn_where_nothing_is_known(dataset):
    unknown = [replace(p, covariance=np.full((6, 6), np.nan)) for p in dataset.poses]
    assert uncertainty.scale_of(unknown) == 0
    assert uncertainty.legend(0) == ""
