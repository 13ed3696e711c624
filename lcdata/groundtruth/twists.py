"""Logarithms of stacks of transforms and their Jacobians, in closed form.

Order translation, rotation, as in `geometry.se3`; these are its functions for whole stacks.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lcdata.geometry.se3 import skew

Array = NDArray[np.float64]

SMALL = 0.05
"""Angle below which series replace quotients that lose their digits."""


def log_many(T: Array) -> Array:
    """(N, 6) twists of (N, 4, 4) transforms."""
    from scipy.spatial.transform import Rotation

    rotation = Rotation.from_matrix(T[:, :3, :3]).as_rotvec()
    translation = np.einsum("nij,nj->ni", _rotation_inverse(rotation), T[:, :3, 3])
    return np.concatenate([translation, rotation], axis=1)


def left_jacobian_inverse(twists: Array) -> Array:
    """(N, 6, 6) matrices with `log(exp(d) exp(xi)) = xi + matrix @ d` to first order.

    Barfoot, State Estimation for Robotics, eqs. (7.85), (7.86), (7.95).
    """
    J_inverse = _rotation_inverse(twists[:, 3:])
    result = np.zeros((len(twists), 6, 6))
    result[:, :3, :3] = result[:, 3:, 3:] = J_inverse
    result[:, :3, 3:] = -J_inverse @ _coupling(twists) @ J_inverse
    return result


def adjoint_many(T: Array) -> Array:
    """(N, 6, 6) adjoints of (N, 4, 4) transforms; see `se3.adjoint`."""
    R = T[:, :3, :3]
    result = np.zeros((len(T), 6, 6))
    result[:, :3, :3] = result[:, 3:, 3:] = R
    result[:, :3, 3:] = skew(T[:, :3, 3]) @ R
    return result


def _rotation_inverse(rotation: Array) -> Array:
    """(N, 3, 3) inverse left Jacobians of SO(3)."""
    angle2 = np.einsum("ni,ni->n", rotation, rotation)
    angle = np.sqrt(angle2)
    small = angle < SMALL
    safe = np.where(small, 1.0, angle)
    c = np.where(
        small,
        1 / 12 + angle2 / 720 + angle2**2 / 30240,
        1 / safe**2 - (1 + np.cos(safe)) / (2 * safe * np.sin(safe + 1e-300)),
    )
    S = skew(rotation)
    return np.asarray(np.eye(3) - S / 2 + c[:, None, None] * (S @ S))


def _coupling(twists: Array) -> Array:
    """(N, 3, 3) block Q of the left Jacobian of SE(3), Barfoot eq. (7.86)."""
    P, S = skew(twists[:, :3]), skew(twists[:, 3:])
    angle2 = np.einsum("ni,ni->n", twists[:, 3:], twists[:, 3:])
    angle = np.sqrt(angle2)
    small = angle < SMALL
    t = np.where(small, 1.0, angle)
    sine, cosine = np.sin(t), np.cos(t)
    a = np.where(small, 1 / 6 - angle2 / 120, (t - sine) / t**3)
    b = np.where(small, 1 / 24 - angle2 / 720, (t**2 + 2 * cosine - 2) / (2 * t**4))
    c = np.where(small, 1 / 120 - angle2 / 2520, (2 * t - 3 * sine + t * cosine) / (2 * t**5))
    a, b, c = (x[:, None, None] for x in (a, b, c))
    SP, PS = S @ P, P @ S
    SPS = SP @ S
    return np.asarray(
        P / 2
        + a * (SP + PS + SPS)
        + b * (S @ SP + PS @ S - 3 * SPS)
        + c * (SPS @ S + S @ SPS)
    )
