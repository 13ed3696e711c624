"""A made-up road, with lane marks and poles, cast ray by ray: exact clouds, pictures and masks."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from lcdata.geometry import se3
from lcdata.geometry.camera import Camera
from lcdata.pair import Pair

CAMERA = Camera("pinhole", 960, 480, (560, 560, 478, 236), (-0.08, 0.02, 0.0005, -0.0004, 0.0))
R_CAMERA_LIDAR = np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]])
SKY, ROAD, LANE, GRASS, POLE, BOX = range(6)
GREY = np.array([200, 80, 225, 110, 150, 120])
LIGHT = np.array([0.0, 12, 70, 25, 35, 30])


@dataclass(frozen=True)
class Road:
    """Marks are x0, x1, y0, y1 on the ground; poles x, y, radius, height; boxes x, y, half sizes
    and height. World frame: x along the road, z up from the ground. Metres."""

    marks: tuple[tuple[float, ...], ...]
    poles: tuple[tuple[float, ...], ...]
    boxes: tuple[tuple[float, ...], ...] = ()


def road(seed, lanes=(-5.4, -1.8, 1.9, 5.5), poles=8, crossing=True, clutter=True):
    """A straight road with dashed inner and solid outer lanes."""
    rng = np.random.default_rng(seed)
    marks = []
    for k, lane in enumerate(lanes):
        y = lane + rng.uniform(-0.2, 0.2)
        if k in {0, len(lanes) - 1}:
            marks.append((-60.0, 90.0, y - 0.075, y + 0.075))
        else:
            start = rng.uniform(-60, -51)
            marks += [(x, x + 4.0, y - 0.075, y + 0.075) for x in np.arange(start, 90, 9.0)]
    if crossing:
        x = rng.uniform(14, 20)
        marks.append((x - 2.5, x - 2.1, *sorted((lanes[0], lanes[-1]))))
        for y in np.arange(lanes[0] + 0.5, lanes[-1] - 0.5, 1.0):
            marks.append((x, x + 3.0, y, y + 0.45))
    stand = [
        (rng.uniform(9, 40), side * rng.uniform(6.8, 11), rng.uniform(0.07, 0.16), 6.0)
        for side in rng.permutation([-1, 1] * poles)[:poles]
    ]
    boxes = []
    if clutter:
        boxes = [(rng.uniform(5, 60), s * rng.uniform(17, 22), 6.0, 3.0, 6.0) for s in (-1, 1, -1)]
        boxes.append((rng.uniform(22, 40), rng.uniform(-3, 3), 2.0, 0.9, 1.5))
    return Road(tuple(marks), tuple(stand), tuple(boxes))


def cast(scene, origin, rays):
    """Distances (inf for none) and kinds of what unit rays (N, 3) of the world frame meet."""
    with np.errstate(divide="ignore", invalid="ignore"):
        far = np.where(rays[:, 2] < -1e-6, -origin[2] / rays[:, 2], np.inf)
        place = origin[:2] + far[:, None] * rays[:, :2]
        kind = np.where(np.abs(place[:, 1]) < 7.5, ROAD, GRASS)
        near = np.flatnonzero((np.abs(place[:, 1]) < 8) & (far < 150))
        x, y = place[near].T
        for x0, x1, y0, y1 in scene.marks:
            kind[near[(x > x0) & (x < x1) & (y > y0) & (y < y1)]] = LANE
        far = np.where(far < 150, far, np.inf)
        kind[~np.isfinite(far)] = SKY
        for x, y, radius, height in scene.poles:
            a = (rays[:, :2] ** 2).sum(1)
            offset = origin[:2] - [x, y]
            b = rays[:, :2] @ offset
            root = b * b - a * (offset @ offset - radius**2)
            t = (-b - np.sqrt(root)) / a
            z = origin[2] + t * rays[:, 2]
            hit = (root > 0) & (t > 0) & (t < far) & (z > 0) & (z < height)
            far[hit], kind[hit] = t[hit], POLE
        for x, y, half_x, half_y, height in scene.boxes:
            low = np.array([x - half_x, y - half_y, 0.0])
            high = np.array([x + half_x, y + half_y, height])
            t0, t1 = (low - origin) / rays, (high - origin) / rays
            near, away = np.minimum(t0, t1).max(1), np.maximum(t0, t1).min(1)
            hit = (near > 0) & (near < away) & (near < far)
            far[hit], kind[hit] = near[hit], BOX
    return far, kind


def mount(seed, rotation_deg=2.0, metres=0.3):
    """`T_world_lidar` and `T_camera_lidar` of a car whose sensors do not sit quite straight."""
    rng = np.random.default_rng([seed, 1])
    T_world_lidar = np.eye(4)
    T_world_lidar[:3, 3] = rng.uniform(-2, 2), rng.uniform(-1.5, 1.5), rng.uniform(1.7, 2.1)
    tilt = np.deg2rad(rng.uniform(-1.5, 1.5, 3))
    T_world_lidar[:3, :3] = se3.exp([0, 0, 0, *tilt])[:3, :3]
    T = np.eye(4)
    T[:3, :3] = R_CAMERA_LIDAR
    T[:3, 3] = [0.0, -0.3, -0.4]
    twist = [*rng.uniform(-metres, metres, 3), *np.deg2rad(rng.uniform(-1, 1, 3) * rotation_deg)]
    return T_world_lidar, se3.exp(twist) @ T


def road_pair(seed, scene=None, camera=CAMERA, rings=64, columns=1000, noise=0.015, T=None):
    """A pair, and its true lane and pole masks (H, W) bool."""
    scene = road(seed) if scene is None else scene
    rng = np.random.default_rng([seed, 2])
    T_world_lidar, T_camera_lidar = mount(seed)
    T_camera_lidar = T_camera_lidar if T is None else T
    elevation = np.deg2rad(np.linspace(15, -25, rings))
    azimuth = np.linspace(-1.75, 1.75, columns)
    e, a = (grid.ravel() for grid in np.meshgrid(elevation, azimuth, indexing="ij"))
    rays = np.column_stack([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])
    R, p = T_world_lidar[:3, :3], T_world_lidar[:3, 3]
    far, kind = cast(scene, p, rays @ R.T)
    seen = np.isfinite(far) & (far < 120)
    far = far[seen] + noise * rng.normal(size=int(seen.sum()))
    points = rays[seen] * far[:, None]
    light = LIGHT[kind[seen]] * np.exp(0.25 * rng.normal(size=len(points)))
    v, u = (grid.ravel() for grid in np.mgrid[: camera.height, : camera.width])
    bearings = camera.unproject(np.column_stack([u, v]))
    T_world_camera = T_world_lidar @ se3.inverse(T_camera_lidar)
    blind = ~np.isfinite(bearings).all(1)
    bearings[blind] = [0, 0, 1]
    kinds = cast(scene, T_world_camera[:3, 3], bearings @ T_world_camera[:3, :3].T)[1]
    kinds[blind] = SKY
    kinds = kinds.reshape(camera.height, camera.width)
    grey = GREY[kinds] + rng.normal(scale=6, size=kinds.shape)
    pair = Pair(
        np.clip(grey, 0, 255).astype(np.uint8),
        points.astype(np.float32),
        light.astype(np.float32),
        camera,
        ring=np.repeat(np.arange(rings), columns)[seen],
        pair_id=f"road/{seed}",
        T_camera_lidar=T_camera_lidar,
    )
    return pair, kinds == LANE, kinds == POLE


@cache
def made(seed, **options):
    """`road_pair`, made once."""
    return road_pair(seed, **options)


def white(*masks):
    """(H, W) uint8, 255 in any of the masks."""
    return np.where(np.logical_or.reduce(masks), np.uint8(255), np.uint8(0))
