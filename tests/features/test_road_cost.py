"""Height maps, means and slopes against brute force and finite differences."""

import numpy as np

from lcdata.features import crlf_refine as refine
from lcdata.features.crlf_coarse import GLANCE
from lcdata.features.road_cloud import RoadCloud
from lcdata.features.road_cost import class_means, flat_poses, height_map, heights
from lcdata.features.road_image import RoadImage
from lcdata.features.road_view import COARSE, FINE, HEIGHTS, road_view, stack, together
from lcdata.geometry import se3
from lcdata.geometry.camera import Camera

CAMERA = Camera("pinhole", 120, 80, (90, 92, 60, 40))
T = se3.exp([0.1, -0.2, 0.3, 0.02, -0.03, 0.01])


def blobs(seed, shape=(80, 120)):
    import cv2

    noise = np.random.default_rng(seed).normal(size=shape).astype(np.float32)
    return cv2.GaussianBlur(noise, (0, 0), 3) > 0.05


def view(seed, count=300):
    """A made-up pair: points anywhere in front of the camera."""
    rng = np.random.default_rng(seed)
    points = rng.uniform([-3, -2, 3], [3, 2, 9], (3, count, 3))
    lane, pole = blobs(seed), blobs(seed + 100)
    lines = np.array([[0.0, 0, 10, 10]])
    cloud = RoadCloud(
        np.eye(3),
        1.5,
        points[0],
        rng.integers(0, 3, count),
        np.zeros((3, 2, 3)),
        points[1],
        rng.integers(0, 4, count),
        np.zeros((4, 2, 3)),
        points[2],
        np.zeros(3),
    )
    return road_view(cloud, RoadImage(CAMERA, 92.0, lane, pole, lines, lines))


def test_heights_are_those_of_equation_8():
    mask = blobs(0, (24, 31))
    found = height_map(mask, 0.7, 0.9)
    y, x = np.nonzero(np.ones_like(mask))
    distance = np.abs(y[:, None] - y) + np.abs(x[:, None] - x)
    inside = mask.ravel()
    deep = np.where(~inside, distance, 999).min(1)
    far = np.where(inside, distance, 999).min(1)
    expected = np.where(inside, 1 - 0.5 * 0.7**deep, 0.5 * 0.9**far)
    np.testing.assert_allclose(found.ravel(), expected, rtol=1e-5)


def test_heights_rise_from_far_away_to_the_middle_of_the_mask():
    mask = np.zeros((5, 60), bool)
    mask[:, 20:40] = True
    row = height_map(mask)[2]
    assert (np.diff(row[:30]) >= 0).all()
    assert row[19] < 0.5 < row[20]


def test_mean_height_of_points_is_that_of_their_nearest_pixels():
    table = np.random.default_rng(0).random((80, 120)).astype(np.float32)
    points = np.random.default_rng(1).uniform([-9, -5, -2], [9, 5, 9], (500, 3))
    seen = se3.apply(T, points)
    pixels, inside = CAMERA.project(seen)
    inside &= seen[:, 2] > 0.1
    column, row = np.floor(pixels[inside] + 0.5).astype(int).T
    expected = table[row, column].sum() / len(points)
    found = heights(flat_poses(T), points, table, np.array(CAMERA.intrinsics))
    np.testing.assert_allclose(found, expected, rtol=1e-6)


def bilinear(table, pixels):
    u, v = pixels.T
    i, j = np.floor(u).astype(int), np.floor(v).astype(int)
    a, b = u - i, v - j
    rows = (1 - a) * table[j, i] + a * table[j, i + 1], (1 - a) * table[j + 1, i]
    return (1 - b) * rows[0] + b * (rows[1] + a * table[j + 1, i + 1])


def test_means_between_pixels_of_all_pairs():
    views = [view(0), view(1, 200)]
    data = stack(together(views), T[None], (10_000,) * 3)
    for kind in (HEIGHTS, FINE, COARSE):
        arrays = (data.points, data.start, data.maps[kind], data.place, data.shape)
        found = class_means(flat_poses(T), *arrays, data.intrinsics, True, 1)[0]
        for v, one in enumerate(views):
            for k, which in enumerate((0, 0, 1)):
                points = data.points[data.start[v, k] : data.start[v, k + 1]]
                pixels, _ = CAMERA.project(se3.apply(T, points))
                inside = (pixels >= 0).all(1) & (pixels < [119, 79]).all(1)
                expected = bilinear(one.maps[kind, which], pixels[inside]).sum() / len(points)
                np.testing.assert_allclose(found[v, k], expected, rtol=1e-4)


def test_the_agreement_is_a_correlation():
    data = stack(together([view(2)]), T[None], (10_000,) * 3)
    lane, road = 0.8, 0.1
    share = refine.lane_share(data)[0]
    a, b, c, d = share * lane, share * (1 - lane), (1 - share) * road, (1 - share) * (1 - road)
    expected = (a * d - b * c) / np.sqrt((a + b) * (c + d) * (a + c) * (b + d))
    np.testing.assert_allclose(refine.phi(lane, road, share), expected, rtol=1e-9)


def test_slopes_are_the_derivatives_of_the_agreement():
    data = stack(together([view(3), view(4)]), T[None], (10_000,) * 3)
    value, gradients = refine.slopes(data, T, COARSE)
    np.testing.assert_allclose(value, refine.agreement(data, T[None], COARSE)[0], rtol=1e-9)
    # Bilinear maps bend where a point changes cells: a long step would feel that.
    steps = 1e-6 * np.eye(6)
    poses = np.array([se3.exp(s * step) @ T for step in steps for s in (1, -1)])
    values = refine.agreement(data, poses, COARSE).reshape(6, 2)
    np.testing.assert_allclose(gradients.sum(0), (values[:, 0] - values[:, 1]) / 2e-6, atol=5e-3)


def test_thinned_points_stay_in_their_classes():
    data = stack(together([view(5), view(6)]), T[None], GLANCE)
    counts = np.diff(data.start, axis=1)
    assert (counts > 0).all()
    assert counts.max() <= GLANCE[0]
    assert data.start[1, 0] == data.start[0, 3]
    assert data.start[1, 3] == len(data.points) == len(data.group)


def test_parts_of_the_points_keep_their_classes():
    data = stack(together([view(7), view(8)]), T[None])
    kept = data.group % 2 == 0
    half = refine.part(data, kept)
    for v in range(2):
        for k in range(3):
            old, new = slice(*data.start[v, k : k + 2]), slice(*half.start[v, k : k + 2])
            np.testing.assert_array_equal(data.points[old][kept[old]], half.points[new])
