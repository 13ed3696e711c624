from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from lcdata.errors import GeometryError
from lcdata.geometry import se3

twists = st.lists(st.floats(-2, 2), min_size=6, max_size=6).map(np.array)


def hat(twist: np.ndarray) -> np.ndarray:
    matrix = np.zeros((4, 4))
    matrix[:3, :3] = se3.skew(twist[3:])
    matrix[:3, 3] = twist[:3]
    return matrix


@given(twists)
def test_exp_is_the_matrix_exponential_and_log_undoes_it(twist):
    T = se3.exp(twist)
    np.testing.assert_allclose(T, expm(hat(twist)), atol=1e-9)
    if np.linalg.norm(twist[3:]) < 3:
        np.testing.assert_allclose(se3.log(T), twist, atol=1e-7)


@given(twists, twists)
def test_adjoint_moves_a_twist_across_a_transform(a, xi):
    T = se3.exp(a)
    np.testing.assert_allclose(
        T @ se3.exp(xi * 0.3) @ se3.inverse(T), se3.exp(se3.adjoint(T) @ xi * 0.3), atol=1e-8
    )


@given(twists)
def test_quaternion_round_trip(twist):
    T = se3.exp(twist)
    np.testing.assert_allclose(se3.from_xyz_xyzw(se3.to_xyz_xyzw(T)), T, atol=1e-9)


def test_inverse_and_apply_work_on_stacks():
    T = np.stack([se3.exp(np.arange(6) / 7), se3.exp(-np.arange(6) / 5)])
    np.testing.assert_allclose(
        T @ se3.inverse(T), np.broadcast_to(np.eye(4), (2, 4, 4)), atol=1e-12
    )
    points = np.arange(12.0).reshape(4, 3)
    expected = (T[0] @ np.column_stack([points, np.ones(4)]).T).T[:, :3]
    np.testing.assert_allclose(se3.apply(T[0], points), expected, atol=1e-12)


@given(st.floats(1e-9, np.pi - 1e-6))
def test_rotation_error_is_the_geodesic_angle(angle):
    T = np.eye(4)
    T[:3, :3] = Rotation.from_rotvec(angle * np.array([2, -1, 2]) / 3).as_matrix()
    assert se3.rotation_error(T, np.eye(4)) == pytest.approx(angle, rel=1e-6, abs=1e-12)


def test_sigma_distance_of_samples_has_a_mean_square_of_six():
    rng = np.random.default_rng(3)
    factor = rng.normal(size=(6, 6)) * 0.01
    covariance = factor @ factor.T
    reference = se3.exp([0.3, -1, 2, 0.5, -0.4, 1.0])
    squares = [
        se3.sigma_distance(
            se3.exp(rng.multivariate_normal(np.zeros(6), covariance)) @ reference,
            reference,
            covariance,
        )
        ** 2
        for _ in range(3000)
    ]
    assert np.mean(squares) == pytest.approx(6, abs=0.3)
    assert np.isnan(se3.sigma_distance(reference, reference, np.full((6, 6), np.nan)))


@pytest.mark.parametrize(
    ("T", "words"),
    [
        (np.eye(3), "shape"),
        (np.full((4, 4), np.nan), "finite"),
        (np.diag([1.0, 1, -1, 1]), "reflection"),
        (np.diag([1.0, 1.01, 1, 1]), "not a rotation"),
        (np.ones((4, 4)), "last row"),
        ("text", "numbers"),
    ],
)
def test_check_transform_says_what_is_wrong(T, words):
    with pytest.raises(GeometryError, match=words):
        se3.check_transform(T)


def test_check_transform_repairs_few_digits():
    T = se3.exp([1, 2, 3, 0.1, 0.2, 0.3])
    fixed = se3.check_transform(np.round(T, 5))
    np.testing.assert_allclose(fixed[:3, :3].T @ fixed[:3, :3], np.eye(3), atol=1e-12)


def test_a_quaternion_that_is_not_unit_is_refused():
    with pytest.raises(GeometryError, match="norm"):
        se3.from_xyz_xyzw([0, 0, 0, 0, 0, 0, 2])
