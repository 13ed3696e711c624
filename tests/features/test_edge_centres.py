from __future__ import annotations

import cv2
import numpy as np
import pytest

from lcdata.features.edge_centres import centre_lines
from lcdata.features.image_lines import extract_image_lines


def picture(where, angle_deg=20.0, levels=(0.05, 0.6), width=None, size=240):
    """An edge, or a stripe of a width, through blur and then gamma, as a camera stores it."""
    fine = 8
    grid = (np.arange(size * fine) + 0.5) / fine - 0.5
    x, y = np.meshgrid(grid, grid)
    normal = np.array([-np.sin(np.deg2rad(angle_deg)), np.cos(np.deg2rad(angle_deg))])
    off = (x - size / 2) * normal[0] + (y - size / 2) * normal[1] - where
    bright = (off > 0) & (off < (width or np.inf))
    light = np.where(bright, levels[1], levels[0]).reshape(size, fine, size, fine).mean((1, 3))
    light = cv2.GaussianBlur(light, (0, 0), 0.7)
    noisy = light + np.random.default_rng(0).normal(size=light.shape) * 0.003
    return (255 * np.clip(noisy, 0, 1) ** (1 / 2.2)).round().astype(np.uint8), normal


def offsets(lines, normal, size=240):
    return ((lines.reshape(-1, 2, 2) - size / 2) @ normal).mean(axis=1)


@pytest.mark.parametrize("where", [-0.4, 0.1, 0.3])
@pytest.mark.parametrize("levels", [(0.05, 0.6), (0.6, 0.05), (0.02, 0.9)])
def test_edges_do_not_move_to_their_dark_side(where, levels):
    image, normal = picture(where, levels=levels)
    assert offsets(extract_image_lines(image), normal) == pytest.approx([where], abs=0.05)


@pytest.mark.parametrize("width", [4.0, 6.0, 12.0])
def test_a_stripe_is_as_wide_as_it_is(width):
    image, normal = picture(0.2, width=width)
    found = np.sort(offsets(extract_image_lines(image), normal))
    assert found == pytest.approx([0.2, 0.2 + width], abs=0.08)


def test_lines_are_turned_too():
    image, normal = picture(0.0)
    along = np.array([normal[1], -normal[0]])
    ends = 120 + np.outer([-80, 80], along) + np.outer([-0.5, 0.5], normal)
    centred = centre_lines(ends.reshape(1, 4), image).reshape(2, 2)
    assert np.abs((centred - 120) @ normal).max() < 0.06


def test_where_nothing_rises_lines_stay():
    lines = np.array([[10.0, 10.0, 60.0, 12.0], [5.0, 50.0, 5.0, 90.0]])
    np.testing.assert_array_equal(centre_lines(lines, np.full((100, 100), 90, np.uint8)), lines)
    assert centre_lines(np.zeros((0, 4)), np.zeros((100, 100), np.uint8)).shape == (0, 4)
