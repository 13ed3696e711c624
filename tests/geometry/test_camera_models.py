"""The formulas of every camera model: against OpenCV, closed forms, differences and themselves."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lcdata.errors import GeometryError
from lcdata.geometry.camera import Camera

FOCAL = (530.0, 531.0, 640.2, 355.5)
BROWN = (-0.05, 0.02, 0.001, -0.0005, 0.003)
RATIONAL = (0.1, -0.05, 0.0003, 0.0002, 0.01, 0.12, -0.03, 0.005)
PRISM = (0.001, 0.002, -0.001, 0.003)
TILT = (0.02, -0.03)
KITTI_360 = (2.2134047507854890, 1336.3220825849971, 1335.7883350012958, 716.943, 705.765)
CAMERAS = {
    "pinhole": Camera("pinhole", 1280, 720, FOCAL),
    "plumb_bob": Camera("pinhole", 1280, 720, FOCAL, BROWN),
    "rational": Camera("pinhole", 1280, 720, FOCAL, RATIONAL),
    "prism": Camera("pinhole", 1280, 720, FOCAL, (*RATIONAL, *PRISM)),
    "tilted": Camera("pinhole", 1280, 720, FOCAL, (*RATIONAL, *PRISM, *TILT)),
    "fisheye_200_deg": Camera(
        "fisheye", 1280, 960, (400, 401, 640, 475), (0.02, -0.01, 0.003, -0.0004)
    ),
    "equidistant": Camera("fisheye", 1000, 1000, (300, 300, 499.5, 499.5)),
    "atan": Camera("atan", 1280, 720, FOCAL, (0.93,)),
    "omni_weak": Camera("omni", 1280, 1024, (0.8, 700, 701, 640, 515), (-0.1, 0.05, 0.001, -5e-4)),
    "omni_strong": Camera("omni", 1400, 1400, KITTI_360, (0.0168, 1.6549, 4.2e-4, 4.2e-4)),
    "equirectangular": Camera("equirectangular", 1920, 960),
}
every = pytest.mark.parametrize("camera", CAMERAS.values(), ids=CAMERAS)


def points_around(count: int, seed: int = 0) -> np.ndarray:
    """Points in all directions, 0.5 to 20 m away."""
    rng = np.random.default_rng(seed)
    directions = rng.normal(size=(count, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return directions * rng.uniform(0.5, 20, (count, 1))


def cv(camera: Camera, points: np.ndarray) -> np.ndarray:
    """OpenCV's projection."""
    zero, D = np.zeros(3), np.array(camera.distortion or (0.0,) * 4)
    if camera.model == "fisheye":
        return cv2.fisheye.projectPoints(points[:, None], zero, zero, camera.K, D)[0][:, 0]
    return cv2.projectPoints(points, zero, zero, camera.K, D)[0][:, 0]


@every
def test_derivatives_equal_finite_differences(camera):
    points, step = points_around(3000), 1e-5
    pixels, jacobian, inside = camera.project_jacobian(points)
    np.testing.assert_allclose(pixels, camera.project(points)[0], atol=1e-9)
    differences = np.stack(
        [
            (camera.project(points + d)[0] - camera.project(points - d)[0]) / (2 * step)
            for d in step * np.eye(3)
        ],
        axis=-1,
    )
    # at the seam of a panorama a step crosses the whole image
    smooth = inside & (np.abs(differences).max(axis=(1, 2)) < 1e5)
    assert smooth.sum() > 300
    error = np.abs(jacobian - differences)[smooth].max(axis=(1, 2))
    assert (error < 1e-7 * np.abs(jacobian[smooth]).max(axis=(1, 2)) + 1e-5).all()
    seen = np.isfinite(pixels).all(axis=1)
    assert np.isfinite(jacobian[seen]).all()
    assert np.isnan(jacobian[~seen]).all()


@every
def test_derivatives_on_the_axis_are_its_resolution(camera):
    (pixel,), (jacobian,), _ = camera.project_jacobian([[0.0, 0.0, 2.0]])
    fx, fy = camera.pixels_per_radian
    if camera.model == "pinhole" and len(camera.distortion) == 14:  # the axis is not straight on
        assert abs(jacobian[0, 0] - fx / 2) < 1e-9
        return
    np.testing.assert_allclose(jacobian, [[fx / 2, 0, 0], [0, fy / 2, 0]], atol=1e-9)
    np.testing.assert_allclose(camera.project([[1e-7, 0, 2.0]])[0][0] - pixel, [fx * 5e-8, 0])


@every
def test_compiled_points_equal_arrays(camera):
    from lcdata.geometry import camera_kernels as kernels

    model, p = kernels.model_id(camera), kernels.parameters(camera)
    points = np.append(points_around(300, 1), [[np.nan, 0, 1], [0, 0, np.nan]], axis=0)
    pixels, jacobian, _ = camera.project_jacobian(points)
    for point, pixel, slopes in zip(points, pixels, jacobian, strict=True):
        u, v, *derivatives, ok = kernels.project_point_jacobian(model, p, *point)
        assert ok == np.isfinite(pixel[0])
        np.testing.assert_allclose([u, v], pixel, rtol=1e-12, atol=1e-9)
        np.testing.assert_allclose(derivatives, slopes.ravel() if ok else np.zeros(6), rtol=1e-9)
        assert kernels.project_point(model, p, *point) == pytest.approx((u, v, ok), nan_ok=True)


@every
def test_compiled_blocks_equal_points(camera):
    from lcdata.geometry import camera_kernels as kernels

    model, p = kernels.model_id(camera), kernels.parameters(camera)
    block = np.full(kernels.BLOCK_ROWS * kernels.BLOCK, -7.0)
    rows = block.reshape(kernels.BLOCK_ROWS, kernels.BLOCK)
    points = points_around(kernels.BLOCK, 4)
    points[:3] = [[np.nan, 0, 1], [0, 0, 0], [0, 0, -1]]
    rows[:3] = points.T
    pixels, jacobian, _ = camera.project_jacobian(points)
    seen = np.isfinite(pixels).all(axis=1)
    assert seen.sum() > 20
    for project in (kernels.project_block, kernels.project_block_jacobian):
        rows[3:] = -7.0
        project(model, p, block)
        np.testing.assert_array_equal(np.isfinite(rows[3]), seen)
        np.testing.assert_allclose(rows[3:5, seen].T, pixels[seen], rtol=1e-12, atol=1e-9)
    np.testing.assert_allclose(
        rows[5:, seen].T, jacobian[seen].reshape(-1, 6), rtol=1e-9, atol=1e-12
    )
    np.testing.assert_array_equal(rows[:3], points.T)


@pytest.mark.parametrize("name", ["plumb_bob", "rational", "prism", "tilted", "fisheye_200_deg"])
def test_formulas_equal_opencv(name):
    camera = CAMERAS[name]
    points = np.random.default_rng(2).uniform([-4, -3, 2], [4, 3, 9], (500, 3))
    np.testing.assert_allclose(camera.project_jacobian(points)[0], cv(camera, points), atol=1e-9)


def test_unified_model_without_mirror_is_a_pinhole_and_with_xi_1_stereographic():
    angle = np.linspace(0, 1.4, 50)
    points = 3 * np.column_stack([np.sin(angle), np.zeros(50), np.cos(angle)])
    pinhole = Camera("omni", 4000, 720, (0, 500, 500, 600, 300))
    np.testing.assert_allclose(pinhole.project(points)[0][:, 0], 600 + 500 * np.tan(angle))
    stereographic = Camera("omni", 1280, 720, (1, 500, 500, 600, 300))
    expected = 600 + 500 * np.tan(angle / 2)
    np.testing.assert_allclose(stereographic.project(points)[0][:, 0], expected)


def test_unified_model_distorts_as_opencv_does_after_the_sphere():
    camera = CAMERAS["omni_strong"]
    points = points_around(2000, 3)
    sphere = points / np.linalg.norm(points, axis=1, keepdims=True)
    sphere = sphere[sphere[:, 2] > -0.4]
    lifted = sphere + np.array([0, 0, camera.intrinsics[0]])
    expected = cv2.projectPoints(
        lifted, np.zeros(3), np.zeros(3), camera.K, np.array(camera.distortion)
    )[0][:, 0]
    np.testing.assert_allclose(camera.project(sphere)[0], expected, atol=1e-9)


def test_field_of_view_model_by_hand():
    w = 1.1
    camera = Camera("atan", 1280, 720, (400, 400, 640, 360), (w,))
    where_atan_is_45_deg = 1 / (2 * np.tan(w / 2))
    pixels, _ = camera.project([[where_atan_is_45_deg, 0, 1], [0, 2e5, 1]])
    np.testing.assert_allclose(pixels[0], [640 + 400 * np.pi / 4 / w, 360])
    np.testing.assert_allclose(pixels[1], [640, 360 + 400 * np.pi / 2 / w], atol=0.01)
    straight = Camera("atan", 1280, 720, (400, 400, 640, 360), (0.0,))
    np.testing.assert_allclose(straight.project([[1, 1, 4]])[0], [[740, 460]])


def test_panorama_by_hand():
    camera = CAMERAS["equirectangular"]
    points = [[0, 0, 1], [1, 0, 0], [-1, 0, 0], [0, 1, 1], [1e-9, 0, -1], [-1e-9, 0, -1]]
    pixels, inside = camera.project(points)
    assert inside.all()
    expected = [
        [959.5, 479.5],
        [1439.5, 479.5],
        [479.5, 479.5],
        [959.5, 719.5],
        [1919.5, 479.5],
        [-0.5, 479.5],
    ]
    np.testing.assert_allclose(pixels, expected, atol=1e-5)
    assert camera.project([[0.0, 0.0, -1.0]])[1].all()


def test_wide_lenses_see_behind_and_others_do_not():
    behind = [[0.8, 0.6, -0.08]]
    seeing = {name for name, camera in CAMERAS.items() if camera.project(behind)[1].all()}
    assert seeing == {"fisheye_200_deg", "equidistant", "omni_strong", "equirectangular"}


@every
def test_the_picture_never_folds_back(camera):
    """Along any great circle from the axis, pixels move outward as long as there are any."""
    angle = np.linspace(0.01, np.pi - 0.01, 2000)
    for about in np.linspace(0, 2 * np.pi, 9):
        across = np.sin(angle)
        points = np.column_stack([across * np.cos(about), across * np.sin(about), np.cos(angle)])
        pixels, inside = camera.project(points)
        if camera.model == "equirectangular":
            assert inside.all()
            continue
        pixels = pixels[: int(np.flatnonzero(inside)[-1]) + 1]
        centre = camera.project([[0.0, 0.0, 1.0]])[0][0]
        assert (np.diff(np.linalg.norm(pixels - centre, axis=1)) > 0).all()


@every
@settings(max_examples=40, deadline=None)
@given(st.floats(0, 1, exclude_max=True), st.floats(0, 1, exclude_max=True), st.floats(0.1, 100))
def test_bearings_of_pixels_project_back(camera, across, down, distance):
    pixel = np.array([[across * camera.width - 0.5, down * camera.height - 0.5]])
    bearing = camera.unproject(pixel)
    if np.isnan(bearing).any():
        # outside the image circle: nothing is ever projected there
        assert camera.model == "omni"
        return
    assert np.linalg.norm(bearing) == pytest.approx(1, abs=1e-12)
    back, _ = camera.project(distance * bearing)
    np.testing.assert_allclose(back, pixel, atol=1e-6)


@every
@settings(max_examples=40, deadline=None)
@given(
    st.tuples(*[st.floats(-20, 20)] * 3).filter(
        lambda p: np.linalg.norm(p) > 0.01 and np.hypot(p[0], p[2]) > 1e-3
    )
)
def test_pixels_of_points_point_back_at_them(camera, point):
    pixels, inside = camera.project([point])
    if inside[0]:
        expected = np.array(point) / np.linalg.norm(point)
        np.testing.assert_allclose(camera.unproject(pixels)[0], expected, atol=1e-6)


@every
def test_points_that_are_nowhere_have_no_pixel(camera):
    points = [[np.nan, 0, 1], [0, np.nan, 1], [0, 0, np.nan], [0, 0, 0]]
    pixels, jacobian, inside = camera.project_jacobian(points)
    assert not inside.any()
    assert np.isnan(pixels).all()
    assert np.isnan(jacobian).all()
    pixels, inside = camera.project(points)
    assert np.isnan(pixels).all()
    assert not inside.any()
    assert np.isnan(camera.unproject([[np.nan, 3.0]])).all()
    for empty in camera.project_jacobian(np.zeros((0, 3))):
        assert len(empty) == 0


@every
def test_a_resized_camera_sees_the_same_scaled(camera):
    """In another aspect, too: images are stretched on the way by some drivers."""
    small = camera.resized(camera.width // 2, camera.height // 4)
    points = points_around(500, 4)
    pixels, inside = camera.project(points)
    expected = (pixels + 0.5) * [small.width / camera.width, small.height / camera.height] - 0.5
    np.testing.assert_allclose(small.project(points)[0], expected, atol=1e-9)
    np.testing.assert_array_equal(small.project(points)[1], inside)


@pytest.mark.parametrize("name", [n for n, c in CAMERAS.items() if c.model != "pinhole"])
def test_the_virtual_pinhole_sees_far_enough_as_sharp_as_the_middle(name):
    camera = CAMERAS[name]
    virtual = camera.undistorted()
    assert (virtual.model, virtual.distortion) == ("pinhole", ())
    np.testing.assert_allclose(virtual.intrinsics[:2], camera.pixels_per_radian)
    to_the_right = np.rad2deg(np.arctan((virtual.width - virtual.intrinsics[2]) / virtual.K[0, 0]))
    assert 54.9 < to_the_right < 55.3
    assert max(virtual.width, virtual.height) < 2.5 * max(camera.width, camera.height)
    white = np.full((camera.height, camera.width), 255, np.uint8)
    assert camera.undistort(white).shape == (virtual.height, virtual.width)
    assert (camera.undistort(white) == 255).mean() > 0.7


def test_a_narrow_fisheye_keeps_to_its_image():
    camera = Camera("fisheye", 640, 480, (900, 900, 319.5, 239.5))
    virtual = camera.undistorted()
    assert 0 <= virtual.width - 2 * 900 * np.tan(320 / 900) < 2
    assert 0 <= virtual.height - 2 * 900 * np.tan(240 / 900) < 2


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("omni", 640, 480, (400, 400, 320, 240)), "give xi fx fy cx cy"),
        (("omni", 640, 480, (-1, 400, 400, 320, 240)), "xi -1"),
        (("omni", 640, 480, (1, 400, -400, 320, 240)), "must be positive"),
        (("omni", 640, 480, (1, 400, 400, 320, 240), (0.1,)), "1 distortion coefficients"),
        (("atan", 640, 480, (400, 400, 320, 240), (53.0,)), "give radians"),
        (("atan", 640, 480, (400, 400, 320, 240), (-0.1,)), "give radians"),
        (("fisheye", 640, 480, (400, 400, 320, 240), (0, 0, 0)), "3 distortion coefficients"),
        (("equirectangular", 1920, 1080, (1920, 960)), "whole panorama"),
        (("equirectangular", 1920, 960, (400, 400, 320, 240)), "give width height"),
        (("equirectangular", 1920, 960, (), (0.1,)), "give 0"),
        (("equirectangular", 0, 960), "must be positive"),
        (("ds", 640, 480, (400, 400, 320, 240)), "pinhole, fisheye, atan, omni, equirectangular"),
    ],
)
def test_impossible_parameters_are_refused(arguments, words):
    with pytest.raises(GeometryError, match=words):
        Camera(*arguments)


def test_a_panorama_has_no_intrinsic_matrix():
    with pytest.raises(GeometryError, match="no intrinsic matrix"):
        _ = CAMERAS["equirectangular"].K
    np.testing.assert_array_equal(CAMERAS["omni_weak"].K[0], [700, 0, 640])
