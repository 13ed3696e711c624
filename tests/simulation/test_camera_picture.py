from __future__ import annotations

import numpy as np
import pytest

from lcdata.geometry import se3
from lcdata.geometry.camera import Camera
from lcdata.simulation.camera import CAMERAS, Sensor, make_camera, render, zed2i
from lcdata.simulation.light import Light
from lcdata.simulation.mesh import Material, quad
from lcdata.simulation.raycast import RayCaster

LIGHT = Light((), (1.0, 1.0, 1.0), (1.0, 1.0, 1.0))
IDEAL = Sensor(blur_px=0, vignetting=0, shot_noise=0, read_noise=0)
WHITE, BLACK = Material("#ffffff", noise=0.0), Material("#000000", noise=0.0)
NOISY = Material("#808080", noise=0.0)


@pytest.mark.parametrize("axis", [0, 1])
def test_an_edge_lies_where_the_camera_model_projects_it(axis: int) -> None:
    """A slanting border between white and black, found to a few hundredths of a pixel."""
    camera = zed2i(320, 180)
    ends = np.array([[0.3, -4.0, 3.0], [-0.2, 4.0, 3.5]])
    if axis:
        ends = np.array([[-7.0, 0.4, 3.0], [7.0, 0.1, 3.5]])
    far = np.array([0.0, 0.0, 9.0])
    far[axis] = 30.0
    white = quad(ends[0], ends[1], ends[1] - far * [1, 1, 0], ends[0] - far * [1, 1, 0], WHITE)
    black = quad([-60, -60, 20], [60, -60, 20], [60, 60, 20], [-60, 60, 20], BLACK)
    T = np.eye(4)
    image = render(RayCaster(white + black), LIGHT, camera, T, np.random.default_rng(0), IDEAL)
    linear = (image[..., 1] / 255.0) ** 2.2
    share = np.clip((linear - linear.min()) / (linear.max() - linear.min()), 0, 1)
    found = share.sum(axis=1 - axis) - 0.5  # white comes first in every row or column
    along = np.linspace(0, 1, 4001)[:, None]
    pixels, inside = camera.project(ends[0] + along * (ends[1] - ends[0]))
    pixels = pixels[inside]
    rows = np.arange(len(found))[5:-5]
    expected = np.interp(rows, pixels[:, 1 - axis], pixels[:, axis])
    errors = found[5:-5] - expected
    assert abs(errors.mean()) < 0.02
    assert np.abs(errors).max() < 0.15


WIDE = tuple(make_camera(name, 320, 240) for name in CAMERAS if name != "zed2i")


@pytest.mark.parametrize("camera", WIDE, ids=lambda camera: camera.model)
@pytest.mark.parametrize("degrees", [(0, 0), (40, 10), (-40, -15), (15, -30)], ids=str)
def test_a_wide_camera_shows_a_lamp_where_its_model_projects_it(
    camera: Camera, degrees: tuple[int, int]
) -> None:
    yaw, pitch = np.deg2rad(degrees)
    ahead = np.array([np.sin(yaw) * np.cos(pitch), np.sin(pitch), np.cos(yaw) * np.cos(pitch)])
    right = np.cross([0.0, 1.0, 0.0], ahead) / np.linalg.norm(np.cross([0.0, 1.0, 0.0], ahead))
    down = np.cross(ahead, right)
    corners = [2 * ahead + 0.08 * (i * right + j * down) for i, j in ((1, 1), (1, -1), (-1, -1))]
    corners.append(2 * ahead + 0.08 * (-right + down))
    card = RayCaster(quad(*corners, Material("#ffffff", noise=0.0, glow=1.0)))
    dark = Light((), (0.0,) * 3, (0.0,) * 3, (0.0,) * 3, (0.0,) * 3)
    image = render(card, dark, camera, np.eye(4), np.random.default_rng(0), IDEAL)
    weight = (image[..., 1] / 255.0) ** 2.2
    v, u = np.indices(weight.shape)
    found = np.array([(weight * u).sum(), (weight * v).sum()]) / weight.sum()
    expected = camera.project(2 * ahead[None])[0][0]
    # edges are sampled by four rays a pixel: an eighth of a pixel either way
    np.testing.assert_allclose(found, expected, atol=0.125)


def test_a_panorama_shows_what_is_behind_the_camera_too() -> None:
    camera = make_camera("equirectangular", 320)
    assert (camera.width, camera.height) == (320, 160)
    card = RayCaster(
        quad([-1, -1, -4], [1, -1, -4], [1, 1, -4], [-1, 1, -4], Material("#ffffff", glow=1.0))
    )
    dark = Light((), (0.0,) * 3, (0.0,) * 3, (0.0,) * 3, (0.0,) * 3)
    image = render(card, dark, camera, np.eye(4), np.random.default_rng(0), IDEAL)[..., 1]
    assert image[80, [0, 319]].min() > 50, "behind, at both edges"
    assert image[80, 160] == 0


def test_an_omnidirectional_image_is_black_where_no_ray_comes_from() -> None:
    camera = Camera("omni", 320, 240, (1.6, 90.0, 90.0, 160.0, 120.0))
    corner = camera.unproject(np.array([[0.0, 0.0]]))
    assert np.isnan(corner).all()
    scene = RayCaster(quad([-9, -9, 2], [9, -9, 2], [9, 9, 2], [-9, 9, 2], WHITE))
    image = render(scene, LIGHT, camera, np.eye(4), np.random.default_rng(0), IDEAL)
    assert image[0, 0].max() == 0
    assert image[120, 160].min() > 50


def test_noise_grows_with_the_light_and_repeats_with_the_seed() -> None:
    camera = zed2i(160, 90)
    card = RayCaster(quad([-9, -9, 2], [9, -9, 2], [9, 9, 2], [-9, 9, 2], NOISY))

    def picture(seed: int) -> np.ndarray:
        return render(card, LIGHT, camera, np.eye(4), np.random.default_rng(seed))

    first = picture(1)
    np.testing.assert_array_equal(first, picture(1))
    assert 0.5 < (first.astype(float) - picture(2)).std() < 6
    assert first[45, 80].mean() > 1.03 * first[0, 0].mean(), "corners are darker"


def test_shadows_fall_where_the_sun_is_hidden() -> None:
    from lcdata.simulation.light import Lamp

    sun = Light((Lamp((0.0, 0.0, 1.0), (1.0, 1.0, 1.0)),), (0.1,) * 3, (0.1,) * 3)
    floor = quad([-9, -9, 0], [9, -9, 0], [9, 9, 0], [-9, 9, 0], NOISY)
    lid = quad([-1, -1, 1], [1, -1, 1], [1, 1, 1], [-1, 1, 1], NOISY)
    R = np.array([[1, 0, 0], [0, -1, 0], [0, 0, -1.0]])  # a camera that looks straight down
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R, (4.0, 0.0, 4.0)
    camera = zed2i(320, 180)
    image = render(RayCaster(floor + lid), sun, camera, T, np.random.default_rng(0), IDEAL)
    points = se3.apply(se3.inverse(T), [[1.2, 0.0, 0.0], [0.95, 0.0, 0.0], [4.0, 0.0, 0.0]])
    pixels = np.rint(camera.project(points)[0]).astype(int)
    lit, dark, open_ = (image[v, u, 0] for u, v in pixels)
    assert open_ == pytest.approx(lit, abs=3)
    assert dark < 0.6 * lit
