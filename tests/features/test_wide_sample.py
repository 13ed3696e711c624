from __future__ import annotations

import numpy as np
import pytest

from lcdata.features.wide_classes import CLASSES, GROUND_SHADES, find_ground, point_classes
from lcdata.features.wide_frames import scenes, signature
from lcdata.features.wide_sample import sample, seen
from lcdata.features.wide_surface import INFLATION, PRIOR, SPREAD, middle, scatter
from lcdata.geometry import se3
from lcdata.geometry.camera import Camera

CAMERA = Camera("pinhole", 320, 200, (200, 200, 159.5, 99.5))


def test_margin_widens_the_view_by_its_angle():
    angle = np.deg2rad(np.arange(0.0, 180.0, 0.5))
    ring = np.stack([np.sin(angle), 0 * angle, np.cos(angle)], 1).astype(np.float32)
    edge = np.arctan(160 / 200)
    for margin in (0.0, 0.1, 0.3):
        found = seen(CAMERA, ring, margin) if margin else CAMERA.project(ring)[1]
        assert angle[found].max() == pytest.approx(edge + margin, abs=0.012)
    panorama = Camera("equirectangular", 400, 200)
    assert seen(panorama, ring, 0.1).all()
    assert not len(seen(CAMERA, np.zeros((0, 3), np.float32), 0.1))


def test_the_nearest_point_of_a_direction_hides_the_others():
    rng = np.random.default_rng(0)
    far = rng.uniform([-3, -2, 9], [3, 2, 11], (3000, 3))
    near = far[:500] * 0.5
    behind = -near
    points = np.concatenate([far, near, behind]).astype(np.float32)
    found = sample(CAMERA, points, np.eye(4), 0.1)
    assert len(found.index) == len(found.roughness) == len(np.unique(found.index))
    assert not (found.index >= 3500).any()
    assert not (found.index < 500).any()
    assert (found.roughness >= 0).all()
    assert found.roughness.max() > 0.1
    empty = sample(CAMERA, behind.astype(np.float32), np.eye(4), 0.1)
    assert len(empty.index) == 0


def ground_scene(rng):
    flat = rng.uniform([-15, -15, -1.75], [15, 15, -1.65], (2000, 3))
    rest = rng.uniform([-15, -15, -1], [15, 15, 4], (2000, 3))
    T = se3.exp([0, 0, 0, 0.05, -0.04, 0.3])
    return se3.apply(T, np.concatenate([flat, rest])).astype(np.float32), T


def test_ground_is_the_plane_below():
    rng = np.random.default_rng(1)
    points, T = ground_scene(rng)
    ground = find_ground(points, np.array([0.0, 0, 1]), rng)
    assert ground.found
    assert np.degrees(np.arccos(ground.normal @ T[:3, 2])) < 0.5
    height = points[:2000] @ ground.normal + ground.offset
    assert np.abs(height).max() < 0.15
    alone = find_ground(points[2000:2040], np.array([0.0, 0, 1]), rng)
    assert not alone.found
    assert not find_ground(points[:0], np.array([0.0, 0, 1]), rng).found


def test_classes_are_evenly_filled_ranks():
    rng = np.random.default_rng(2)
    points, _ = ground_scene(rng)
    ground = find_ground(points, np.array([0.0, 0, 1]), rng)
    light = rng.random(len(points)).astype(np.float32)
    rough = rng.random(len(points)).astype(np.float32)
    halves = np.split(np.arange(len(points)), 2)
    classes = point_classes(
        [points[h] for h in halves],
        [light[h] for h in halves],
        [rough[h] for h in halves],
        [ground, ground],
    )
    assert [len(c) for c in classes] == [2000, 2000]
    count = np.bincount(np.concatenate(classes), minlength=CLASSES)
    assert len(count) == CLASSES
    assert count[:GROUND_SHADES].sum() >= 2000
    assert np.ptp(count[:GROUND_SHADES]) <= 1
    dark = point_classes([points], [0 * light], [rough], [ground])[0]
    assert dark.max() < CLASSES


def test_scans_of_a_still_lidar_are_one_scene():
    rng = np.random.default_rng(3)
    direction = rng.normal(size=(20_000, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    marks = []
    for room in ((5, 7, 3), (9, 4, 6)):
        reach = np.min(np.array(room) / np.abs(direction), axis=1, keepdims=True)
        for _ in range(2):
            noise = 1 + 0.002 * rng.normal(size=(len(direction), 1))
            marks.append(signature((direction * reach * noise).astype(np.float32)))
    assert scenes(marks) == [[0, 1], [2, 3]]
    assert scenes([]) == []


def rough_valley(rng, x0):
    """A quadratic about a displacement, with a roughness that has minima everywhere."""
    A = rng.normal(size=(6, 6))
    H = A @ A.T + 2 * np.eye(6)
    waves, phases = rng.normal(size=(20, 6)) * 20, rng.uniform(0, 6, 20)

    def costs(poses):
        w = np.array([se3.log(p)[3:] for p in poses])
        z = np.concatenate([w, poses[:, :3, 3]], 1) / SPREAD - x0
        return np.einsum("ni,ij,nj->n", z, H, z) + np.sin(z @ waves.T + phases).sum(1)

    return costs


def test_middle_of_a_rough_valley():
    rng = np.random.default_rng(4)
    x0 = rng.uniform(-2, 2, 6)
    found = middle(rough_valley(rng, x0), np.eye(4))
    place = np.concatenate([se3.log(found)[3:], found[:3, 3]]) / SPREAD
    np.testing.assert_allclose(place, x0, atol=0.35)
    # Upside down there is no valley: stay.
    assert np.array_equal(middle(lambda p: -np.square(p[:, :3, 3]).sum(1), np.eye(4)), np.eye(4))


def twist(x, T):
    """Left perturbation of a displacement in standard deviations."""
    other = se3.exp([0, 0, 0, *(x * SPREAD)[:3]]) @ T
    other[:3, 3] = T[:3, 3] + (x * SPREAD)[3:]
    return se3.log(other @ se3.inverse(T))


def test_scatter_is_that_of_minima_of_halves_and_frames():
    rng = np.random.default_rng(5)
    T = np.eye(4)
    T[:3, 3] = 0.3, -0.2, 0.5
    shifts = rng.normal(size=(400, 6)) * 0.3

    def costs(x0):
        def function(poses):
            w = np.array([se3.log(p @ se3.inverse(T))[3:] for p in poses])
            z = np.concatenate([w, (poses - T)[:, :3, 3]], 1) / SPREAD - x0
            return np.square(z).sum(1)

        return function

    # One frame: halves alone, times what they do not tell, times Student's factor.
    found = scatter(costs(np.zeros(6)), [costs(np.zeros(6))], [costs(x) for x in shifts], T)
    twists = np.array([twist(x, T) for x in shifts])
    expected = INFLATION * PRIOR / (PRIOR - 2.0) * twists.T @ twists / len(twists)
    np.testing.assert_allclose(found, expected, atol=0.03 * expected.max())
    # Five frames that scatter widely one way: the whole, which is their mean, may be off that way.
    frames = np.zeros((5, 6))
    frames[:, 3] = -4, -2, 0, 2, 4
    wide = scatter(costs(np.zeros(6)), [costs(x) for x in frames], [costs(x) for x in shifts], T)
    known = PRIOR + 4
    standard = np.square(frames[:, 3]).sum() / 4 / 5
    ratio = standard / 0.09 / 6
    least = (4 * standard + PRIOR * ratio * 0.09) / (known - 2)
    assert wide[0, 0] == pytest.approx(least * SPREAD[3] ** 2, rel=0.15)
    assert wide[1, 1] == pytest.approx(PRIOR * ratio * 0.09 / (known - 2) * SPREAD[4] ** 2, rel=0.5)
    assert scatter(lambda p: np.zeros(len(p)), [], [], T) is None
