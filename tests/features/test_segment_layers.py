import numpy as np

from lcdata.features.segment_layers import RIM, layers_of_image, layers_of_masks, reduced_camera
from lcdata.geometry.camera import Camera
from tests.segment_scene import CAMERA, patch_pair


def box(top, bottom, left, right, shape=(400, 640)):
    mask = np.zeros(shape, np.uint8)
    mask[top:bottom, left:right] = 255
    return mask


def test_overlapping_masks_share_their_pixels():
    found = layers_of_masks([box(0, 400, 0, 320), box(100, 110, 310, 330)], CAMERA)
    both = set(found.labels[102, 319])
    assert {1, 2} <= both  # the smaller is the first
    assert set(found.labels[102, 328]) == {0, 1}
    assert found.masks == 2


def test_only_the_rim_counts_and_the_image_has_none():
    found = layers_of_masks([box(0, 400, 0, 320)], CAMERA)
    width = RIM * found.focal
    counted = np.flatnonzero(found.labels[200].any(axis=1))
    assert counted.max() == 319
    assert abs(320 - counted.min() - width) <= 1.5
    assert found.areas[1] == found.labels.astype(bool).sum()
    assert not layers_of_masks([np.full((400, 640), 255, np.uint8)], CAMERA).areas[1:].any()


def test_middles_are_those_of_the_rim():
    found = layers_of_masks([box(100, 104, 50, 60)], CAMERA)
    assert np.allclose(found.centres[1], [54.5, 101.5])


def test_specks_and_empty_masks_are_left_out():
    masks = [box(0, 0, 0, 0), box(5, 7, 5, 7), box(50, 90, 50, 90)]
    assert layers_of_masks(masks, CAMERA).masks == 1


def test_more_masks_than_layers_leave_the_smallest():
    masks = [box(100, 140 + 9 * k, 100, 140 + 9 * k) for k in range(6)]
    found = layers_of_masks(masks, CAMERA)
    assert sorted(found.labels[101, 120]) == [1, 2, 3, 4]


def test_fine_images_are_reduced():
    camera = Camera("pinhole", 1920, 1200, (2100, 2100, 960, 600))
    small = reduced_camera(camera)
    assert abs(small.width / small.height - 1.6) < 0.01
    assert small.width < 1000
    found = layers_of_masks([box(300, 600, 300, 600, (1200, 1920))], camera)
    assert found.labels.shape[:2] == (small.height, small.width)
    assert abs(found.centres[1, 0] / small.width - 449.5 / 1920) < 0.002


def test_every_scale_of_an_image_is_a_layer_of_its_own_masks():
    pair = patch_pair(1)
    found = layers_of_image(pair.image, pair.camera, (150.0, 600.0))
    first, second = (set(np.unique(found.labels[:, :, k])) - {0} for k in (0, 1))
    assert first and second and not first & second
    assert found.masks >= len(first | second)
