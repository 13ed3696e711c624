from __future__ import annotations

import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lcdata.errors import MessageError
from lcdata.recording.pointcloud import DATATYPES, Field, unpack

from .bags import OUSTER, ouster_cloud


@st.composite
def layouts(draw: st.DrawFn) -> tuple[np.dtype, list[Field]]:
    """A random layout: any types, counts, order, gaps before, between and after the fields."""
    order = draw(st.sampled_from("<>"))
    names, formats, offsets, fields = [], [], [], []
    end = draw(st.integers(0, 5))
    for i in range(draw(st.integers(1, 8))):
        datatype = draw(st.sampled_from(sorted(DATATYPES)))
        count = draw(st.sampled_from([1, 1, 1, 2, 3]))
        base = np.dtype(order + DATATYPES[datatype])
        offset = end + draw(st.sampled_from([0, 0, 0, 1, 4]))
        end = offset + base.itemsize * count
        names.append(f"f{i}")
        formats.append(base if count == 1 else (base, (count,)))
        offsets.append(offset)
        fields.append(Field(f"f{i}", offset, datatype, count))
    step = end + draw(st.integers(0, 9))
    dtype = np.dtype({"names": names, "formats": formats, "offsets": offsets, "itemsize": step})
    return dtype, draw(st.permutations(fields))


@given(layouts(), st.integers(1, 4), st.integers(0, 5), st.integers(0, 7), st.data())
def test_any_layout_comes_back_packed_and_native(
    layout: tuple[np.dtype, list[Field]], height: int, width: int, gap: int, data: st.DataObject
) -> None:
    dtype, fields = layout
    row_step = width * dtype.itemsize + gap
    raw = data.draw(st.binary(min_size=height * row_step, max_size=height * row_step))
    big = any(dtype[n].base.str[0] == ">" for n in dtype.names or ())
    records = unpack(
        fields,
        np.frombuffer(raw, np.uint8),
        height=height,
        width=width,
        point_step=dtype.itemsize,
        row_step=row_step,
        big_endian=big,
    )
    assert records.shape == (height * width,)
    assert set(records.dtype.names or ()) == set(dtype.names or ())
    assert records.dtype.itemsize == sum(dtype[n].itemsize for n in dtype.names or ())
    for row in range(height):
        for column in range(width):
            start = row * row_step + column * dtype.itemsize
            point = np.frombuffer(raw, dtype, 1, start)[0]
            for name in dtype.names or ():
                found = records[name][row * width + column]
                assert records.dtype[name].base.isnative
                np.testing.assert_array_equal(found, point[name])


def test_a_packed_cloud_is_not_copied() -> None:
    raw = np.arange(48, dtype=np.uint8)
    fields = [Field(n, 4 * i, 7, 1) for i, n in enumerate("xyz")]
    records = unpack(fields, raw, height=1, width=4, point_step=12, row_step=48)
    assert np.shares_memory(records, raw) == (sys.byteorder == "little")


def test_the_ouster_layout_loses_its_padding() -> None:
    records = ouster_cloud(0)
    codes = {"f4": 7, "u4": 6, "u2": 4}
    fields = [
        Field(n, OUSTER.fields[n][1], codes[OUSTER[n].str[1:]], 1) for n in OUSTER.names or ()
    ]
    found = unpack(fields, records.tobytes(), height=8, width=16, point_step=48, row_step=48 * 16)
    assert found.dtype.itemsize == 30
    for name in OUSTER.names or ():
        np.testing.assert_array_equal(found[name], records[name])


X = Field("x", 0, 7, 1)


@pytest.mark.parametrize(
    ("fields", "size", "row_step", "message"),
    [
        ([Field("x", 2, 8, 1)], 40, 40, "bytes 2 to 10 of a point of 8"),
        ([Field("x", 0, 9, 1)], 40, 40, "datatype 9"),
        ([X], 39, 40, "39 bytes instead of 40"),
    ],
)
def test_a_damaged_cloud_says_what_is_wrong(
    fields: list[Field], size: int, row_step: int, message: str
) -> None:
    with pytest.raises(MessageError, match=message):
        unpack(fields, bytes(size), height=1, width=5, point_step=8, row_step=row_step)


@pytest.mark.parametrize("row_step", [0, 8, 1_000_000])
def test_a_wrong_row_step_is_corrected_by_the_bytes(row_step: int) -> None:
    raw = np.arange(10, dtype="<f4").tobytes()
    found = unpack([X], raw, height=2, width=5, point_step=4, row_step=row_step)
    assert found["x"].tolist() == list(range(10))


def test_padding_fields_repeated_names_and_a_count_of_zero() -> None:
    fields = [X, Field("_", 4, 2, 4), Field("x", 8, 7, 1), Field("i", 12, 7, 0)]
    raw = np.arange(8, dtype="<f4").tobytes()
    found = unpack(fields, raw, height=1, width=2, point_step=16, row_step=32)
    assert found.dtype.names == ("x", "x_2", "i")
    assert found[1].tolist() == (4.0, 6.0, 7.0)


def test_an_empty_cloud_keeps_its_fields() -> None:
    found = unpack([X], b"", height=1, width=0, point_step=4, row_step=0)
    assert found.shape == (0,) and found.dtype.names == ("x",)
