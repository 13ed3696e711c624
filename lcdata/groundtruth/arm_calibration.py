"""Joint offsets of one arm, from encoder readings with a ball in fixed sockets.

Protocol of the held-out figures: each place of the tool is left out in turn; the ball's place and
the offsets are fitted to the other places; each socket of the left-out place is put at the mean of
its readings, and the distances from it are gathered over all places. Every reading as recorded
counts, also of sockets that moved: those are only kept from misleading the fit.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import yaml
from numpy.typing import NDArray

from lcdata.arm import Arm
from lcdata.errors import ArmError, GroundTruthError
from lcdata.groundtruth.ball_in_socket import BallFit, Model, fit
from lcdata.groundtruth.sockets import Socket, read_sockets

Array = NDArray[np.float64]

__all__ = ["ArmCalibration", "Socket", "calibrate_arm", "read_sockets"]

LINK_STD = (1e-3, np.deg2rad(0.1))
"""Prior standard deviations of a link's place (m) and direction (rad)."""

DISTANCE_STD_M = 5e-4
"""Of the known distance between two sockets: a drilled plate."""

STEP = 2.5
"""A socket moved if its readings make one step of so many times the scatter that is left."""

STEP_READINGS = 3
"""Readings on either side of such a step."""


@dataclass(frozen=True, eq=False)
class ArmCalibration:
    """Joint offsets of one arm and what they are worth.

    Args:
        arm: The arm with the offsets.
        covariance: (n, n) of the offsets, rad^2: of the fit, or of leaving places of the tool
            out where that says more.
        ball: (3,) the ball in the effector frame, m.
        link_twists: (n + 1, 6) twists of the links, m and rad, where they were asked for.
        undetermined: What the readings do not determine; its value is the prior's.
        moved: Sockets that moved while they were measured.
        readings: Number of readings.
        nominal_rms_mm: Scatter with no more than the ball's place fitted.
        fitted_rms_mm: Scatter with everything fitted.
        heldout_nominal_rms_mm: As nominal, held out by place of the tool; NaN with one place.
        heldout_rms_mm: As fitted, held out by place of the tool; NaN with one place.
        heldout_max_mm: The largest distance among those.
        heldout_steady_rms_mm: The same scatter about each of a moved socket's two places.
        socket_distance_mm: Mean distance between neighbouring sockets, each place of the tool by
            the fit to the others; NaN where no place has several sockets.
    """

    arm: Arm
    covariance: Array
    ball: Array
    link_twists: Array | None
    undetermined: tuple[str, ...]
    moved: tuple[str, ...]
    readings: int
    nominal_rms_mm: float
    fitted_rms_mm: float
    heldout_nominal_rms_mm: float
    heldout_rms_mm: float
    heldout_max_mm: float
    heldout_steady_rms_mm: float
    socket_distance_mm: float

    @property
    def offsets_deg(self) -> dict[str, float]:
        """Degrees to add to each joint's reading."""
        return {
            name: float(np.rad2deg(self.arm.joint_offsets[name])) for name in self.arm.joint_names
        }

    @property
    def offsets_std_deg(self) -> dict[str, float]:
        """Their standard deviations in degrees."""
        std = np.rad2deg(np.sqrt(np.diag(self.covariance)))
        return {name: float(s) for name, s in zip(self.arm.joint_names, std, strict=True)}

    def to_dict(self) -> dict[str, object]:
        """Plain values, as JSON takes them; None where a figure does not exist."""
        figures = {
            name: getattr(self, name) if np.isfinite(getattr(self, name)) else None
            for name in self.__dataclass_fields__
            if name.endswith("_mm")
        }
        return {
            **figures,
            "readings": self.readings,
            "offsets_deg": self.offsets_deg,
            "offsets_std_deg": self.offsets_std_deg,
            "undetermined": list(self.undetermined),
            "moved": list(self.moved),
        }

    def offsets_yaml(self, serial: str) -> str:
        """The per-serial file that `arm: {joint_offsets: FILE}` of a rig names."""
        content = {
            "serial": serial,
            "model": self.arm.urdf.stem,
            "model_sha256": self.arm.sha256,
            "offsets_deg": {k: round(v, 4) for k, v in self.offsets_deg.items()},
            "offsets_std_deg": {k: round(v, 4) for k, v in self.offsets_std_deg.items()},
            "offsets_covariance_deg2": [
                [float(f"{x:.6g}") for x in row] for row in np.rad2deg(np.rad2deg(self.covariance))
            ],
            "undetermined": list(self.undetermined),
            "readings": self.readings,
            "heldout_rms_mm": self.to_dict()["heldout_rms_mm"],
        }
        return (
            "# Joint offsets from ball-in-socket readings (`lcdata arm calibrate`), added to the\n"
            "# encoders' readings before forward kinematics.\n"
            + yaml.safe_dump(content, sort_keys=False, default_flow_style=None)
        )


def calibrate_arm(
    arm: Arm,
    sockets: Sequence[Socket],
    *,
    kinematics: bool = False,
    offset_std_deg: float = 2.0,
    link_std: tuple[float, float] = LINK_STD,
    socket_distance_m: float | None = 0.05,
) -> ArmCalibration:
    """Joint offsets from ball-in-socket readings.

    Args:
        arm: Arm; joint offsets that it has already are the prior's mean.
        sockets: Readings, see `read_sockets`.
        kinematics: Fit a small twist of each link as well.
        offset_std_deg: Prior standard deviation of a joint's offset.
        link_std: Prior standard deviations of a link, m and rad.
        socket_distance_m: Known distance between `hole_0` and `hole_1` of one tool; None if it is
            not known.

    Raises:
        ArmError: A reading outside the joint limits, naming it.
        GroundTruthError: Too few readings.
    """
    sockets = tuple(s for s in sockets if len(s.positions))
    _check(arm, sockets, len(arm.joint_names) + 3)
    offset_std = np.deg2rad(offset_std_deg)
    model = Model(arm, offset_std, link_std if kinematics else None)
    nominal = Model(arm, 0.0)
    found, segments, moved = _fit(model, sockets, socket_distance_m)
    tools = sorted({s.tool for s in sockets})
    held: dict[str, list[Array]] = {"nominal": [], "fitted": [], "steady": []}
    apart, left_out = [], []
    for tool in tools if len(tools) > 1 else ():
        train = [s for s in sockets if s.tool != tool]
        test = [s for s in sockets if s.tool == tool]
        other, _, _ = _fit(model, train, socket_distance_m)
        left_out.append(model.offsets(other.x))
        held["nominal"].append(_scatter(nominal, fit(nominal, train).x, test))
        held["fitted"].append(_scatter(model, other.x, test))
        held["steady"].append(_scatter(model, other.x, [s for s in segments if s.tool == tool]))
        places = [model.balls(s.positions, other.x)[0].mean(axis=0) for s in test]
        apart += [float(np.linalg.norm(a - b)) for a, b in pairwise(places)]
    rms = {name: _rms_mm(values) for name, values in held.items()}
    covariance = found.covariance[3 : 3 + model.n, 3 : 3 + model.n]
    offsets = arm.with_offsets(np.zeros((1, model.n)))[0] + model.offsets(found.x)
    named = {name: float(x) for name, x in zip(arm.joint_names, offsets, strict=True)}
    return ArmCalibration(
        arm=replace(arm, joint_offsets=named),
        covariance=_at_least(covariance, np.array(left_out)),
        ball=found.x[:3],
        link_twists=model.twists(found.x) if kinematics else None,
        undetermined=_undetermined(model, found),
        moved=moved,
        readings=sum(len(s.positions) for s in sockets),
        nominal_rms_mm=_rms_mm([_scatter(nominal, fit(nominal, sockets).x, sockets)]),
        fitted_rms_mm=_rms_mm([_scatter(model, found.x, sockets)]),
        heldout_nominal_rms_mm=rms["nominal"],
        heldout_rms_mm=rms["fitted"],
        heldout_max_mm=1e3 * float(np.max(np.concatenate(held["fitted"] or [np.array([np.nan])]))),
        heldout_steady_rms_mm=rms["steady"],
        socket_distance_mm=1e3 * float(np.mean(apart)) if apart else float("nan"),
    )


def _check(arm: Arm, sockets: Sequence[Socket], unknowns: int) -> None:
    for socket in sockets:
        if socket.positions.shape[1:] != (len(arm.joint_names),):
            raise GroundTruthError(
                f"{socket}: readings of shape {socket.positions.shape}",
                f"give (N, {len(arm.joint_names)}): {', '.join(arm.joint_names)}",
            )
        for i, row in enumerate(socket.positions):
            try:
                arm.check_limits(row)
            except ArmError as error:
                raise ArmError(
                    f"{socket} reading {i + 1}: {error.message}", error.remedy
                ) from error
    readings = sum(len(s.positions) for s in sockets)
    if 3 * (readings - len(sockets)) <= unknowns:
        raise GroundTruthError(
            f"{readings} readings in {len(sockets)} sockets cannot determine {unknowns} unknowns",
            "move the arm around each socket for ten readings or more",
        )


def _fit(
    model: Model, sockets: Sequence[Socket], distance: float | None
) -> tuple[BallFit, tuple[Socket, ...], tuple[str, ...]]:
    """Fit, with each socket that moved taken as two; those, and their names."""
    first = fit(model, sockets)
    segments: list[Socket] = []
    moved, moved_tools = [], set()
    for socket in sockets:
        at, step, scatter = _largest_step(model.balls(socket.positions, first.x)[0])
        if step > STEP * scatter:
            moved.append(f"{socket} after reading {at}: {1e3 * step:.1f} mm")
            moved_tools.add(socket.tool)
            segments += [
                replace(socket, positions=socket.positions[:at]),
                replace(socket, positions=socket.positions[at:]),
            ]
        else:
            segments.append(socket)
    index = {(s.tool, s.name): i for i, s in enumerate(segments)}
    pairs = [
        (i, index[tool, "hole_1"])
        for (tool, name), i in index.items()
        if name == "hole_0" and (tool, "hole_1") in index and tool not in moved_tools
    ]
    if not moved and (distance is None or not pairs):
        return first, tuple(segments), ()
    found = fit(model, segments, pairs if distance else (), (distance or 1.0, DISTANCE_STD_M))
    return found, tuple(segments), tuple(moved)


def _largest_step(balls: Array) -> tuple[int, float, float]:
    """Where one step explains most of the scatter, its length, and the RMS that is left (m)."""
    best = (0, 0.0, np.inf)
    for at in range(STEP_READINGS, len(balls) - STEP_READINGS + 1):
        parts = balls[:at], balls[at:]
        left = sum(float(np.square(p - p.mean(axis=0)).sum()) for p in parts)
        rms = float(np.sqrt(left / len(balls)))
        if rms < best[2]:
            best = at, float(np.linalg.norm(parts[0].mean(axis=0) - parts[1].mean(axis=0))), rms
    return best


def _scatter(model: Model, x: Array, sockets: Sequence[Socket]) -> Array:
    """Distances of all readings from their socket's mean, m."""
    balls = [model.balls(s.positions, x)[0] for s in sockets]
    return np.concatenate([np.linalg.norm(b - b.mean(axis=0), axis=1) for b in balls])


def _rms_mm(distances: list[Array]) -> float:
    if not distances:
        return float("nan")
    return 1e3 * float(np.sqrt(np.square(np.concatenate(distances)).mean()))


def _at_least(covariance: Array, left_out: Array) -> Array:
    """The covariance of the fit, raised where leaving out a place of the tool moves it more.

    What offsets cannot explain is the same in neighbouring readings, so they are not as many
    independent ones as the fit believes; the jackknife over places of the tool sees that.
    """
    count = len(left_out)
    if count < 3:
        return covariance
    apart = left_out - left_out.mean(axis=0)
    jackknife = (count - 1) / count * apart.T @ apart
    root = np.linalg.cholesky(covariance)
    inverse = np.linalg.inv(root)
    values, vectors = np.linalg.eigh(inverse @ jackknife @ inverse.T)
    raised = root @ vectors
    return np.asarray(raised * np.maximum(values, 1.0) @ raised.T)


def _undetermined(model: Model, found: BallFit) -> tuple[str, ...]:
    """What keeps more than 70 % of the prior's standard deviation."""
    open_ends = np.sqrt(np.diag(found.covariance)) > 0.7 * model.std
    joints = model.arm.joint_names
    names = [f"ball along {axis} of the effector" for axis in "xyz"]
    names += [f"offset of {name}" for name in joints]
    if model.link_std:
        names += [f"link before {name}" for name in joints[1:] for _ in range(6)]
    axes = [""] * (3 + len(joints)) + [" x", " y", " z", " rx", " ry", " rz"] * (len(joints) - 1)
    grouped: dict[str, str] = {}
    for name, axis, is_open in zip(names, axes, open_ends, strict=False):
        if is_open:
            grouped[name] = grouped.get(name, "") + axis
    return tuple(name + axis for name, axis in grouped.items())
