"""The table in a joint log, CSV or JSON: which column is the stamp, which are joints.

Nothing in it is a number yet: an arm decides which columns matter. The CSV's header row decides
the style:

    UR      `timestamp actual_q_0 ... actual_q_5`, as Universal Robots' RTDE recorder writes it
    KUKA    `Zeit;A1;...;A6`, also `$AXIS_ACT.A1`
    names   `stamp,joint_1,...`: columns with the joints' own names
"""

from __future__ import annotations

import csv
import json
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lcdata.errors import RecordingError

if TYPE_CHECKING:
    from lcdata.rig_joint_log import JointLogSection

STAMP_UNITS = {"s": 9, "sec": 9, "ms": 6, "us": 3, "ns": 0}
"""Powers of ten that make nanoseconds."""

STAMPS = ("stamp", "timestamp", "time", "zeit", "t")
"""Names of the stamp's column, without unit."""

UR = re.compile(r"actual_q_?(\d)")
KUKA = re.compile(r"(?:.*axis.*[._ ])?a([1-9])", re.IGNORECASE)  # not ROS's joint_a1

ANGLES = {"deg": "deg", "°": "deg", "grad": "deg", "degrees": "deg", "rad": "rad", "radians": "rad"}


@dataclass(frozen=True)
class Column:
    """A column: its name as written, without the unit in it, and that unit (or "")."""

    written: str
    name: str
    unit: str


@dataclass(frozen=True, eq=False)
class Table:
    """The content of a joint log.

    Args:
        path: The file.
        style: `UR`, `KUKA`, `names`, `JSON` or `columns` (those that the rig names).
        stamp: The stamp's column.
        joints: Columns of joints, or in style `names` of whatever is not the stamp.
        named: Whether they carry the joints' names; else they are in the arm's order.
        rows: Stamp first, then the joints; text of a CSV, values of a JSON.
        places: Where each row is in the file: `:17` (line) or `: sample 16`.
        unit: `rad`, `deg`, or "" where the file does not say it.
    """

    path: Path
    style: str
    stamp: Column
    joints: tuple[Column, ...]
    named: bool
    rows: list[list[Any]]
    places: Sequence[str]
    unit: str = ""

    def where(self, row: int) -> str:
        """File and place of a row."""
        return f"{self.path}{self.places[row]}"


def read_table(path: Path, options: JointLogSection) -> Table:
    """Read a joint log.

    Args:
        path: A `.json` file; any other is a CSV.
        options: The rig's.

    Raises:
        RecordingError: Not readable, no stamp, no joints, or rows of different lengths.
    """
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "it is no text file in UTF-8"
        raise RecordingError(f"{path}: cannot be read ({reason})", "check the file") from error
    table = _json(path, text) if path.suffix.lower() == ".json" else _csv(path, text, options)
    if not table.rows:
        raise RecordingError(f"{path} has no samples", "record the joints again")
    return table


def _csv(path: Path, text: str, options: JointLogSection) -> Table:
    lines = [(i + 1, line) for i, line in enumerate(text.splitlines()) if line.strip()]
    if not lines:
        raise RecordingError(f"{path} is empty", "record the joints again")
    first, header = lines[0][0], lines[0][1].lstrip("#% ")
    delimiter = next((mark for mark in ";\t," if mark in header), "")
    written = [cell.strip() for cell in next(iter(_cells([(first, header)], delimiter)))]
    written = written[:-1] if not written[-1] else written  # some writers end lines with one
    if all(_is_number(cell, delimiter) for cell in written):
        raise RecordingError(
            f"{path}:{first}: no header row, it begins with {written[0]!r}",
            "name the columns in a first line: stamp,joint_1,...",
        )
    columns = [_column(name) for name in written]
    stamp = _stamp(path, columns, options)
    style, joints = _joints(path, columns, stamp, options)
    chosen = [stamp, *joints]
    lines = [line for line in lines[1:] if line[1].lstrip()[0] not in "#%"]
    rows = []
    for (number, _), cells in zip(lines, _cells(lines, delimiter), strict=True):
        if len(cells) < len(columns):
            raise RecordingError(
                f"{path}:{number}: {len(cells)} values for {len(columns)} columns",
                "remove the line, or record the joints again",
            )
        rows.append([cells[i] for i in chosen])
    if delimiter not in ("", ","):
        rows = [[cell.replace(",", ".") for cell in row] for row in rows]
    places = [f":{number}" for number, _ in lines]
    picked = tuple(columns[i] for i in joints)
    return Table(path, style, columns[stamp], picked, style == "names", rows, places)


def _cells(lines: Sequence[tuple[int, str]], delimiter: str) -> Iterable[list[str]]:
    if not delimiter:
        return (line.split() for _, line in lines)
    return csv.reader((line for _, line in lines), delimiter=delimiter, skipinitialspace=True)


def _is_number(cell: str, delimiter: str) -> bool:
    try:
        float(cell if delimiter == "," else cell.replace(",", "."))
    except ValueError:
        return False
    return True


def _column(written: str) -> Column:
    """`A1 [deg]`, `A1(deg)`, `joint_1_deg`, `stamp_ns`: name and unit."""
    units = "|".join(map(re.escape, sorted({*STAMP_UNITS, *ANGLES}, key=len, reverse=True)))
    found = re.fullmatch(rf"(.+?)(?:\s*[\[(]\s*({units})\s*[\])]|_({units}))", written, re.I)
    if found is None:
        return Column(written, written, "")
    return Column(written, found[1], (found[2] or found[3]).lower())


def _index(path: Path, columns: Sequence[Column], wanted: str, key: str) -> int:
    for i, column in enumerate(columns):
        if wanted in (column.written, column.name):
            return i
    listed = ", ".join(column.written for column in columns)
    raise RecordingError(f"{path} has no column {wanted!r}", f"joint_log.{key} takes {listed}")


def _stamp(path: Path, columns: Sequence[Column], options: JointLogSection) -> int:
    if options.stamp_column:
        return _index(path, columns, options.stamp_column, "stamp_column")
    for i, column in enumerate(columns):
        if column.name.lower() in STAMPS:
            return i
    listed = ", ".join(column.written for column in columns)
    raise RecordingError(
        f"{path} has no column of stamps ({' or '.join(STAMPS)}); it has {listed}",
        "name it in the rig (joint_log.stamp_column)",
    )


def _joints(
    path: Path, columns: Sequence[Column], stamp: int, options: JointLogSection
) -> tuple[str, list[int]]:
    if options.columns:
        return "columns", [_index(path, columns, name, "columns") for name in options.columns]
    for style, pattern, begin in (("UR", UR, 0), ("KUKA", KUKA, 1)):
        matches = [(pattern.fullmatch(c.name), i) for i, c in enumerate(columns) if i != stamp]
        found = sorted((int(match[1]), i) for match, i in matches if match)
        if not found:
            continue
        numbers = [number for number, _ in found]
        if numbers != [*range(begin, begin + len(found))]:
            listed = ", ".join(columns[i].written for _, i in found)
            raise RecordingError(
                f"{path}: one joint is missing or there twice: {listed}",
                "name one column a joint in the rig (joint_log.columns)",
            )
        return style, [i for _, i in found]
    others = [i for i in range(len(columns)) if i != stamp]
    if not others:
        raise RecordingError(f"{path} has no column of joints", "record the joints again")
    return "names", others


def _json(path: Path, text: str) -> Table:
    remedy = 'write a list of {"stamp_ns": ..., "positions": [...]}'
    try:
        content = json.loads(text)
    except ValueError as error:
        raise RecordingError(f"{path}: not JSON ({error})", "write it again") from error
    top = content if isinstance(content, dict) else {"samples": content}
    samples, names, unit = top.get("samples"), top.get("names"), str(top.get("unit", ""))
    if not isinstance(samples, list):
        raise RecordingError(f"{path}: holds no list of samples", remedy)
    if unit and unit not in ANGLES:
        raise RecordingError(f"{path}: its unit is {unit!r}", "rad and deg are known")
    key = ""
    rows: list[list[Any]] = []
    for i, sample in enumerate(samples):
        where = f"{path}: sample {i}"
        positions = sample.get("positions") if isinstance(sample, dict) else None
        if not isinstance(positions, list):
            raise RecordingError(f"{where} has no list of positions", remedy)
        key = key or next((k for k in ("stamp_ns", "stamp") if k in sample), "")
        if key not in sample or not key:
            raise RecordingError(f"{where} has no {key or 'stamp_ns or stamp'}", remedy)
        own = sample.get("names", names)
        if i == 0:
            names = own
        if own != names:
            raise RecordingError(f"{where} has other names than the first", "use one order")
        if len(positions) != len(names or rows[0][1:] if rows or names else positions):
            expected = len(names) if names else len(rows[0]) - 1
            raise RecordingError(
                f"{where} has {len(positions)} positions, not {expected}", "remove the sample"
            )
        rows.append([sample[key], *positions])
    count = len(rows[0]) - 1 if rows else 0
    columns = tuple(Column(str(n), str(n), "") for n in names or range(count))
    places = [f": sample {i}" for i in range(len(rows))]
    stamp = _column(key or "stamp")
    return Table(path, "JSON", stamp, columns, bool(names), rows, places, ANGLES.get(unit, ""))
