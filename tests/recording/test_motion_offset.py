"""The clock offset from images of the moving arm, piece by piece, on simulated input."""

from __future__ import annotations

from itertools import pairwise

import cv2
import numpy as np
import pytest

from lcdata.arm import Arm
from lcdata.geometry import se3
from lcdata.geometry.camera import Camera
from lcdata.recording import clock_offset
from lcdata.recording.clock_offset import ClockOffset
from lcdata.recording.clock_report import ClockReport, with_consequence
from lcdata.recording.dwells import find_dwells
from lcdata.recording.image_motion import Turn, gray, turn
from lcdata.recording.joint_path import JointPath
from lcdata.recording.plan import plan_poses
from lcdata.recording.survey import Survey
from lcdata.rig import Rig

RIG = Rig.from_dict(
    {
        "arm": {"joint_offset_std_deg": 0.5},
        "T_camera_effector": {
            "translation_m": [0.06, 0.04, -0.03],
            "rotation_rpy_deg": [1.5, -2.0, 90.0],
            "translation_std_m": 0.003,
            "rotation_std_deg": 0.3,
        },
        "T_base_lidar": {"translation_m": [0, 0, 1], "rotation_rpy_deg": [0, 0, 0]},
    }
)
CAMERA = Camera("pinhole", 640, 360, (264.0, 264.0, 320.0, 180.0))


@pytest.fixture(scope="module")
def arm() -> Arm:
    return RIG.load_arm()


def run_of_the_arm(seed: int = 0, poses: int = 3) -> Survey:
    """Dwells of 2 s, motions of 1.6 s, joints at 100 Hz, scans and images at 10 Hz."""
    rng = np.random.default_rng(seed)
    goals = rng.uniform(-0.7, 0.7, (poses, 6))
    seconds = np.arange(0, 3.6 * poses - 1.6, 0.01)
    share = np.clip((seconds % 3.6 - 2.0) / 1.6, 0, 1)
    share = share**3 * (10 - 15 * share + 6 * share**2)
    index = (seconds // 3.6).astype(int)
    after = goals[np.minimum(index + 1, poses - 1)]
    q = goals[index] + share[:, None] * (after - goals[index])
    stamps = 10**18 + (seconds * 1e9).astype(np.int64)
    return Survey(stamps[::10], stamps[3::10], stamps, q, None)


@pytest.mark.parametrize("travel", [[0.0, 0.0, 0.0], [1.0, 0.2, 0.1]])
def test_the_turn_between_two_images_is_found(travel):
    rng = np.random.default_rng(1)
    image = cv2.GaussianBlur(rng.integers(0, 255, (360, 640), np.uint8), (0, 0), 3)
    image = cv2.normalize(image, None, 0, 255, cv2.NORM_MINMAX)
    R = se3.exp([0, 0, 0, 0.02, -0.05, 0.03])[:3, :3]
    second = cv2.warpPerspective(image, CAMERA.K @ R @ np.linalg.inv(CAMERA.K), (640, 360))
    found = turn(gray(image), gray(second), CAMERA, np.array(travel))
    T = np.eye(4)
    T[:3, :3] = found.R @ R.T
    apart = np.rad2deg(np.linalg.norm(se3.log(T)[3:]))
    assert apart < 0.03
    assert np.sqrt(np.trace(found.covariance)) < np.deg2rad(0.03)


def test_images_without_content_show_no_turn():
    flat = np.full((360, 640), 90, np.uint8)
    assert turn(gray(flat), gray(flat), CAMERA, np.zeros(3)) is None


def turns_of(survey: Survey, arm: Arm, offset_s: float, rng: np.random.Generator):
    """What images would show of an arm whose mount and joints are not quite the rig's."""
    path = JointPath.of(survey)
    stamps = path.images(survey.image_ns, 48)
    pairs = np.array([(a, b) for a, b in pairwise(stamps) if b - a < 2.5e8])
    model = clock_offset._Model(path, arm, RIG.T_camera_effector.T, pairs)
    mount, joints = rng.normal(0, np.deg2rad(0.3), 3), rng.normal(0, np.deg2rad(0.5), 6)
    T = model.predict(np.concatenate([[offset_s], mount, joints]))
    sigma = np.deg2rad(0.03)
    noise = np.zeros((len(T), 6))
    noise[:, 3:] = rng.normal(0, sigma, (len(T), 3))
    return model, [
        Turn((se3.exp(n) @ t)[:3, :3], sigma**2 * np.eye(3)) for n, t in zip(noise, T, strict=True)
    ]


def test_the_offset_is_as_certain_as_it_says(arm):
    errors = []
    for seed, offset in enumerate(np.linspace(-0.6, 0.6, 10)):
        rng = np.random.default_rng(seed)
        model, turns = turns_of(run_of_the_arm(seed), arm, offset, rng)
        found, std, used = clock_offset._fit(model, turns, clock_offset._stds(RIG))
        assert std < 0.002
        assert used > 0.9 * len(turns)
        errors.append((found - offset) / std)
    assert np.abs(errors).max() < 3.5
    assert 0.1 < np.mean(np.square(errors)) < 2  # 0.7 is expected, as kinematics are exact here


def test_wrong_turns_cost_little_and_another_motion_is_none(arm):
    rng = np.random.default_rng(5)
    model, turns = turns_of(run_of_the_arm(5), arm, 0.05, rng)
    for k in range(0, len(turns), 6):
        turns[k] = Turn(se3.exp([0, 0, 0, *rng.normal(0, 0.1, 3)])[:3, :3], turns[k].covariance)
    found, std, _ = clock_offset._fit(model, turns, clock_offset._stds(RIG))
    assert found == pytest.approx(0.05, abs=4 * std)
    other = [Turn(t.R, t.covariance) for t in turns_of(run_of_the_arm(9), arm, 0.0, rng)[1]]
    assert clock_offset._fit(model, other[: len(turns)], clock_offset._stds(RIG)) is None


def report_of(offset_s: float, arm: Arm, applied_s: float = 0.0) -> ClockReport:
    survey = run_of_the_arm()
    plans = plan_poses(
        "run", survey, find_dwells(survey.joint_ns, survey.positions, RIG.dwells), tolerance_ms=50
    )
    measured = ClockOffset(offset_s, 0.001, 30, 0, 0)
    return with_consequence(ClockReport(measured, applied_s), survey, plans, arm, RIG)


def test_an_offset_matters_where_it_moves_the_camera(arm):
    small, large = report_of(0.02, arm), report_of(0.4, arm)
    assert not small.warning
    assert "no pair is affected" in small.line
    assert large.moved.pairs >= 2
    assert large.moved.mm > 10
    for word in ("+400.0 +- 1.0 ms", f"{large.moved.pairs} of the images", "clock_offset_s"):
        assert word in large.warning
    assert not report_of(0.4, arm, applied_s=0.4).warning
    assert "beyond the rig's -200.0 ms" in report_of(0.4, arm, applied_s=-0.2).warning


def test_what_was_asked_for_and_cannot_be_measured_is_named():
    report = ClockReport(None, 0.0, "0 pairs of neighbouring images", asked=True)
    assert "0 pairs of neighbouring images; nothing was taken out" in report.warning
    assert not ClockReport(None, 0.0, "no images").warning
    assert report.to_dict()["offset_s"] is None
