from __future__ import annotations

import numpy as np
import pytest

from lcdata.recording.voxel_cloud import VoxelCloud


def test_cells_hold_the_means_of_their_points() -> None:
    rng = np.random.default_rng(0)
    cloud = VoxelCloud(0.5, 10_000)
    scans = [rng.uniform(-3, 3, (n, 3)).astype(np.float32) for n in (4000, 1, 0, 90_000)]
    strengths = [rng.integers(0, 255, len(points)).astype(np.uint8) for points in scans]
    for points, strength in zip(scans, strengths, strict=True):
        cloud.add(points, strength)
    found, intensity = cloud.cells()
    assert cloud.scans == 4
    assert found.dtype == intensity.dtype == np.float32
    points, strength = np.concatenate(scans), np.concatenate(strengths)
    cells, index = np.unique(np.floor(points / 0.5), axis=0, return_inverse=True)
    assert len(found) == len(cells)
    order = np.lexsort(np.floor(found / 0.5).T[::-1])
    for k in range(3):
        mean = np.bincount(index, points[:, k]) / np.bincount(index)
        np.testing.assert_allclose(found[order, k], mean, atol=1e-5)
    mean = np.bincount(index, strength) / np.bincount(index)
    np.testing.assert_allclose(intensity[order], mean, rtol=1e-5)


def test_points_that_are_not_finite_are_left_out() -> None:
    cloud = VoxelCloud(0.1, 1000)
    points = np.array([[1.0, 2, 3], [np.nan, 0, 0], [np.inf, 0, 0], [1.01, 2.01, 3.01]])
    cloud.add(points)
    found, intensity = cloud.cells()
    np.testing.assert_allclose(found, [[1.005, 2.005, 3.005]], atol=1e-6)
    np.testing.assert_array_equal(intensity, 0)
    empty = VoxelCloud(0.1, 1000)
    empty.add(points[1:3])
    assert len(empty.cells()[0]) == 0


@pytest.mark.parametrize("limit", [1000, 20_000])
def test_the_cloud_never_has_more_points_than_allowed(limit: int) -> None:
    rng = np.random.default_rng(1)
    cloud = VoxelCloud(0.01, limit)
    for _ in range(5):
        cloud.add(rng.uniform(-5, 5, (30_000, 3)))
    found, _ = cloud.cells()
    assert limit / 3 < len(found) <= limit
    assert cloud.voxel_m > 0.05
    assert np.ptp(found, axis=0) == pytest.approx(10, abs=1.5)
