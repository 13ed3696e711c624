"""A camera's pose from points and the pixels that show them.

Candidates come from three points each (P3P on bearings, so that any camera will do), the best of
them by a robust cost; then Levenberg-Marquardt on the reprojection error with a Cauchy kernel, as
in Koide et al., section III-D.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lcdata.errors import CalibrationError
from lcdata.features.p3p import SAMPLES, p3p, triples
from lcdata.geometry import se3
from lcdata.geometry.camera import Camera

Array = NDArray[np.float64]

SCALE_PX = 2.0
"""Scale of the Cauchy kernel: what a careful click or a good feature is off."""

FEWEST = 3
"""Fewer matches leave the pose free."""

REFINED = 6
"""Candidates that are refined."""

INLIER_PX = 10.0
"""Farther off than this a match does not belong to the pose."""

LINE_RATIO = 0.02
"""Second-largest by largest extent of points that are on one line."""

LARGEST_STD = (np.deg2rad(2.0), 0.5)
"""Predicted standard deviations (rad, m) from which matches do not determine the pose."""

SAME_POSE = (np.deg2rad(0.5), 0.05)
"""Two solutions nearer than this (rad, m) are one."""


@dataclass(frozen=True, eq=False)
class PointPose:
    """A pose from matches.

    Args:
        T_camera_lidar: 4x4.
        residuals_px: (N,) reprojection errors, infinite for points that cannot be projected.
        inliers: (N,) matches that belong to the pose.
        covariance: 6x6, for pixels that are `SCALE_PX` off, left perturbation.
        others: Further poses that fit as well; of three matches there may be up to three.
        warnings: What a user should know before trusting it, a line each.
    """

    T_camera_lidar: Array
    residuals_px: Array
    inliers: NDArray[np.bool_]
    covariance: Array
    others: tuple[Array, ...]
    warnings: tuple[str, ...]

    @property
    def rms_px(self) -> float:
        """Root mean square of the inliers' reprojection errors."""
        kept = self.residuals_px[self.inliers]
        return float(np.sqrt(np.mean(kept**2))) if len(kept) else float("inf")


def point_pose(
    points: ArrayLike,
    pixels: ArrayLike,
    camera: Camera,
    initial: ArrayLike | None = None,
    *,
    seed: int = 0,
) -> PointPose:
    """Solve for `T_camera_lidar`.

    Args:
        points: (N, 3) in the LiDAR frame, metres.
        pixels: (N, 2) of the raw image.
        camera: Of the raw image, any model.
        initial: 4x4 that chooses between equally good solutions; not needed.
        seed: Of the triples, where there are too many.

    Raises:
        CalibrationError: Fewer than three matches, values that are not finite, pixels without a
            bearing, the same place twice, points on one line, or a mirrored scene.
    """
    points = np.asarray(points, float).reshape(-1, 3)
    pixels = np.asarray(pixels, float).reshape(-1, 2)
    bearings = _checked(points, pixels, camera)
    slopes = camera.project_jacobian(bearings)[1]
    found = _solutions(points, bearings, slopes, seed)
    if not found:
        raise CalibrationError(
            "no pose fits the matches", "are the points in the order of their pixels?"
        )
    best_cost = found[0][0]
    _refuse_mirrored(points, bearings, slopes, seed, best_cost)
    # Exact ones of three points are all equally good; a hint chooses.
    good = [T for cost, T in found if cost <= best_cost + 0.5 * len(points)]
    if initial is not None:
        good.sort(key=lambda T: _distance(T, np.asarray(initial, float)))
    T, *others = good
    return _judged(T, tuple(others), points, pixels, camera, slopes, bearings)


def _checked(points: Array, pixels: Array, camera: Camera) -> Array:
    """Bearings of the pixels, if a pose can be made from the matches."""
    if len(points) != len(pixels):
        raise CalibrationError(f"{len(points)} points and {len(pixels)} pixels", "give pairs")
    if len(points) < FEWEST:
        raise CalibrationError(
            f"{len(points)} match{'es' * (len(points) != 1)}",
            f"give {FEWEST} or more, better 6, spread over the image",
        )
    wrong = np.flatnonzero(~(np.isfinite(points).all(1) & np.isfinite(pixels).all(1)))
    if len(wrong):
        raise CalibrationError(f"match {wrong[0] + 1} is not finite", "remove it")
    bearings = camera.unproject(pixels)
    outside = np.flatnonzero(~(camera.contains(pixels) & np.isfinite(bearings).all(1)))
    if len(outside):
        u, v = pixels[outside[0]]
        raise CalibrationError(
            f"match {outside[0] + 1}: pixel ({u:.1f}, {v:.1f}) is not in the image of "
            f"{camera.width}x{camera.height}",
            "remove it, or is this the right image?",
        )
    for what, values, limit in (("pixel", pixels, 1.0), ("point", points, 0.01)):
        apart = np.linalg.norm(values[:, None] - values, axis=2) + 1e9 * np.eye(len(values))
        i, j = np.unravel_index(apart.argmin(), apart.shape)
        if apart[i, j] < limit and len(values) <= SAMPLES:
            raise CalibrationError(
                f"matches {min(i, j) + 1} and {max(i, j) + 1} have the same {what}",
                "remove one of them",
            )
    extent = np.linalg.svd(points - points.mean(0), compute_uv=False)
    if extent[1] < LINE_RATIO * extent[0]:
        raise CalibrationError(f"all {len(points)} points are on one line", "pick some beside it")
    return bearings


def _solutions(
    points: Array, bearings: Array, slopes: Array, seed: int
) -> list[tuple[float, Array]]:
    """Refined candidates with their cost, the best first, each once."""
    candidates = [
        T
        for triple in triples(len(points), seed)
        for T in p3p(points[list(triple)], bearings[list(triple)])
    ]
    candidates.sort(key=lambda T: _cost(_errors(T, points, bearings, slopes)))
    refined = [_refined(T, points, bearings, slopes) for T in candidates[:REFINED]]
    refined.sort(key=lambda pair: pair[0])
    single: list[tuple[float, Array]] = []
    for cost, T in refined:
        if all(_distance(T, other) > 1.0 for _, other in single):
            single.append((cost, T))
    return single


def _distance(a: Array, b: Array) -> float:
    """1 where two poses are `SAME_POSE` apart."""
    rotation, translation = se3.rotation_error(a, b), se3.translation_error(a, b)
    return float(max(rotation / SAME_POSE[0], translation / SAME_POSE[1]))


def _errors(T: Array, points: Array, bearings: Array, slopes: Array) -> Array:
    """(N, 2) reprojection errors in pixels, to first order in the angle.

    Unlike pixels they are defined for every direction, also behind a camera.
    """
    seen = se3.apply(T, points)
    seen /= np.maximum(np.linalg.norm(seen, axis=1, keepdims=True), 1e-9)
    # Away from the bearing the angle counts, not its sine, which shrinks again behind.
    along = np.einsum("ni,ni->n", seen, bearings)
    across = seen - along[:, None] * bearings
    sine = np.linalg.norm(across, axis=1)
    stretch = np.where(sine > 1e-9, np.arctan2(sine, along) / np.maximum(sine, 1e-9), 1.0)
    return np.asarray(np.einsum("nij,nj->ni", slopes, across * stretch[:, None]))


def _cost(errors: Array) -> float:
    """Cauchy: sum of log(1 + (e / scale)^2)."""
    return float(np.sum(np.log1p((errors**2).sum(1) / SCALE_PX**2)))


def _refined(T: Array, points: Array, bearings: Array, slopes: Array) -> tuple[float, Array]:
    """Levenberg-Marquardt with iteratively reweighted least squares; cost and pose."""
    errors = _errors(T, points, bearings, slopes)
    cost, damping = _cost(errors), 1e-3
    for _ in range(60):
        J = _jacobian(T, points, slopes)
        weight = 1.0 / (SCALE_PX**2 + (errors**2).sum(1))
        H = np.einsum("n,nki,nkj->ij", weight, J, J)
        g = np.einsum("n,nki,nk->i", weight, J, errors)
        step = -np.linalg.lstsq(H + damping * np.diag(np.diag(H) + 1e-12), g, rcond=None)[0]
        trial = se3.exp(step) @ T
        trial_errors = _errors(trial, points, bearings, slopes)
        trial_cost = _cost(trial_errors)
        if trial_cost < cost:
            T, errors, cost, damping = trial, trial_errors, trial_cost, damping / 5
            if np.linalg.norm(step) < 1e-9:
                break
        elif damping > 1e8:
            break
        else:
            damping *= 8
    return cost, T


def _jacobian(T: Array, points: Array, slopes: Array) -> Array:
    """(N, 2, 6) derivatives of the errors by a left perturbation, to first order."""
    seen = se3.apply(T, points)
    distance = np.maximum(np.linalg.norm(seen, axis=1), 1e-9)
    unit = seen / distance[:, None]
    direction = (np.eye(3) - unit[:, :, None] * unit[:, None, :]) / distance[:, None, None]
    moved = np.concatenate([np.broadcast_to(np.eye(3), (len(seen), 3, 3)), -se3.skew(seen)], axis=2)
    return np.asarray(slopes @ direction @ moved)


def _refuse_mirrored(
    points: Array, bearings: Array, slopes: Array, seed: int, best_cost: float
) -> None:
    """Left and right confused: a reflected scene fits, the scene itself does not."""
    bad = len(points) * np.log1p((INLIER_PX / SCALE_PX) ** 2)
    if len(points) < FEWEST + 1 or best_cost < 0.5 * bad:
        return
    mirrored = _solutions(points * [1.0, -1.0, 1.0], bearings, slopes, seed)
    if mirrored and mirrored[0][0] < 0.3 * best_cost:
        raise CalibrationError(
            "the matches fit a mirrored scene", "left and right are swapped in one of the images"
        )


def _judged(
    T: Array,
    others: tuple[Array, ...],
    points: Array,
    pixels: Array,
    camera: Camera,
    slopes: Array,
    bearings: Array,
) -> PointPose:
    seen = se3.apply(T, points)
    residuals = np.linalg.norm(camera.project(seen)[0] - pixels, axis=1)
    # Where the true projection is impossible (behind a pinhole) or folded, the angle says how far.
    angular = np.linalg.norm(_errors(T, points, bearings, slopes), axis=1)
    residuals = np.where(np.isfinite(residuals), residuals, np.maximum(angular, 1e3))
    inliers = residuals < INLIER_PX
    used = inliers if inliers.sum() >= FEWEST else np.ones(len(points), bool)
    J = _jacobian(T, points[used], slopes[used]).reshape(-1, 6)
    information = J.T @ J / SCALE_PX**2
    covariance = np.asarray(np.linalg.pinv(information, rcond=1e-12, hermitian=True), np.float64)
    std = np.sqrt(np.maximum(np.diag(covariance), 0))
    rotation, translation = float(np.linalg.norm(std[3:])), float(np.linalg.norm(std[:3]))
    warnings = []
    if others:
        warnings.append(
            f"{len(points)} matches fit {1 + len(others)} different poses: pick one more"
        )
    elif len(points) == FEWEST:
        warnings.append("three matches fit any click: pick one more, which checks them")
    if not others and (rotation > LARGEST_STD[0] or translation > LARGEST_STD[1]):
        warnings.append(
            f"the matches leave {np.rad2deg(rotation):.1f} deg and {translation:.2f} m open: pick "
            "farther apart, near and far"
        )
    for i in np.flatnonzero(~inliers):
        warnings.append(f"match {i + 1} is {residuals[i]:.0f} px off: remove it or pick it again")
    return PointPose(T, residuals, inliers, covariance, others, tuple(warnings))
