"""KITTI's text files: calibrations (`KEY: numbers`) and time stamps."""

from __future__ import annotations

import re
from datetime import UTC, datetime
from decimal import Decimal, InvalidOperation
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lcdata.errors import SourceError

Array = NDArray[np.float64]

STAMP = re.compile(r"(\d{4}-\d\d-\d\d[ T]\d\d:\d\d:\d\d)(?:\.(\d{1,9}))?\Z")
"""A line of timestamps.txt: `2011-09-26 13:02:25.594360375`."""

LONGEST_S = 10**9
"""No recording's clock counts farther from its start."""


def parse_calibration(text: str) -> dict[str, Array]:
    """Numbers of a calibration file by their keys; what is no number (dates) is left out."""
    result = {}
    for line in text.splitlines():
        key, colon, values = line.partition(":")
        if not colon:
            key, _, values = line.strip().partition(" ")
        try:
            row = np.array([float(value) for value in values.split()])
        except ValueError:
            continue
        if key.strip() and len(row):
            result[key.strip()] = row
    return result


def read_calibration(path: Path, remedy: str) -> dict[str, Array]:
    """Numbers of a calibration file by their keys.

    Args:
        path: The file.
        remedy: Where it is to be had, for an error.

    Raises:
        SourceError: Not there, or nothing of its kind in it.
    """
    found = parse_calibration(_text(path, remedy))
    if not found:
        raise SourceError(f"{path}: no line `KEY: numbers` in it", remedy)
    return found


def value(found: dict[str, Array], key: str, path: Path, remedy: str) -> Array:
    """Numbers of a key.

    Raises:
        SourceError: The file has no such key.
    """
    if key not in found:
        there = ", ".join(list(found)[:12])
        raise SourceError(f"{path}: no {key} in it (there are {there})", remedy)
    return found[key]


def read_timestamps(path: Path) -> list[int | None]:
    """Stamps of frames in ns by the line they are on; None where a line is none.

    KITTI's stamps have no time zone; they are taken as UTC, so that differences are right.

    Raises:
        SourceError: Not there, or no stamps in it.
    """
    stamps = [_stamp(line) for line in _text(path, "download the drive again").splitlines()]
    if not any(stamp is not None for stamp in stamps):
        raise SourceError(
            f"{path}: no time stamps in it", "its lines are like 2011-09-26 13:02:25.594360375"
        )
    return stamps


def read_times(path: Path) -> list[int | None]:
    """Stamps in ns of a times.txt, which has seconds; None where a line is no number.

    Raises:
        SourceError: Not there, or no numbers in it.
    """
    stamps: list[int | None] = []
    for line in _text(path, "data_odometry_calib.zip has it").splitlines():
        try:
            seconds = Decimal(line.strip())
            stamps.append(int(seconds.scaleb(9)) if abs(seconds) < LONGEST_S else None)
        except (InvalidOperation, ValueError, OverflowError):
            stamps.append(None)
    if not any(stamp is not None for stamp in stamps):
        raise SourceError(f"{path}: no times in it", "its lines are seconds")
    return stamps


def at(stamps: list[int | None], number: int) -> int | None:
    """Stamp of a frame; None if there is none."""
    return stamps[number] if 0 <= number < len(stamps) else None


def _stamp(line: str) -> int | None:
    match = STAMP.match(line.strip())
    if match is None:
        return None
    try:
        seconds = datetime.fromisoformat(match[1]).replace(tzinfo=UTC).timestamp()
    except ValueError:
        return None
    return int(seconds) * 10**9 + int((match[2] or "0").ljust(9, "0"))


def _text(path: Path, remedy: str) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except FileNotFoundError as error:
        raise SourceError(f"{path}: not there", remedy) from error
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "it is no text file"
        raise SourceError(f"{path}: cannot be read ({reason})", remedy) from error
