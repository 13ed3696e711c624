from __future__ import annotations

import time

import numpy as np
import pytest

from lcdata.recording.dwells import Dwell, find_dwells, speed
from lcdata.rig import Dwells

RULES = Dwells()
START = 1_700_000_000_000_000_000


def arm_run(
    poses: int, dwell_s: float, move_s: float, *, noise_deg: float = 0.02, rate: float = 100.0
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Stamps (ns), positions (rad) with noise, and the poses' true positions."""
    rng = np.random.default_rng(0)
    goals = rng.uniform(-2, 2, (poses, 6))
    t = np.arange(0, poses * dwell_s + (poses - 1) * move_s, 1 / rate)
    pose = np.minimum((t // (dwell_s + move_s)).astype(int), poses - 1)
    s = np.clip((t - pose * (dwell_s + move_s) - dwell_s) / move_s, 0, 1)
    s = (s**3 * (10 - 15 * s + 6 * s**2))[:, None]
    q = goals[pose] + s * (goals[np.minimum(pose + 1, poses - 1)] - goals[pose])
    q = q + np.deg2rad(rng.normal(0, noise_deg, q.shape))
    return START + np.round(t * 1e9).astype(np.int64), q, goals


@pytest.mark.parametrize(
    ("noise_deg", "rate"),
    [(0.0, 20.0), (0.02, 20.0), (0.0, 100.0), (0.02, 100.0), (0.05, 100.0), (0.05, 500.0)],
)
def test_every_stop_is_a_dwell_and_lies_inside_it(noise_deg: float, rate: float) -> None:
    stamps, q, goals = arm_run(7, 3.0, 2.0, noise_deg=noise_deg, rate=rate)
    dwells = find_dwells(stamps, q, RULES)
    assert [d.index for d in dwells] == list(range(7))
    for dwell, goal in zip(dwells, goals, strict=True):
        begin = START + dwell.index * 5_000_000_000
        assert begin <= dwell.start_ns and dwell.end_ns <= begin + 3_000_000_000
        assert dwell.duration_s > 2.0
        np.testing.assert_allclose(np.rad2deg(dwell.positions_mean - goal), 0, atol=0.02)
        assert np.rad2deg(dwell.positions_std).max() < 1.5 * noise_deg + 0.01
        assert dwell.samples == pytest.approx(dwell.duration_s * rate, abs=2)


def test_settling_is_cut_off_and_short_stops_do_not_count() -> None:
    stamps, q, _ = arm_run(4, 2.0, 2.0)
    early, late = (find_dwells(stamps, q, Dwells(settle_s=s)) for s in (0.0, 0.7))
    for one, other in zip(early[1:], late[1:], strict=True):
        assert other.start_ns - one.start_ns == pytest.approx(0.7e9, abs=11e6)
        assert other.end_ns == one.end_ns
    assert find_dwells(stamps, q, Dwells(min_duration_s=2.5)) == []


def test_a_gap_in_the_joint_states_ends_a_dwell() -> None:
    stamps, q, _ = arm_run(1, 6.0, 1.0)
    keep = (stamps < START + 2_000_000_000) | (stamps > START + 4_000_000_000)
    dwells = find_dwells(stamps[keep], q[keep], RULES)
    assert len(dwells) == 2
    assert dwells[0].end_ns < START + 2_000_000_000 < START + 4_000_000_000 < dwells[1].start_ns


def test_stamps_in_any_order_and_more_than_once() -> None:
    stamps, q, _ = arm_run(3, 2.0, 1.0)
    order = np.random.default_rng(1).permutation(np.r_[np.arange(len(stamps)), np.arange(50)])
    expected, found = (find_dwells(*run, RULES) for run in ((stamps, q), (stamps[order], q[order])))
    assert [(d.start_ns, d.end_ns) for d in found] == [(d.start_ns, d.end_ns) for d in expected]


def test_a_continuous_joint_at_its_seam_stands_still() -> None:
    stamps, q, _ = arm_run(1, 3.0, 1.0, noise_deg=0.02)
    q = np.mod(q - q.mean(axis=0) + np.pi + np.pi, 2 * np.pi) - np.pi
    assert np.ptp(q) > 6
    (dwell,) = find_dwells(stamps, q, RULES)
    assert np.rad2deg(dwell.positions_std).max() < 0.03


@pytest.mark.parametrize("samples", [0, 1, 2, 5])
def test_too_few_joint_states_are_no_dwell(samples: int) -> None:
    stamps, q, _ = arm_run(1, 3.0, 1.0)
    assert find_dwells(stamps[:samples], q[:samples], RULES) == []


def test_damaged_positions_count_as_missing() -> None:
    stamps, q, _ = arm_run(1, 6.0, 1.0)
    q[300, 2] = np.nan
    (dwell,) = find_dwells(stamps, q, RULES)
    assert np.isfinite(dwell.positions_mean).all()
    q[300:400] = np.inf
    assert len(find_dwells(stamps, q, RULES)) == 2


def test_speed_of_a_steady_motion() -> None:
    t = np.arange(0, 5, 0.01)
    q = np.c_[0.3 * t, -0.1 * t]
    np.testing.assert_allclose(speed(t, q), 0.3, rtol=1e-6)


@pytest.mark.slow
def test_hours_of_joint_states_take_a_second() -> None:
    stamps, q, _ = arm_run(600, 10.0, 2.0)
    assert len(stamps) > 700_000
    begin = time.process_time()
    dwells: list[Dwell] = find_dwells(stamps, q, RULES)
    assert len(dwells) == 600
    assert time.process_time() - begin < 5
