from __future__ import annotations

import cv2
import numpy as np
import pytest

from lcdata.errors import GeometryError
from lcdata.geometry.camera import Camera

PLUMB_BOB = (-0.05, 0.02, 0.001, -0.0005, 0.003)
RATIONAL = (0.1, -0.05, 0.0003, 0.0002, 0.01, 0.12, -0.03, 0.005)
CAMERAS = [
    Camera("pinhole", 1280, 720, (530, 531, 640.2, 355.5)),
    Camera("pinhole", 1280, 720, (530, 531, 640.2, 355.5), PLUMB_BOB),
    Camera("pinhole", 1280, 720, (530, 531, 640.2, 355.5), RATIONAL),
    Camera("fisheye", 1280, 720, (530, 531, 640.2, 355.5), (0.02, -0.01, 0.003, -0.0004)),
    Camera("atan", 1280, 720, (530, 531, 640.2, 355.5), (0.93,)),
    Camera("omni", 1280, 720, (1.2, 1100, 1101, 640.2, 355.5), (-0.1, 0.05, 0.001, -0.0005)),
    Camera("equirectangular", 2400, 1200),
]


@pytest.mark.parametrize("camera", CAMERAS)
def test_bearings_project_back_to_their_pixels(camera):
    rng = np.random.default_rng(1)
    pixels = rng.uniform([40, 40], [1240, 680], (500, 2))
    bearings = camera.unproject(pixels)
    np.testing.assert_allclose(np.linalg.norm(bearings, axis=1), 1)
    back, inside = camera.project(bearings * rng.uniform(1, 30, (500, 1)))
    assert inside.all()
    np.testing.assert_allclose(back, pixels, atol=2e-3)


@pytest.mark.parametrize("camera", CAMERAS[:4])
def test_projection_equals_opencv(camera):
    points = np.random.default_rng(2).uniform([-1, -0.6, 2], [1, 0.6, 9], (200, 3))
    D = np.array(camera.distortion or (0.0,) * 4)
    if camera.model == "fisheye":
        expected = cv2.fisheye.projectPoints(
            points[:, None], np.zeros(3), np.zeros(3), camera.K, D
        )[0]
    else:
        expected = cv2.projectPoints(points, np.zeros(3), np.zeros(3), camera.K, D)[0]
    np.testing.assert_allclose(camera.project(points)[0], expected[:, 0], atol=1e-9)


def test_points_behind_beside_and_not_finite_are_outside():
    camera = CAMERAS[1]
    points = [[0, 0, 5], [0, 0, -5], [100, 0, 1], [np.nan, 0, 1], [0, 0, 0]]
    pixels, inside = camera.project(points)
    assert inside.tolist() == [True, False, False, False, False]
    assert np.isnan(pixels[[1, 3, 4]]).all()


def test_far_points_do_not_fold_back_into_the_image():
    """Strong barrel distortion turns back on itself; points beyond must not be seen."""
    camera = Camera("pinhole", 640, 480, (400, 400, 320, 240), (-0.4, 0.0, 0, 0))
    x = np.linspace(0, 5, 200)
    pixels, inside = camera.project(np.column_stack([x, np.zeros(200), np.ones(200)]))
    last = int(np.flatnonzero(inside)[-1])
    assert inside[: last + 1].all()
    assert (np.diff(pixels[: last + 1, 0]) > 0).all()


def test_points_far_to_the_side_do_not_come_back_through_the_middle():
    """A slight distortion folds at 80 degrees only, and crosses the axis again at 84."""
    camera = Camera("pinhole", 640, 480, (400, 400, 320, 240), (-0.01, 0.0, 0, 0))
    x = np.tan(np.deg2rad(np.linspace(45, 89.99, 5000)))
    _, inside = camera.project(np.column_stack([x, np.zeros_like(x), np.ones_like(x)]))
    assert not inside.any()


@pytest.mark.parametrize("camera", CAMERAS[1:])
def test_undistorted_image_shows_points_where_the_undistorted_camera_projects_them(camera):
    """A distorted picture of dots, undistorted, has the dots at pinhole positions."""
    points = np.array([[x, y, 4.0] for x in (-1.5, -0.5, 0.7, 1.4) for y in (-0.8, 0.1, 0.9)])
    image = np.zeros((camera.height, camera.width), np.uint8)
    for u, v in camera.project(points)[0]:
        cv2.circle(image, (round(u * 16), round(v * 16)), 6 * 16, 255, -1, cv2.LINE_AA, 4)
    result = camera.undistort(image)
    expected, _ = camera.undistorted().project(points)
    for u, v in expected:
        x, y = round(u), round(v)
        patch = result[y - 12 : y + 13, x - 12 : x + 13].astype(float)
        rows, columns = np.mgrid[-12:13, -12:13]
        centre = [x + (patch * columns).sum() / patch.sum(), y + (patch * rows).sum() / patch.sum()]
        np.testing.assert_allclose(centre, [u, v], atol=0.4)


def test_camera_info_of_every_ros_model():
    k = [500, 0, 320, 0, 501, 240, 0, 0, 1]
    assert Camera.from_ros("plumb_bob", 640, 480, k, [0.0] * 5).distortion == ()
    assert Camera.from_ros("plumb_bob", 640, 480, k, PLUMB_BOB).distortion == PLUMB_BOB
    assert Camera.from_ros("rational_polynomial", 640, 480, k, RATIONAL).model == "pinhole"
    fisheye = Camera.from_ros("equidistant", 640, 480, k, [0.1, 0, 0, 0])
    assert (fisheye.model, fisheye.intrinsics) == ("fisheye", (500, 501, 320, 240))


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("ds", 640, 480, (1, 1, 1, 1)), "unknown camera model"),
        (("omni", 640, 480, (1, 1, 1, 1)), "xi fx fy cx cy"),
        (("pinhole", 640, 480, (500, 500, 320, 240), (1.0, 2.0)), "2 distortion coefficients"),
        (("pinhole", 640, 480, (500, 500, 320)), "3 values"),
        (("pinhole", 640, 480, (-500, 500, 320, 240)), "must be positive"),
        (("pinhole", 640, 480, (np.nan, 500, 320, 240)), "not finite"),
    ],
)
def test_impossible_cameras_are_refused(arguments, words):
    with pytest.raises(GeometryError, match=words):
        Camera(*arguments)


def test_unknown_ros_model_names_the_known_ones():
    with pytest.raises(GeometryError, match="rational_polynomial"):
        Camera.from_ros("thin_prism", 640, 480, np.eye(3).ravel(), [])
    with pytest.raises(GeometryError, match="3 coefficients"):
        Camera.from_ros("plumb_bob", 640, 480, np.eye(3).ravel(), [1, 2, 3])


def test_an_image_of_another_size_is_refused():
    with pytest.raises(GeometryError, match="640x480"):
        CAMERAS[1].undistort(np.zeros((480, 640), np.uint8))
