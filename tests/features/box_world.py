"""A closed-form ray caster for worlds made of boxes: exact ranges and exact edges."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class BoxWorld:
    """Boxes standing in a room, on a ground plane, or in the air.

    Args:
        T_lidar_box: (B, 4, 4) pose of each box's centre in the LiDAR frame.
        half_sizes: (B, 3) metres.
        hollow: (B,) True where the scanner is inside the box (a room).
    """

    T_lidar_box: Array
    half_sizes: Array
    hollow: NDArray[np.bool_]

    def ranges(self, directions: Array) -> Array:
        """Distance along (N, 3) unit rays from the scanner to the first surface; inf if none."""
        nearest = np.full(len(directions), np.inf)
        for T, half, hollow in zip(self.T_lidar_box, self.half_sizes, self.hollow, strict=True):
            origin = -T[:3, :3].T @ T[:3, 3]
            rays = directions @ T[:3, :3]
            with np.errstate(divide="ignore"):
                one, other = (-half - origin) / rays, (half - origin) / rays
            enter = np.minimum(one, other).max(axis=1)
            leave = np.maximum(one, other).min(axis=1)
            hit = (leave > 0) & (leave >= enter) & (hollow | (enter > 0))
            nearest = np.where(hit, np.minimum(nearest, leave if hollow else enter), nearest)
        return nearest

    def edges(self) -> Array:
        """(12 B, 2, 3) edges of all boxes in the LiDAR frame, metres."""
        corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
        pairs = [
            (i, j) for i in range(8) for j in range(i) if (corners[i] != corners[j]).sum() == 1
        ]
        return np.concatenate(
            [
                (corners * half @ T[:3, :3].T + T[:3, 3])[pairs]
                for T, half in zip(self.T_lidar_box, self.half_sizes, strict=True)
            ]
        )


def beam_directions(
    rings: int = 128, columns: int = 2048, elevation_deg: float = 22.5, azimuth_deg: float = 360.0
) -> Array:
    """(rings, columns, 3) unit directions of a spinning scanner, top ring first, clockwise."""
    elevation = np.radians(np.linspace(elevation_deg, -elevation_deg, rings))[:, None]
    half = np.radians(azimuth_deg) / 2
    azimuth = np.linspace(half, -half, columns, endpoint=False)[None]
    return np.stack(
        [
            np.cos(elevation) * np.cos(azimuth),
            np.cos(elevation) * np.sin(azimuth),
            np.sin(elevation) + 0 * azimuth,
        ],
        axis=-1,
    )


def scan(
    world: BoxWorld,
    directions: Array,
    rng: np.random.Generator,
    noise_m: float = 0.02,
    dropout: float = 0.01,
    reach_m: float = 80.0,
) -> Array:
    """(rings, columns, 3) simulated points with range noise; NaN where nothing came back."""
    ranges = world.ranges(directions.reshape(-1, 3)).reshape(directions.shape[:2])
    ranges = np.where(ranges < reach_m, ranges, np.nan)
    ranges = ranges + rng.normal(0, noise_m, ranges.shape)
    ranges[rng.random(ranges.shape) < dropout] = np.nan
    return directions * ranges[..., None]


def pose(xyz: tuple[float, float, float], yaw_deg: float = 0.0) -> Array:
    """4x4 transform of a translation and a turn about z."""
    yaw = np.radians(yaw_deg)
    T = np.eye(4)
    T[:2, :2] = [[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]]
    T[:3, 3] = xyz
    return T


def tilt(roll_deg: float, pitch_deg: float) -> Array:
    """4x4 rotation of a scanner that does not stand quite upright."""
    roll, pitch = np.radians([roll_deg, pitch_deg])
    T = np.eye(4)
    T[:3, :3] = np.array(
        [[np.cos(pitch), 0, np.sin(pitch)], [0, 1, 0], [-np.sin(pitch), 0, np.cos(pitch)]]
    ) @ np.array([[1, 0, 0], [0, np.cos(roll), -np.sin(roll)], [0, np.sin(roll), np.cos(roll)]])
    return T


def room_with_boxes(seed: int, boxes: int = 12) -> BoxWorld:
    """A hall of about 20 m with boxes on its floor, seen from 1.6 m by a tilted scanner."""
    rng = np.random.default_rng(seed)
    floor = -1.6
    poses, halves, hollow = [], [], []
    length, width, height = rng.uniform([14, 10, 4], [24, 18, 6])
    poses.append(pose((rng.uniform(-2, 2), rng.uniform(-2, 2), floor + height / 2), 20.0))
    halves.append([length / 2, width / 2, height / 2])
    hollow.append(True)
    placed: list[Array] = [np.zeros(2)]
    while len(poses) <= boxes:
        place = rng.uniform([-length / 2 + 1, -width / 2 + 1], [length / 2 - 1, width / 2 - 1])
        if min(float(np.linalg.norm(place - other)) for other in placed) < 2.2:
            boxes -= 1
            continue
        placed.append(place)
        half = rng.uniform([0.2, 0.2, 0.25], [0.8, 0.8, 1.2])
        box = pose((place[0], place[1], floor + half[2]), rng.uniform(0, 90))
        poses.append(poses[0] @ pose((0, 0, -poses[0][2, 3])) @ box)
        halves.append(list(half))
        hollow.append(False)
    lean = tilt(*rng.uniform(-4, 4, 2))
    return BoxWorld(np.array([lean @ T for T in poses]), np.array(halves), np.array(hollow))


def yard_with_boxes(seed: int, boxes: int = 14) -> BoxWorld:
    """Boxes of all sizes up to 40 m away on open ground under the sky."""
    rng = np.random.default_rng(seed)
    floor = -1.6
    poses = [pose((0, 0, floor - 1.0), 10.0)]
    halves = [[200.0, 200.0, 1.0]]
    for _ in range(boxes):
        distance, azimuth = rng.uniform(4, 40), rng.uniform(0, 2 * np.pi)
        half = rng.uniform([0.3, 0.3, 0.3], [1, 1, 1.0]) * (0.6 + distance / 12)
        distance += float(np.hypot(half[0], half[1]))
        xy = distance * np.array([np.cos(azimuth), np.sin(azimuth)])
        poses.append(pose((xy[0], xy[1], floor + half[2]), rng.uniform(0, 90)))
        halves.append(list(half))
    lean = tilt(*rng.uniform(-4, 4, 2))
    return BoxWorld(
        np.array([lean @ T for T in poses]), np.array(halves), np.zeros(len(poses), bool)
    )


def distance_to_edges(segments: Array, edges: Array, samples: int = 9) -> Array:
    """(M, samples) distance of points along each segment from the nearest true edge, metres."""
    steps = np.linspace(0, 1, samples)[:, None]
    points = segments[:, None, 0] + steps * (segments[:, 1] - segments[:, 0])[:, None]
    start, along = edges[:, 0], edges[:, 1] - edges[:, 0]
    offset = points[:, :, None] - start
    t = np.clip((offset * along).sum(-1) / (along * along).sum(-1), 0, 1)
    return np.linalg.norm(offset - t[..., None] * along, axis=-1).min(axis=2)
