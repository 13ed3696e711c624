"""Poses from two parallel lines and a third, against poses that the lines were made from."""

import numpy as np
import pytest

from lcdata.features.p3l import p3l
from lcdata.geometry import se3


def unit(v):
    return v / np.linalg.norm(v)


def scene(seed):
    """A pose, and what it shows: normals in the camera frame, directions and points."""
    rng = np.random.default_rng(seed)
    T = se3.exp(np.concatenate([rng.normal(size=3), rng.uniform(-1, 1, 3) * 2]))
    along, upright = unit(rng.normal(size=3)), unit(rng.normal(size=3))
    points = rng.uniform(-10, 10, (3, 3))
    seen, others = se3.apply(T, points), []
    for point, direction in zip(points, (along, along, upright), strict=True):
        others.append(se3.apply(T, (point + direction)[None])[0])
    normals = np.cross(seen, np.array(others))
    return T, normals / np.linalg.norm(normals, axis=1)[:, None], [along, upright], points


@pytest.mark.parametrize("seed", range(20))
def test_the_true_pose_is_among_the_solutions(seed):
    T, normals, directions, points = scene(seed)
    found = p3l(normals, directions, points)
    assert 1 <= len(found) <= 4
    assert min(np.abs(pose - T).max() for pose in found) < 1e-7


@pytest.mark.parametrize("seed", range(5))
def test_all_solutions_explain_the_lines(seed):
    _, normals, directions, points = scene(seed)
    signs = np.array([1.0, -1.0, -1.0])
    for T in p3l(normals * signs[:, None], directions, points):
        R = T[:3, :3]
        np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-9)
        assert np.linalg.det(R) > 0
        on_plane = np.einsum("ij,ij->i", normals, se3.apply(T, points))
        np.testing.assert_allclose(on_plane, 0, atol=1e-8)
        np.testing.assert_allclose(normals[:2] @ R @ directions[0], 0, atol=1e-9)
        np.testing.assert_allclose(normals[2] @ R @ directions[1], 0, atol=1e-9)


def test_lines_that_determine_nothing_have_no_solution():
    _, normals, directions, points = scene(0)
    assert p3l(normals[[0, 0, 2]], directions, points) == []
    assert p3l(normals, [directions[0], directions[0]], points) == []
