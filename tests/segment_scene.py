"""A made-up world of flat patches, one colour, brightness and plane each: exact truth."""

from __future__ import annotations

import numpy as np

from lcdata.geometry import se3
from lcdata.geometry.camera import Camera
from lcdata.pair import Pair

CAMERA = Camera("pinhole", 640, 400, (320, 320, 320, 200), (-0.1, 0.02, 0.001, -0.001))
R_CAMERA_LIDAR = np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]])


def patches(seed, camera=CAMERA, count=60):
    """(H, W) patch of each pixel: the nearest of random seeds."""
    from scipy.spatial import cKDTree

    rng = np.random.default_rng(seed)
    middles = rng.uniform(0, [camera.width, camera.height], (count, 2))
    v, u = np.mgrid[: camera.height, : camera.width]
    return cKDTree(middles).query(np.stack([u, v], -1))[1]


def patch_pair(seed, points=8000, camera=CAMERA, intensity=True, pair_id="", T=None):
    """Points all over the image, as bright as the patch they are on and in its plane."""
    rng = np.random.default_rng(seed + 1000)
    label = patches(seed, camera)
    count = label.max() + 1
    colour = rng.integers(0, 256, (count, 3)).astype(np.uint8)
    brightness = rng.uniform(0, 1, count)
    distance = rng.uniform(4, 12, count)
    normal = rng.normal(size=(count, 3)) * 0.5 + [0, 0, 1.5]
    pixels = rng.uniform(0, [camera.width - 1, camera.height - 1], (points, 2))
    column, row = np.rint(pixels).astype(int).T
    own = label[row, column]
    ray = camera.unproject(pixels)
    middle = camera.unproject(np.array([[camera.width / 2, camera.height / 2]]))[0]
    depth = distance[own] * (normal[own] @ middle) / np.einsum("ij,ij->i", normal[own], ray)
    place = ray * np.clip(depth, 2, 30)[:, None]
    if T is None:
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = R_CAMERA_LIDAR, rng.normal(size=3) * 0.1
        T = se3.exp([0, 0, 0, *rng.normal(size=3) * 0.05]) @ T
    light = brightness[own] + 0.03 * rng.normal(size=points)
    return Pair(
        colour[label],
        se3.apply(se3.inverse(T), place).astype(np.float32),
        (100 * light).astype(np.float32) if intensity else None,
        camera,
        pair_id=pair_id,
        T_camera_lidar=T,
    )
