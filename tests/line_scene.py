"""A synthetic world of straight edges, seen by a camera: lines with exact truth."""

from __future__ import annotations

import numpy as np

from lcdata.features.distance_fields import FIELDS, distance_fields
from lcdata.features.line_features import LineFeatures
from lcdata.features.line_solver import Problem
from lcdata.features.matching import project_segments
from lcdata.geometry import se3
from lcdata.geometry.camera import Camera

CAMERA = Camera("pinhole", 1280, 720, (530, 530, 640, 360))
R_CAMERA_LIDAR = np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]])


def random_problem(rng, count, noise=1.0, direction=None, focus=None):
    """True pose and `count` matched lines 4-15 m away with `noise` pixels on image end points.

    Args:
        rng: Random generator.
        count: Number of lines.
        noise: Pixels.
        direction: (3,) of all lines in the camera frame, for parallel lines.
        focus: (3,) point in the camera frame that all lines go through.
    """
    T = se3.exp(rng.normal(size=6) * 0.3)
    camera, image = [], []
    while len(camera) < count:
        middle = rng.uniform([-6, -3, 4], [6, 3, 15])
        if focus is not None:
            along = middle - focus
        else:
            along = rng.normal(size=3) if direction is None else np.array(direction, float)
        half = along / np.linalg.norm(along) * rng.uniform(1.5, 4)
        segment = np.stack([middle - half, middle + half])
        if segment[:, 2].min() < 1:
            continue
        pixels = segment[:, :2] / segment[:, 2:] * 530 + [640, 360]
        inside = (pixels > 0).all() and (pixels < [1280, 720]).all()
        if inside and np.linalg.norm(pixels[1] - pixels[0]) > 40:
            camera.append(segment)
            image.append(pixels)
    segments = se3.apply(se3.inverse(T), np.reshape(camera, (-1, 3))).reshape(-1, 2, 3)
    pixels = np.array(image) + rng.normal(size=(count, 2, 2)) * noise
    sigma = np.full(count, max(noise, 0.1) / 530)
    return T, Problem(segments, (pixels - [640, 360]) / 530, sigma, np.zeros(count))


def box(centre, size, yaw):
    """(12, 2, 3) edges of an upright box."""
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) / 2 * size
    c, s = np.cos(yaw), np.sin(yaw)
    corners = corners @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]) + centre
    edges = [(i, j) for i in range(8) for j in range(i + 1, 8) if (i ^ j).bit_count() == 1]
    return np.array([[corners[i], corners[j]] for i, j in edges])


def world(seed):
    """True pose and features of a room with boxes: noise, missing lines and clutter."""
    rng = np.random.default_rng(seed)
    edges = [box(np.array([2, 1, 1.0]), np.array([40, 30, 5.0]), 0.2)]
    for _ in range(12):
        size, azimuth = rng.uniform([0.3, 0.3, 0.5], 3), rng.uniform(-np.pi, np.pi)
        away = rng.uniform(4, 18)
        place = np.array([away * np.cos(azimuth), away * np.sin(azimuth), size[2] / 2 - 1.5])
        edges.append(box(place, size, rng.uniform(0, 3)))
    segments = np.concatenate(edges)
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R_CAMERA_LIDAR, rng.normal(size=3) * 0.3
    T = se3.exp([0, 0, 0, *rng.normal(size=3) * 0.2]) @ T
    nothing = LineFeatures(CAMERA, np.zeros((0, 4)), segments, np.full(len(segments), 0.01), {})
    _, seen = project_segments(nothing, T)
    seen = seen[rng.random(len(seen)) < 0.7]
    seen = seen + rng.normal(size=seen.shape) * 0.7
    count = 2 * len(seen)
    start = rng.uniform([0, 0], [1280, 720], (count, 2))
    angle = rng.choice([0, np.pi / 2, 0.5], count) + rng.normal(size=count) * 0.1
    length = rng.exponential(60, count) + 20
    along = np.stack([np.cos(angle), np.sin(angle)], 1) * length[:, None]
    lines = np.concatenate([seen.reshape(-1, 4), np.concatenate([start, start + along], 1)])
    measured = segments + rng.normal(size=segments.shape) * 0.01
    return T, features(lines, measured)


def features(lines, segments, camera=CAMERA):
    """Features of given lines."""
    scale = camera.intrinsics[0] / 1000
    fields = {tau: distance_fields(lines, camera, tau * scale, a) for tau, a in FIELDS.items()}
    return LineFeatures(camera, lines, segments, np.full(len(segments), 0.01), fields)


def perturbed(T, rng, rotation_deg=5.0, translation=0.5):
    """The protocol's wrong initial guess: both errors on each axis with random signs."""
    T = T.copy()
    twist = np.deg2rad(rotation_deg) * rng.choice([-1, 1], 3)
    T[:3, :3] = se3.exp([0, 0, 0, *twist])[:3, :3] @ T[:3, :3]
    T[:3, 3] += translation * rng.choice([-1, 1], 3)
    return T


def errors(T_estimate, T):
    """Degrees and metres."""
    return np.rad2deg(se3.rotation_error(T_estimate, T)), se3.translation_error(T_estimate, T)
