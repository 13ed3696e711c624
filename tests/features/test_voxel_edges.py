"""Edges of dense clouds from planes in voxels."""

from __future__ import annotations

import numpy as np
import pytest

from lcdata.features.voxel_edges import voxel_edges
from lcdata.features.voxel_planes import thinned, voxel_planes

LOW, HIGH = np.array([4.0, -0.7, -0.9]), np.array([5.2, 0.8, 0.4])
"""A box that a scanner in the origin sees from the front, from above and from neither side."""


def box_cloud(rng, noise=0.01, count=30_000):
    """Front, top and left side of the box."""
    places = rng.uniform(LOW, HIGH, (3 * count, 3))
    places[:count, 0] = LOW[0]
    places[count : 2 * count, 2] = HIGH[2]
    places[2 * count :, 1] = LOW[1]
    return places + rng.normal(0.0, noise, places.shape)


def distance_to_edges(points):
    """To the three edges between those faces."""
    x, y, z = points.T
    return np.min(
        [
            np.hypot(x - LOW[0], z - HIGH[2]),
            np.hypot(x - LOW[0], y - LOW[1]),
            np.hypot(y - LOW[1], z - HIGH[2]),
        ],
        axis=0,
    )


@pytest.mark.parametrize("seed", range(3))
def test_edges_of_a_box_are_where_its_faces_meet(seed):
    points, tangents, sigma = voxel_edges(box_cloud(np.random.default_rng(seed)))
    assert len(points) > 150
    off = distance_to_edges(points)
    assert np.median(off) < 0.004
    assert np.quantile(off, 0.98) < 0.012
    # Each edge runs along one axis.
    assert np.abs(tangents).max(axis=1).min() > 0.99
    assert np.bincount(np.abs(tangents).argmax(axis=1), minlength=3).min() > 20
    np.testing.assert_allclose(np.linalg.norm(tangents, axis=1), 1.0)
    assert 0.1 < np.sqrt(np.mean((off / sigma) ** 2)) < 3.0


def test_a_plane_has_no_edges():
    rng = np.random.default_rng(0)
    plane = rng.uniform([3.0, -4.0, -4.0], [3.0, 4.0, 4.0], (50_000, 3))
    points, tangents, sigma = voxel_edges(plane + rng.normal(0.0, 0.01, plane.shape))
    assert points.shape == tangents.shape == (0, 3)
    assert sigma.shape == (0,)


def test_planes_that_cross_without_ending_have_no_edge():
    rng = np.random.default_rng(0)
    cross = rng.uniform(-0.9, 0.9, (40_000, 3))
    cross[:20_000, 0], cross[20_000:, 1] = 0.0, 0.0
    points, _, _ = voxel_edges(cross + np.array([5.5, 1.5, 1.5]))
    assert len(points) == 0


def test_missing_returns_and_few_points_are_left_out():
    cloud = box_cloud(np.random.default_rng(0))
    holes = np.concatenate([cloud, np.full((500, 3), np.nan), np.zeros((500, 3))])
    np.testing.assert_allclose(voxel_edges(holes)[0], voxel_edges(cloud)[0])
    for few in (np.zeros((0, 3)), np.full((10, 3), np.nan), cloud[:50]):
        assert len(voxel_edges(few)[0]) == 0


def test_planes_of_a_voxel_are_those_of_least_squares():
    rng = np.random.default_rng(1)
    normal = np.array([0.6, 0.0, 0.8])
    wall = rng.uniform(0.05, 0.95, (3000, 3))
    wall[:, 2] = (0.62 - 0.6 * wall[:, 0]) / 0.8
    wall += rng.normal(0.0, 0.003, wall.shape)
    found = voxel_planes(wall, 1.0, 0.02, 60)
    v = int(np.argmax(found.counts[:, 0]))
    inside = found.points[found.starts[v] : found.starts[v + 1]]
    centred = inside - inside.mean(axis=0)
    exact = np.linalg.svd(centred, full_matrices=False)[2][2]
    n, d = found.planes[v, 0, :3], found.planes[v, 0, 3]
    assert abs(n @ exact) > 1 - 1e-6
    assert abs(abs(n @ normal) - 1.0) < 1e-4
    assert abs(n @ inside.mean(axis=0) - d) < 1e-4
    assert found.spread[v, 0] == pytest.approx(0.003, rel=0.1)


def test_thinning_averages_each_cell():
    points = np.array([[0.01, 0.01, 0.01], [0.02, 0.03, 0.04], [0.3, 0.0, 0.0]])
    np.testing.assert_allclose(
        sorted(thinned(points, 0.1).tolist()), [[0.015, 0.02, 0.025], [0.3, 0, 0]]
    )
