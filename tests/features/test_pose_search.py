"""Edges of virtual views, faces of any camera, and the search over all rotations."""

from __future__ import annotations

import numpy as np
import pytest

from lcdata import Camera
from lcdata.features.edge_registration import register
from lcdata.features.edge_score import extract_edge_features, scores
from lcdata.features.image_faces import image_faces
from lcdata.features.lidar_view import field_of_view, fill_holes, lidar_view
from lcdata.features.pose_search import even_rotations
from lcdata.features.view_edges import extract_cloud_edges
from lcdata.geometry import se3
from lcdata.pair import Pair

FORWARD = np.array([[0, -1, 0, 0], [0, 0, -1, 0], [1, 0, 0, 0], [0, 0, 0, 1.0]])


def sector(angle_deg: float, rng: np.random.Generator, count: int = 4000) -> np.ndarray:
    azimuth = np.deg2rad(rng.uniform(-angle_deg / 2, angle_deg / 2, count))
    azimuth[:2] = np.deg2rad(angle_deg / 2) * np.array([1, -1])
    ranges = rng.uniform(2, 20, count)
    return np.stack([ranges * np.cos(azimuth), ranges * np.sin(azimuth), 0 * azimuth], 1)


@pytest.mark.parametrize("angle", [20.0, 76.0, 140.0, 178.0])
def test_the_field_of_view_is_the_largest_angle_between_bearings(angle: float) -> None:
    found, middle = field_of_view(sector(angle, np.random.default_rng(0)))
    assert np.rad2deg(found) == pytest.approx(angle, abs=3.0)
    np.testing.assert_allclose(middle, [1, 0, 0], atol=0.03)


def test_narrow_clouds_get_a_pinhole_and_wide_ones_a_panorama() -> None:
    rng = np.random.default_rng(0)
    for angle, model in ((80.0, "pinhole"), (360.0, "equirectangular")):
        points = sector(angle, rng)
        view = lidar_view(points, rng.uniform(size=len(points)), size=200)
        assert view.camera.model == model
        shown = view.index[view.index >= 0]
        assert len(shown) > 100
        assert view.intensity[view.index < 0].max() == 0


def test_a_view_shows_the_nearest_point_and_survives_empty_clouds() -> None:
    points = np.array([[2.0, 0, 0], [1.0, 0, 0], [3.0, 0, 0], [np.nan] * 3, [0.0, 0, 0]])
    view = lidar_view(points, np.arange(5.0), size=64)
    assert set(view.index[view.measured]) == {1}
    empty = lidar_view(np.full((4, 3), np.nan), None, size=64)
    assert not empty.measured.any()
    assert field_of_view(np.zeros((0, 3)))[0] == 0.0


def test_holes_between_rings_are_filled_and_the_outline_stays() -> None:
    index = np.full((60, 60), -1)
    index[20:41:4, 20:40] = np.arange(20)
    filled = fill_holes(index, 3)
    assert (filled[20:41, 22:38] >= 0).all()
    assert (filled[:19] < 0).all()
    assert (filled[:, :19] < 0).all()


def test_super_fibonacci_rotations_are_rotations_and_spread() -> None:
    R = even_rotations(2000)
    np.testing.assert_allclose(
        R @ np.swapaxes(R, 1, 2), np.tile(np.eye(3), (2000, 1, 1)), atol=1e-9
    )
    cosine = (np.einsum("aij,bij->ab", R[:200], R) - 1) / 2
    cosine[np.arange(200), np.arange(200)] = -1
    nearest = np.rad2deg(np.arccos(np.clip(cosine.max(1), -1, 1)))
    assert nearest.min() > 5
    assert nearest.max() < 35


def test_a_panorama_has_six_faces_and_a_pinhole_one() -> None:
    rng = np.random.default_rng(0)
    image = rng.integers(0, 255, (128, 256), dtype=np.uint8)
    assert len(image_faces(image, Camera("equirectangular", 256, 128))) == 6
    pinhole = Camera("pinhole", 256, 128, (200.0, 200.0, 127.5, 63.5))
    (face,) = image_faces(image, pinhole)
    assert face.image.shape == (128, 256)
    assert face.valid.all()


def boxes(camera: Camera) -> Pair:
    """A board with rectangles of paint and a nearer box, as both sensors see them."""
    T = se3.exp([0.1, -0.15, 0.05, 0.03, -0.05, 0.02]) @ FORWARD
    rng = np.random.default_rng(3)
    paint = [(*rng.uniform(-4, 4, 2), *rng.uniform(0.5, 1.6, 2)) for _ in range(25)]

    def shade(y: np.ndarray, z: np.ndarray) -> np.ndarray:
        value = np.full(y.shape, 60.0)
        for k, (a, b, width, height) in enumerate(paint):
            value[(np.abs(y - a) < width / 2) & (np.abs(z - b) < height / 2)] = 100 + 6 * k
        return value

    def seen(origin: np.ndarray, rays: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        wall = (6.0 - origin[0]) / rays[:, 0]
        box = (4.0 - origin[0]) / rays[:, 0]
        at = origin + box[:, None] * rays
        hit = (np.abs(at[:, 1] - 0.5) < 0.8) & (np.abs(at[:, 2] + 0.6) < 0.5)
        points = np.where(hit[:, None], at, origin + wall[:, None] * rays)
        return points, np.where(hit, 230.0, shade(points[:, 1], points[:, 2]))

    a, b = np.meshgrid(np.linspace(-0.6, 0.6, 500), np.linspace(-0.5, 0.5, 400))
    rays = np.stack([np.ones(a.size), np.tan(a.ravel()), np.tan(b.ravel())], 1)
    points, intensity = seen(np.zeros(3), rays)
    inverse = se3.inverse(T)
    v, u = np.indices((camera.height, camera.width), float)
    bearings = camera.unproject(np.stack([u.ravel(), v.ravel()], 1)) @ inverse[:3, :3].T
    bearings[:, 0] = np.maximum(bearings[:, 0], 1e-3)
    image = seen(inverse[:3, 3], bearings)[1].reshape(camera.height, camera.width)
    return Pair(image.astype(np.uint8), points, intensity, camera, T_camera_lidar=T)


@pytest.fixture(scope="module")
def pair() -> Pair:
    return boxes(Camera("pinhole", 640, 480, (420.0, 420.0, 319.5, 239.5)))


def test_true_poses_score_high_and_others_do_not(pair: Pair) -> None:
    features = extract_edge_features(pair)
    truth = pair.T_camera_lidar
    assert truth is not None
    others = np.tile(truth, (300, 1, 1))
    others[:, :3, :3] = even_rotations(300)
    high = scores([features], truth[None], 0.02, 3000)[0]
    assert high > 5
    assert scores([features], others, 0.02, 3000).max() < 0.5 * high


def test_registration_comes_home_from_half_a_degree(pair: Pair) -> None:
    features = extract_edge_features(pair)
    truth = pair.T_camera_lidar
    start = se3.exp([0.03, -0.03, 0.03, 0.009, -0.008, 0.007]) @ truth
    found = register([features.lines], [features.cloud], start)
    # One wall from the front leaves some rotation open against translation; the picture is right.
    points = pair.points[::50]
    here, there = (pair.camera.project(se3.apply(T, points))[0] for T in (found, truth))
    assert np.median(np.linalg.norm(here - there, axis=1)) < 1.0
    before = pair.camera.project(se3.apply(start, points))[0]
    assert np.median(np.linalg.norm(before - there, axis=1)) > 3.0


def test_edges_of_shape_are_found_without_intensity(pair: Pair) -> None:
    edges = extract_cloud_edges(pair.points, None)
    assert not edges.painted.any()
    # The box's outline, 4 m away.
    assert np.mean(np.abs(edges.points[:, 0] - 4.0) < 0.2) > 0.5
