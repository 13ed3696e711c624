"""Association of projected edge points, their derivatives and their weights."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from lcdata.features.edge_alignment import Alignment, EdgeNoise, EdgeView, lidar_variance
from lcdata.features.image_edges import DIRECTION_WEIGHT, image_edges
from lcdata.features.nid_views import nid_image
from lcdata.geometry import se3
from lcdata.geometry.camera import Camera

CAMERAS = {
    "pinhole": Camera(
        "pinhole", 640, 480, (500.0, 510.0, 318.0, 243.0), (-0.1, 0.05, 1e-3, -5e-4, 0.0)
    ),
    "fisheye": Camera("fisheye", 640, 480, (300.0, 302.0, 318.0, 243.0), (0.02, -0.01, 0.0, 0.0)),
    "equirectangular": Camera("equirectangular", 1024, 512, ()),
}


def polygons(width, height, seed=0):
    """A picture of some bright and dark triangles."""
    rng = np.random.default_rng(seed)
    image = np.full((height, width), 90, np.uint8)
    for _ in range(12):
        corners = rng.uniform(0, [width, height], (3, 2)).astype(np.int32)
        cv2.fillPoly(image, [corners], int(rng.integers(20, 240)))
    return image


def alignment(name, seed=0, count=3000):
    """Random edge points before a picture: (Alignment, pose)."""
    camera = CAMERAS[name]
    rng = np.random.default_rng(seed)
    image = nid_image(polygons(camera.width, camera.height), camera)
    points = rng.uniform([-4, -3, 3], [4, 3, 9], (count, 3))
    tangents = rng.normal(size=(count, 3))
    tangents /= np.linalg.norm(tangents, axis=1, keepdims=True)
    T = se3.exp([0.05, -0.02, 0.1, 0.03, -0.02, 0.05])
    local = se3.apply(se3.inverse(T), points)
    blocks = rng.integers(0, 48, count).astype(np.uint8)
    view = EdgeView(image, image_edges(image), local, tangents @ T[:3, :3], np.zeros(count), blocks)
    return Alignment([view], EdgeNoise(), np.deg2rad(20.0)), T


@pytest.mark.parametrize("name", CAMERAS)
def test_derivatives_are_those_of_finite_differences(name):
    whole, T = alignment(name)
    matches = whole.matches(T, 0.02)
    assert len(matches.residual) > 60
    step = 1e-6
    for k in range(6):
        twist = np.zeros(6)
        twist[k] = step
        ahead, back = (whole.matches(se3.exp(s * twist) @ T, 0.02) for s in (1.0, -1.0))
        if not len(ahead.residual) == len(back.residual) == len(matches.residual):
            continue  # a match on the edge of its gate came or went
        numeric = (ahead.residual - back.residual) / (2 * step)
        same = (ahead.normals == back.normals).all(axis=1)
        scale = np.abs(matches.jacobian[:, k]).max()
        assert same.mean() > 0.9
        np.testing.assert_allclose(
            numeric[same], matches.jacobian[same, k], atol=2e-4 * scale, rtol=1e-3
        )


@pytest.mark.parametrize("name", CAMERAS)
def test_weights_are_those_of_monte_carlo(name):
    camera = CAMERAS[name]
    rng = np.random.default_rng(2)
    T = se3.exp([0.2, -0.1, 0.1, 0.1, -0.2, 0.05])
    noise = EdgeNoise(0.03, np.deg2rad(0.1), 1.0)
    n = np.array([0.6, 0.8])
    for _ in range(3):
        p = se3.apply(se3.inverse(T), rng.uniform([-2, -1, 3], [2, 1, 8], (1, 3)))[0]
        r = np.linalg.norm(p)
        across = np.linalg.svd(p[None])[2][1:]
        bearing = rng.normal(0.0, noise.bearing_rad, (20_000, 2)) @ across
        samples = (p / r + bearing) * (r + rng.normal(0.0, noise.range_m, (20_000, 1)))
        pixels, _ = camera.project(se3.apply(T, samples))
        step = 1e-5
        ahead, _ = camera.project(se3.apply(T, p) + step * np.eye(3))
        back, _ = camera.project(se3.apply(T, p) - step * np.eye(3))
        a = (ahead - back) @ n / (2 * step)
        predicted = lidar_variance(a[None], (T[:3, :3] @ p)[None], noise)[0]
        assert predicted == pytest.approx(np.var(pixels @ n), rel=0.05)


def test_association_is_that_of_brute_force():
    camera = CAMERAS["pinhole"]
    image = nid_image(polygons(camera.width, camera.height), camera)
    edges = image_edges(image)
    rng = np.random.default_rng(3)
    pixels = rng.uniform(0, [639, 479], (400, 2))
    angle = rng.uniform(0, np.pi, 400)
    along = np.stack([np.cos(angle), np.sin(angle)], 1)
    gate, largest = 15.0, np.deg2rad(20.0)
    found = edges.nearest(pixels, along, gate, largest)
    other = np.arctan2(edges.normals[:, 1], edges.normals[:, 0]) + np.pi / 2
    weight = DIRECTION_WEIGHT * edges.focal
    for k in range(400):
        place = np.linalg.norm(edges.points - pixels[k], axis=1)
        turn = 2.0 * weight * np.abs(np.sin(other - angle[k]))
        best = int(np.argmin(np.hypot(place, turn)))
        sine = abs(np.sin(other[best] - angle[k]))
        good = place[best] <= gate and sine <= np.sin(largest)
        assert found[k] == (best if good else -1)
    assert (found >= 0).sum() > 20


def test_edges_of_a_step_are_where_it_is():
    image = np.full((480, 640), 60, np.uint8)
    tilt = np.deg2rad(7.0)
    x, y = np.meshgrid(np.arange(640), np.arange(480))
    distance = (x - 320.3) * np.cos(tilt) + (y - 240) * np.sin(tilt)
    image = np.clip(60 + 120 * (distance + 0.5), 60, 180).astype(np.uint8)
    camera = CAMERAS["pinhole"]
    edges = image_edges(nid_image(image, camera))
    inner = (np.abs(edges.points - [320, 240]) < [300, 200]).all(axis=1)
    off = (edges.points[inner] - [320.3, 240]) @ [np.cos(tilt), np.sin(tilt)]
    assert np.abs(off).max() < 0.25
    turn = np.abs(edges.normals[inner] @ [-np.sin(tilt), np.cos(tilt)])
    assert np.quantile(turn, 0.95) < np.sin(np.deg2rad(3.0))
    assert edges.alone.min() > 0.5


def test_a_blank_picture_has_no_edges_and_no_matches():
    camera = CAMERAS["pinhole"]
    edges = image_edges(nid_image(np.full((480, 640), 77, np.uint8), camera))
    assert len(edges.points) == 0
    assert (edges.nearest(np.ones((3, 2)), np.ones((3, 2)), 10.0, 0.3) == -1).all()


def test_brick_proves_less_than_a_line_alone():
    image = np.full((480, 640), 90, np.uint8)
    for column in range(20, 300, 12):
        image[60:420, column : column + 5] = 200
    image[:, 520:] = 200
    edges = image_edges(nid_image(image, CAMERAS["pinhole"]))
    brick = edges.alone[(edges.points[:, 0] < 280) & (np.abs(edges.points[:, 1] - 240) < 100)]
    alone = edges.alone[np.abs(edges.points[:, 0] - 520) < 2]
    assert np.median(brick) < 0.5 * np.median(alone)
