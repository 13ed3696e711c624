from __future__ import annotations

import dataclasses

import numpy as np

from lcdata.geometry.camera import Camera
from lcdata.pair import Pair
from lcdata.report.overlay import depth_range, draw_overlay

CAMERA = Camera("pinhole", 400, 300, (300.0, 300.0, 200.0, 150.0), (-0.1, 0.02, 0.0, 0.0))


def make_pair(points: list[list[float]], colour: bool = True) -> Pair:
    image = np.full((300, 400, 3) if colour else (300, 400), 100, np.uint8)
    return Pair(image, np.array(points, np.float32), None, CAMERA)


def is_red(pixel: np.ndarray) -> bool:
    return bool(pixel[0] > pixel[2] + 50)


def is_blue(pixel: np.ndarray) -> bool:
    return bool(pixel[2] > pixel[0] + 50)


def test_points_are_drawn_where_the_camera_sees_them_near_red_far_blue() -> None:
    points = [[-1.0, 0.2, 4.0], [8.0, -3.0, 40.0], [0, 0, -5], [np.nan] * 3, [30.0, 0, 4.0]]
    pair = make_pair(points)
    picture = draw_overlay(pair, np.eye(4), depths=(4, 40))
    pixels, inside = CAMERA.project(pair.points)
    assert inside.tolist() == [True, True, False, False, False]
    (u, v), (far_u, far_v) = np.round(pixels[:2]).astype(int)
    assert is_red(picture[v, u]) and is_blue(picture[far_v, far_u])
    grey = (picture == picture[0, 0]).all(axis=2)
    assert (~grey).sum() == 2 * 5  # two dots, nothing else
    assert picture.dtype == np.uint8 and picture.shape == (300, 400, 3)


def test_the_transform_moves_the_points() -> None:
    pair = make_pair([[0.0, 0.0, 10.0]])
    T = np.eye(4)
    T[0, 3] = 2.0
    before, after = (draw_overlay(pair, t, depths=(5, 20)) for t in (np.eye(4), T))
    assert not (before[150, 200] == before[0, 0]).all()
    assert (after[150, 200] == after[0, 0]).all()
    pixel = np.round(CAMERA.project([[2.0, 0, 10.0]])[0][0]).astype(int)
    assert not (after[pixel[1], pixel[0]] == after[0, 0]).all()


def test_near_points_hide_far_ones_whatever_their_order() -> None:
    for points in ([[0, 0, 3.0], [0, 0, 30.0]], [[0, 0, 30.0], [0, 0, 3.0]]):
        assert is_red(draw_overlay(make_pair(points), np.eye(4), depths=(3, 30))[150, 200])


def test_smaller_pictures_and_grey_images() -> None:
    pair = make_pair([[0, 0, 3.0]], colour=False)
    picture = draw_overlay(pair, np.eye(4), width=200, depths=(3, 30))
    assert picture.shape == (150, 200, 3)
    assert is_red(picture[75, 100])


def test_nothing_in_view() -> None:
    pair = make_pair([[0, 0, -3.0]])
    assert depth_range(pair, np.eye(4)) == (1.0, 100.0)
    assert (draw_overlay(pair, np.eye(4)) == 72).all()
    empty = dataclasses.replace(pair, points=np.zeros((0, 3), np.float32))
    assert (draw_overlay(empty, np.eye(4)) == 72).all()
