"""A made-up surface with a picture on it, seen by a camera and by a LiDAR: exact truth."""

from __future__ import annotations

import numpy as np

from lcdata.geometry import se3
from lcdata.geometry.camera import Camera
from lcdata.pair import Pair

CAMERA = Camera("pinhole", 640, 400, (320, 320, 320, 200), (-0.1, 0.02, 0.001, -0.001))
R_CAMERA_LIDAR = np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]])


def smooth_noise(shape, sigma, rng):
    """Random picture, 0 .. 1."""
    import cv2

    noise = cv2.GaussianBlur(rng.normal(size=shape).astype(np.float32), (0, 0), sigma)
    return (noise - noise.min()) / (noise.max() - noise.min())


def textured_pair(seed, points=12_000, camera=CAMERA, noise=0.05, map_intensity=None):
    """Points all over the image and beyond, as bright as the image where they are seen.

    Args:
        seed: Of picture, distances, pose and noise.
        points: How many.
        camera: The camera.
        noise: Of the intensities; the picture spans 0 .. 1.
        map_intensity: Applied to the intensities, for another sensor's unit.
    """
    rng = np.random.default_rng(seed)
    shape = camera.height, camera.width
    picture = 0.5 * smooth_noise(shape, 4, rng) + 0.5 * smooth_noise(shape, 25, rng)
    distance = 4 + 12 * smooth_noise(shape, 40, rng)
    pixels = rng.uniform(0, [camera.width - 1, camera.height - 1], (points, 2))
    column, row = np.rint(pixels).astype(int).T
    place = camera.unproject(pixels) * distance[row, column][:, None]
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R_CAMERA_LIDAR, rng.normal(size=3) * 0.1
    T = se3.exp([0, 0, 0, *rng.normal(size=3) * 0.05]) @ T
    light = picture[row, column] + noise * rng.normal(size=points)
    light = 1000 * np.exp(light) if map_intensity is None else map_intensity(light)
    return Pair(
        (255 * picture).astype(np.uint8),
        se3.apply(se3.inverse(T), place).astype(np.float32),
        light.astype(np.float32),
        camera,
        T_camera_lidar=T,
    )
