"""Image messages to pixels and to files. Colour is RGB."""

from __future__ import annotations

import struct
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lcdata.errors import MessageError

JPEG, PNG = b"\xff\xd8\xff", b"\x89PNG\r\n\x1a\n"
"""First bytes of the two kinds of file."""

END = {".jpg": b"\xff\xd9", ".png": b"IEND\xaeB`\x82"}
"""Last bytes of the two kinds of file."""

DAMAGED = "the message is damaged or its driver is wrong"

LAYOUTS: dict[str, tuple[str, int, str]] = {
    "mono8": ("u1", 1, ""),
    "8UC1": ("u1", 1, ""),
    "mono16": ("u2", 1, ""),
    "16UC1": ("u2", 1, ""),
    "rgb8": ("u1", 3, "RGB2BGR"),
    "bgr8": ("u1", 3, ""),
    "8UC3": ("u1", 3, ""),
    "rgba8": ("u1", 4, "RGBA2BGR"),
    "bgra8": ("u1", 4, "BGRA2BGR"),
    "8UC4": ("u1", 4, "BGRA2BGR"),
    # OpenCV names a filter array after its second row, ROS after its first.
    "bayer_rggb8": ("u1", 1, "BayerBG2BGR"),
    "bayer_bggr8": ("u1", 1, "BayerRG2BGR"),
    "bayer_gbrg8": ("u1", 1, "BayerGR2BGR"),
    "bayer_grbg8": ("u1", 1, "BayerGB2BGR"),
    "yuv422": ("u1", 2, "YUV2BGR_UYVY"),
    "uyvy": ("u1", 2, "YUV2BGR_UYVY"),
    "yuv422_yuy2": ("u1", 2, "YUV2BGR_YUY2"),
    "yuyv": ("u1", 2, "YUV2BGR_YUY2"),
}
"""Encoding to pixel type, channels, and OpenCV's conversion to BGR."""


def decode_raw(
    data: Any,
    encoding: str,
    *,
    height: int,
    width: int,
    step: int = 0,
    big_endian: bool = False,
) -> NDArray[Any]:
    """Pixels of a raw image.

    Args:
        data: Bytes of the pixels, anything with the buffer protocol.
        encoding: ROS name, `bgr8`.
        height: Rows.
        width: Pixels a row.
        step: Bytes a row; 0 if rows are not padded.
        big_endian: Byte order of 16-bit pixels.

    Returns:
        (H, W) gray or (H, W, 3) **BGR**, uint8 or uint16, as OpenCV writes it; may be a view.

    Raises:
        MessageError: Unknown encoding, or too few bytes.
    """
    if encoding not in LAYOUTS:
        raise MessageError(
            f"image encoding {encoding!r} is unknown", f"known are {', '.join(LAYOUTS)}"
        )
    kind, channels, conversion = LAYOUTS[encoding]
    dtype = np.dtype((">" if big_endian else "<") + kind)
    row = width * channels * dtype.itemsize
    step = step if step > row else row
    size = memoryview(data).nbytes
    if height <= 0 or width <= 0 or size < step * (height - 1) + row:
        raise MessageError(
            f"{encoding} image of {width}x{height} has {size} bytes instead of {step * height}",
            DAMAGED,
        )
    shape = (height, width) if channels == 1 else (height, width, channels)
    strides = (step, channels * dtype.itemsize, dtype.itemsize)[: len(shape)]
    pixels: NDArray[Any] = np.ndarray(shape, dtype, data, strides=strides)
    if not dtype.isnative:
        pixels = pixels.astype(dtype.newbyteorder("="))
    return _converted(pixels, conversion) if conversion else pixels


def _converted(pixels: NDArray[Any], conversion: str) -> NDArray[Any]:
    import cv2

    try:
        return np.asarray(cv2.cvtColor(pixels, getattr(cv2, f"COLOR_{conversion}")))
    except cv2.error as error:
        raise MessageError(
            f"image of shape {pixels.shape} cannot be converted ({conversion})"
        ) from error


def to_8_bit(pixels: NDArray[Any]) -> NDArray[np.uint8]:
    """BGR or gray pixels of 8 or 16 bits to RGB or gray of 8 bits, contiguous.

    16-bit images come from sensors of 10, 12, 14 or 16 bits, left or right justified: the
    highest bit in use decides how far they are shifted, so that a dark 12-bit image does not
    come out black.
    """
    if pixels.dtype == np.uint16:
        depth = max(int(pixels.max(initial=0)).bit_length(), 8)
        depth += depth % 2
        pixels = (pixels >> (depth - 8)).astype(np.uint8)
    if pixels.ndim == 3:
        pixels = pixels[..., 2::-1]
    return np.ascontiguousarray(pixels, np.uint8)


def decode_file(data: Any) -> NDArray[np.uint8]:
    """(H, W) gray or (H, W, 3) RGB uint8 pixels of the bytes of a JPEG or PNG.

    Raises:
        MessageError: Damaged, or another kind of file.
    """
    return to_8_bit(_read(data, "file"))


def decode_compressed(data: Any, encoding: str) -> NDArray[np.uint8]:
    """Pixels of a compressed image message.

    Args:
        data: Bytes of a JPEG or PNG.
        encoding: Format of the message: `jpeg`, `bgr8; jpeg compressed bgr8`, ...

    Returns:
        (H, W) gray or (H, W, 3) RGB uint8.

    Raises:
        MessageError: Damaged, or another kind of file.
    """
    suffix(data, encoding)
    pixels = _read(data, encoding)
    original = encoding.partition(";")[0].strip()
    if pixels.ndim == 2 and pixels.dtype == np.uint8 and original.startswith("bayer_"):
        _, _, conversion = LAYOUTS.get(original, ("", 0, ""))
        pixels = _converted(pixels, conversion) if conversion else pixels
    return to_8_bit(pixels)


def _read(data: Any, what: str) -> NDArray[Any]:
    import cv2

    content = np.frombuffer(data, np.uint8)
    # As it is: neither turned by an EXIF orientation nor stripped of 16 bits.
    pixels = cv2.imdecode(content, cv2.IMREAD_UNCHANGED) if len(content) else None
    if pixels is None:
        raise MessageError(
            f"image ({what}) of {memoryview(data).nbytes} bytes cannot be decoded", "it is damaged"
        )
    return np.asarray(pixels)


def encode_png(pixels: NDArray[Any]) -> bytes:
    """Lossless PNG of BGR or gray pixels.

    OpenCV's own choice (run lengths of differences to the left) takes half the time of level 1
    of the usual one and makes files that are as small.
    """
    import cv2

    ok, data = cv2.imencode(".png", np.ascontiguousarray(pixels))
    if not ok:
        raise MessageError(f"pixels of {pixels.shape} {pixels.dtype} cannot be written as PNG")
    return data.tobytes()


def suffix(data: Any, encoding: str) -> str:
    """`.jpg` or `.png`, by the first bytes: drivers' format strings differ too much.

    Raises:
        MessageError: Neither JPEG nor PNG.
    """
    head = bytes(memoryview(data)[:8])
    if not head:
        raise MessageError(f"compressed image of format {encoding!r} has 0 bytes", DAMAGED)
    if head.startswith(JPEG):
        return ".jpg"
    if head.startswith(PNG):
        return ".png"
    raise MessageError(
        f"compressed image of format {encoding!r} starts with {head[:4].hex()}, "
        "which is neither JPEG nor PNG",
        "choose another image topic in the rig (topics.image)",
    )


def check_whole(data: Any, encoding: str) -> None:
    """Refuse a JPEG or PNG that was cut off.

    Decoding each image would take longer than all else in a build: only one that does not end
    as it should, which some drivers' images do not, is decoded.

    Raises:
        MessageError: Neither JPEG nor PNG, or not decodable.
    """
    end = END[suffix(data, encoding)]
    if end in bytes(memoryview(data)[-64:]):
        return
    try:
        _read(data, encoding)
    except MessageError as error:  # without its size, that a report can name many at once
        raise MessageError(f"compressed image ({encoding}) is cut off", DAMAGED) from error


def size(data: Any) -> tuple[int, int]:
    """(height, width) of a JPEG or PNG from its header, without decoding; (0, 0) if unknown."""
    view = memoryview(data)
    if bytes(view[:8]) == PNG and len(view) >= 24:
        width, height = struct.unpack_from(">II", view, 16)
        return height, width
    position = 2
    while bytes(view[:3]) == JPEG and position + 9 <= len(view):
        marker, length = view[position + 1], struct.unpack_from(">H", view, position + 2)[0]
        if view[position] != 0xFF:
            break
        if 0xC0 <= marker <= 0xCF and marker not in (0xC4, 0xC8, 0xCC):  # a frame header
            height, width = struct.unpack_from(">HH", view, position + 5)
            return height, width
        position += 2 + length
    return 0, 0
