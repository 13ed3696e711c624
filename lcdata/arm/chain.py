"""A serial arm as plain arrays: fixed links and joints that all turn about (or slide along) z.

A joint about any axis a is one about z between two fixed rotations, B(a) Rz B(a)^T, and these are
taken into the links. So forward kinematics is one short formula that runs on stacks of joint
positions, in NumPy here and compiled in `arm.kernels`:

    T_base_effector = links[0] J(q_0) links[1] J(q_1) ... links[n]
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lcdata.errors import ArmError
from lcdata.geometry import se3

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Chain:
    """Fixed links and joints between two frames.

    Args:
        links: (n + 1, 4, 4); link k maps from the frame after joint k to the one before it,
            joint 0 being the base.
        slides: (n,) bool, true where a joint is prismatic.
    """

    links: Array
    slides: NDArray[np.bool_]

    def frames(self, positions: ArrayLike, twists: Array | None = None) -> tuple[Array, Array]:
        """Poses in the base frame of every joint and of the effector.

        Args:
            positions: (N, n) rad or m, offsets included.
            twists: (n + 1, 6) m and rad, left perturbations of `links`.

        Returns:
            (N, n + 1, 4, 4) frames before the motion of each joint, the last one the effector's,
            and (N, n + 1, 4, 4) frames that link k is fixed to, link 0 to the base.
        """
        q = np.asarray(positions, float)
        n = len(self.slides)
        before, fixed = np.empty((2, len(q), n + 1, 4, 4))
        T: Array = np.broadcast_to(np.eye(4), (len(q), 4, 4))
        for k, link in enumerate(self.links):
            fixed[:, k] = T
            T = T @ (link if twists is None else se3.exp(twists[k]) @ link)
            before[:, k] = T
            if k < n:
                T = T @ _motion(q[:, k], bool(self.slides[k]))
        return before, fixed

    def forward(self, positions: ArrayLike) -> Array:
        """(N, 4, 4) `T_base_effector` of (N, n) joint positions, offsets included."""
        return self.frames(positions)[0][:, -1]

    def jacobians(self, positions: ArrayLike) -> tuple[Array, Array]:
        """Effector poses and their Jacobians, as `Arm.jacobian` defines them.

        Args:
            positions: (N, n) rad or m, offsets included.

        Returns:
            (N, 4, 4) `T_base_effector` and (N, 6, n) Jacobians in the effector's own axes,
            translation then rotation.
        """
        before, _ = self.frames(positions)
        effector, axes = before[:, -1], before[:, :-1, :3, 2]
        arms = effector[:, None, :3, 3] - before[:, :-1, :3, 3]
        slides = self.slides[:, None]
        linear = np.where(slides, axes, np.cross(axes, arms))
        angular = np.where(slides, 0.0, axes)
        R = effector[:, :3, :3]
        return effector, np.concatenate(
            [np.einsum("nji,nkj->nik", R, part) for part in (linear, angular)], axis=1
        )


def _motion(values: Array, slides: bool) -> Array:
    motion = np.zeros((len(values), 4, 4))
    motion[:] = np.eye(4)
    if slides:
        motion[:, 2, 3] = values
    else:
        cosine, sine = np.cos(values), np.sin(values)
        motion[:, 0, 0] = motion[:, 1, 1] = cosine
        motion[:, 0, 1], motion[:, 1, 0] = -sine, sine
    return motion


def chain_of(model: Any, joints: Sequence[str], base: int, effector: int) -> Chain:
    """Chain of a Pinocchio model between two of its frames.

    Args:
        model: Pinocchio model.
        joints: Names of the joints from base to effector.
        base: Frame id of the base.
        effector: Frame id of the effector.

    Raises:
        ArmError: A joint that neither turns about nor slides along one axis.
    """
    links = [se3.inverse(model.frames[base].placement.homogeneous)]
    slides = []
    for name in joints:
        joint_id = model.getJointId(name)
        axis, slide = _axis(model.joints[joint_id], name)
        to_axis = _rotation_of_z_to(axis)
        links[-1] = links[-1] @ model.jointPlacements[joint_id].homogeneous @ to_axis
        links.append(to_axis.T)
        slides.append(slide)
    links[-1] = links[-1] @ model.frames[effector].placement.homogeneous
    return Chain(np.array(links), np.array(slides, bool))


def _axis(joint: Any, name: str) -> tuple[Array, bool]:
    """Axis of a joint in its own frame, and whether it slides along it."""
    data = joint.createData()
    q = np.array([1.0, 0.0]) if joint.nq == 2 else np.zeros(joint.nq)
    joint.calc(data, q)
    motion = np.asarray(data.S, float).reshape(6, -1)
    if motion.shape[1] != 1:
        raise ArmError(
            f"{name} is a {joint.shortname()} with {motion.shape[1]} degrees of freedom",
            "use revolute, continuous and prismatic joints",
        )
    linear, angular = motion[:3, 0], motion[3:, 0]
    slide = not angular.any()
    return (linear if slide else angular), slide


def _rotation_of_z_to(axis: Array) -> Array:
    """4x4 rotation that maps z to a unit axis; the identity if it is z."""
    T = np.eye(4)
    if not np.array_equal(axis, [0.0, 0.0, 1.0]):
        helper = np.eye(3)[int(np.argmin(np.abs(axis)))]
        x = np.cross(helper, axis)
        x /= np.linalg.norm(x)
        T[:3, :3] = np.column_stack([x, np.cross(axis, x), axis])
    return T
