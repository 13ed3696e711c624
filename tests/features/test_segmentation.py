"""Masks from a real ONNX network: one convolution, written byte by byte."""

import numpy as np
import pytest

from lcdata.errors import CalibrationError
from lcdata.features.segmentation import input_shapes, segment

CLASSES = {"lane": [1], "pole": [2], "mean": [0, 0, 0], "std": [1, 1, 1]}


def varint(n):
    out = bytearray()
    while True:
        out.append((n & 127) | (128 if n > 127 else 0))
        n >>= 7
        if not n:
            return bytes(out)


def field(number, value):
    """A field of a protocol-buffer message: a number, text or another message."""
    if isinstance(value, int):
        return varint(number << 3) + varint(value)
    data = value.encode() if isinstance(value, str) else value
    return varint(number << 3 | 2) + varint(len(data)) + data


def value_info(name, shape):
    dims = b"".join(field(1, field(1, n) if n else field(2, "any")) for n in shape)
    return field(1, name) + field(2, field(1, field(1, 1) + field(2, dims)))


def tensor(name, array):
    dims = b"".join(field(1, n) for n in array.shape)
    return dims + field(2, 1) + field(8, name) + field(9, array.astype("<f4").tobytes())


def network(path, weights, size=(48, 64), inputs=("image",), channels=3):
    """1x1 convolution of C x 3 weights: class scores from a pixel's colour."""
    weights = np.asarray(weights, float)
    kernel = field(5, field(1, "kernel_shape") + field(8, 1) + field(8, 1) + field(20, 7))
    node = field(1, "image") + field(1, "weights") + field(2, "scores") + field(4, "Conv") + kernel
    graph = field(1, node) + field(2, "one")
    graph += field(5, tensor("weights", weights[:, :, None, None]))
    for name in inputs:
        graph += field(11, value_info(name, (1, channels, *size)))
    graph += field(11, value_info("weights", (*weights.shape, 1, 1)))
    graph += field(12, value_info("scores", (1, len(weights), *size)))
    path.write_bytes(field(1, 8) + field(7, graph) + field(8, field(1, "") + field(2, 13)))
    return path


WEIGHTS = [[-1, -1, 1], [1, -1, -1], [-1, 1, -1]]
"""Class 1 is red, class 2 green, class 0 blue and grey."""


@pytest.fixture
def picture():
    image = np.full((96, 128, 3), 90, np.uint8)
    image[:] = [10, 10, 200]
    image[60:90, 20:50] = [250, 0, 0]
    image[5:70, 80:90] = [0, 250, 0]
    return image


@pytest.mark.parametrize("size", [(48, 64), (0, 0)])
def test_masks_are_those_of_the_classes(tmp_path, picture, size):
    path = network(tmp_path / "model.onnx", WEIGHTS, size)
    lane, pole = segment(picture, path, CLASSES)
    assert lane.shape == pole.shape == picture.shape[:2]
    assert ((picture[..., 0] == 250) ^ lane).mean() < 0.01
    assert ((picture[..., 1] == 250) ^ pole).mean() < 0.02


def test_grey_images_are_taken(tmp_path, picture):
    lane, pole = segment(picture[..., 0].copy(), network(tmp_path / "m.onnx", WEIGHTS), CLASSES)
    assert not lane.any()
    assert not pole.any()


def test_the_shape_of_the_input_is_read(tmp_path):
    path = network(tmp_path / "m.onnx", WEIGHTS, (40, 0))
    assert input_shapes(path.read_bytes()) == [(1, 3, 40, 0)]


@pytest.mark.parametrize(
    ("classes", "said"),
    [
        (None, "no map of its classes"),
        ({"lane": [1]}, "class numbers of pole"),
        ({"lane": [1], "pole": ["two"]}, "class numbers of pole"),
        ({**CLASSES, "pole": [7]}, "classes 0 to 2, the map says 7"),
        ({**CLASSES, "road": [3]}, "road"),
        ({**CLASSES, "size": [100, 100]}, "64x48, the map says 100x100"),
        ({**CLASSES, "std": [1, 0, 1]}, "std"),
    ],
)
def test_maps_that_do_not_fit_are_refused(tmp_path, picture, classes, said):
    path = network(tmp_path / "model.onnx", WEIGHTS)
    with pytest.raises(CalibrationError, match=said) as raised:
        segment(picture, path, classes)
    assert "model.onnx" in raised.value.message
    assert raised.value.remedy


def test_networks_with_other_inputs_are_refused(tmp_path, picture):
    two = network(tmp_path / "two.onnx", WEIGHTS, inputs=("image", "depth"))
    with pytest.raises(CalibrationError, match="inputs 1x3x48x64 and 1x3x48x64"):
        segment(picture, two, CLASSES)
    deep = network(tmp_path / "deep.onnx", np.ones((3, 5)), channels=5)
    with pytest.raises(CalibrationError, match="inputs 1x5x48x64"):
        segment(picture, deep, CLASSES)


def test_files_that_are_no_networks_are_refused(tmp_path, picture):
    for name, content in (("text.onnx", b"no network"), ("empty.onnx", b"")):
        (tmp_path / name).write_bytes(content)
        with pytest.raises(CalibrationError, match=rf"{name}: not an ONNX"):
            segment(picture, tmp_path / name, CLASSES)
    with pytest.raises(CalibrationError, match=r"none\.onnx: No such file"):
        segment(picture, tmp_path / "none.onnx", CLASSES)
