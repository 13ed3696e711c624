"""Joint positions from a file beside a recording, where it has no JointState.

Arms that are not driven through ROS write logs of their own. One beside the recording, or the one
that the rig names, takes the part of the joint states' topic.
"""

from __future__ import annotations

from dataclasses import dataclass
from decimal import Decimal, DecimalException
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lcdata.errors import ArmError, RecordingError
from lcdata.recording.joint_table import ANGLES, STAMP_UNITS, Column, Table, read_table

if TYPE_CHECKING:
    from lcdata.arm import Arm
    from lcdata.rig import Rig
    from lcdata.rig_joint_log import JointLogSection

Array = NDArray[np.float64]
Stamps = NDArray[np.int64]

SUFFIXES = (".json", ".csv")
KUKA_UNIT = "KUKA's controllers write degrees"
JOINT_LOG = "joint log"
"""Type of the topic that a log stands for."""

FAR_FUTURE_NS = 10**20
"""The year 5138: seconds beyond it are not seconds."""


class Samples(NamedTuple):
    """(N,) increasing stamps of a log on the sensors' clock, and (N, n) radians."""

    stamps_ns: Stamps
    positions: Array


@dataclass(frozen=True, eq=False)
class JointLog:
    """A joint log.

    Args:
        table: Its content.
        options: How the rig wants it read.
    """

    table: Table
    options: JointLogSection

    @property
    def topic(self) -> str:
        """The file's name, which stands for the topic's."""
        return self.table.path.name

    @property
    def names(self) -> tuple[str, ...]:
        """Names of joints, or columns in the order of the arm's joints."""
        # A joint may be called joint_1_s: that is no unit of an angle.
        return tuple(c.name if c.unit in ANGLES else c.written for c in self.table.joints)

    @cached_property
    def unit(self) -> tuple[str, str]:
        """`rad` or `deg`, and what says so: the rig, the file, or its style, in this order."""
        if self.options.unit != "auto":
            return self.options.unit, "joint_log.unit in the rig"
        if self.table.unit:
            return self.table.unit, "the file's unit"
        written = {ANGLES.get(column.unit, "") for column in self.table.joints} - {""}
        if len(written) == 1:
            return written.pop(), "the columns' names"
        if len(written) > 1:
            raise RecordingError(
                f"{self.table.path}: columns in degrees and in radians", "set joint_log.unit"
            )
        if self.table.style == "KUKA":
            return "deg", KUKA_UNIT
        return "rad", "nothing says degrees"

    @cached_property
    def stamp_unit(self) -> str:
        """Unit of the stamps: the rig's, the one in the column's name, or seconds."""
        if self.options.stamp_unit != "auto":
            return self.options.stamp_unit
        return self.table.stamp.unit if self.table.stamp.unit in STAMP_UNITS else "s"

    @cached_property
    def stamps_ns(self) -> Stamps:
        """(N,) stamps on the sensors' clock.

        Raises:
            RecordingError: Not a number, or not increasing.
        """
        table, power = self.table, STAMP_UNITS[self.stamp_unit]
        offset = round(Decimal(str(self.options.epoch_s)).scaleb(9))
        stamps = np.empty(len(table.rows), np.int64)
        for i, row in enumerate(table.rows):
            try:
                stamp = round(Decimal(str(row[0])).scaleb(power))
            except (DecimalException, ValueError, OverflowError) as error:
                raise RecordingError(
                    f"{table.where(i)}: stamp {row[0]!r} is not a number", "remove it"
                ) from error
            if abs(stamp) > FAR_FUTURE_NS:
                raise RecordingError(
                    f"{table.where(i)}: stamp {row[0]} would be the year 5000 in {self.stamp_unit}",
                    "set joint_log.stamp_unit in the rig: s, ms, us or ns",
                )
            stamps[i] = stamp + offset
        steps = np.diff(stamps)
        if len(wrong := np.flatnonzero(steps <= 0)):
            i = int(wrong[0])
            what = f"goes back by {-steps[i] * 1e-9:.6g} s" if steps[i] else "is there twice"
            raise RecordingError(
                f"{table.where(i + 1)}: stamp {table.rows[i + 1][0]} {what}",
                "sort the log by its stamps, each once",
            )
        return stamps

    def samples(self, arm: Arm | None = None) -> Samples:
        """All samples, in the arm's joint order where there is an arm.

        Raises:
            RecordingError: Stamps or positions that are no numbers; positions outside the arm's
                limits, as degrees read as radians are.
            ArmError: Joints of the arm are missing.
        """
        chosen = self._chosen(arm)
        cells = [[row[1 + i] for i in chosen] for row in self.table.rows]
        try:
            positions = np.array(cells, dtype=str).astype(np.float64)
        except ValueError:
            positions = np.array([[_number(cell) for cell in row] for row in cells])
        if len(wrong := np.argwhere(~np.isfinite(positions))):
            row, i = (int(k) for k in wrong[0])
            raise RecordingError(
                f"{self.table.where(row)}: {self.names[chosen[i]]} is {cells[row][i]!r}",
                "remove the line, or mend it",
            )
        if self.unit[0] == "deg":
            positions = np.deg2rad(positions)
        if arm is not None:
            self._check_limits(arm, positions)
        return Samples(self.stamps_ns, positions)

    def _chosen(self, arm: Arm | None) -> list[int]:
        table, names = self.table, self.names
        if arm is None:
            every = range(len(names))
            numbers = [i for i in every if np.isfinite(_number(table.rows[0][1 + i]))]
            return numbers if table.style == "names" else [*every]
        if not table.named:
            if len(names) != len(arm.joint_names):
                raise ArmError(
                    f"{table.path}: {len(names)} joints ({_listed(table.joints)}), "
                    f"{arm.urdf.stem} has {len(arm.joint_names)}",
                    "is this the right arm model? Or name the columns in the rig "
                    "(joint_log.columns)",
                )
            return [*range(len(names))]
        index = {c.written: i for i, c in enumerate(table.joints)}
        index |= {name: i for i, name in enumerate(names)}
        if missing := [name for name in arm.joint_names if name not in index]:
            raise ArmError(
                f"{table.path} lacks {', '.join(missing)}; it has {_listed(table.joints)}",
                "name the columns of the joints in the rig (joint_log.columns)",
            )
        return [index[name] for name in arm.joint_names]

    def _check_limits(self, arm: Arm, positions: Array) -> None:
        extremes = np.concatenate([positions.argmin(axis=0), positions.argmax(axis=0)])
        for row in np.unique(extremes):
            try:
                arm.check_limits(positions[row])
            except ArmError as error:
                unit, reason = self.unit
                other = "deg" if unit == "rad" else "rad"
                raise RecordingError(
                    f"{self.table.where(row)}: {error.message}, read in {unit} ({reason})",
                    f"set joint_log.unit: {other} in the rig, or is {arm.urdf.stem} the right arm "
                    "model?",
                ) from error

    def check_clock(self, sensors_ns: Stamps) -> None:
        """Refuse a log of another time: a controller's clock often counts from power-up.

        Args:
            sensors_ns: Stamps of scans and images.

        Raises:
            RecordingError: The log ends before they begin, or begins after they end.
        """
        if not len(sensors_ns):
            return
        first, last = int(sensors_ns.min()), int(sensors_ns.max())
        begin, end = int(self.stamps_ns[0]), int(self.stamps_ns[-1])
        if begin <= last and first <= end:
            return
        raise RecordingError(
            f"{self.table.path}: its stamps, {begin * 1e-9:.3f} to {end * 1e-9:.3f} s, are not of "
            f"the time of scans and images, {first * 1e-9:.3f} to {last * 1e-9:.3f} s",
            "set joint_log.epoch_s in the rig: the sensors' time at the log's 0, in seconds",
        )

    @property
    def note(self) -> str:
        """What a user should look at: angles that are degrees by rule and look like radians."""
        if self.unit != ("deg", KUKA_UNIT):
            return ""
        largest = np.rad2deg(np.abs(self.samples().positions).max())
        if largest > 2 * np.pi:
            return ""
        return (
            f"{self.table.path}: no joint is beyond {largest:.2f} deg: if these are radians set "
            "joint_log.unit: rad in the rig"
        )

    def describe(self) -> str:
        """One line: style, columns, units and what says so."""
        table, (unit, reason) = self.table, self.unit
        styles = {"names": "columns by name", "columns": "columns of the rig", "JSON": "JSON"}
        style = styles.get(table.style, f"{table.style} columns")
        return (
            f"{table.path.name}: {len(table.rows)} samples, {style} ({_listed(table.joints)}), "
            f"angles in {unit} ({reason}), stamps {table.stamp.written} in {self.stamp_unit}, "
            f"counted from {self.options.epoch_s:.6f} s"
        )


def find_joint_log(recording: Path, rig: Rig | None = None) -> Path | None:
    """The joint log of a recording; None without one.

    The rig's `joint_log.file`, with `{recording}` for the recording's name; else
    `NAME.joints.json` or `NAME.joints.csv` beside the recording, or `joints.json` or `joints.csv`
    inside its folder.

    Raises:
        RecordingError: The rig's is not there, or there are two.
    """
    from lcdata.recording.source import scenario_name

    if rig is not None and rig.ground_truth == "static":
        return None
    name = scenario_name(recording)
    if rig is not None and rig.joint_log is not None and rig.joint_log.file:
        named = (rig.folder or Path()) / rig.joint_log.file.replace("{recording}", name)
        if not named.is_file():
            raise RecordingError(f"no joint log {named}", "correct joint_log.file in the rig")
        return named
    places = [recording.parent / f"{name}.joints{suffix}" for suffix in SUFFIXES]
    if recording.is_dir():
        places += [recording / f"joints{suffix}" for suffix in SUFFIXES]
    found = [place for place in places if place.is_file()]
    if len(found) > 1:
        raise RecordingError(
            f"{found[0]} and {found[1]} are both joint logs of {recording}",
            "remove one, or name one in the rig (joint_log.file)",
        )
    return found[0] if found else None


def open_joint_log(recording: Path, rig: Rig | None = None) -> JointLog | None:
    """Read the joint log of a recording; None without one.

    Raises:
        RecordingError: It is not there, or cannot be read.
    """
    from lcdata.rig_joint_log import JointLogSection

    path = find_joint_log(recording, rig)
    options = (rig.joint_log if rig else None) or JointLogSection()
    if path is not None:
        return JointLog(read_table(path, options), options)
    if rig is not None and rig.joint_log is not None and rig.ground_truth == "arm":
        raise RecordingError(
            f"no joint log beside {recording}", "name it in the rig (joint_log.file)"
        )
    return None


def _number(cell: Any) -> float:
    try:
        return float(cell)
    except (TypeError, ValueError):
        return float("nan")


def _listed(columns: tuple[Column, ...]) -> str:
    written = [column.written for column in columns]
    return ", ".join(written if len(written) <= 9 else [*written[:8], "..."])
