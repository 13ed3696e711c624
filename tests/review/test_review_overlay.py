from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lcdata.geometry import se3
from lcdata.geometry.camera import Camera
from lcdata.review import colours
from lcdata.review.frustum import frustum
from lcdata.review.overlay import (
    clip_segments,
    image_strips,
    project_cloud,
    project_segments,
    project_strips,
)

CAMERA = Camera("pinhole", 100, 80, (60.0, 60.0, 50.0, 40.0))
LENSES = (
    Camera("pinhole", 100, 80, (60.0, 60.0, 50.0, 40.0), (-0.2, 0.03, 0, 0, 0)),
    Camera("fisheye", 120, 100, (40.0, 40.0, 60.0, 50.0), (0.02, -0.01, 0.003, -0.0004)),
    Camera("equirectangular", 200, 100),
)


def test_a_segment_that_reaches_behind_the_camera_is_cut_in_front_of_it():
    segment = np.array([[[0.0, 0.0, 4.0], [0.3, 0.0, -1.0]]])
    ((start, end),) = project_segments(CAMERA, np.eye(4), segment)
    np.testing.assert_allclose(start, [50, 40])
    assert end[0] == pytest.approx(99)  # it leaves the image before it reaches the camera
    assert end[1] == pytest.approx(40)


def test_a_segment_behind_the_camera_is_left_out():
    segment = np.array([[[0.0, 0.0, -4.0], [0.3, 0.0, -1.0]]])
    assert project_segments(CAMERA, np.eye(4), segment).shape == (0, 2, 2)


coordinate = st.floats(-300, 300, allow_subnormal=False)


@given(st.tuples(coordinate, coordinate, coordinate, coordinate))
def test_clipped_segments_are_the_part_of_the_line_that_is_inside(values):
    segment = np.array(values).reshape(1, 2, 2)
    clipped = clip_segments(segment, (100, 80))
    share = np.linspace(0, 1, 2001)[:, None]
    samples = segment[0, 0] + share * (segment[0, 1] - segment[0, 0])
    inside = samples[((samples >= 0) & (samples <= [99, 79])).all(axis=1)]
    if len(clipped) == 0:
        assert len(inside) <= 2
        return
    assert (clipped > -1e-6).all()
    assert (clipped < np.array([99, 79]) + 1e-6).all()
    if len(inside) > 2:
        step = np.linalg.norm(segment[0, 1] - segment[0, 0]) / 2000 + 1e-6
        np.testing.assert_allclose(clipped[0], [inside[0], inside[-1]], atol=2 * step)


@pytest.mark.parametrize("camera", LENSES, ids=lambda camera: camera.model)
def test_lines_are_bent_as_the_lens_bends_them(camera):
    """Points of the strips look along the segment, and no strip crosses the picture."""
    segments = np.array([[[-1.5, 0.4, 3.0], [1.2, -0.3, 2.5]], [[0.1, -9.0, 4.0], [0.1, 9.0, 4.0]]])
    if camera.model == "equirectangular":
        segments = np.concatenate([segments, [[[-1.0, 0.2, -2.0], [1.0, 0.2, -2.0]]]])
    T = se3.exp([0.1, -0.05, 0.2, 0.05, -0.1, 0.2])
    strips = project_strips(camera, T, segments)
    assert len(strips) == (4 if camera.model == "equirectangular" else 2)
    normals = [np.cross(*ends) for ends in se3.apply(T, segments.reshape(-1, 3)).reshape(-1, 2, 3)]
    normals = [normal / np.linalg.norm(normal) for normal in normals]
    for strip in strips:
        assert np.abs(np.diff(strip[:, 0])).max() < camera.width / 2
        assert camera.contains(strip).all()
        away = np.abs(camera.unproject(strip) @ np.transpose(normals)).max(axis=0)
        assert away.min() < 1e-4


def test_lines_of_the_undistorted_image_are_put_back():
    camera = LENSES[0]
    plain = camera.undistorted()
    segment = np.array([[[20.0, 15.0], [70.0, 60.0]]])
    (strip,) = image_strips(camera, segment)
    rays = camera.unproject(strip)
    pixels, _ = plain.project(rays)
    direction = np.array([50.0, 45.0]) / np.hypot(50, 45)
    offsets = pixels - segment[0, 0]
    np.testing.assert_allclose(offsets @ [-direction[1], direction[0]], 0, atol=1e-3)
    np.testing.assert_allclose(pixels[[0, -1]], segment[0], atol=1e-3)
    np.testing.assert_array_equal(image_strips(plain, segment)[0], segment[0])


def test_a_full_cloud_is_thinned_evenly():
    points = np.column_stack([np.linspace(-2, 2, 900), np.zeros(900), np.full(900, 5.0)])
    pixels, distances = project_cloud(CAMERA, np.eye(4), points, 50)
    assert len(pixels) == len(distances) == 50
    assert np.ptp(np.diff(pixels[:, 0])) < 0.2
    offsets = (pixels[:, 0] - 50) / 60 * 5
    np.testing.assert_allclose(distances, np.hypot(offsets, 5.0), rtol=1e-5)


def test_frustum_corners_project_to_the_image_corners():
    T = se3.exp([0.1, -0.2, 0.3, 0.2, 0.1, -0.3])
    outline, *_ = frustum(CAMERA, T, 0.7)
    in_camera = se3.apply(T, outline)
    np.testing.assert_allclose(in_camera[:, 2], 0.7)
    pixels = in_camera[:4, :2] / 0.7 * 60 + [50, 40]
    np.testing.assert_allclose(pixels, [[-0.5, -0.5], [99.5, -0.5], [99.5, 79.5], [-0.5, 79.5]])


def test_near_is_red_and_far_is_blue():
    near, far = colours.by_depth(np.array([1.0, 50.0]), (1.0, 50.0))
    red, _, blue = ((int(near) >> shift) & 255 for shift in (24, 16, 8))
    assert red > 2 * blue
    red, _, blue = ((int(far) >> shift) & 255 for shift in (24, 16, 8))
    assert blue > 2 * red


def test_a_cloud_without_a_finite_intensity_has_one_colour():
    assert len(set(colours.by_intensity(np.full(4, np.nan)).tolist())) == 1
    assert colours.by_intensity(np.zeros(0)).shape == (0,)


def test_methods_have_colours_of_their_own():
    six = [f"m{i}" for i in range(6)]
    assert len(set(colours.of_sources(six).values())) == 8
