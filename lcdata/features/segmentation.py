"""Lanes and poles of an image by a semantic-segmentation network in an ONNX file.

OpenCV runs it. Colours are scaled to 0..1 and normalised with the means of ImageNet, as nearly all
published networks expect; the class map can say otherwise.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lcdata.errors import CalibrationError

Mask = NDArray[np.bool_]

MEAN, STD = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)
"""Of ImageNet's red, green and blue, 0..1."""

REMEDY = 'give classes={"lane": [NUMBERS], "pole": [NUMBERS]} as the model was trained'

KEYS = ("lane", "pole", "mean", "std", "size")


def segment(
    image: NDArray[np.uint8],
    model: str | os.PathLike[str],
    classes: Mapping[str, Sequence[float]] | None,
) -> tuple[Mask, Mask]:
    """Lane and pole masks.

    Args:
        image: (H, W) or (H, W, 3) uint8 RGB.
        model: ONNX file: one input (1, 3, h, w), and a first output (1, C, h, w) of class scores
            or (1, h, w) of class numbers.
        classes: `lane` and `pole`: their class numbers; optional `mean` and `std` (three numbers
            in 0..1) and `size` (width, height) where the model's own is not fixed.

    Returns:
        (H, W) bool lanes, and poles.

    Raises:
        CalibrationError: A file that is missing or no network, one with other inputs or outputs,
            or class numbers that it does not have.
    """
    import cv2

    path = Path(model)
    numbers = _checked(path, classes)
    network, shape = _network(str(path), _stamp(path))
    size = _size(path, shape, classes or {}, image.shape)
    colour = image if image.ndim == 3 else np.repeat(image[:, :, None], 3, 2)
    small = cv2.resize(colour, size, interpolation=cv2.INTER_AREA).astype(np.float32) / 255.0
    mean, std = (
        np.array((classes or {}).get(key, default), np.float32)
        for key, default in (("mean", MEAN), ("std", STD))
    )
    network.setInput(np.ascontiguousarray(((small - mean) / std).transpose(2, 0, 1)[None]))
    try:
        output = np.asarray(network.forward())
    except cv2.error as error:
        raise CalibrationError(
            f"model {path}: does not take an input of 1x3x{size[1]}x{size[0]} ({_line(error)})",
            'give the size it was made for in classes: "size": [WIDTH, HEIGHT]',
        ) from error
    label, count = _labels(path, output)
    highest = max(*numbers["lane"], *numbers["pole"])
    if count and highest >= count:
        raise CalibrationError(
            f"model {path}: has classes 0 to {count - 1}, the map says {highest}", REMEDY
        )
    masks = []
    for name in ("lane", "pole"):
        mask = np.isin(label, numbers[name]).astype(np.uint8)
        full = cv2.resize(mask * np.uint8(255), image.shape[1::-1], interpolation=cv2.INTER_LINEAR)
        masks.append(np.asarray(full >= 128))
    return masks[0], masks[1]


def _checked(path: Path, classes: Mapping[str, Sequence[float]] | None) -> dict[str, list[int]]:
    """The class numbers of lanes and poles."""
    if not isinstance(classes, Mapping):
        raise CalibrationError(f"model {path}: no map of its classes ({classes!r})", REMEDY)
    unknown = [key for key in classes if key not in KEYS]
    if unknown:
        raise CalibrationError(f"model {path}: classes have {unknown}", f"use {', '.join(KEYS)}")
    numbers = {}
    for name in ("lane", "pole"):
        given = classes.get(name, ())
        values = [given] if isinstance(given, int) else list(given)
        if not values or not all(isinstance(n, int | np.integer) and n >= 0 for n in values):
            raise CalibrationError(f"model {path}: class numbers of {name} are {given!r}", REMEDY)
        numbers[name] = [int(n) for n in values]
    for key, length in (("mean", 3), ("std", 3), ("size", 2)):
        value = classes.get(key)
        if value is not None and (
            len(value) != length or not all(float(n) > 0 or key == "mean" for n in value)
        ):
            raise CalibrationError(
                f"model {path}: {key} of its classes is {value!r}", f"give {length} numbers"
            )
    return numbers


def _stamp(path: Path) -> int:
    try:
        return path.stat().st_mtime_ns
    except OSError as error:
        raise CalibrationError(
            f"model {path}: {error.strerror or error}", "give the path of an ONNX file"
        ) from error


@lru_cache(maxsize=2)
def _network(path: str, stamp: int) -> tuple[Any, tuple[int, ...]]:
    """The network and the shape of its input, 0 where any number will do."""
    import cv2

    content = Path(path).read_bytes() if Path(path).is_file() else b""
    try:
        inputs = input_shapes(content)
        network = cv2.dnn.readNetFromONNX(np.frombuffer(content, np.uint8))
    except (cv2.error, ValueError, IndexError) as error:
        raise CalibrationError(
            f"model {path}: not an ONNX network that OpenCV can run ({_line(error)})",
            "give an ONNX file of a semantic segmentation",
        ) from error
    if len(inputs) != 1 or len(inputs[0]) != 4 or inputs[0][1] not in {0, 3}:
        shapes = " and ".join("x".join(str(n or "?") for n in shape) for shape in inputs)
        raise CalibrationError(
            f"model {path}: has inputs {shapes or 'of unknown shape'}, one of 1x3xHxW is needed",
            "give a semantic segmentation of colour images",
        )
    return network, inputs[0]


def _size(
    path: Path,
    shape: tuple[int, ...],
    classes: Mapping[str, Sequence[float]],
    image: tuple[int, ...],
) -> tuple[int, int]:
    """Width and height of the network's input."""
    wanted = classes.get("size")
    height, width = shape[2], shape[3]
    if wanted is None:
        # Networks halve the size again and again; most take multiples of 32.
        return width or 32 * max(1, image[1] // 32), height or 32 * max(1, image[0] // 32)
    given = int(wanted[0]), int(wanted[1])
    if (width and width != given[0]) or (height and height != given[1]):
        raise CalibrationError(
            f"model {path}: takes images of {width}x{height}, the map says {given[0]}x{given[1]}",
            "leave size out of the classes",
        )
    return given


def _labels(path: Path, output: NDArray[Any]) -> tuple[NDArray[np.int64], int]:
    """(h, w) class numbers, and how many classes there are, 0 if that is not known."""
    if output.ndim == 4 and output.shape[0] == 1 and output.shape[1] > 1:
        return output[0].argmax(0).astype(np.int64), int(output.shape[1])
    if output.ndim in {3, 4} and output.shape[: output.ndim - 2] == (1,) * (output.ndim - 2):
        return np.rint(output.reshape(output.shape[-2:])).astype(np.int64), 0
    raise CalibrationError(
        f"model {path}: its output has shape {'x'.join(map(str, output.shape))}",
        "give one whose first output is 1xCxHxW class scores or 1xHxW class numbers",
    )


def _line(error: Exception) -> str:
    return " ".join(str(error).split())[:120]


def input_shapes(content: bytes) -> list[tuple[int, ...]]:
    """Shapes of the inputs of an ONNX file that are no weights, 0 for dimensions left open.

    OpenCV does not say them. The numbers are those of fields in `onnx.proto`.

    Raises:
        ValueError: Not an ONNX file.
    """
    graphs = [value for field, value in _fields(content) if field == 7]
    if not graphs or not isinstance(graphs[0], bytes):
        raise ValueError("no graph in it")
    weights, inputs = set(), []
    for field, value in _fields(graphs[0]):
        if field == 5:
            weights |= {name for key, name in _fields(value) if key == 8}
        elif field == 11:
            inputs.append(dict(_fields(value)))
    shapes = []
    for entry in inputs:
        if entry.get(1) in weights:
            continue
        tensor = dict(_fields(entry.get(2, b""))).get(1, b"")
        shape = dict(_fields(tensor)).get(2, b"")
        sizes = [dict(_fields(size)).get(1, 0) for key, size in _fields(shape) if key == 1]
        shapes.append(tuple(size if isinstance(size, int) else 0 for size in sizes))
    return shapes


def _fields(content: Any) -> Iterator[tuple[int, Any]]:
    """Field numbers and values (int or bytes) of a protocol-buffer message."""
    if not isinstance(content, bytes):
        raise ValueError("not a message")
    at = 0
    while at < len(content):
        tag, at = _varint(content, at)
        if tag & 7 == 0:
            value, at = _varint(content, at)
            yield tag >> 3, value
            continue
        size, at = _varint(content, at) if tag & 7 == 2 else ({1: 8, 5: 4}.get(tag & 7, -1), at)
        if size < 0 or at + size > len(content):
            raise ValueError("damaged")
        yield tag >> 3, content[at : at + size]
        at += size


def _varint(content: bytes, at: int) -> tuple[int, int]:
    value, shift = 0, 0
    while True:
        byte = content[at]
        value |= (byte & 127) << shift
        at, shift = at + 1, shift + 7
        if byte < 128:
            return value, at
        if shift > 63:
            raise ValueError("damaged")
