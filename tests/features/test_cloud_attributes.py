import numpy as np

from lcdata.features.cloud_attributes import DIRECTIONS, cloud_attributes, direction_vectors


def world(rng):
    """Ground, a wall, and two posts well apart: points and which they are of."""
    n = 20_000
    ground = np.stack([rng.uniform(3, 23, n), rng.uniform(-10, 10, n), np.full(n, -1.7)], 1)
    wall = np.stack([rng.uniform(3, 23, n), np.full(n, 10.0), rng.uniform(-1.4, 4, n)], 1)
    post = [
        np.stack([x + 0.3 * rng.uniform(size=600), rng.uniform(0, 0.3, 600), z], 1)
        for x, z in ((8.0, rng.uniform(-1.2, 2, 600)), (15.0, rng.uniform(-1.2, 2, 600)))
    ]
    points = np.concatenate([ground, wall, *post])
    points += 0.01 * rng.normal(size=points.shape)
    return points.astype(np.float32), np.repeat([0, 1, 2, 3], [n, n, 600, 600])


def test_planes_and_clusters_are_told_apart():
    points, truth = world(np.random.default_rng(0))
    found = cloud_attributes(points, None)
    own = [np.bincount(found.classes[truth == k] + 1).argmax() - 1 for k in range(4)]
    assert found.planes == 2
    assert set(own[:2]) == {0, 1}
    assert own[2] != own[3] and min(own[2:]) >= 2
    for k in range(4):
        assert (found.classes[truth == k] == own[k]).mean() > 0.95
    assert found.intensity is None


def test_normals_are_those_of_the_planes_and_directions_are_the_nearest():
    points, truth = world(np.random.default_rng(1))
    found = cloud_attributes(points, None)
    for k, axis in ((0, [0, 0, 1]), (1, [0, 1, 0])):
        assert np.median(np.abs(found.normals[truth == k] @ axis)) > 0.99
    vectors = direction_vectors()
    assert len(vectors) == DIRECTIONS
    assert np.allclose(np.linalg.norm(vectors, axis=1), 1)
    cosines = np.abs(found.normals @ vectors.T)
    chosen = cosines[np.arange(len(points)), found.directions]
    assert np.allclose(chosen, cosines.max(axis=1), atol=1e-5)
    assert chosen.min() > 0.9


def test_intensities_are_scaled_and_retroreflectors_clipped():
    points, _ = world(np.random.default_rng(2))
    light = np.random.default_rng(3).uniform(20, 40, len(points)).astype(np.float32)
    light[:5] = 1e6
    found = cloud_attributes(points, light)
    assert found.intensity.min() == 0 and found.intensity.max() == 1
    assert 0.4 < np.median(found.intensity) < 0.6


def test_too_few_points_are_an_empty_cloud():
    for count in (0, 3):
        assert len(cloud_attributes(np.zeros((count, 3)), None).points) == 0
    assert len(cloud_attributes(np.eye(4, 3) + 1, None).points) == 4
