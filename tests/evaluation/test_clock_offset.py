"""The clock offset between arm and camera; its figures are in `benchmarks/clock_offset.py`."""

from __future__ import annotations

import numpy as np
import pytest

from lcdata.errors import GroundTruthError
from lcdata.evaluation import clock_offset as module
from lcdata.evaluation.clock_offset import clock_offset
from lcdata.rig import Rig, load_rig


def test_too_few_images_in_motion_are_named(sample_recordings):
    rig = load_rig(sample_recordings / "rig.yaml")
    with pytest.raises(GroundTruthError, match=r"\d images in motion, 3 are needed"):
        clock_offset(sample_recordings / "gym", rig)


def test_a_rig_without_an_arm_has_one_clock(sample_recordings):
    static = Rig.from_dict({"ground_truth": "static"})
    with pytest.raises(GroundTruthError, match="without an arm"):
        clock_offset(sample_recordings / "gym", static)


def test_images_are_chosen_by_speed():
    joint_ns = np.arange(0, 10_000_000_000, 10_000_000)
    angle = np.where(joint_ns < 5e9, 0.0, (joint_ns - 5e9) * 1e-9 * 0.5)
    read = module.Survey(
        np.zeros(0, np.int64),
        np.arange(500_000_000, 10_000_000_000, 1_000_000_000),
        joint_ns,
        np.column_stack([angle, 0 * angle]),
        None,
    )
    stamps, positions, velocities = module._chosen(read, 3)
    moving = velocities[:, 0] > 0.4
    assert (moving.sum(), len(stamps)) == (3, 6)
    np.testing.assert_allclose(velocities[moving, 0], 0.5, atol=1e-6)
    np.testing.assert_allclose(positions[moving, 0], (stamps[moving] - 5e9) * 0.5e-9, atol=1e-9)
