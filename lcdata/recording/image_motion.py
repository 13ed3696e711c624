"""How far the camera turned between two images, from points tracked from one to the other."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lcdata.geometry import se3
from lcdata.geometry.camera import Camera

Array = NDArray[np.float64]
Gray = NDArray[np.uint8]

WIDEST = 800
"""Wider images are halved: tracks are good to a tenth of a pixel, and there are many."""

POINTS, FEWEST = 300, 20
"""Points to track, and how many must agree."""

BACK_PX = 0.5
"""A point tracked there and back again must arrive where it came from."""

EPIPOLE_RAD = 0.1
"""Nearer to the direction of travel, a point says nothing of the turn."""

NOISE_RAD = 1e-4
"""No track is better than this."""


@dataclass(frozen=True, eq=False)
class Turn:
    """Rotation of the camera between two images.

    Args:
        R: (3, 3) maps directions in the first camera frame to the second.
        covariance: (3, 3) rad^2 of its left perturbation, from the scatter of the tracks.
    """

    R: Array
    covariance: Array


def gray(image: NDArray[np.uint8]) -> tuple[Gray, int]:
    """An image (H, W[, 3]) in gray, halved until it is narrow enough, and how many times."""
    import cv2

    shades = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    halvings = 0
    while shades.shape[1] > WIDEST:
        shades, halvings = cv2.resize(shades, None, fx=0.5, fy=0.5, interpolation=3), halvings + 1
    return np.asarray(shades, np.uint8), halvings


def tracks(first: Gray, second: Gray) -> tuple[Array, Array]:
    """Pixels (N, 2) of the same points in two images: Lucas-Kanade, there and back."""
    import cv2

    corners = cv2.goodFeaturesToTrack(first, POINTS, 0.01, 8)
    if corners is None:
        return np.zeros((0, 2)), np.zeros((0, 2))
    flow: Any = partial(cv2.calcOpticalFlowPyrLK, nextPts=None, winSize=(21, 21), maxLevel=4)
    there, found, _ = flow(first, second, corners)
    back, returned, _ = flow(second, first, there)
    a, b, c = (np.asarray(p, float).reshape(-1, 2) for p in (corners, there, back))
    kept = (found.ravel() == 1) & (returned.ravel() == 1)
    kept &= np.linalg.norm(c - a, axis=1) < BACK_PX
    return a[kept], b[kept]


def turn(
    first: tuple[Gray, int], second: tuple[Gray, int], camera: Camera, travel: Array
) -> Turn | None:
    """Rotation between two images whose camera moved in a known direction.

    Each track must lie in its epipolar plane, whatever the point's distance: the turn is what
    brings them there, robustly, in least squares. Near and far points then weigh alike.

    Args:
        first: From `gray`.
        second: From `gray`.
        camera: Of the images as recorded.
        travel: (3,) translation t of p_second = R p_first + t, of any length.

    Returns:
        None if too few points could be tracked or agree.
    """
    halvings = first[1]
    a, b = tracks(first[0], second[0])
    if len(a) < FEWEST:
        return None
    scale = 2.0**halvings
    f, g = (camera.unproject(scale * (pixels + 0.5) - 0.5) for pixels in (a, b))
    known = np.isfinite(f).all(axis=1) & np.isfinite(g).all(axis=1)
    f, g = f[known], g[known]
    if len(f) < FEWEST:
        return None
    R = _start(f, g)
    length = float(np.linalg.norm(travel))
    t = travel / length if length > 0 else np.array([0.0, 0.0, 1.0])
    for _ in range(10):
        turned = f @ R.T
        normal = np.cross(t, turned)
        sine = np.linalg.norm(normal, axis=1)
        use = sine > EPIPOLE_RAD
        if use.sum() < FEWEST:
            return None
        sine, turned, seen = sine[use], turned[use], g[use]
        r = (seen * normal[use]).sum(axis=1) / sine
        along, same = turned @ t, (seen * turned).sum(axis=1)
        J = (along[:, None] * seen - same[:, None] * t) / sine[:, None]
        sigma = max(1.4826 * float(np.median(np.abs(r))), NOISE_RAD)
        weights = 1 / (1 + (r / (2 * sigma)) ** 2) ** 2  # Geman-McClure
        H = (J * weights[:, None]).T @ J
        step = -np.linalg.lstsq(H, J.T @ (weights * r), rcond=None)[0]
        R = se3.exp(np.concatenate([np.zeros(3), step]))[:3, :3] @ R
        if np.linalg.norm(step) < 1e-7:
            break
    if (np.abs(r) < 3 * sigma).sum() < FEWEST or np.linalg.cond(H) > 1e8:
        return None
    return Turn(R, sigma**2 * np.linalg.inv(H))


def _start(f: Array, g: Array) -> Array:
    """Rotation that best takes directions f to g, without those that fit worst."""
    for _ in range(3):
        U, _, Vt = np.linalg.svd(g.T @ f)
        R = np.asarray(U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt)
        apart = np.linalg.norm(g - f @ R.T, axis=1)
        near = apart <= max(2 * float(np.median(apart)), 1e-6)
        f, g = f[near], g[near]
    return R
