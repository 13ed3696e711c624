import cv2
import numpy as np
import pytest

from lcdata.features.image_segments import segment_scales
from tests.segment_scene import patches


def scene(seed=0):
    label = patches(seed)
    colour = np.random.default_rng(seed).integers(0, 256, (label.max() + 1, 3))
    return label, colour.astype(np.uint8)[label]


def test_patches_of_one_colour_are_found_whole():
    label, image = scene()
    (found,) = segment_scales(image, (150.0,))
    inner = cv2.erode(label.astype(np.float32), np.ones((9, 9))) == cv2.dilate(
        label.astype(np.float32), np.ones((9, 9))
    )
    for patch in np.unique(label):
        inside = found[inner & (label == patch)]
        if len(inside):
            assert (inside == np.bincount(inside).argmax()).mean() > 0.99


def test_every_segment_is_connected_and_large_enough():
    rng = np.random.default_rng(1)
    image = cv2.GaussianBlur(rng.integers(0, 256, (120, 160, 3)).astype(np.uint8), (0, 0), 3)
    for labels in segment_scales(image, (5.0, 50.0), smallest=30):
        assert set(np.unique(labels)) == set(range(labels.max() + 1))
        assert np.bincount(labels.ravel()).min() >= 30
        for number in range(labels.max() + 1):
            parts, _ = cv2.connectedComponents((labels == number).astype(np.uint8), connectivity=4)
            assert parts == 2


def test_larger_scales_have_fewer_segments():
    rng = np.random.default_rng(2)
    image = cv2.GaussianBlur(rng.integers(0, 256, (200, 300, 3)).astype(np.uint8), (0, 0), 4)
    counts = [labels.max() for labels in segment_scales(image, (2.0, 20.0, 200.0))]
    assert counts[0] > counts[1] > counts[2]


@pytest.mark.parametrize("shape", [(50, 60), (50, 60, 3)])
def test_a_constant_image_is_one_segment(shape):
    (labels,) = segment_scales(np.full(shape, 77, np.uint8), (150.0,))
    assert labels.shape == (50, 60)
    assert labels.max() == 0


def test_grey_images_are_segmented_like_colour_ones_of_the_same_grey():
    grey = np.where(patches(3) % 2 == 0, 40, 200).astype(np.uint8)
    one, three = (segment_scales(image, (150.0,))[0] for image in (grey, np.dstack([grey] * 3)))
    assert np.array_equal(one, three)
    assert one.max() > 0
