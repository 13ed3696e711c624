"""URDF to Pinocchio model, forward kinematics and Jacobians of named frames."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lcdata.arm.offsets import read_offsets_file
from lcdata.arm.urdf import find_urdf
from lcdata.errors import ArmError

if TYPE_CHECKING:
    from lcdata.arm.chain import Chain

Array = NDArray[np.float64]

LIMIT_TOLERANCE_RAD = np.deg2rad(15.0)
"""Limits are those of the controller, and an arm moved by hand goes past them: the last joint of a
real Gen3 lite (149 deg) was read at 157 deg. What is farther out is another unit or arm."""

AT_LIMIT_RAD = np.deg2rad(1.0)
"""Encoders of an arm at its limit read a little beyond it."""


@dataclass(frozen=True, eq=False)
class Arm:
    """A serial arm between two named frames.

    Args:
        urdf: Path of the URDF.
        base_frame: Frame that the arm stands on, T_base_lidar's frame `base`.
        effector_frame: Frame that carries the camera, T_camera_effector's frame `effector`.
        joint_offsets: Radians added to the encoder's reading, by joint name.
        offset_covariance: (n, n) of the offsets in rad^2, in the order of `joint_names`, NaN on
            the diagonal of joints of which nothing is known; None if nothing is known of any.
        serial: Serial number that the offsets belong to; empty if it is not known.

    Raises:
        ArmError: Unreadable URDF, unknown frame, unknown joint in the offsets.
    """

    urdf: Path
    base_frame: str = "base_link"
    effector_frame: str = "end_effector_link"
    joint_offsets: dict[str, float] = field(default_factory=dict)
    offset_covariance: Array | None = None
    serial: str = ""

    model: Any = field(init=False, repr=False)
    joint_names: tuple[str, ...] = field(init=False)

    def __post_init__(self) -> None:
        import pinocchio

        try:
            model = pinocchio.buildModelFromUrdf(str(self.urdf))
        except (ValueError, RuntimeError) as error:
            raise ArmError(f"{self.urdf}: not a URDF ({_first_line(error)})") from error
        object.__setattr__(self, "model", model)
        object.__setattr__(self, "joint_names", self._joints_between())
        for name in self.joint_offsets:
            if name not in self.joint_names:
                raise ArmError(
                    f"offset for joint {name!r}, which {self.urdf.name} does not have between "
                    f"{self.base_frame} and {self.effector_frame}",
                    f"its joints are {', '.join(self.joint_names)}",
                )

    @classmethod
    def load(
        cls,
        model: str | Path = "gen3_lite",
        *,
        base_frame: str = "base_link",
        effector_frame: str = "end_effector_link",
        joint_offsets: Path | None = None,
        relative_to: Path | None = None,
        serial: str = "",
    ) -> Arm:
        """Arm by its model's name or URDF path.

        Args:
            model: See `find_urdf`.
            base_frame: Frame that the arm stands on.
            effector_frame: Frame that carries the camera.
            joint_offsets: A per-serial YAML.
            relative_to: Folder that a relative `model` starts from.
            serial: Serial number of the arm; offsets of another one are refused.

        Raises:
            ArmError: Unknown model or frame, unreadable offsets, offsets of another arm.
        """
        arm = cls(find_urdf(model, relative_to), base_frame, effector_frame, serial=serial)
        return arm.with_offsets_of(joint_offsets) if joint_offsets else arm

    def with_offsets_of(self, path: Path) -> Arm:
        """The same arm with the joint offsets of a per-serial YAML in place of its own.

        Raises:
            ArmError: Unreadable, or of another arm: model, URDF, serial or joints differ.
        """
        read = read_offsets_file(path)
        read.check(self.urdf.stem, self.sha256, self.serial)
        return replace(
            self,
            joint_offsets=read.offsets,
            offset_covariance=read.covariance_of(self.joint_names),
            serial=self.serial or read.serial,
        )

    @property
    def sha256(self) -> str:
        """Checksum of the URDF file."""
        return hashlib.sha256(self.urdf.read_bytes()).hexdigest()

    def _frame_id(self, name: str) -> int:
        if not self.model.existFrame(name):
            frames = sorted(f.name for f in self.model.frames if f.name != "universe")
            raise ArmError(
                f"{self.urdf.name} has no frame {name!r}", f"its frames are {', '.join(frames)}"
            )
        return int(self.model.getFrameId(name))

    def _joints_between(self) -> tuple[str, ...]:
        """Names of the moving joints between base and effector, base first."""
        model = self.model
        base = model.frames[self._frame_id(self.base_frame)].parentJoint
        joint = model.frames[self._frame_id(self.effector_frame)].parentJoint
        on_path: list[str] = []
        while joint not in (0, base):
            on_path.append(model.names[joint])
            joint = model.parents[joint]
        if joint != base:
            raise ArmError(
                f"{self.urdf.name}: {self.effector_frame} does not hang on {self.base_frame}",
                "choose frames of one chain",
            )
        return tuple(reversed(on_path))

    def order(self, names: Sequence[str], positions: ArrayLike) -> Array:
        """Positions in this arm's joint order.

        Args:
            names: JointState names in any order; names of other devices are ignored.
            positions: (..., len(names)) in radians.

        Returns:
            (..., n) positions of `joint_names`.

        Raises:
            ArmError: A joint of the arm is not among the names.
        """
        positions = np.asarray(positions, float)
        index = {name: i for i, name in enumerate(names)}
        missing = [name for name in self.joint_names if name not in index]
        if missing:
            raise ArmError(
                f"joint states lack {', '.join(missing)}; they have {', '.join(names) or 'none'}",
                f"{self.urdf.name} needs {', '.join(self.joint_names)}",
            )
        return np.asarray(positions[..., [index[name] for name in self.joint_names]])

    def check_limits(self, positions: ArrayLike) -> None:
        """Raise `ArmError` where a joint is far outside its limits, naming joint, value and limit.

        Args:
            positions: (n,) encoder readings in the order of `joint_names`, radians.
        """
        for text in self.outside_limits(positions, LIMIT_TOLERANCE_RAD):
            raise ArmError(
                text, "is this the right arm model, and are the joint states in radians?"
            )

    def outside_limits(
        self, positions: ArrayLike, tolerance: float = AT_LIMIT_RAD
    ) -> Iterator[str]:
        """A line for each joint outside its limits.

        Args:
            positions: (n,) encoder readings in the order of `joint_names`, radians.
            tolerance: How far beyond a limit is not worth a word, radians.

        Raises:
            ArmError: A position that is no number.
        """
        for name, value in zip(self.joint_names, np.asarray(positions, float), strict=True):
            if not np.isfinite(value):
                raise ArmError(f"{name} is at {value}", "the joint states are damaged")
            joint = self.model.joints[self.model.getJointId(name)]
            if joint.nq != 1:  # continuous
                continue
            low = self.model.lowerPositionLimit[joint.idx_q]
            high = self.model.upperPositionLimit[joint.idx_q]
            if not low - tolerance <= value <= high + tolerance:
                yield (
                    f"{name} is at {np.rad2deg(value):.2f} deg, outside its limits "
                    f"[{np.rad2deg(low):.2f}, {np.rad2deg(high):.2f}] deg"
                )

    def configuration(self, positions: ArrayLike) -> Array:
        """Pinocchio's q of joint positions, joint offsets added.

        Args:
            positions: (n,) encoder readings in the order of `joint_names`, radians.

        Returns:
            (model.nq,); a continuous joint has cosine and sine.
        """
        import pinocchio

        values = np.asarray(positions, float)
        if values.shape != (len(self.joint_names),):
            raise ArmError(
                f"{values.shape} joint positions for {len(self.joint_names)} joints",
                f"give one for each of {', '.join(self.joint_names)}",
            )
        q = pinocchio.neutral(self.model)
        for name, value in zip(self.joint_names, values, strict=True):
            angle = value + self.joint_offsets.get(name, 0.0)
            joint = self.model.joints[self.model.getJointId(name)]
            if joint.nq == 2:
                q[joint.idx_q : joint.idx_q + 2] = np.cos(angle), np.sin(angle)
            else:
                q[joint.idx_q] = angle
        return np.asarray(q)

    def forward(self, positions: ArrayLike) -> Array:
        """4x4 `T_base_effector` of (n,) joint positions in radians."""
        import pinocchio

        data = self.model.createData()
        pinocchio.framesForwardKinematics(self.model, data, self.configuration(positions))
        base = data.oMf[self._frame_id(self.base_frame)]
        effector = data.oMf[self._frame_id(self.effector_frame)]
        return np.asarray(base.actInv(effector).homogeneous)

    def jacobian(self, positions: ArrayLike) -> Array:
        """Jacobian of the effector frame in its own axes.

        `forward(q + d) == forward(q) @ exp(jacobian(q) @ d)` to first order.

        Args:
            positions: (n,) radians.

        Returns:
            (6, n): translation (m/rad), then rotation (rad/rad), in the effector frame.
        """
        import pinocchio

        data = self.model.createData()
        full = pinocchio.computeFrameJacobian(
            self.model,
            data,
            self.configuration(positions),
            self._frame_id(self.effector_frame),
            pinocchio.ReferenceFrame.LOCAL,
        )
        columns = [
            self.model.joints[self.model.getJointId(name)].idx_v for name in self.joint_names
        ]
        return np.asarray(full[:, columns])

    def chain(self) -> Chain:
        """The arm as plain arrays, which stacks of joint positions run through."""
        from lcdata.arm.chain import chain_of

        frames = self._frame_id(self.base_frame), self._frame_id(self.effector_frame)
        return chain_of(self.model, self.joint_names, *frames)

    def with_offsets(self, positions: ArrayLike) -> Array:
        """(N, n) encoder readings of `joint_names`, joint offsets added."""
        values = np.asarray(positions, float)
        if values.ndim != 2 or values.shape[1] != len(self.joint_names):
            raise ArmError(
                f"joint positions of shape {values.shape}",
                f"give (N, {len(self.joint_names)}): {', '.join(self.joint_names)}",
            )
        return values + [self.joint_offsets.get(name, 0.0) for name in self.joint_names]

    def forward_many(self, positions: ArrayLike) -> Array:
        """(N, 4, 4) `T_base_effector` of (N, n) joint positions in radians.

        Compiled: worth it from some ten thousand samples on.
        """
        from lcdata.arm import kernels

        chain = self.chain()
        return np.asarray(kernels.forward(chain.links, chain.slides, self.with_offsets(positions)))

    def covariance_many(self, positions: ArrayLike, std: ArrayLike) -> tuple[Array, Array]:
        """Effector poses of many joint positions and what the joints' errors make of them.

        Args:
            positions: (N, n) encoder readings, radians.
            std: (N, n) or (n,) standard deviations, radians.

        Returns:
            (N, 4, 4) `T_base_effector`, and (N, 6, 6) covariances J diag(std^2) J^T in the
            effector's own axes, translation then rotation.
        """
        from lcdata.arm import kernels

        chain, q = self.chain(), self.with_offsets(positions)
        variance = np.atleast_2d(np.square(np.asarray(std, float)))
        if variance.shape not in {q.shape, (1, q.shape[1])}:
            raise ArmError(
                f"standard deviations of shape {variance.shape} for positions {q.shape}",
                "give one for each joint, or one for each sample and joint",
            )
        poses, covariances = kernels.forward_covariance(
            chain.links, chain.slides, q, np.ascontiguousarray(variance)
        )
        return np.asarray(poses), np.asarray(covariances)


def read_joint_offsets(path: Path) -> dict[str, float]:
    """Joint offsets in radians of a per-serial YAML (`offsets_deg: {joint_1: 0.12, ...}`).

    Raises:
        ArmError: Not readable, or not of this form.
    """
    return read_offsets_file(path).offsets


def _first_line(error: Exception) -> str:
    return (str(error).strip().splitlines() or [type(error).__name__])[0]
