from __future__ import annotations

import numpy as np
import pytest

from lcdata.features.image_lines import extract_image_lines, merge_lines
from lcdata.geometry.camera import Camera


def edge_image(angle_deg, through=(200.3, 199.6), size=400):
    """An antialiased step edge as a camera stores it; pixel centres have integer coordinates."""
    fine = 8
    grid = (np.arange(size * fine) + 0.5) / fine - 0.5
    x, y = np.meshgrid(grid, grid)
    normal = np.array([-np.sin(np.deg2rad(angle_deg)), np.cos(np.deg2rad(angle_deg))])
    step = (x - through[0]) * normal[0] + (y - through[1]) * normal[1] > 0
    low, high = (np.array([80, 180]) / 255) ** 2.2
    light = step.reshape(size, fine, size, fine).mean((1, 3)) * (high - low) + low
    image = 255 * light ** (1 / 2.2)
    image += np.random.default_rng(0).normal(size=image.shape) * 2
    return image.round().astype(np.uint8), normal


@pytest.mark.parametrize("angle", [3, 20, 45, 70, 88, 150])
def test_edges_are_found_without_bias(angle):
    image, normal = edge_image(angle)
    lines = extract_image_lines(image)
    assert len(lines) == 1
    offset = (lines[0].reshape(2, 2) - [200.3, 199.6]) @ normal
    assert np.abs(offset.mean()) < 0.06
    assert np.abs(offset).max() < 0.12


def test_pieces_are_joined_and_parallel_neighbours_are_not():
    lines = np.array(
        [
            [10, 10, 60, 10],
            [63, 10.4, 100, 10.6],
            [103, 10.5, 140, 10.2],
            [10, 13, 140, 13],  # three pixels beside
            [141, 10, 160, 14],  # bends by 12 degrees
            [140, 10.2, 103, 10.5],  # the other way: the far edge of something thin
        ]
    )
    merged = merge_lines(lines.astype(float), 5.0, np.deg2rad(2), 2.0)
    assert len(merged) == 4
    longest = merged[np.argmax(merged[:, 2] - merged[:, 0] - (merged[:, 1] > 12))]
    np.testing.assert_allclose(longest, [10, 10, 140, 10.4], atol=0.3)


def test_merging_nothing_and_one():
    assert merge_lines(np.zeros((0, 4)), 5, 0.03, 2).shape == (0, 4)
    assert merge_lines(np.ones((1, 4)), 5, 0.03, 2).shape == (1, 4)


def test_blank_and_tiny_images_have_no_lines():
    assert extract_image_lines(np.full((100, 100), 7, np.uint8)).shape == (0, 4)
    assert extract_image_lines(np.zeros((3, 3), np.uint8)).shape == (0, 4)
    assert extract_image_lines(np.zeros((100, 100, 3), np.uint8)).shape == (0, 4)


def test_short_lines_are_dropped_in_proportion_to_the_width():
    image = np.full((360, 640), 50, np.uint8)
    image[100:115, 100:400] = 200
    found = extract_image_lines(image)
    length = np.hypot(found[:, 2] - found[:, 0], found[:, 3] - found[:, 1])
    assert (length >= 10).all()
    assert length[0] > 280
    assert len(extract_image_lines(image, min_length=40)) == 2


def test_the_border_of_an_undistorted_image_is_no_line():
    camera = Camera("pinhole", 640, 480, (400, 400, 320, 240), (0.35, 0.1, 0, 0, 0))
    image = np.full((480, 640), 180, np.uint8)
    undistorted = camera.undistort(image)
    valid = camera.undistort(np.full_like(image, 255)) == 255
    assert not valid.all()
    assert len(extract_image_lines(undistorted)) > 0
    assert len(extract_image_lines(undistorted, valid=valid)) == 0
