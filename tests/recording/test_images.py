from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lcdata.errors import MessageError
from lcdata.recording import images
from lcdata.recording.messages import Image

RNG = np.random.default_rng(0)
RGB = cv2.resize(RNG.integers(0, 255, (6, 8, 3), dtype=np.uint8), (64, 48))


def raw(
    data: np.ndarray, encoding: str, *, step: int = 0, big_endian: bool = False, width: int = 0
) -> Image:
    height = data.shape[0]
    return Image(
        1, 2, "camera", memoryview(np.ascontiguousarray(data)).cast("B"), encoding, False,
        height, width or data.shape[1], step, big_endian,
    )  # fmt: skip


def compressed(data: bytes, encoding: str) -> Image:
    height, width = images.size(data)
    return Image(1, 2, "camera", memoryview(data), encoding, True, height, width)


BGR = RGB[..., ::-1]
ALPHA = np.full((48, 64, 1), 200, np.uint8)


@pytest.mark.parametrize(
    ("pixels", "encoding"),
    [
        (RGB, "rgb8"),
        (BGR, "bgr8"),
        (BGR, "8UC3"),
        (np.dstack([RGB, ALPHA]), "rgba8"),
        (np.dstack([BGR, ALPHA]), "bgra8"),
    ],
)
def test_colour_comes_out_as_rgb(pixels: np.ndarray, encoding: str) -> None:
    image = raw(pixels, encoding)
    np.testing.assert_array_equal(image.decode(), RGB)
    data, suffix = image.encoded()
    assert suffix == ".png"
    np.testing.assert_array_equal(images.decode_file(data), RGB)


@pytest.mark.parametrize("first_row", ["rg", "gr", "gb", "bg"])
def test_bayer_is_interpolated_with_the_right_colours(first_row: str) -> None:
    colour = {"r": 200, "g": 100, "b": 30}
    second_row = {"rg": "gb", "gr": "bg", "gb": "rg", "bg": "gr"}[first_row]
    cell = np.array([[colour[c] for c in first_row], [colour[c] for c in second_row]], np.uint8)
    image = raw(np.tile(cell, (8, 8)), f"bayer_{first_row}{second_row}8")
    assert (image.decode() == [200, 100, 30]).all()


def test_yuv_keeps_its_luminance() -> None:
    flat = np.full((4, 6, 2), 128, np.uint8)
    flat[..., 1] = 90
    assert (raw(flat, "uyvy").decode() == raw(flat[..., ::-1], "yuyv").decode()).all()
    assert np.ptp(raw(flat, "yuv422").decode()) == 0


@pytest.mark.parametrize("big_endian", [False, True])
@pytest.mark.parametrize("bits", [8, 10, 12, 14, 16])
def test_mono16_of_any_depth_fills_8_bits(bits: int, big_endian: bool) -> None:
    values = np.linspace(0, 2**bits - 1, 48 * 64).reshape(48, 64).astype("<u2")
    recorded = values.astype(">u2") if big_endian else values
    image = raw(recorded, "mono16", big_endian=big_endian)
    np.testing.assert_array_equal(image.decode(), values >> (bits - 8))
    data, _ = image.encoded()
    np.testing.assert_array_equal(cv2.imdecode(np.frombuffer(data, np.uint8), -1), values)


@given(
    st.sampled_from(["mono8", "mono16", "rgb8", "bgr8", "rgba8", "bgra8"]),
    st.integers(1, 9),
    st.integers(1, 9),
    st.integers(0, 13),
    st.booleans(),
    st.data(),
)
def test_rows_may_be_padded(
    encoding: str, height: int, width: int, gap: int, big_endian: bool, data: st.DataObject
) -> None:
    kind, channels, _ = images.LAYOUTS[encoding]
    row = width * channels * np.dtype(kind).itemsize
    step = row + gap
    # The last row's padding is often missing.
    size = step * height - data.draw(st.integers(0, gap))
    recorded = data.draw(st.binary(min_size=size, max_size=size))
    padded = Image(0, 0, "", memoryview(recorded), encoding, False, height, width, step, big_endian)
    rows = b"".join(recorded[i * step : i * step + row] for i in range(height))
    tight = Image(0, 0, "", memoryview(rows), encoding, False, height, width, row, big_endian)
    expected = tight.decode()
    np.testing.assert_array_equal(padded.decode(), expected)
    assert expected.shape == ((height, width) if channels == 1 else (height, width, 3))
    np.testing.assert_array_equal(images.decode_file(padded.encoded()[0]), expected)


@pytest.mark.parametrize(
    "encoding", ["jpeg", "bgr8; jpeg compressed bgr8", "rgb8; jpeg compressed ", "png", ""]
)
@pytest.mark.parametrize("ending", [".jpg", ".png"])
def test_compressed_bytes_are_kept_and_told_by_their_content(encoding: str, ending: str) -> None:
    data = cv2.imencode(ending, BGR)[1].tobytes()
    image = compressed(data, encoding)
    assert image.encoded() == (data, ending)
    assert (image.height, image.width) == (48, 64)
    difference = np.abs(image.decode().astype(int) - RGB)
    assert difference.mean() < (8 if ending == ".jpg" else 1e-9)


@pytest.mark.parametrize("progressive", [0, 1])
def test_the_size_of_a_jpeg_is_known_without_decoding(progressive: int) -> None:
    gray = cv2.imencode(".jpg", BGR[..., 0], [cv2.IMWRITE_JPEG_PROGRESSIVE, progressive])[1]
    assert images.size(gray) == (48, 64)
    assert images.size(gray.tobytes()[:20]) == (0, 0)


def test_compressed_gray_16_bit_and_bayer() -> None:
    deep = np.linspace(0, 4095, 48 * 64).reshape(48, 64).astype(np.uint16)
    png = cv2.imencode(".png", deep)[1].tobytes()
    np.testing.assert_array_equal(compressed(png, "mono16; png compressed").decode(), deep >> 4)
    mosaic = np.tile(np.array([[200, 100], [100, 30]], np.uint8), (8, 8))
    image = compressed(cv2.imencode(".png", mosaic)[1].tobytes(), "bayer_rggb8; png compressed")
    assert (image.decode() == [200, 100, 30]).all()


def test_what_cannot_be_read_says_so() -> None:
    with pytest.raises(MessageError, match="encoding 'nv21' is unknown: known are mono8"):
        raw(RGB, "nv21").decode()
    with pytest.raises(MessageError, match="bgr8 image of 65x48 has 9216 bytes instead of 9360"):
        raw(BGR, "bgr8", width=65).decode()
    with pytest.raises(MessageError, match="starts with 00010203, which is neither"):
        compressed(bytes(range(20)), "16UC1; compressedDepth").encoded()
    jpeg = cv2.imencode(".jpg", BGR)[1].tobytes()
    with pytest.raises(MessageError, match="cannot be decoded: it is damaged"):
        compressed(jpeg[:40], "jpeg").decode()
