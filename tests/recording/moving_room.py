"""A spinning LiDAR that moves through a room, its rays cut with the walls in closed form."""

from __future__ import annotations

import numpy as np

from lcdata.geometry import se3

LOW, HIGH = np.array([-3.0, -4.0, -1.2]), np.array([5.0, 2.5, 1.8])
PILLAR_LOW, PILLAR_HIGH = np.array([2.0, -1.5, -1.2]), np.array([2.6, -0.8, 1.8])
SCAN_S = 0.1


def motion(times: np.ndarray, start_s: float = 0.0) -> np.ndarray:
    """(..., 4, 4) `T_room_lidar`: up and down 0.4 m, swaying and turning, from rest at 0."""
    t = np.asarray(times, float) + start_s
    way = np.stack(
        [
            0.08 * (1 - np.cos(1.9 * t)),
            0.06 * (1 - np.cos(1.3 * t)),
            0.20 * (1 - np.cos(2.3 * t)),
        ],
        -1,
    )
    turn = np.stack(
        [0.03 * np.sin(1.1 * t) ** 2, -0.04 * np.sin(1.4 * t) ** 2, 0.12 * (1 - np.cos(1.2 * t))],
        -1,
    )
    T = np.zeros((*t.shape, 4, 4))
    for index in np.ndindex(t.shape):
        T[index] = se3.exp(np.concatenate([np.zeros(3), turn[index]]))
        T[index][:3, 3] = way[index]
    return T


def scan(
    number: int, *, start_s: float = 0.0, std_m: float = 0.01, rings: int = 24, columns: int = 360
) -> tuple[np.ndarray, np.ndarray]:
    """(N, 3) points, each in the LiDAR's frame of its moment, and (N,) seconds since the start."""
    rng = np.random.default_rng([number, 7])
    azimuth = np.repeat(np.linspace(np.pi, -np.pi, columns, endpoint=False), rings)
    elevation = np.tile(np.deg2rad(np.linspace(16.6, -16.6, rings)), columns)
    seconds = np.repeat(np.arange(columns) * SCAN_S / columns, rings)
    ahead = np.stack(
        [
            np.cos(elevation) * np.cos(azimuth),
            np.cos(elevation) * np.sin(azimuth),
            np.sin(elevation),
        ],
        1,
    )
    moments, index = np.unique(seconds, return_inverse=True)
    T = motion(number * SCAN_S + moments, start_s)[index]
    rays, origin = np.einsum("nij,nj->ni", T[:, :3, :3], ahead), T[:, :3, 3]
    with np.errstate(divide="ignore"):
        wall = (np.where(rays > 0, HIGH, LOW) - origin) / rays
        near, far = (PILLAR_LOW - origin) / rays, (PILLAR_HIGH - origin) / rays
    distance = wall.min(axis=1)
    enter = np.minimum(near, far).max(axis=1)
    leave = np.maximum(near, far).min(axis=1)
    distance = np.where((enter < leave) & (enter > 0), np.minimum(enter, distance), distance)
    distance = distance + rng.normal(scale=std_m, size=len(distance))
    return distance[:, None] * ahead, seconds
