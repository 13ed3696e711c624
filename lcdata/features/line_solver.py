"""Extrinsic from matched lines: PLK-Calib's Method I (joint) and Method II (decoupled).

Both are iteratively reweighted least squares with a Cauchy loss a line, in the left perturbation
of `lcdata.geometry.se3`. Image lines are in normalised coordinates ((u - cu)/fu, (v - cv)/fv), so
that pairs of different cameras can be solved together.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lcdata.features.held import NOTHING, ROTATION, TRANSLATION
from lcdata.features.line_least_squares import (
    CAUCHY_SCALE,
    Solution,
    cauchy,
    invert,
    minimise,
    unit_variance,
)
from lcdata.geometry import pluecker, se3
from lcdata.geometry.se3 import exp, skew

__all__ = [
    "CAUCHY_SCALE",
    "ROTATION_RATIO",
    "TRANSLATION_RATIO",
    "Problem",
    "Solution",
    "Solver",
    "projection_system",
    "singular_ratios",
    "solve_decoupled",
    "solve_pluecker",
    "solve_projection",
]

Array = NDArray[np.float64]

ROTATION_RATIO = 0.02
"""Smallest over largest singular value of the rows R v x n' below which rotation is degenerate."""

TRANSLATION_RATIO = 0.01
"""The same of the rows n', for translation."""


@dataclass(frozen=True, eq=False)
class Problem:
    """Matched lines of one pair, or of several with the same extrinsic.

    Args:
        segments: (N, 2, 3) in the LiDAR frame, metres.
        image: (N, 2, 2) matched image segments, normalised coordinates.
        image_sigma: (N,) standard deviation of image end points across their line, normalised
            coordinates.
        cloud_sigma: (N,) standard deviation of cloud end points across their line, metres.
    """

    segments: Array
    image: Array
    image_sigma: Array
    cloud_sigma: Array


Solver = Callable[[Problem, Array], Solution]


def solve_projection(
    problem: Problem, T_initial: Array, iterations: int = 20, hold: str = NOTHING
) -> Solution:
    """Method I: Levenberg-Marquardt on the residuals of eq. (4).

    Args:
        problem: Three lines or more.
        T_initial: 4x4.
        iterations: At most so many steps.
        hold: What stays as it is in `T_initial`, see `held.HOLDS`.
    """
    return minimise(projection_system(problem, T_initial), T_initial, iterations, hold)


def projection_system(problem: Problem, T_near: Array) -> Callable[[Array], tuple[Array, Array]]:
    """Residuals of eq. (4), in standard deviations, as a function of the pose.

    Args:
        problem: Matched lines.
        T_near: 4x4 pose that the standard deviations are taken at.

    Returns:
        A function of a 4x4 pose that gives (N, 2) residuals and their (N, 2, 6) derivative by a
        left perturbation.
    """
    n, v = pluecker.from_points(problem.segments)
    place, depth = _footpoints(problem, problem.image, T_near)
    # A cloud line is the less certain the farther it is prolonged beyond its own end points.
    prolonged = np.sqrt((1.0 - place) ** 2 + place**2)
    inverse_sigma = 1.0 / np.hypot(
        problem.image_sigma[:, None], problem.cloud_sigma[:, None] * prolonged / depth
    )

    def evaluate(T: Array) -> tuple[Array, Array]:
        r, J = pluecker.projection_residuals(T, n, v, np.eye(3), problem.image)
        return r * inverse_sigma, J * inverse_sigma[:, :, None]

    return evaluate


def solve_decoupled(
    problem: Problem, T_initial: Array, iterations: int = 20, hold: str = NOTHING
) -> Solution:
    """Method II as published: rotation from (11), then translation by linear least squares.

    Each residual is divided by its standard deviation; see `_Constraints`. Only the robust weight
    of a line is shared by the two steps, so they alternate until it settles.

    Args:
        problem: Three lines or more.
        T_initial: 4x4; only its rotation and the robust weights at it matter, and what is held.
        iterations: At most so many alternations.
        hold: What stays as it is in `T_initial`, see `held.HOLDS`; the other step alone is done.
    """
    system = _Constraints(problem, T_initial)
    T = np.array(T_initial, float)
    for _ in range(iterations):
        r, J, t, _ = system.evaluate(T)
        weights, _ = cauchy(0.5 * (r * r + t * t))
        root = weights[:, None] ** 0.5
        theta: Array = np.zeros(3)
        p: Array = T[:3, 3]
        if hold != ROTATION:
            theta = np.asarray(-np.linalg.lstsq(J * root, r * root[:, 0], rcond=1e-12)[0], float)
        R = exp(np.concatenate([np.zeros(3), theta]))[:3, :3] @ T[:3, :3]
        if hold != TRANSLATION:
            b = np.einsum("nc,nc->n", system.A, system.middle @ R.T)
            p = np.asarray(-np.linalg.lstsq(system.A * root, b * root[:, 0], rcond=1e-12)[0], float)
        moved = float(np.abs(theta).max()) + 0.1 * float(np.abs(p - T[:3, 3]).max())
        T[:3, :3], T[:3, 3] = R, p
        if moved < 1e-8:
            break

    r, J, t, B = system.evaluate(T)
    weights, cost = cauchy(0.5 * (r * r + t * t))
    W = weights[:, None]
    cov_theta, cov_p = np.zeros((3, 3)), np.zeros((3, 3))
    if hold != ROTATION:
        cov_theta = invert((J * W).T @ J, unit_variance(r[:, None], weights, 3))
    # The mean and the difference of a line's two end-point errors are independent.
    H = (system.A * W).T @ system.A
    G = skew(T[:3, 3])
    if hold != TRANSLATION:
        cov_p = invert(H, unit_variance(t[:, None], weights, 3))
        G = G - np.linalg.lstsq(H, (system.A * W).T @ B, rcond=1e-15)[0]
    return Solution(
        T,
        np.block([[cov_p + G @ cov_theta @ G.T, G @ cov_theta], [cov_theta @ G.T, cov_theta]]),
        weights,
        cost,
    )


def solve_pluecker(
    problem: Problem, T_initial: Array, iterations: int = 20, hold: str = NOTHING
) -> Solution:
    """Method II with both constraints in rotation *and* translation.

    The co-parallel constraint holds the rotation too, which the published order of steps does
    not use: on real scenes, whose lines are short, its rotation is several times less certain.
    Here both constraints are minimised jointly by Levenberg-Marquardt.

    Args:
        problem: Three lines or more.
        T_initial: 4x4.
        iterations: At most so many steps.
        hold: What stays as it is in `T_initial`, see `held.HOLDS`.
    """
    system = _Constraints(problem, T_initial)

    def evaluate(T: Array) -> tuple[Array, Array]:
        r, J, t, B = system.evaluate(T)
        by_rho = np.stack([np.zeros_like(system.A), system.A], 1)
        by_theta = np.stack([J, B - system.A @ skew(T[:3, 3])], 1)
        return np.stack([r, t], 1), np.concatenate([by_rho, by_theta], 2)

    return minimise(evaluate, T_initial, iterations, hold)


class _Constraints:
    """The two constraints of Method II, divided by their standard deviations.

    Co-perpendicular (11), n'^T R v: an error of the back-projected plane about the viewing ray
    counts by sqrt(2) sigma / length of the image line, about the line itself by sigma / sqrt(2).
    Where both lines have the same end points this is v / sqrt(|p1|^2 + |p2|^2).

    Co-parallel (14) as n'^T (R p_mid + p) = 0, weighted by 1 / |p_mid|, which an inexact rotation
    does not bias; p_mid is the point of the cloud line in the direction of the image line's middle.
    """

    def __init__(self, problem: Problem, T: Array) -> None:
        self.n_image = pluecker.back_project(np.eye(3), problem.image)
        v = problem.segments[:, 1] - problem.segments[:, 0]
        length = np.linalg.norm(v, axis=1)
        place, _ = _footpoints(problem, problem.image.mean(1, keepdims=True), T)
        self.middle = problem.segments[:, 0] + np.clip(place, 0.0, 1.0) * v
        v /= length[:, None]
        ray = np.column_stack([problem.image.mean(1), np.ones(len(v))])
        ray /= np.linalg.norm(ray, axis=1, keepdims=True)
        cosine = np.einsum("nc,nc->n", ray, v @ T[:3, :3].T)
        image_length = np.linalg.norm(problem.image[:, 1] - problem.image[:, 0], axis=1)
        about_ray = 2.0 * (1.0 - cosine**2) / image_length**2
        variance = problem.image_sigma**2 * (about_ray + 0.5 * cosine**2)
        variance += 2.0 * (problem.cloud_sigma / length) ** 2
        self.v = v / np.sqrt(variance)[:, None]
        distance = np.linalg.norm(se3.apply(T, self.middle), axis=1)
        sigma = np.hypot(problem.image_sigma * distance, problem.cloud_sigma) / np.sqrt(2.0)
        self.A = self.n_image / sigma[:, None]

    def evaluate(self, T: Array) -> tuple[Array, Array, Array, Array]:
        """Residuals of both constraints at a pose.

        Returns:
            r' (N,), its derivative by theta (N, 3), the co-parallel residual t (N,), and its
            derivative (N, 3) by a rotation that leaves p alone.
        """
        r, J = pluecker.co_perpendicular_residuals(T[:3, :3], self.v, self.n_image)
        turned = self.middle @ T[:3, :3].T
        t = np.einsum("nc,nc->n", self.A, turned + T[:3, 3])
        return r, J, t, np.cross(turned, self.A)


def _footpoints(problem: Problem, image: Array, T: Array) -> tuple[Array, Array]:
    """Where on the cloud lines image points lie.

    Args:
        problem: N matched lines.
        image: (N, k, 2) points near the lines, normalised coordinates.
        T: 4x4 `T_camera_lidar`.

    Returns:
        (N, k) place on the cloud line nearest to the viewing ray, 0 and 1 at its end points, and
        (N, k) its depth in metres; both clipped to a reasonable range.
    """
    camera = problem.segments @ T[:3, :3].T + T[:3, 3]
    start, along = camera[:, None, 0], camera[:, None, 1] - camera[:, None, 0]
    ray = np.concatenate([image, np.ones((*image.shape[:2], 1))], 2)
    ray /= np.linalg.norm(ray, axis=2, keepdims=True)
    start_across = start - (start * ray).sum(2, keepdims=True) * ray
    along_across = along - (along * ray).sum(2, keepdims=True) * ray
    place = -(start_across * along_across).sum(2) / np.maximum((along_across**2).sum(2), 1e-12)
    place = np.clip(place, -2.0, 3.0)
    depth = start[..., 2] + place * along[..., 2]
    return place, np.maximum(depth, 0.5)


def singular_ratios(problem: Problem, T: Array, weights: Array) -> tuple[float, float]:
    """How well the lines determine rotation and translation, whatever their noise.

    Args:
        problem: The matched lines.
        T: 4x4 `T_camera_lidar`.
        weights: (N,) robust weights.

    Returns:
        Smallest over largest singular value of the rows R v x n' and of the rows n'.
    """
    n_image = pluecker.back_project(np.eye(3), problem.image)
    v = problem.segments[:, 1] - problem.segments[:, 0]
    v /= np.maximum(np.linalg.norm(v, axis=1, keepdims=True), 1e-300)
    rows = np.cross(v @ T[:3, :3].T, n_image)
    root = np.sqrt(weights)[:, None]
    ratios = []
    for matrix in (rows * root, n_image * root):
        values = np.linalg.svd(matrix, compute_uv=False)
        ratios.append(float(values[2] / values[0]) if len(values) > 2 and values[0] > 0 else 0.0)
    return ratios[0], ratios[1]
