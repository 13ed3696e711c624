"""A refined rig: does the ground truth that it makes know how wrong it is?"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import handeye_dataset
import numpy as np
import pytest

from lcdata.arm import Arm, read_joint_offsets
from lcdata.dataset import Dataset, regenerate, schema
from lcdata.dataset.atomic import write_json
from lcdata.dataset.schema import DatasetInfo
from lcdata.errors import GroundTruthError, RigError
from lcdata.evaluation.handeye import refine
from lcdata.evaluation.refined_rig import check_target, offsets_path, write_refined_rig
from lcdata.evaluation.refinement import Refinement
from lcdata.geometry import se3
from lcdata.groundtruth.chain import arm_truths
from lcdata.groundtruth.handeye import HandEye, Joints, Prior, solve
from lcdata.groundtruth.twists import adjoint_many
from lcdata.rig import Rig, load_rig
from lcdata.simulation.mounts import default_rig, joint_offsets, true_mounts

OFFSETS_DEG = 0.3
STD = np.repeat([0.01, np.deg2rad(0.1)], 3)
"""Metres and radians of a simulated estimate."""


def made(path, std_deg: float) -> Dataset:
    dataset = handeye_dataset.make(path, rig=default_rig(std_deg))
    handeye_dataset.store(dataset)
    return dataset


@pytest.mark.parametrize(("std_deg", "solved"), [(0.0, False), (0.3, False), (0.3, True)])
def test_the_refined_rig_makes_the_covariance_of_the_refinement(tmp_path, std_deg, solved):
    dataset = made(tmp_path / "dataset", std_deg)
    found = refine(dataset, joint_offsets=solved)
    write_refined_rig(found, tmp_path / "refined.yaml")
    regenerate(dataset, tmp_path / "refined.yaml")
    poses = Dataset.open(dataset.path).poses
    covariances = np.array([pose.covariance for pose in poses])
    scale = np.abs(covariances).max()
    np.testing.assert_allclose(covariances, found.covariances(), rtol=0, atol=1e-9 * scale)
    np.testing.assert_allclose(
        [pose.T_camera_lidar for pose in poses], found.extrinsics(), atol=1e-9
    )

    # The same from the solution's own covariance, link by link.
    X, arm = found.found.T_camera_effector, found.refined_arm
    q = arm.with_offsets([pose.joint_positions for pose in poses])
    forward, J = arm.chain().jacobians(q)
    by_joints = se3.adjoint(X) @ J
    parts = [np.broadcast_to(np.eye(6), (len(q), 6, 6)), adjoint_many(X @ se3.inverse(forward))]
    parts += [-by_joints] if solved else []
    C = np.concatenate(parts, axis=2)
    encoders = np.deg2rad(dataset.rig.arm.encoder_std_deg) ** 2
    unsolved = 0 if solved else np.deg2rad(std_deg) ** 2
    by_hand = C @ found.found.full_covariance @ C.transpose(0, 2, 1)
    by_hand = by_hand + by_joints @ by_joints.transpose(0, 2, 1) * (encoders + unsolved)
    np.testing.assert_allclose(covariances, by_hand, rtol=0, atol=1e-9 * scale)

    source = "links_and_joint_offsets" if solved else "links"
    assert poses[0].budget[source].trace() > 0
    assert "T_camera_effector" not in poses[0].budget
    # Independent links with the same deviations would be known far worse.
    apart = C * np.sqrt(np.diag(found.found.full_covariance))
    apart = np.einsum("nii->n", (apart @ apart.transpose(0, 2, 1))[:, :3, :3])
    assert np.mean(apart) > 3 * np.mean([p.budget[source][:3, :3].trace() for p in poses])


def test_joint_offsets_go_into_a_file_beside_the_rig(tmp_path):
    found = refine(made(tmp_path / "dataset", 0.5), joint_offsets=True)
    path = tmp_path / "refined.yaml"
    write_refined_rig(found, path)
    rig = load_rig(path)
    np.testing.assert_allclose(rig.T_camera_effector.T, found.found.T_camera_effector, atol=1e-11)
    assert set(read_joint_offsets(offsets_path(path))) == set(found.arm.joint_names)
    refined = rig.load_arm()
    np.testing.assert_allclose(
        [refined.joint_offsets[name] for name in found.arm.joint_names],
        found.found.joint_offsets,
        atol=1e-12,
    )
    np.testing.assert_allclose(
        refined.offset_covariance, found.found.full_covariance[12:, 12:], rtol=1e-9
    )
    text = path.read_text()
    assert text.startswith("# Links refined by `lcdata handeye` from projection at 12 poses")
    with pytest.raises(RigError, match="refined with its own joint offsets"):
        regenerate(found.dataset, path, arm_offsets=offsets_path(path))


def test_a_rig_file_is_not_replaced_unasked(tmp_path):
    path = tmp_path / "refined.yaml"
    check_target(path, force=False)
    offsets_path(path).touch()
    with pytest.raises(RigError, match="refined_joint_offsets"):
        check_target(path, force=False)
    check_target(path, force=True)


def refined_from(rig: Rig, arm: Arm, q, T, *, joints: bool) -> HandEye:
    """`evaluation.handeye.refine` of estimates that are not stored."""
    A = se3.inverse(arm.chain().forward(arm.with_offsets(q)))
    J = se3.adjoint(rig.T_camera_effector.T) @ arm.chain().jacobians(arm.with_offsets(q))[1]
    encoders = J @ J.transpose(0, 2, 1) * np.deg2rad(rig.arm.encoder_std_deg) ** 2
    return solve(
        A,
        T,
        weights=np.diag(STD**2) + encoders,
        prior=Prior.of_rig(rig),
        joints=Joints(arm, q, rig.arm.joint_offset_std_deg) if joints else None,
    )


@pytest.mark.parametrize("std_deg", [0.0, pytest.param(OFFSETS_DEG, marks=pytest.mark.slow)])
def test_the_covariance_of_refined_rigs_is_that_of_their_errors(std_deg):
    """60 towers off their rig by its deviations, refined from 12 poses, judged at 12 others."""
    rig = default_rig(std_deg)
    arm, squares = rig.load_arm(), []
    for seed in range(60):
        rng = np.random.default_rng([seed, 11])
        mounts, offsets = true_mounts(rig, seed), joint_offsets(arm, seed, std_deg)
        q = handeye_dataset.positions(24, seed)
        read = q - offsets + rng.normal(0, np.deg2rad(rig.arm.encoder_std_deg), q.shape)
        true = mounts.T_camera_effector @ se3.inverse(arm.chain().forward(q)) @ mounts.T_base_lidar
        T = np.array([se3.exp(xi) for xi in rng.normal(size=(12, 6)) * STD]) @ true[:12]
        found = refined_from(rig, arm, read[:12], T, joints=std_deg > 0)
        refined = Refinement(dataset_of(rig), "", arm, (), found)
        zeros = np.zeros((12, 6))
        for truth, T_true in zip(
            arm_truths(
                refined.rig, refined.refined_arm, read[12:], zeros, zeros[:, 0], zeros[:, 0]
            ),
            true[12:],
            strict=True,
        ):
            error = se3.log(T_true @ se3.inverse(truth.T_camera_lidar))
            squares.append(error @ np.linalg.solve(truth.covariance, error) / 6)
    print(f"\njoint offsets {std_deg} deg: mean normalised squared error {np.mean(squares):.3f}")
    assert 0.8 < np.mean(squares) < 1.25


def dataset_of(rig: Rig) -> Dataset:
    """A data set of no recordings, of which only its rig is asked."""
    info = DatasetInfo(rig.to_dict(), None, (), {}, simulated=True)
    return Dataset(Path(), info, (), ())


@pytest.mark.parametrize("joints", [False, True])
def test_a_second_refinement_goes_on_from_all_that_the_first_knew(joints):
    """Exact estimates of 8 poses, then of 8 others: the same covariance as from all 16 at once."""
    rig = default_rig(OFFSETS_DEG if joints else 0.0)
    arm, q = rig.load_arm(), handeye_dataset.positions(16)
    A = se3.inverse(arm.chain().forward(q))
    T = rig.T_camera_effector.T @ A @ rig.T_base_lidar.T
    at_once = refined_from(rig, arm, q, T, joints=joints)
    first = refined_from(rig, arm, q[:8], T[:8], joints=joints)
    between = Refinement(dataset_of(rig), "", arm, (), first)
    second = refined_from(between.rig, between.refined_arm, q[8:], T[8:], joints=joints)
    scale = np.sqrt(np.diag(at_once.full_covariance))
    np.testing.assert_allclose(
        second.full_covariance / np.outer(scale, scale),
        at_once.full_covariance / np.outer(scale, scale),
        atol=2e-3,
    )
    # Deviations of each link alone, the correlations left out, claim what nobody knows.
    alone = replace(Prior.of_rig(between.rig), covariance=None)
    claimed = solve(
        A[8:],
        T[8:],
        weights=np.tile(np.diag(STD**2), (8, 1, 1)),
        prior=alone,
        joints=Joints(arm, q[8:], OFFSETS_DEG) if joints else None,
    )
    assert np.trace(claimed.covariance) < 0.95 * np.trace(at_once.covariance)


def test_other_recordings_go_on_from_a_refined_rig_and_the_same_do_not(tmp_path):
    first = refine(made(tmp_path / "first", OFFSETS_DEG), joint_offsets=True)
    write_refined_rig(first, tmp_path / "refined.yaml")
    assert len(load_rig(tmp_path / "refined.yaml").links_refined_from) == 1
    regenerate(first.dataset, tmp_path / "refined.yaml")
    with pytest.raises(GroundTruthError, match="were refined from gym already"):
        refine(Dataset.open(first.dataset.path))

    refined = Dataset.open(first.dataset.path)
    later = replace(refined.info, sources=({"scenario": "gym", "fingerprint": "f" * 64},))
    write_json(refined.path / schema.INFO, later.to_dict())
    second = refine(Dataset.open(refined.path))  # its joint offsets again, unasked
    assert len(second.found.joint_offsets) == 6
    assert len(second.rig.links_refined_from) == 2
    before, after = (np.trace(one.found.full_covariance) for one in (first, second))
    assert after < 0.9 * before
