"""Simulated hand-eye data: true links, arm poses, estimates with noise."""

from __future__ import annotations

import numpy as np

from lcdata.arm import Arm
from lcdata.geometry import se3

X = se3.exp([0.02, -0.04, 0.06, 1.2, -1.1, 0.9])
Z = se3.exp([0.1, -0.2, 0.5, 0.1, 0.05, 1.5])
CENTRE = se3.exp([0.3, 0.2, 0.4, 0.1, 2.0, 0.5])
NOISE = np.repeat([0.03, np.deg2rad(0.3)], 3)  # m, rad: a line method on one pair


def arm_poses(rng, n: int, degrees: float = 30.0) -> np.ndarray:
    turns = np.deg2rad(degrees) * rng.uniform(-1, 1, (n, 3))
    shifts = rng.uniform(-0.3, 0.3, (n, 3))
    return np.array([se3.exp([*t, *r]) @ CENTRE for t, r in zip(shifts, turns, strict=True)])


def twists(rng, n: int, std=NOISE) -> np.ndarray:
    return rng.normal(0, 1, (n, 6)) * std


def noisy(rng, T: np.ndarray, std=NOISE) -> np.ndarray:
    return np.array([se3.exp(xi) for xi in twists(rng, len(T), std)]) @ T


def joint_positions(rng, arm: Arm, n: int) -> np.ndarray:
    return np.array([0.2, -0.4, 1.0, 0.3, -0.8, 0.5]) + rng.uniform(-0.6, 0.6, (n, 6))


def link_errors(found) -> np.ndarray:
    """(12,) left perturbations from the found links to the true ones."""
    return np.concatenate(
        [
            se3.log(X @ se3.inverse(found.T_camera_effector)),
            se3.log(Z @ se3.inverse(found.T_base_lidar)),
        ]
    )
