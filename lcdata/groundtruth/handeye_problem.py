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

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lcdata.arm import Arm
from lcdata.errors import GroundTruthError
from lcdata.geometry import se3
from lcdata.groundtruth.twists import adjoint_many, linearised_log_many, log_many
from lcdata.rig import Rig

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Prior:
    """The two links as measured by hand.

    Args:
        T_camera_effector: 4x4.
        T_base_lidar: 4x4.
        covariance_camera_effector: 6x6, translation (m) then rotation (rad), left perturbation.
        covariance_base_lidar: 6x6, the same.
    """

    T_camera_effector: Array
    T_base_lidar: Array
    covariance_camera_effector: Array
    covariance_base_lidar: Array

    @classmethod
    def of_rig(cls, rig: Rig) -> Prior:
        """The links of a rig file with their standard deviations.

        Raises:
            GroundTruthError: A link is missing or has no standard deviations.
        """
        X, Z = rig.T_camera_effector, rig.T_base_lidar
        if X is None or Z is None:
            raise GroundTruthError("the rig has no T_camera_effector and T_base_lidar", "add both")
        return cls(X.T, Z.T, X.covariance, Z.covariance)


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
    """

    arm: Arm
    positions: ArrayLike
    offset_std_deg: float = 0.5
    velocities: ArrayLike | None = None
    clock_std_s: float = 0.1


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

    @property
    def extra_std(self) -> Array:
        """Prior standard deviations of the joint offsets and the clock offset."""
        if self.joints is None:
            return np.zeros(0)
        offsets = np.full(len(self.joints.arm.joint_names), np.deg2rad(self.joints.offset_std_deg))
        stds = offsets if self.joints.offset_std_deg > 0 else offsets[:0]
        return np.append(stds, [] if self.joints.velocities is None else self.joints.clock_std_s)

    def start(self, X: Array, Z: Array) -> State:
        """State with the given links and no joint or clock offset."""
        return State(X, Z, np.zeros(len(self.extra_std)))

    def motion(self, state: State) -> tuple[Array, Array]:
        """T_effector_base (N, 4, 4) of a state, and (N, 6, extra) of d log / d extra times -1."""
        if self.joints is None or not len(state.extra):
            return self.A, np.zeros((len(self.A), 6, 0))
        arm, q = self.joints.arm, self.joints.arm.with_offsets(self.joints.positions)
        n = len(arm.joint_names) if self.joints.offset_std_deg > 0 else 0
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
        size = 12 + len(state.extra)
        rows, jacobians = [state.extra / self.extra_std], [np.zeros((len(state.extra), size))]
        jacobians[0][:, 12:] = np.diag(1 / self.extra_std)
        if self.prior is not None:
            for start, T, measured, covariance in (
                (0, state.X, self.prior.T_camera_effector, self.prior.covariance_camera_effector),
                (6, state.Z, self.prior.T_base_lidar, self.prior.covariance_base_lidar),
            ):
                whiten = whitening(covariance)
                twist, Jl = linearised_log_many((T @ se3.inverse(measured))[None])
                J = np.zeros((6, size))
                J[:, start : start + 6] = whiten @ Jl[0]
                rows.append(whiten @ twist[0])
                jacobians.append(J)
        return np.concatenate(rows), np.concatenate(jacobians)


def whitening(covariance: Array) -> Array:
    """W^(-1/2) of (..., 6, 6) covariances: whitened residuals have unit covariance."""
    return np.asarray(np.linalg.inv(np.linalg.cholesky(covariance)))
