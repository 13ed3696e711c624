"""Mask images of a pair from files: where they lie and how they are read.

A method's parameter `masks` is a path. A file is the mask of the one pair that is given. In a
folder, `<pair_id>.png` (or .jpg, .jpeg) is the mask of that pair, and the folder `<pair_id>/`
holds its segments, one image each; a folder without either, but with images directly in it, holds
the segments of the one pair that is given.
"""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lcdata.errors import CalibrationError
from lcdata.pair import Pair

SUFFIXES = (".png", ".jpg", ".jpeg")
"""Files that are taken for images, also in capitals."""

WHITE = 128
"""Grey values from here on belong to a mask: JPEG frays the edges."""


def mask_file(masks: str | os.PathLike[str], pair: Pair) -> Path:
    """The file with one pair's semantic mask.

    Args:
        masks: The file, or a folder with one file a pair.
        pair: Whose name is looked for in a folder.

    Raises:
        CalibrationError: No such file.
    """
    path = _existing(masks, pair)
    if path.is_file():
        return path
    for suffix in SUFFIXES if pair.pair_id else ():
        for candidate in (suffix, suffix.upper()):
            found = path / f"{pair.pair_id}{candidate}"
            if found.is_file():
                return found
    raise CalibrationError(
        f"{path}: no mask of pair {pair.pair_id!r}, {_size(pair)}",
        f"give its file, or name it {pair.pair_id or 'PAIR_ID'}.png in this folder",
    )


def segment_files(masks: str | os.PathLike[str], pair: Pair) -> list[Path]:
    """The files with one pair's segments, one image a segment, in the order of their names.

    Args:
        masks: A folder with one folder a pair, or with the segments of this one.
        pair: Whose name is looked for.

    Raises:
        CalibrationError: No such folder, or none with images in it.
    """
    path = _existing(masks, pair)
    if path.is_file():
        raise CalibrationError(
            f"{path}: a file where a folder with one image a segment is needed",
            f"give the folder with the masks of pair {pair.pair_id!r}, {_size(pair)}",
        )
    own = path / pair.pair_id if pair.pair_id else path
    folder = own if own.is_dir() else path
    found = sorted(file for file in folder.iterdir() if file.suffix.lower() in SUFFIXES)
    if not found:
        raise CalibrationError(
            f"{folder}: no images in it; expected one PNG a segment of pair {pair.pair_id!r}, "
            f"{_size(pair)}",
            f"put them there, or into a folder {pair.pair_id or 'PAIR_ID'} in it",
        )
    return found


def read_mask(path: str | os.PathLike[str], shape: tuple[int, int]) -> NDArray[np.uint8]:
    """A mask: white (or 1, where 1 is the highest value) in it, black elsewhere.

    Args:
        path: An image file, grey or in colour, of any format OpenCV reads.
        shape: (height, width) of the pair's image, pixels.

    Returns:
        (H, W) uint8, 255 in the mask and 0 elsewhere.

    Raises:
        CalibrationError: A file that is missing, unreadable, of another size, empty or all white.
    """
    import cv2

    path, size = Path(path), f"{shape[1]}x{shape[0]} pixels"
    try:
        stored = np.frombuffer(path.read_bytes(), np.uint8)
    except OSError as error:
        raise CalibrationError(
            f"mask {path}: {error.strerror or error}", f"give an image of {size}"
        ) from error
    grey = cv2.imdecode(stored, cv2.IMREAD_GRAYSCALE) if len(stored) else None
    if grey is None:
        raise CalibrationError(f"mask {path}: not an image", f"give a PNG or JPEG of {size}")
    if grey.shape != shape:
        raise CalibrationError(
            f"mask {path}: {grey.shape[1]}x{grey.shape[0]} pixels for an image of {size}",
            "make it from the image as recorded, neither scaled nor undistorted",
        )
    white = grey >= (1 if grey.max() == 1 else WHITE)
    if white.all() or not white.any():
        raise CalibrationError(
            f"mask {path}: {'all white' if white.any() else 'empty (all black)'}, {size}",
            "give one that is white where the objects are and black elsewhere",
        )
    return np.where(white, np.uint8(255), np.uint8(0))


def _existing(masks: str | os.PathLike[str], pair: Pair) -> Path:
    """The path, of a file or folder that is there."""
    path = Path(masks)
    if not path.exists():
        raise CalibrationError(
            f"masks {path}: no such file or folder",
            f"give a file, or a folder with the masks of pair {pair.pair_id!r}, {_size(pair)}",
        )
    return path


def _size(pair: Pair) -> str:
    return f"of {pair.camera.width}x{pair.camera.height} pixels"
