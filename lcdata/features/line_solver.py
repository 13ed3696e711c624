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

from lcdata.features.held import NOTHING, ROTATION, TRANSLATION, free_directions, stepped
from lcdata.geometry import pluecker, se3
from lcdata.geometry.se3 import exp, skew

Array = NDArray[np.float64]

ROTATION_RATIO = 0.02
"""Smallest over largest singular value of the rows R v x n' below which rotation is degenerate."""

TRANSLATION_RATIO = 0.01
"""The same of the rows n', for translation."""

CAUCHY_SCALE = 1.0
"""Residual, in standard deviations, at which a line's weight has fallen to one half.

Small, because good lines fit to a fraction of a pixel and every third is another edge beside
the right one: a skirting board, a window's frame."""


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


@dataclass(frozen=True, eq=False)
class Solution:
    """A pose and its fit.

    Args:
        T_camera_lidar: 4x4.
        covariance: 6x6, left perturbation, metres and radians; infinite where undetermined.
        weights: (N,) robust weight of each line, 0..1.
        cost: Mean robust cost of a line, squared standard deviations.
    """

    T_camera_lidar: Array
    covariance: Array
    weights: Array
    cost: float


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
    return _minimise(projection_system(problem, T_initial), T_initial, iterations, hold)


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
        weights, _ = _cauchy(0.5 * (r * r + t * t))
        root = weights[:, None] ** 0.5
        theta, p = np.zeros(3), T[:3, 3].copy()
        if hold != ROTATION:
            theta = -np.linalg.lstsq(J * root, r * root[:, 0], rcond=1e-12)[0]
        R = exp(np.concatenate([np.zeros(3), theta]))[:3, :3] @ T[:3, :3]
        if hold != TRANSLATION:
            b = np.einsum("nc,nc->n", system.A, system.middle @ R.T)
            p = -np.linalg.lstsq(system.A * root, b * root[:, 0], rcond=1e-12)[0]
        moved = float(np.abs(theta).max()) + 0.1 * float(np.abs(p - T[:3, 3]).max())
        T[:3, :3], T[:3, 3] = R, p
        if moved < 1e-8:
            break

    r, J, t, B = system.evaluate(T)
    weights, cost = _cauchy(0.5 * (r * r + t * t))
    W = weights[:, None]
    cov_theta, cov_p = np.zeros((3, 3)), np.zeros((3, 3))
    if hold != ROTATION:
        cov_theta = _invert((J * W).T @ J, _variance(r[:, None], weights, 3))
    # The mean and the difference of a line's two end-point errors are independent.
    H = (system.A * W).T @ system.A
    G = skew(T[:3, 3])
    if hold != TRANSLATION:
        cov_p = _invert(H, _variance(t[:, None], weights, 3))
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

    return _minimise(evaluate, T_initial, iterations, hold)


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


def _minimise(
    evaluate: Callable[[Array], tuple[Array, Array]], T_initial: Array, iterations: int, hold: str
) -> Solution:
    """Levenberg-Marquardt with a Cauchy loss a line.

    Args:
        evaluate: Gives at a pose (N, 2) residuals in standard deviations and their (N, 2, 6)
            derivative by a left perturbation.
        T_initial: 4x4.
        iterations: At most so many steps.
        hold: What stays as it is, see `held.HOLDS`.
    """
    T = np.array(T_initial, float)
    free = free_directions(T, hold)
    r, J = evaluate(T)
    J = J @ free
    weights, cost = _cauchy(0.5 * (r * r).sum(1))
    damping = 1e-4
    for _ in range(iterations):
        H = np.einsum("nki,n,nkj->ij", J, weights, J)
        gradient = np.einsum("nki,n,nk->i", J, weights, r)
        step = -np.linalg.lstsq(H + damping * np.diag(np.diag(H)), gradient, rcond=1e-15)[0]
        T_next = stepped(T, free @ step, hold)
        r_next, J_next = evaluate(T_next)
        weights_next, cost_next = _cauchy(0.5 * (r_next * r_next).sum(1))
        if cost_next > cost:
            damping *= 10.0
            if damping > 1e6:
                break
            continue
        done = cost - cost_next < 1e-9 * cost
        T, r, J, weights, cost = T_next, r_next, J_next @ free, weights_next, cost_next
        damping = max(damping * 0.1, 1e-9)
        if done:
            break
    H = np.einsum("nki,n,nkj->ij", J, weights, J)
    covariance = _invert(H, _variance(r, weights, free.shape[1]))
    return Solution(T, free @ covariance @ free.T, weights, cost)


def _cauchy(squared: Array) -> tuple[Array, float]:
    """Weights and mean cost of squared residuals in standard deviations."""
    scaled = squared / CAUCHY_SCALE**2
    return 1.0 / (1.0 + scaled), float(CAUCHY_SCALE**2 * np.log1p(scaled).mean())


def _variance(residuals: Array, weights: Array, unknowns: int) -> float:
    """Variance of unit weight from the scatter of the residuals, at least 1.

    The expected noise is the floor: a few lines that happen to fit well prove nothing.
    """
    freedom = residuals.shape[1] * weights.sum() - unknowns
    if freedom < 1.0:
        return 1.0
    return max(1.0, float((weights[:, None] * residuals**2).sum() / freedom))


def _invert(H: Array, variance: float) -> Array:
    """Covariance of an information matrix; infinite variances where it is singular."""
    diagonal = np.diag(H)
    scale = np.sqrt(np.maximum(diagonal, 1e-12 * diagonal.max(initial=1e-12)))
    values, vectors = np.linalg.eigh(H / np.outer(scale, scale))
    values = np.maximum(values, 1e-14)
    return np.asarray(variance * ((vectors / values) @ vectors.T) / np.outer(scale, scale))
