"""What the fields of a cloud mean: points, intensity, ring and per-point time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lcdata.errors import MessageError

INTENSITY_NAMES = ("intensity", "intensities", "reflectivity", "reflectance", "remission", "signal")
RING_NAMES = ("ring", "channel", "laser_id", "ring_id", "laser_number")
TIME_NAMES = (
    "t",
    "time",
    "timestamp",
    "offset_time",
    "time_offset",
    "timeoffset",
    "t_offset",
    "time_stamp",
    "timestamps",
    "relative_time",
    "point_time_offset",
)
"""Usual names, best first; capitals do not matter."""

UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
"""Seconds in each unit."""

SCAN_SECONDS = (0.005, 2.0)
"""How long one scan may take. The range is narrower than a factor of 1000, so that at most one
unit fits."""

ABSOLUTE_SECONDS = 100.0
"""Larger values count from an epoch or from the sensor's start, not from the scan's."""


def points(records: NDArray[np.void]) -> NDArray[np.float32]:
    """Points of records.

    Args:
        records: (N,) structured, with fields x, y, z in metres.

    Returns:
        (N, 3) float32. Points at exactly (0, 0, 0), which is how many drivers write a pulse
        without return, are NaN.

    Raises:
        MessageError: No x, y or z.
    """
    check_points(records.dtype)
    result = np.empty((len(records), 3), np.float32)
    for axis, name in enumerate("xyz"):
        result[:, axis] = records[name]
    result[~result.any(axis=1)] = np.nan
    return result


def check_points(dtype: np.dtype[Any]) -> None:
    """Refuse records without coordinates.

    Raises:
        MessageError: No x, y or z.
    """
    names = dtype.names or ()
    if not {"x", "y", "z"} <= set(names):
        raise MessageError(
            f"cloud without x, y, z; its fields are {', '.join(names) or 'none'}",
            "choose another LiDAR topic in the rig (topics.lidar)",
        )


def intensity_name(dtype: np.dtype[Any]) -> str | None:
    """Name of the field that holds intensity or reflectivity; None without one."""
    return _first_of(INTENSITY_NAMES, dtype)


def ring_name(dtype: np.dtype[Any]) -> str | None:
    """Name of the field that holds the ring (laser, channel); None without one."""
    return _first_of(RING_NAMES, dtype)


def is_livox(dtype: np.dtype[Any]) -> bool:
    """Whether points are a Livox's, whose scans do not repeat and whose `line` is no ring."""
    return {"tag", "line"} <= set(dtype.names or ())


def _first_of(candidates: tuple[str, ...], dtype: np.dtype[Any]) -> str | None:
    scalar = {name.lower(): name for name in dtype.names or () if dtype[name].shape == ()}
    return next((scalar[name] for name in candidates if name in scalar), None)


@dataclass(frozen=True)
class PointTimeField:
    """The per-point time of a cloud.

    Args:
        name: Field.
        unit: `s`, `ms`, `us` or `ns`.
        absolute: Counts from an epoch or the sensor's start instead of the scan's stamp.
        span_s: Last minus first time in the cloud it was chosen on, seconds.
        reason: How the unit was chosen.
    """

    name: str
    unit: str
    absolute: bool
    span_s: float
    reason: str

    def seconds(self, records: NDArray[np.void]) -> NDArray[np.float64]:
        """(N,) seconds since the earliest point of the cloud."""
        values = _values(records, self.name)
        if not len(values):
            return values
        return np.asarray((values - np.nanmin(values)) * UNITS[self.unit])

    def since(self, records: NDArray[np.void], stamp_ns: int) -> NDArray[np.float64]:
        """(N,) seconds since the cloud's stamp.

        Times that count from an epoch of their own count from the earliest one instead. Where a
        pulse has no return the time may be anything.
        """
        seconds = _values(records, self.name) * UNITS[self.unit]
        if not self.absolute or not len(seconds):
            return seconds
        measured = seconds[np.isfinite(seconds) & (seconds != 0)]
        start = stamp_ns * 1e-9
        if len(measured) and abs(np.median(measured) - start) > SCAN_SECONDS[1]:
            start = float(measured.min())
        return np.asarray(seconds - start)


def point_time(
    records: NDArray[np.void], *, field: str = "auto", unit: str = "auto"
) -> PointTimeField | None:
    """Find the per-point time field and its unit.

    The unit is the one in which a scan takes 5 ms to 2 s. Where none fits (a cloud of one
    column, say), it follows from the type: integers are ns, floats s, and absolute times
    are told by their magnitude as seconds, ms, us or ns since 1970.

    Args:
        records: (N,) structured records of a cloud.
        field: Name of the field if the rig gives it.
        unit: Unit if the rig gives it.

    Returns:
        The choice; None if the cloud has no such field.

    Raises:
        MessageError: The rig names a field that is not there.
    """
    name = _first_of(TIME_NAMES, records.dtype) if field == "auto" else field
    if name is None:
        return None
    names = records.dtype.names or ()
    if name not in names:
        raise MessageError(
            f"cloud has no field {name!r}; its fields are {', '.join(names)}",
            "correct point_time.field in the rig",
        )
    values = _values(records, name)
    values = values[np.isfinite(values) & (values != 0)]  # 0 where a pulse has no return
    low, high = (float(values.min()), float(values.max())) if len(values) else (0.0, 0.0)
    reason = "given in the rig"
    if unit == "auto":
        unit, reason = _unit(records.dtype[name], low, high)
    scale = UNITS[unit]
    absolute = abs(high) * scale > ABSOLUTE_SECONDS
    if not absolute:  # relative times start at 0 and may run to 0
        low, high = min(low, 0.0), max(high, 0.0)
    return PointTimeField(name, unit, absolute, (high - low) * scale, reason)


def _unit(dtype: np.dtype[Any], low: float, high: float) -> tuple[str, str]:
    shortest, longest = SCAN_SECONDS
    span = high - low
    for unit, scale in UNITS.items():
        if shortest <= span * scale <= longest:
            return unit, f"a scan takes {span * scale:.3g} s"
    if high > 1e8:  # seconds since 1970 are 1e9, nanoseconds 1e18
        unit = next((u for u, scale in UNITS.items() if high * scale < 1e11), "ns")
        return unit, f"values near {high:.3g}"
    kind = "s" if dtype.kind == "f" else "ns"
    return kind, f"its type {dtype.name}, as its range of {span:.3g} does not tell"


def _values(records: NDArray[np.void], name: str) -> NDArray[np.float64]:
    return records[name].astype(np.float64)
