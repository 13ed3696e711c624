from __future__ import annotations

import numpy as np
import pytest

from lcdata.geometry import pluecker, se3

K = np.array([[530.0, 0, 641.0], [0, 545.0, 357.0], [0, 0, 1]])


def random_case(seed: int = 0, count: int = 7):
    """Pose, segments in the LiDAR frame, in front of the camera, and noisy image segments."""
    rng = np.random.default_rng(seed)
    T = se3.exp(rng.normal(size=6) * 0.4)
    camera = np.stack([rng.uniform([-4, -2, 4], [4, 2, 12], (count, 3)) for _ in range(2)], 1)
    segments = se3.apply(se3.inverse(T), camera.reshape(-1, 3)).reshape(-1, 2, 3)
    pixels = camera @ K.T
    image = pixels[..., :2] / pixels[..., 2:] + rng.normal(size=(count, 2, 2)) * 3
    return T, segments, image


def test_transform_is_that_of_the_points():
    T, segments, _ = random_case()
    n, v = pluecker.transform(T, *pluecker.from_points(segments))
    moved = se3.apply(T, segments.reshape(-1, 3)).reshape(-1, 2, 3)
    np.testing.assert_allclose(n, np.cross(moved[:, 0], moved[:, 1]), atol=1e-12)
    np.testing.assert_allclose(v, moved[:, 1] - moved[:, 0], atol=1e-12)


def test_line_matrix_is_the_projection_of_lines():
    np.testing.assert_allclose(
        pluecker.line_matrix(K), K[0, 0] * K[1, 1] * np.linalg.inv(K).T, rtol=1e-12, atol=1e-6
    )


def test_residual_is_the_distance_of_image_points_to_the_projected_line():
    T, segments, image = random_case()
    residuals, _ = pluecker.projection_residuals(T, *pluecker.from_points(segments), K, image)
    pixels = se3.apply(T, segments.reshape(-1, 3)) @ K.T
    a, b = (pixels[:, :2] / pixels[:, 2:]).reshape(-1, 2, 2).transpose(1, 0, 2)
    normal = np.stack([a[:, 1] - b[:, 1], b[:, 0] - a[:, 0]], 1)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    expected = np.einsum("nkc,nc->nk", image - a[:, None], normal)
    np.testing.assert_allclose(np.abs(residuals), np.abs(expected), atol=1e-9)


@pytest.mark.parametrize("seed", range(5))
def test_projection_jacobian_agrees_with_finite_differences(seed):
    T, segments, image = random_case(seed)
    n, v = pluecker.from_points(segments)
    _, jacobian = pluecker.projection_residuals(T, n, v, K, image)
    for i, step in enumerate(np.eye(6) * 1e-6):
        up, _ = pluecker.projection_residuals(se3.exp(step) @ T, n, v, K, image)
        down, _ = pluecker.projection_residuals(se3.exp(-step) @ T, n, v, K, image)
        np.testing.assert_allclose(jacobian[:, :, i], (up - down) / 2e-6, rtol=1e-5, atol=1e-3)


def test_printed_parametrisation_maps_to_the_left_perturbation():
    """R <- Exp(d) R, p <- p + dp of eq. (6) is rho = dp + [p]x d, theta = d."""
    T, segments, image = random_case(3)
    n, v = pluecker.from_points(segments)
    r0, jacobian = pluecker.projection_residuals(T, n, v, K, image)
    d, dp = np.array([2e-6, -1e-6, 3e-6]), np.array([-1e-6, 4e-6, 2e-6])
    moved = T.copy()
    moved[:3, :3] = se3.exp([0, 0, 0, *d])[:3, :3] @ T[:3, :3]
    moved[:3, 3] += dp
    r1, _ = pluecker.projection_residuals(moved, n, v, K, image)
    rho = dp + se3.skew(T[:3, 3]) @ d
    np.testing.assert_allclose(r1 - r0, jacobian @ np.concatenate([rho, d]), atol=1e-6)
    # The printed derivative, put right: dn/dd = -[Rn]x - [p]x[Rv]x, dn/dp = -[Rv]x.
    R, p = T[:3, :3], T[:3, 3]
    dn = (-se3.skew(n @ R.T) - se3.skew(p) @ se3.skew(v @ R.T)) @ d - se3.skew(v @ R.T) @ dp
    before, _ = pluecker.transform(T, n, v)
    after, _ = pluecker.transform(moved, n, v)
    np.testing.assert_allclose(after - before, dn, atol=1e-8)


def test_co_perpendicular_jacobian_agrees_with_finite_differences():
    T, segments, image = random_case(1)
    _, v = pluecker.from_points(segments)
    normals = pluecker.back_project(K, image)
    _, jacobian = pluecker.co_perpendicular_residuals(T[:3, :3], v, normals)
    for i, step in enumerate(np.eye(6)[3:] * 1e-6):
        up, _ = pluecker.co_perpendicular_residuals((se3.exp(step) @ T)[:3, :3], v, normals)
        down, _ = pluecker.co_perpendicular_residuals((se3.exp(-step) @ T)[:3, :3], v, normals)
        np.testing.assert_allclose(jacobian[:, i], (up - down) / 2e-6, rtol=1e-6, atol=1e-8)


def test_back_projection_is_perpendicular_to_the_true_line():
    T, segments, _ = random_case(2)
    camera = se3.apply(T, segments.reshape(-1, 3))
    pixels = camera @ K.T
    image = (pixels[:, :2] / pixels[:, 2:]).reshape(-1, 2, 2)
    normals = pluecker.back_project(K, image)
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0)
    np.testing.assert_allclose(
        np.einsum("nc,nkc->nk", normals, camera.reshape(-1, 2, 3)), 0.0, atol=1e-12
    )
