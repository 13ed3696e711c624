"""Encoder readings of an arm whose ball sits in fixed sockets, from files.

Two layouts: a folder with one folder for each place of the tool and one CSV without header for
each socket on it (`front/hole_0.csv`, a column for each joint, radians; further columns are
ignored), or one CSV with the header `tool,socket,joint_1,...`.
"""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lcdata.errors import GroundTruthError

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Socket:
    """Readings with the ball in one socket.

    Args:
        tool: Place of the tool that the socket is part of.
        name: The socket on that tool.
        positions: (N, n) encoder readings in radians, in the order they were taken.
    """

    tool: str
    name: str
    positions: Array

    def __str__(self) -> str:
        return f"{self.tool}/{self.name}"


def read_sockets(path: Path, joint_names: Sequence[str]) -> tuple[Socket, ...]:
    """Readings of a folder or of one CSV.

    Args:
        path: Folder of tool positions, or CSV with a header.
        joint_names: The arm's joints, in order.

    Raises:
        GroundTruthError: Nothing there, a column that is missing, a value that is no number.
    """
    if path.is_dir():
        files = sorted(path.glob("*/*.csv"))
        if not files:
            raise GroundTruthError(
                f"{path}: no TOOL/SOCKET.csv in it",
                "give a folder for each place of the tool, with a CSV for each socket",
            )
        return tuple(Socket(f.parent.name, f.stem, _read_bare(f, joint_names)) for f in files)
    return _read_table(path, joint_names)


def _read_bare(path: Path, joint_names: Sequence[str]) -> Array:
    rows = _rows(path)
    if rows and rows[0][: len(joint_names)] == list(joint_names):
        rows = rows[1:]
    return _positions(path, [(row, list(range(len(joint_names)))) for row in rows], joint_names)


def _read_table(path: Path, joint_names: Sequence[str]) -> tuple[Socket, ...]:
    rows = _rows(path)
    header = rows[0] if rows else []
    wanted = ["tool", "socket", *joint_names]
    missing = [name for name in wanted if name not in header]
    if missing:
        raise GroundTruthError(
            f"{path}: no column {', '.join(missing)}; it has {', '.join(header) or 'none'}",
            f"its first line must name {', '.join(wanted)}",
        )
    columns = [header.index(name) for name in joint_names]
    tool, socket = header.index("tool"), header.index("socket")
    groups: dict[tuple[str, str], list[tuple[list[str], list[int]]]] = {}
    for row in rows[1:]:
        if len(row) < len(header):
            raise GroundTruthError(f"{path}: {len(row)} of {len(header)} columns in {row}")
        groups.setdefault((row[tool], row[socket]), []).append((row, columns))
    return tuple(
        Socket(*key, _positions(path, group, joint_names)) for key, group in groups.items()
    )


def _rows(path: Path) -> list[list[str]]:
    try:
        with path.open(encoding="utf-8", newline="") as file:
            rows = [[cell.strip() for cell in row] for row in csv.reader(file)]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise GroundTruthError(f"{path}: cannot be read ({error})") from error
    return [row for row in rows if any(row)]


def _positions(
    path: Path, rows: list[tuple[list[str], list[int]]], joint_names: Sequence[str]
) -> Array:
    positions = np.empty((len(rows), len(joint_names)))
    for i, (row, columns) in enumerate(rows):
        for k, column in enumerate(columns):
            name = joint_names[k]
            if column >= len(row):
                raise GroundTruthError(
                    f"{path}: reading {i + 1} has {len(row)} columns, none for {name}",
                    f"a reading needs {', '.join(joint_names)}",
                )
            try:
                positions[i, k] = float(row[column])
            except ValueError as error:
                raise GroundTruthError(
                    f"{path}: {name} of reading {i + 1} is {row[column]!r}", "give radians"
                ) from error
    return positions
