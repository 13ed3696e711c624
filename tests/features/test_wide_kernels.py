from __future__ import annotations

import numpy as np
import pytest

from lcdata.features.chamfer_search import displaced
from lcdata.features.nid_views import flat
from lcdata.features.wide_kernels import count, field_sums, information
from lcdata.features.wide_labels import LABELS, descriptors, k_means, label_maps, nearest
from lcdata.features.wide_projection import pixels
from lcdata.geometry import camera_kernels, se3
from lcdata.geometry.camera import Camera

CAMERAS = {
    "pinhole": Camera("pinhole", 320, 200, (200, 210, 158, 99)),
    "brown": Camera("pinhole", 320, 200, (200, 210, 158, 99), (-0.1, 0.02, 0.001, -0.001)),
    "fisheye": Camera("fisheye", 320, 200, (120, 120, 158, 99), (0.01, 0.0, 0.0, 0.0)),
}
LENS = (-0.1, 0.02, 0.001, -0.001, 0.003, 0.02, 0.01, 0.001)
OTHERS = {
    "rational": Camera("pinhole", 320, 200, (200, 210, 158, 99), LENS),
    "prism": Camera("pinhole", 320, 200, (200, 210, 158, 99), (*LENS, 0.01, 0.002, -0.01, 0.003)),
    "tilted": Camera(
        "pinhole", 320, 200, (200, 210, 158, 99), (*LENS, 0.0, 0.0, 0.0, 0.0, 0.01, -0.02)
    ),
    "all round": Camera("fisheye", 320, 200, (60, 60, 158, 99), (0.02, -0.003, 0.0, 0.0)),
    "atan": Camera("atan", 320, 200, (150, 160, 158, 99), (0.9,)),
    "omni": Camera("omni", 320, 200, (1.4, 300, 310, 158, 99), (-0.1, 0.02, 0.001, -0.001)),
    "mirror": Camera("omni", 320, 200, (0.8, 120, 120, 158, 99), (-0.05, 0.0, 0.0, 0.0)),
    "panorama": Camera("equirectangular", 320, 160),
}


def scene(camera, count=400):
    rng = np.random.default_rng(0)
    points = rng.uniform([-8, -5, -3], [8, 5, 12], (count, 3)).astype(np.float32)
    poses = displaced(np.eye(4), rng.normal(size=(5, 6)) * 0.1)
    return rng, points, poses, (camera_kernels.model_id(camera), camera_kernels.parameters(camera))


def cells(camera, pose, points, scale, shape):
    """Row and column without border, and whether there are such."""
    pixels, seen = camera.project(se3.apply(pose, points))
    seen &= (camera.model != "pinhole") | (se3.apply(pose, points)[:, 2] > 0.1)
    column, row = np.floor((np.nan_to_num(pixels) + 0.5) * scale).astype(int).T
    return row, column, seen & (row >= 0) & (column >= 0) & (row < shape[0]) & (column < shape[1])


@pytest.mark.parametrize("name", CAMERAS)
def test_histograms_are_those_of_each_point_looked_up_alone(name):
    camera = CAMERAS[name]
    rng, points, poses, model = scene(camera)
    classes = rng.integers(0, 6, len(points)).astype(np.uint8)
    labels = np.full((102, 162), 9, np.uint8)
    labels[1:-1, 1:-1] = rng.integers(0, 9, (100, 160))
    counts = np.zeros((len(poses), 6, 10), np.int32)
    rows = flat(poses).astype(np.float32)
    count(*model, rows, np.ascontiguousarray(points.T), classes, labels, np.float32(0.5), counts)
    for k, pose in enumerate(poses):
        expected = np.zeros((6, 10), int)
        row, column, inside = cells(camera, pose, points, 0.5, (100, 160))
        label = np.full(len(points), 9)
        label[inside] = labels[1:-1, 1:-1][row[inside], column[inside]]
        np.add.at(expected, (classes, label), 1)
        assert 50 < inside.sum() < len(points) - 50
        assert counts[k].sum() == len(points)
        # In single precision a point on a cell's border may fall to its other side.
        assert np.abs(counts[k] - expected).sum() <= 2


@pytest.mark.parametrize("name", [name for name in CAMERAS if name != "pinhole"] + list(OTHERS))
def test_pixels_are_those_of_the_camera(name):
    camera = (CAMERAS | OTHERS)[name]
    rng, _, poses, model = scene(camera)
    points = rng.uniform([-8, -5, -9], [8, 5, 12], (3000, 3)).astype(np.float32)
    us, vs = np.empty((2, len(points)), np.float32)
    for pose in poses:
        pixels(*model, flat(pose[None]).astype(np.float32)[0], points.T.copy(), us, vs)
        expected, seen = camera.project(se3.apply(pose, points))
        seen &= (camera.model != "pinhole") | (se3.apply(pose, points)[:, 2] > 0.1)
        inside = (us >= -0.5) & (us < camera.width - 0.5)
        inside &= (vs >= -0.5) & (vs < camera.height - 0.5)
        # In single precision a point on the image's border may fall to its other side.
        assert (inside != seen).sum() <= 2
        assert (inside & seen).sum() > 100
        found = np.stack([us, vs], 1)[inside & seen]
        np.testing.assert_allclose(found, expected[inside & seen], atol=0.01)


@pytest.mark.parametrize("name", CAMERAS)
def test_field_sums_are_those_of_each_point_looked_up_alone(name):
    camera = CAMERAS[name]
    rng, points, poses, model = scene(camera)
    weights = rng.random(len(points)).astype(np.float32)
    field = np.zeros((202, 322), np.float32)
    field[1:-1, 1:-1] = np.add.outer(np.linspace(-1, 1, 200), np.linspace(-1, 1, 320))
    sums = np.full(len(poses), 2.0)
    rows = flat(poses).astype(np.float32)
    field_sums(*model, rows, np.ascontiguousarray(points.T), weights, field, np.float32(1.0), sums)
    for k, pose in enumerate(poses):
        row, column, inside = cells(camera, pose, points, 1.0, (200, 320))
        values = field[1:-1, 1:-1][row[inside], column[inside]]
        assert sums[k] == pytest.approx(2.0 + weights[inside] @ values, abs=0.02)


def test_information_is_that_of_its_definition():
    counts = np.random.default_rng(1).integers(0, 9, (3, 4, 6)).astype(np.int32)
    counts[2, :, :-1] = 0  # nothing inside
    n = np.arange(1, 1000)
    logs = np.concatenate([[0.0], n * np.log(n)])
    shared, joint, inside = np.empty((3, 3))
    information(counts, logs, shared, joint, inside)
    for k in range(2):
        p = counts[k, :, :-1] / counts[k, :, :-1].sum()
        product = np.outer(p.sum(1), p.sum(0))
        some = p > 0
        assert shared[k] == pytest.approx((p[some] * np.log(p[some] / product[some])).sum())
        assert joint[k] == pytest.approx(-(p[some] * np.log(p[some])).sum())
        assert inside[k] == pytest.approx(counts[k, :, :-1].sum() / counts[k].sum())
    assert shared[2] == joint[2] == inside[2] == 0.0


def test_nearest_centre_is_that_of_all_distances():
    rng = np.random.default_rng(2)
    values = rng.normal(size=(1500, 5)).astype(np.float32)
    centres = rng.normal(size=(7, 5)).astype(np.float32)
    gaps = ((values[:, None] - centres) ** 2).sum(-1)
    found = nearest(np.ascontiguousarray(values.T), centres)
    np.testing.assert_allclose(gaps[np.arange(1500), found], gaps.min(1), rtol=1e-5)


def test_k_means_finds_clusters_and_not_more_than_there_are():
    rng = np.random.default_rng(3)
    truth = np.array([[0, 0], [10, 0], [0, 10]], np.float32)
    values = np.repeat(truth, 50, 0) + rng.normal(size=(150, 2)).astype(np.float32) * 0.1
    found = k_means(values, 3, rng)
    assert np.abs(found[:, None] - truth).sum(-1).min(0).max() < 0.1
    assert len(k_means(np.repeat(truth, 5, 0), 32, rng)) == 3


def test_label_maps_have_a_border_and_common_labels():
    rng = np.random.default_rng(4)
    image = rng.integers(0, 255, (120, 200, 3)).astype(np.uint8)
    grey = np.ascontiguousarray(image[..., 0])
    for level in (0, 1):
        frames = [descriptors(picture, 200.0)[level] for picture in (image, grey)]
        assert all(np.isfinite(f).all() for f in frames)
        maps = label_maps(frames, rng)
        for labels, frame in zip(maps, frames, strict=True):
            assert labels.shape == (frame.shape[0] + 2, frame.shape[1] + 2)
            assert labels[1:-1, 1:-1].max() < LABELS
            assert (labels[[0, -1]] == LABELS).all()
            assert (labels[:, [0, -1]] == LABELS).all()
