"""Both links from the lines of all poses, in a synthetic room with exact truth."""

from __future__ import annotations

import handeye_dataset
import numpy as np
import pytest

from lcdata.errors import GroundTruthError
from lcdata.evaluation.handeye import encoder_covariances, hand_measured, refine
from lcdata.evaluation.handeye_direct import solve_features
from lcdata.features.line_features import LineFeatures
from lcdata.features.matching import project_segments
from lcdata.geometry import se3
from lcdata.groundtruth.handeye import Joints
from lcdata.groundtruth.handeye_problem import Problem, State

POSES = 10


def room(rng):
    """(M, 2, 3) edges of a hall and of boxes in it, in the LiDAR frame."""
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) / 2
    edges = [(i, j) for i in range(8) for j in range(i + 1, 8) if (i ^ j).bit_count() == 1]
    found = []
    for k in range(60):
        size = np.array([30, 24, 5.0]) if k == 0 else rng.uniform(0.4, 2.5, 3)
        away, azimuth = rng.uniform(3, 12), rng.uniform(-np.pi, np.pi)
        middle = [away * np.cos(azimuth), away * np.sin(azimuth), rng.uniform(-1.5, 2)]
        turn = se3.exp([0, 0, 0, 0, 0, rng.uniform(0, 3)])[:3, :3]
        placed = corners * size @ turn.T + (np.zeros(3) if k == 0 else middle)
        found += [placed[[i, j]] for i, j in edges]
    return np.array(found)


def seen(rng, segments, T, noise=0.5):
    """Features of a pose: noise on both sides, lines that are missing, and clutter."""
    sigma = np.full(len(segments), 0.005)
    blank = LineFeatures(handeye_dataset.CAMERA, np.zeros((0, 4)), segments, sigma, {})
    _, lines = project_segments(blank, T)
    lines = lines[rng.random(len(lines)) < 0.7]
    lines = lines + rng.normal(size=lines.shape) * noise
    start = rng.uniform([0, 0], [1280, 720], (30, 2))
    clutter = np.concatenate([start, start + rng.normal(size=(30, 2)) * 60], 1)
    lines = np.concatenate([lines.reshape(-1, 4), clutter])
    measured = segments + rng.normal(size=segments.shape) * 0.005
    return LineFeatures(handeye_dataset.CAMERA, lines, measured, sigma, {})


@pytest.fixture
def scene(tmp_path):
    """A data set's problem, its features, and the truth."""
    rng = np.random.default_rng(0)
    dataset = handeye_dataset.make(tmp_path / "dataset", poses=POSES)
    segments = room(rng)
    true = handeye_dataset.truth(dataset)
    features = [[seen(rng, segments, T)] for T in true]
    A = np.array([pose.T_effector_base for pose in dataset.poses])
    prior = hand_measured(dataset)
    encoders = encoder_covariances(dataset, dataset.load_arm(), dataset.poses)
    return dataset, features, Problem(A, A, prior), encoders, true


def errors(T, true):
    """(N, 2) mm and deg."""
    pairs = zip(T, true, strict=True)
    return np.array(
        [
            (1e3 * se3.translation_error(a, b), np.rad2deg(se3.rotation_error(a, b)))
            for a, b in pairs
        ]
    )


def test_lines_refine_the_hand_measurement_without_any_estimate(scene):
    _, features, problem, encoders, true = scene
    prior = problem.prior
    start = State(prior.T_camera_effector, prior.T_base_lidar, np.zeros(0))
    found = solve_features(features, problem, encoders, start)
    before = np.median(errors(problem.predict(start), true), axis=0)
    after = errors(found.extrinsic(problem.A), true)
    assert (np.median(after, axis=0) < before / 3).all()
    assert (np.median(after, axis=0) < [2.0, 0.05]).all()
    assert found.outliers == found.failed == ()
    xi = np.array(
        [se3.log(b @ se3.inverse(a)) for a, b in zip(found.extrinsic(problem.A), true, strict=True)]
    )
    squares = np.einsum(
        "ni,nij,nj->n", xi, np.linalg.inv(found.extrinsic_covariance(problem.A)), xi
    )
    assert squares.mean() / 6 < 2.5


def test_a_pose_without_lines_is_named_and_a_wrong_one_costs_little(scene):
    _, features, problem, encoders, true = scene
    rng = np.random.default_rng(3)
    blank = features[2][0]
    none = LineFeatures(blank.camera, np.zeros((0, 4)), blank.segments, blank.sigma, {})
    moved = se3.exp([0.03, 0, 0, 0, 0, np.deg2rad(0.25)])
    features[2] = [none]
    features[5] = [seen(rng, features[5][0].segments, moved @ true[5])]
    start = State(problem.prior.T_camera_effector, problem.prior.T_base_lidar, np.zeros(0))
    found = solve_features(features, problem, encoders, start)
    assert found.failed == (2,)
    assert found.outliers == (5,)
    assert np.isnan(found.residuals.mm[2])
    assert np.nanargmax(found.left_out.deg) == 5
    good = np.delete(np.arange(POSES), [2, 5])
    assert errors(found.extrinsic(problem.A), true)[good].max(axis=0)[1] < 0.1
    with pytest.raises(GroundTruthError, match="no pose has"):
        solve_features([[none]] * POSES, problem, encoders, start)


def test_joint_offsets_are_found_too(scene, tmp_path):
    dataset, _, problem, encoders, _ = scene
    rng = np.random.default_rng(4)
    arm = dataset.load_arm()
    offsets = np.deg2rad([0.0, 0.6, -0.5, 0.4, 0.5, 0.0])
    q = np.array([pose.joint_positions for pose in dataset.poses])
    nominal = handeye_dataset.truth(dataset)
    wrong = se3.inverse(arm.chain().forward(q))
    right = se3.inverse(arm.chain().forward(q + offsets))
    mounts = handeye_dataset.true_mounts(dataset.rig, 1)
    true = mounts.T_camera_effector @ right @ mounts.T_base_lidar
    np.testing.assert_allclose(
        nominal, mounts.T_camera_effector @ wrong @ mounts.T_base_lidar, atol=1e-9
    )
    segments = room(rng)
    features = [[seen(rng, segments, T)] for T in true]
    joints = Joints(arm, q, 0.5)
    start = State(problem.prior.T_camera_effector, problem.prior.T_base_lidar, np.zeros(6))
    found = solve_features(
        features, Problem(problem.A, problem.A, problem.prior, joints), encoders, start
    )
    fixed = se3.inverse(arm.chain().forward(q + found.joint_offsets))
    assert (np.median(errors(found.extrinsic(fixed), true), axis=0) < [3.0, 0.06]).all()
    assert found.full_covariance.shape == (18, 18)


def test_a_data_set_without_estimates_or_lines_says_so(tmp_path):
    dataset = handeye_dataset.make(tmp_path / "dataset")
    with pytest.raises(GroundTruthError, match="no pose has"):
        refine(dataset, direct=True)
