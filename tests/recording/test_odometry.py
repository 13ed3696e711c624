from __future__ import annotations

import numpy as np
import pytest

from lcdata.errors import IntegrationError
from lcdata.geometry import se3
from lcdata.recording.odometry import (
    NEAREST_M,
    POINTS,
    ThinScan,
    Trajectory,
    cell_size,
    register,
    thin,
)

from .moving_room import SCAN_S, motion, scan

PERIOD_NS = round(SCAN_S * 1e9)


def thinned(numbers: range, **how: float) -> tuple[list[ThinScan], float]:
    scans = [scan(k, **how) for k in numbers]
    cell = cell_size(scans[0][0])
    return [
        thin(k * PERIOD_NS, points, seconds, cell)
        for k, (points, seconds) in zip(numbers, scans, strict=True)
    ], cell


def errors(found: Trajectory, start_s: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Metres and degrees off the truth, at all times, in the frame of the first moment."""
    times = np.arange(found.seconds[0] - SCAN_S / 2, found.seconds[-1] + SCAN_S / 2, 0.02)
    estimated, true = found.at(found.start_ns, times), motion(times, start_s)
    estimated, true = (se3.inverse(T[0]) @ T for T in (estimated, true))
    off = se3.inverse(true) @ estimated
    angles = np.arccos(np.clip((np.trace(off[:, :3, :3], axis1=1, axis2=2) - 1) / 2, -1, 1))
    return np.linalg.norm(off[:, :3, 3], axis=1), np.rad2deg(angles)


@pytest.mark.parametrize("start_s", [0.0, 0.9], ids=["from rest", "under way"])
def test_a_moved_lidar_is_followed_to_millimetres(start_s: float) -> None:
    pytest.importorskip("small_gicp")
    scans, cell = thinned(range(25), start_s=start_s)
    found = register(scans, cell)
    metres, degrees = errors(found, start_s)
    print(f"\nat most {1000 * metres.max():.1f} mm and {degrees.max():.3f} deg off")
    assert metres.max() < 0.025
    assert degrees.max() < 0.2
    assert 0.2 < found.way_m < 0.6
    assert found.turn_rad > 0.1


def test_a_missing_scan_does_not_matter() -> None:
    pytest.importorskip("small_gicp")
    scans, cell = thinned(range(14))
    del scans[6:8]
    metres, _ = errors(register(scans, cell))
    assert metres.max() < 0.025


def test_one_scan_and_two_are_enough() -> None:
    pytest.importorskip("small_gicp")
    scans, cell = thinned(range(2), start_s=0.9)
    still = register(scans[:1], cell)
    np.testing.assert_array_equal(still.at(0, [0.0, 0.1]), [np.eye(4)] * 2)
    assert still.way_m == 0
    metres, _ = errors(register(scans, cell), 0.9)
    assert metres.max() < 0.025


def test_a_scan_of_another_place_is_named() -> None:
    pytest.importorskip("small_gicp")
    scans, cell = thinned(range(8))
    rng = np.random.default_rng(0)
    scans[5] = ThinScan(scans[5].stamp_ns, rng.uniform(-20, 20, (3000, 3)), scans[5].seconds[:3000])
    with pytest.raises(IntegrationError, match=r"scan 6 of 8, 0.5 s after the first, .* move the"):
        register(scans, cell)


def test_a_jump_is_named() -> None:
    pytest.importorskip("small_gicp")
    scans, cell = thinned(range(8))
    T = se3.exp([0.0, 0.9, 0.0, 0, 0, 0.1])
    scans[4:] = [ThinScan(s.stamp_ns, se3.apply(T, s.points), s.seconds) for s in scans[4:]]
    with pytest.raises(IntegrationError, match="scan 5 of 8"):
        register(scans, cell)


def test_scans_without_points_are_named() -> None:
    scans, cell = thinned(range(2))
    scans[0] = thin(0, np.full((50, 3), np.nan), np.zeros(50), cell)
    assert len(scans[0].points) == 0
    with pytest.raises(IntegrationError, match="no point farther than 1 m"):
        register(scans, cell)


def test_thinning_keeps_one_point_a_cell_with_its_time() -> None:
    rng = np.random.default_rng(1)
    points = rng.uniform(-4, 4, (50_000, 3)).astype(np.float32)
    points[::10] = np.nan
    seconds = np.linspace(0, 0.1, len(points))
    kept = thin(5, points, seconds, 0.5)
    assert kept.stamp_ns == 5
    assert np.linalg.norm(kept.points, axis=1).min() >= NEAREST_M
    cells = np.floor(kept.points / 0.5)
    assert len(np.unique(cells, axis=0)) == len(cells) > 2000
    index = np.searchsorted(seconds, kept.seconds)
    np.testing.assert_array_equal(points[index], kept.points.astype(np.float32))
    assert len(thin(0, points, seconds, 0.01).points) == POINTS
    assert 0.02 <= cell_size(points) <= 0.1
    assert cell_size(points[:0]) == 0.1
