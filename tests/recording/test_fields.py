from __future__ import annotations

import numpy as np
import pytest

from lcdata.errors import MessageError
from lcdata.recording import fields


def records(**columns: np.ndarray) -> np.ndarray:
    dtype = [(name, column.dtype, column.shape[1:]) for name, column in columns.items()]
    result = np.zeros(len(next(iter(columns.values()))), dtype)
    for name, column in columns.items():
        result[name] = column
    return result


TURN = np.linspace(0, 0.1, 1000)
EPOCH = 1_700_000_000.0


@pytest.mark.parametrize(
    ("name", "values", "unit", "absolute"),
    [
        ("t", (TURN * 1e9).astype("u4"), "ns", False),  # Ouster
        ("time", (TURN - 0.1).astype("f4"), "s", False),  # Velodyne: ends at the stamp
        ("timestamp", EPOCH + TURN, "s", True),  # Hesai, RoboSense
        ("timestamp", (EPOCH + TURN) * 1e9, "ns", True),  # Livox
        ("offset_time", (TURN * 1e9).astype("u4"), "ns", False),  # Livox
        ("time_offset", (TURN * 1e6).astype("u4"), "us", False),
        ("Timestamp", (EPOCH + TURN) * 1e6, "us", True),
        ("time", (TURN * 1e3).astype("f4"), "ms", False),
        ("t", 5000 + TURN, "s", True),  # since the sensor's start
    ],
)
def test_names_and_units_of_common_drivers(
    name: str, values: np.ndarray, unit: str, absolute: bool
) -> None:
    cloud = records(x=np.ones(1000, "f4"), **{name: values})
    found = fields.point_time(cloud)
    assert found is not None
    assert (found.name, found.unit, found.absolute) == (name, unit, absolute)
    assert found.span_s == pytest.approx(0.1, rel=1e-3)
    seconds = found.seconds(cloud)
    assert seconds.min() == 0 and seconds.max() == pytest.approx(0.1, rel=1e-3)


@pytest.mark.parametrize(
    ("values", "unit"),
    [
        (np.full(10, 7, "u4"), "ns"),
        (np.zeros(10, "f4"), "s"),
        (np.full(10, EPOCH), "s"),
        (np.full(10, EPOCH * 1e3), "ms"),
        (np.full(10, EPOCH * 1e9), "ns"),
    ],
)
def test_a_range_that_does_not_tell_leaves_it_to_type_and_magnitude(
    values: np.ndarray, unit: str
) -> None:
    found = fields.point_time(records(t=values))
    assert found is not None and found.unit == unit


def test_points_without_return_do_not_make_an_absolute_time_span_decades() -> None:
    values = EPOCH + TURN
    values[::7] = 0
    found = fields.point_time(records(timestamp=values))
    assert found is not None and found.unit == "s" and found.span_s < 0.11


def test_the_rig_overrides_field_and_unit() -> None:
    cloud = records(t=(TURN * 1e9).astype("u4"), lap=(TURN * 1e3).astype("f4"))
    found = fields.point_time(cloud, field="lap", unit="ms")
    assert found is not None
    assert (found.name, found.unit, found.reason) == ("lap", "ms", "given in the rig")
    with pytest.raises(MessageError, match="no field 'lop'; its fields are t, lap"):
        fields.point_time(cloud, field="lop")


def test_intensity_ring_and_their_absence() -> None:
    one = np.ones(2, "f4")
    cloud = records(x=one, Intensity=one, reflectivity=one, channel=one.astype("u1"))
    assert fields.intensity_name(cloud.dtype) == "Intensity"
    assert fields.ring_name(cloud.dtype) == "channel"
    bare = records(x=one, intensity=np.ones((2, 3), "f4"))
    assert fields.intensity_name(bare.dtype) is None
    assert fields.ring_name(bare.dtype) is None
    assert fields.point_time(bare) is None


def test_pulses_without_return_are_nan() -> None:
    cloud = records(x=np.array([0.0, 1, 0]), y=np.array([0.0, 2, 0]), z=np.array([0.0, 3, 1]))
    np.testing.assert_array_equal(
        fields.points(cloud), np.array([[np.nan] * 3, [1, 2, 3], [0, 0, 1]], np.float32)
    )
    with pytest.raises(MessageError, match="without x, y, z; its fields are range"):
        fields.points(records(range=np.ones(3)))
