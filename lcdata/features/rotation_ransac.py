"""Rotation between two sets of bearings, most of them wrong (Koide et al., Algorithm 1)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def rotation_ransac(
    bearings_camera: Array,
    bearings_lidar: Array,
    *,
    tolerance: float = np.deg2rad(3.0),
    iterations: int = 5000,
    seed: int = 0,
) -> tuple[Array, NDArray[np.bool_]]:
    """The rotation that most matches agree with, the translation taken as none.

    In place of pixels as in print, angles are compared: they are defined for every camera, and
    the tolerance covers the parallax of what the translation is small against.

    Args:
        bearings_camera: (M, 3) unit vectors in the camera frame.
        bearings_lidar: (M, 3) unit vectors in the LiDAR frame.
        tolerance: Largest angle of a match that agrees, radians.
        iterations: Pairs of matches that are tried.
        seed: Of their choice.

    Returns:
        3x3 `R_camera_lidar`, least squares over the matches that agree, and (M,) which those are.
    """
    count = len(bearings_camera)
    if count < 2:
        return np.eye(3), np.zeros(count, bool)
    rng = np.random.default_rng(seed)
    first = rng.integers(0, count, iterations)
    second = (first + rng.integers(1, count, iterations)) % count
    # Matches whose own angle differs between the sensors cannot both be right.
    own = [
        np.arccos(np.clip(np.einsum("ki,ki->k", b[first], b[second]), -1, 1))
        for b in (bearings_camera, bearings_lidar)
    ]
    usable = (np.abs(own[0] - own[1]) < 2 * tolerance) & (own[0] > tolerance)
    first, second = first[usable], second[usable]
    best, agree = 0, np.zeros(count, bool)
    cosine = np.cos(tolerance)
    chosen = np.stack([first, second], axis=1)
    for part in np.array_split(chosen, max(1, len(chosen) // 500)):
        if not len(part):
            continue
        R = _fit(bearings_camera[part], bearings_lidar[part])
        near = np.einsum("mi,kij,mj->km", bearings_camera, R, bearings_lidar, optimize=True)
        votes = (near > cosine).sum(1)
        k = int(votes.argmax())
        if votes[k] > best:
            best, agree = int(votes[k]), near[k] > cosine
    if best < 2:
        return np.eye(3), np.zeros(count, bool)
    return _fit(bearings_camera[None, agree], bearings_lidar[None, agree])[0], agree


def _fit(to: Array, of: Array) -> Array:
    """(K, 3, 3) rotations that map (K, N, 3) vectors `of` onto `to` (Umeyama 1991)."""
    U, _, Vt = np.linalg.svd(np.einsum("kni,knj->kij", to, of))
    sign = np.where(np.linalg.det(U @ Vt) < 0, -1.0, 1.0)
    U[:, :, 2] *= sign[:, None]
    return np.asarray(U @ Vt)
