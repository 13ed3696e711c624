"""Residuals of T_camera_lidar(i) = X A_i Z and their Jacobian.

X = T_camera_effector, A_i = T_effector_base(i), Z = T_base_lidar. All perturbations are left
ones, as everywhere: X <- exp(x) X, Z <- exp(z) Z. An estimate T_i with covariance W_i says
T_true = exp(xi) T_i with xi ~ N(0, W_i), so its residual is that xi:

    r_i = log(X A_i Z T_i^-1)
    dr_i = Jl^-1(r_i) [ x + Ad(X A_i) z - Ad(X) J_i (dq + v_i dt) ]

with J_i the effector's Jacobian in its own axes, dq the joint offsets, and v_i dt what a clock
offset dt makes of joint velocities v_i.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lcdata.arm import Arm
from lcdata.errors import GroundTruthError
from lcdata.geometry import se3
from lcdata.groundtruth.twists import adjoint_many, linearised_log_many, log_many
from lcdata.rig import Rig
from lcdata.rig_links import LINKS

Array = NDArray[np.float64]

STD_FLOOR = 1e-6
"""Metres and radians: what is called exact is known to so much."""


@dataclass(frozen=True, eq=False)
class Prior:
    """The two links as measured by hand.

    Args:
        T_camera_effector: 4x4.
        T_base_lidar: 4x4.
        covariance_camera_effector: 6x6, translation (m) then rotation (rad), left perturbation.
        covariance_base_lidar: 6x6, the same.
        covariance: (12, 12) of both links, where their errors belong together, or (12 + n, 12 + n)
            with the errors (rad) of n joint offsets after them; replaces the two.
    """

    T_camera_effector: Array
    T_base_lidar: Array
    covariance_camera_effector: Array
    covariance_base_lidar: Array
    covariance: Array | None = None

    @property
    def joint(self) -> Array:
        """`covariance`, or that of two independent links."""
        if self.covariance is not None:
            return self.covariance
        result = np.zeros((LINKS, LINKS))
        result[:6, :6] = self.covariance_camera_effector
        result[6:, 6:] = self.covariance_base_lidar
        return result

    @classmethod
    def of_rig(cls, rig: Rig) -> Prior:
        """The links of a rig file with their standard deviations or their covariance.

        Raises:
            GroundTruthError: A link is missing.
        """
        X, Z = rig.T_camera_effector, rig.T_base_lidar
        if X is None or Z is None:
            raise GroundTruthError("the rig has no T_camera_effector and T_base_lidar", "add both")
        C = rig.covariance_of_links()
        together = C if rig.links_covariance is not None else None
        return cls(X.T, Z.T, C[:6, :6], C[6:12, 6:12], together)


@dataclass(frozen=True, eq=False)
class Joints:
    """Joint positions, where the arm's own errors are to be solved for as well.

    Args:
        arm: Arm model that T_effector_base was computed with.
        positions: (N, n) encoder readings of the poses, radians.
        offset_std_deg: Standard deviation of a joint's offset before the data speak; 0 leaves
            the offsets out.
        velocities: (N, n) rad/s; with them one clock offset is solved for.
        clock_std_s: Its standard deviation before the data speak.
        offset_covariance: (n, n) rad^2 in place of `offset_std_deg`, where more is known.
    """

    arm: Arm
    positions: ArrayLike
    offset_std_deg: float = 0.5
    velocities: ArrayLike | None = None
    clock_std_s: float = 0.1
    offset_covariance: Array | None = None

    @property
    def n_offsets(self) -> int:
        """How many joint offsets are solved for."""
        asked = self.offset_std_deg > 0 or self.offset_covariance is not None
        return len(self.arm.joint_names) if asked else 0


@dataclass(frozen=True, eq=False)
class State:
    """What is solved for.

    Args:
        X: 4x4 T_camera_effector.
        Z: 4x4 T_base_lidar.
        extra: Joint offsets (rad), then the clock offset (s), as far as they are asked for.
    """

    X: Array
    Z: Array
    extra: Array

    def moved(self, step: Array) -> State:
        """This state moved by (12 + extra,) left perturbations and increments."""
        return State(
            se3.exp(step[:6]) @ self.X, se3.exp(step[6:12]) @ self.Z, self.extra + step[12:]
        )


@dataclass(frozen=True, eq=False)
class Problem:
    """Poses, estimates and priors.

    Args:
        A: (N, 4, 4) T_effector_base.
        T: (N, 4, 4) estimates of T_camera_lidar.
        prior: Hand-measured links, or None.
        joints: Joint positions, or None.
    """

    A: Array
    T: Array
    prior: Prior | None = None
    joints: Joints | None = None

    def subset(self, keep: NDArray[np.intp]) -> Problem:
        """The same problem of some of its poses."""
        joints = self.joints
        if joints is not None:
            v = joints.velocities
            joints = replace(
                joints,
                positions=np.asarray(joints.positions, float)[keep],
                velocities=None if v is None else np.asarray(v, float)[keep],
            )
        return Problem(self.A[keep], self.T[keep], self.prior, joints)

    @cached_property
    def prior_covariance(self) -> Array:
        """(12 + extra, 12 + extra) before the data speak; the links' part is 0 without a prior.

        A prior of the links and the joint offsets together wins over what is known of the offsets
        alone.
        """
        offsets, clock = np.zeros((0, 0)), np.zeros(0)
        if self.joints is not None:
            n = self.joints.n_offsets
            offsets = np.eye(n) * np.deg2rad(self.joints.offset_std_deg) ** 2
            if self.joints.offset_covariance is not None:
                offsets = self.joints.offset_covariance
            if self.joints.velocities is not None:
                clock = np.array([self.joints.clock_std_s**2])
        end = LINKS + len(offsets)
        result = np.zeros((end + len(clock),) * 2)
        result[LINKS:end, LINKS:end] = offsets
        result[end:, end:] = np.diag(clock)
        if self.prior is not None:
            known = self.prior.joint[:end, :end]
            result[: len(known), : len(known)] = known
        return result + STD_FLOOR**2 * np.eye(len(result))

    @property
    def extra_std(self) -> Array:
        """Prior standard deviations of the joint offsets and the clock offset."""
        return np.asarray(np.sqrt(np.diag(self.prior_covariance)[LINKS:]))

    def start(self, X: Array, Z: Array) -> State:
        """State with the given links and no joint or clock offset."""
        return State(X, Z, np.zeros(len(self.extra_std)))

    def motion(self, state: State) -> tuple[Array, Array]:
        """T_effector_base (N, 4, 4) of a state, and (N, 6, extra) of d log / d extra times -1."""
        if self.joints is None or not len(state.extra):
            return self.A, np.zeros((len(self.A), 6, 0))
        arm, q = self.joints.arm, self.joints.arm.with_offsets(self.joints.positions)
        n = self.joints.n_offsets
        q = q + (state.extra[:n] if n else 0.0)
        velocities = self.joints.velocities
        if velocities is not None:
            q = q + np.asarray(velocities, float) * state.extra[-1]
        poses, J = arm.chain().jacobians(q)
        columns = [J] if n else []
        if velocities is not None:
            columns.append(np.einsum("nij,nj->ni", J, np.asarray(velocities, float))[:, :, None])
        return se3.inverse(poses), np.concatenate(columns, axis=2)

    def predict(self, state: State) -> Array:
        """(N, 4, 4) T_camera_lidar of a state."""
        return np.asarray(state.X @ self.motion(state)[0] @ state.Z)

    def residuals(self, state: State) -> Array:
        """(N, 6) log(X A_i Z T_i^-1)."""
        return log_many(self.predict(state) @ se3.inverse(self.T))

    def linearise(self, state: State) -> tuple[Array, Array]:
        """Residuals (N, 6) and their Jacobians (N, 6, 12 + extra)."""
        A, J = self.motion(state)
        XA = state.X @ A
        residuals, Jl = linearised_log_many(XA @ state.Z @ se3.inverse(self.T))
        return residuals, np.concatenate(
            [Jl, Jl @ adjoint_many(XA), -Jl @ se3.adjoint(state.X) @ J], axis=2
        )

    def prior_rows(self, state: State) -> tuple[Array, Array]:
        """Whitened residuals of the priors and their Jacobian."""
        size = LINKS + len(state.extra)
        twists, J = np.zeros(size), np.eye(size)
        twists[LINKS:] = state.extra
        if self.prior is not None:
            measured = np.array([self.prior.T_camera_effector, self.prior.T_base_lidar])
            moved = np.array([state.X, state.Z]) @ se3.inverse(measured)
            logs, (J[:6, :6], J[6:LINKS, 6:LINKS]) = linearised_log_many(moved)
            twists[:LINKS] = logs.ravel()
        known = slice(LINKS if self.prior is None else 0, size)
        whiten = whitening(self.prior_covariance[known, known])
        return whiten @ twists[known], whiten @ J[known]


def whitening(covariance: Array) -> Array:
    """W^(-1/2) of (..., 6, 6) covariances: whitened residuals have unit covariance."""
    return np.asarray(np.linalg.inv(np.linalg.cholesky(covariance)))
