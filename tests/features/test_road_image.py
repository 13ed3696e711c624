"""Lanes told from poles in one mask, their lines, and borders moved onto the image's edges."""

import cv2
import numpy as np
import pytest
import road_world as world

from lcdata.features.marks import classical_masks
from lcdata.features.road_cloud import road_cloud
from lcdata.features.road_image import (
    horizon,
    mask_lines,
    middles,
    road_image,
    worked,
    working_camera,
)
from lcdata.features.road_masks import beside, snapped
from lcdata.geometry import se3

SEED = 3


def drawn(lines, width=5, shape=(300, 400)):
    mask = np.zeros(shape, np.uint8)
    for x1, y1, x2, y2 in lines:
        cv2.line(mask, (x1, y1), (x2, y2), 1, width)
    return mask > 0


@pytest.fixture(scope="module")
def masks():
    pair, lane, pole = world.made(SEED)
    camera = working_camera(pair.camera)
    small = [worked(world.white(mask), camera) > 127 for mask in (lane, pole)]
    return camera.undistorted(), *small


def test_middles_lie_in_the_middle():
    points, half = middles(drawn([(20, 150, 380, 150)], 9))
    inner = (points[:, 0] > 30) & (points[:, 0] < 370)
    assert np.abs(points[inner, 1] - 150).max() <= 1
    assert np.abs(half[inner] - 5).max() < 1.5


def test_lines_of_a_mask_are_those_drawn_in_it():
    lines = [(30, 280, 180, 120), (380, 290, 220, 120), (60, 20, 62, 100)]
    found = mask_lines(drawn(lines), 300.0, gaps=False)
    assert len(found) == 3
    for x1, y1, x2, y2 in lines:
        direct, swapped = np.array([x1, y1, x2, y2]), np.array([x2, y2, x1, y1])
        away = [min(np.abs(one - direct).max(), np.abs(one - swapped).max()) for one in found]
        assert min(away) < 8


def test_dashes_are_one_lane_and_pieces_are_poles_of_their_own():
    dashes = drawn([(100, 290, 130, 230), (145, 200, 160, 170), (170, 150, 180, 130)])
    assert len(mask_lines(dashes, 300.0)) == 1
    poles = drawn([(100, 20, 100, 100), (100, 180, 100, 250)])
    (line,) = mask_lines(poles, 300.0, gaps=False)
    assert abs(abs(line[3] - line[1]) - 80) < 10


def test_the_horizon_is_where_lanes_meet():
    lanes = np.array([(0, 290, 190, 105), (400, 290, 210, 105), (120, 290, 196, 110.0)])
    stop = np.array([(20, 250, 380, 250.0)])
    assert abs(horizon(np.concatenate([lanes, stop]), 400, 300) - 95) < 5
    assert horizon(stop, 400, 300) is None


def test_poles_and_lanes_are_told_apart(masks):
    camera, lane, pole = masks
    image = road_image(lane | pole, None, camera)
    assert (image.lane & ~lane).sum() < 0.05 * lane.sum()
    assert (image.pole & ~pole).sum() < 0.05 * pole.sum()
    assert (image.lane & lane).sum() > 0.9 * lane.sum()
    assert (image.pole & pole).sum() > 0.9 * pole.sum()
    run = image.pole_lines[:, 2:] - image.pole_lines[:, :2]
    assert (np.abs(run[:, 0]) < 0.3 * np.abs(run[:, 1])).all()


def test_masks_given_apart_keep_their_classes(masks):
    camera, lane, pole = masks
    image = road_image(lane, pole, camera)
    assert not (image.lane & ~lane).any()
    assert not (image.pole & ~pole).any()


def test_lenses_are_undone(masks):
    camera = masks[0]
    assert not camera.is_distorted
    assert (camera.height, camera.width) == masks[1].shape


def test_borders_move_onto_edges():
    truth = drawn([(100, 280, 180, 120), (300, 20, 300, 200)], 9)
    grey = np.where(truth, 200, 90).astype(np.uint8)
    grey = cv2.GaussianBlur(grey, (0, 0), 0.8)
    given = np.roll(cv2.dilate(truth.astype(np.uint8), np.ones((3, 3))) > 0, 3, 1)
    found = snapped(given, grey, 600.0)
    assert (given ^ truth).sum() > 2000
    assert (found ^ truth).sum() < 300


def test_borders_stay_where_the_image_shows_nothing():
    mask = drawn([(100, 280, 180, 120)], 9)
    flat = np.full(mask.shape, 90, np.uint8)
    assert (snapped(mask, flat, 600.0) ^ mask).sum() < 20


@pytest.mark.parametrize("twist", [np.zeros(6), [0.1, -0.1, 0.1, 0.01, -0.01, 0.01]])
def test_marks_and_poles_are_found_without_a_mask(masks, twist):
    _, lane, pole = masks
    pair = world.made(SEED)[0]
    found = classical_masks(pair, road_cloud(pair), se3.exp(twist) @ pair.T_camera_lidar)
    near = cv2.dilate(lane.astype(np.uint8), np.ones((5, 5))) > 0
    assert (found.lane & near).sum() > 0.85 * found.lane.sum()
    near = cv2.dilate(pole.astype(np.uint8), np.ones((5, 5))) > 0
    assert (found.pole & near).sum() > 0.7 * found.pole.sum()
    assert (found.lane & lane).sum() > 0.3 * lane.sum()
    assert (found.pole & pole).sum() > 0.3 * pole.sum()


@pytest.mark.parametrize("shift", [0, 3])
def test_borders_are_known_to_lie_beside_edges(shift):
    truth = drawn([(100, 280, 180, 120), (300, 20, 300, 200)], 9)
    noise = np.random.default_rng(0).normal(0, 6, truth.shape)
    grey = np.clip(np.where(truth, 200, 90) + noise, 0, 255).astype(np.uint8)
    assert beside(np.roll(truth, shift, 1), grey, 600.0) == (shift > 0)
    wide = cv2.dilate(truth.astype(np.uint8), np.ones((5, 5))) > 0
    assert beside(wide, grey, 600.0)
    assert not beside(truth, np.full(truth.shape, 90, np.uint8), 600.0)
