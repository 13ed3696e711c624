"""Masks from files: where they are looked for, and what is wrong with them in words."""

import cv2
import numpy as np
import pytest

from lcdata.errors import CalibrationError
from lcdata.features.mask_files import mask_file, read_mask, segment_files
from lcdata.geometry.camera import Camera
from lcdata.pair import Pair

SHAPE = (40, 60)


def pair(pair_id=""):
    camera = Camera("pinhole", SHAPE[1], SHAPE[0], (50, 50, 30, 20))
    image = np.zeros(SHAPE, np.uint8)
    return Pair(image, np.zeros((1, 3)), None, camera, pair_id=pair_id)


def write(path, mask=None):
    path.parent.mkdir(parents=True, exist_ok=True)
    if mask is None:
        mask = np.zeros(SHAPE, np.uint8)
        mask[10:20, 30:50] = 255
    assert cv2.imwrite(str(path), mask)
    return path


def test_a_file_is_the_mask_of_the_pair_given(tmp_path):
    file = write(tmp_path / "mask.jpg")
    assert mask_file(file, pair()) == file
    assert mask_file(str(file), pair("yard/3/001")) == file


@pytest.mark.parametrize("name", ["a/001.png", "a/001.jpg", "a/001.JPEG"])
def test_a_folder_has_one_mask_a_pair(tmp_path, name):
    file = write(tmp_path / name)
    write(tmp_path / "a/002.png")
    assert mask_file(tmp_path, pair("a/001")) == file


def test_segments_are_in_a_folder_of_the_pairs_name_or_directly_there(tmp_path):
    own = [write(tmp_path / "one" / "001" / f"{k}.png") for k in range(3)]
    write(tmp_path / "one" / "stray.png")
    assert segment_files(tmp_path / "one", pair("001")) == own
    assert segment_files(tmp_path / "one" / "001", pair("001")) == own
    assert segment_files(tmp_path / "one" / "001", pair()) == own
    (tmp_path / "one" / "001" / "notes.txt").write_text("no image")
    assert segment_files(tmp_path / "one", pair("001")) == own


@pytest.mark.parametrize("find", [mask_file, segment_files])
def test_what_is_missing_is_named_with_its_size(tmp_path, find):
    with pytest.raises(CalibrationError, match=r"nowhere.*'007', of 60x40"):
        find(tmp_path / "nowhere", pair("007"))
    with pytest.raises(CalibrationError, match=r"'007', of 60x40.*007"):
        find(tmp_path, pair("007"))
    with pytest.raises(CalibrationError, match="PAIR_ID"):
        find(tmp_path, pair())


def test_a_file_holds_no_segments(tmp_path):
    with pytest.raises(CalibrationError, match=r"mask\.png.*folder"):
        segment_files(write(tmp_path / "mask.png"), pair("1"))


def test_masks_are_read_as_black_and_white(tmp_path):
    expected = np.zeros(SHAPE, np.uint8)
    expected[10:20, 30:50] = 255
    stored = {
        "grey.png": expected,
        "lossy.jpg": expected,
        "ones.png": expected // 255,
        "colour.png": np.repeat(expected[:, :, None], 3, 2),
        "deep.png": expected.astype(np.uint16) * 257,
    }
    for name, mask in stored.items():
        found = read_mask(write(tmp_path / name, mask), SHAPE)
        assert found.dtype == np.uint8
        np.testing.assert_array_equal(found, expected, err_msg=name)


@pytest.mark.parametrize(
    ("mask", "said"),
    [
        (np.zeros(SHAPE, np.uint8), "empty"),
        (np.full(SHAPE, 255, np.uint8), "all white"),
        (np.full((20, 30), 255, np.uint8), "30x20 pixels for an image of 60x40"),
    ],
)
def test_masks_that_say_nothing_are_refused(tmp_path, mask, said):
    with pytest.raises(CalibrationError, match=said) as raised:
        read_mask(write(tmp_path / "mask.png", mask), SHAPE)
    assert "mask.png" in raised.value.message
    assert raised.value.remedy


def test_files_that_are_no_images_are_refused(tmp_path):
    (tmp_path / "mask.png").write_bytes(b"no image")
    (tmp_path / "empty.png").write_bytes(b"")
    for name in ("mask.png", "empty.png"):
        with pytest.raises(CalibrationError, match=rf"{name}: not an image.*60x40"):
            read_mask(tmp_path / name, SHAPE)
    with pytest.raises(CalibrationError, match=r"none\.png: No such file.*60x40"):
        read_mask(tmp_path / "none.png", SHAPE)
    with pytest.raises(CalibrationError, match="directory"):
        read_mask(tmp_path, SHAPE)
