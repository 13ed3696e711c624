"""Offset between the clocks of arm and camera, from what images show of the arm's motion.

Between neighbouring images of a moving arm the camera turns by what tracked points say
(`image_motion`), and by what the forward kinematics say of the joints at the images' stamps. The
offset is what lets both agree as the arm speeds up and slows down. An error of the camera's mount
or of the joints' zero points scales with the speed, not with its change; they are solved for
beside it, held by the rig's standard deviations.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from lcdata.errors import GroundTruthError, MessageError, MotionError
from lcdata.geometry import se3
from lcdata.geometry.camera import Camera
from lcdata.recording.image_motion import Turn, gray, turn
from lcdata.recording.joint_path import JointPath
from lcdata.recording.messages import Image
from lcdata.recording.source import Recording
from lcdata.recording.survey import Survey
from lcdata.recording.topics import Topics

if TYPE_CHECKING:
    from lcdata.arm import Arm
    from lcdata.rig import Rig

Array = NDArray[np.float64]
Stamps = NDArray[np.int64]

FARTHEST_NS = 250_000_000
"""Images farther apart show too little of the same."""

RANGE_S, STEP_S = 1.0, 0.02
"""Offsets that are looked for, and how finely before they are refined."""

FEW = 6
"""Fewer turns than this are no measurement."""

KINEMATICS_RAD = np.deg2rad(0.02)
"""What the arm's motion between two images is wrong by anyway: encoders, sagging, vibration."""

LOOSE_RAD = np.deg2rad(1.0)
"""How well a camera is mounted of which the rig does not say."""

LARGEST_STD_S = 0.05
"""Less certain offsets are none."""

IMAGES = 48
"""So many images tell the offset to a millisecond and are decoded within a second."""

PLAUSIBLE_RAD = np.deg2rad(0.5)
"""Turns that differ by more at the best offset are not those of this arm."""

MEDIAN_CHI_3 = 1.538
"""Median length of three standard normal numbers."""


@dataclass(frozen=True)
class ClockOffset:
    """Clock of the arm minus clock of the camera.

    Args:
        offset_s: Seconds to add to an image's stamp for the joints' stamp of the same time.
        std_s: Its standard deviation.
        moving: Images in motion that were used.
        still: Images in dwells that were used.
        failed: Images that were of no use, or did not fit.
        source: What they were held against: `motion` of the images themselves, or `scans`.
    """

    offset_s: float
    std_s: float
    moving: int
    still: int
    failed: int
    source: str = "motion"

    @property
    def significant(self) -> bool:
        """Whether it is more than three standard deviations from none."""
        return abs(self.offset_s) > 3 * self.std_s

    def __str__(self) -> str:
        return f"{1e3 * self.offset_s:+.1f} +- {1e3 * self.std_s:.1f} ms"


def motion_offset(
    recording: Recording,
    topics: Topics,
    surveyed: Survey,
    arm: Arm,
    rig: Rig,
    *,
    images: int = IMAGES,
) -> ClockOffset:
    """Offset between arm and camera clock from the first motions of a recording.

    Args:
        recording: Open; it is read up to the last image that is used.
        topics: Its topics.
        surveyed: Its stamps and joint positions.
        arm: The rig's arm.
        rig: Hand-measured links and their standard deviations.
        images: At most so many are decoded.

    Raises:
        GroundTruthError: No camera, too few neighbouring images of the moving arm, or images that
            show too little.
        MotionError: A motion that is not the arm's, as with a camera mounted otherwise than the
            rig says.
        GeometryError: A camera that is none.
    """
    if rig.T_camera_effector is None:
        raise GroundTruthError(f"{recording.path} is of a rig without an arm", "it has one clock")
    path = JointPath.of(surveyed)
    stamps = path.images(surveyed.image_ns, images)
    neighbours = np.array([(a, b) for a, b in pairwise(stamps) if b - a <= FARTHEST_NS], np.int64)
    if len(neighbours) < FEW:
        raise GroundTruthError(
            f"{recording.path}: {len(neighbours)} pairs of neighbouring images of the moving arm, "
            f"{FEW} are needed",
            "record images while the arm moves, 5 a second or more",
        )
    camera = rig.camera_model()
    if camera is None and surveyed.camera_info is not None:
        camera = surveyed.camera_info.camera()
    if camera is None:
        raise GroundTruthError(f"{recording.path}: no camera info", "give the camera in the rig")
    model = _Model(path, arm, rig.T_camera_effector.T, neighbours)
    turns = _turns(recording, topics.image, camera, neighbours, model.predict()[:, :3, 3])
    seen = [i for i, one in enumerate(turns) if one is not None]
    if len(seen) < FEW:
        raise GroundTruthError(
            f"{recording.path}: {len(seen)} of {len(neighbours)} pairs of neighbouring images show "
            f"how the camera turned, {FEW} are needed",
            "record where there is something to see, with a short exposure",
        )
    found = _fit(replace(model, stamps=neighbours[seen]), [t for t in turns if t], _stds(rig))
    if found is None:
        raise MotionError(
            f"{recording.path}: what the images show is not the motion of the joints, whatever the "
            f"offset between arm and camera clock (up to {RANGE_S:g} s was tried)",
            "is T_camera_effector right, is this the camera on the arm, and the right arm model?",
        )
    offset, std, used = found
    if std > LARGEST_STD_S:
        raise GroundTruthError(
            f"{recording.path}: the images of the moving arm say nothing of the offset between arm "
            f"and camera clock (+-{1e3 * std:.0f} ms)",
            "move the arm faster between its poses",
        )
    return ClockOffset(offset, std, used, 0, len(neighbours) - used)


@dataclass(frozen=True, eq=False)
class _Model:
    """How the camera moves between neighbouring images, by the joints.

    Args:
        path: Of the joints.
        arm: Its kinematics.
        X: 4x4 T_camera_effector.
        stamps: (N, 2) of the images, ns.
    """

    path: JointPath
    arm: Arm
    X: Array
    stamps: Stamps

    def predict(self, state: Array | None = None) -> Array:
        """(N, 4, 4) maps points in the first camera's frame to the second's.

        Args:
            state: Clock offset (s), twist of the camera's mount about its axes (3, rad), joint
                offsets (n, rad); all zero for None.
        """
        n = self.path.positions.shape[1]
        state = np.zeros(4 + n) if state is None else state
        seconds = (self.stamps - self.path.start_ns) * 1e-9 + state[0]
        q = self.arm.with_offsets(self.path.at(seconds).reshape(-1, n)) + state[4:]
        T_base_effector = self.arm.chain().forward(q).reshape(-1, 2, 4, 4)
        X = se3.exp(np.concatenate([np.zeros(3), state[1:4]])) @ self.X
        T_base_camera = T_base_effector @ se3.inverse(X)
        return np.asarray(se3.inverse(T_base_camera[:, 1]) @ T_base_camera[:, 0])

    def residuals(self, state: Array, turns: Array) -> Array:
        """(N, 3) rotation vectors from the predicted turns to those seen, (N, 3, 3)."""
        from scipy.spatial.transform import Rotation

        predicted = self.predict(state)[:, :3, :3]
        return np.asarray(Rotation.from_matrix(turns @ predicted.swapaxes(1, 2)).as_rotvec())


def _turns(
    recording: Recording, topic: str, camera: Camera, neighbours: Stamps, travel: Array
) -> list[Turn | None]:
    """What each pair of neighbouring images shows; None where it cannot be told."""
    wanted = set(neighbours.ravel().tolist())
    pictures: dict[int, tuple[NDArray[np.uint8], int]] = {}
    for _, message in recording.messages([topic], lambda _, stamp: stamp in wanted):
        if isinstance(message, Image) and (message.width, message.height) == (
            camera.width,
            camera.height,
        ):
            try:
                pictures[message.stamp_ns] = gray(message.decode())
            except MessageError:
                continue
        if len(pictures) == len(wanted):
            break
    return [
        turn(pictures[a], pictures[b], camera, t) if a in pictures and b in pictures else None
        for (a, b), t in zip(neighbours.tolist(), travel, strict=True)
    ]


def _stds(rig: Rig) -> Array:
    """Of clock, camera mount and joint offsets (one number for all), before images are seen."""
    mount = np.sqrt(np.diag(rig.covariance_of_links())[3:6])
    mount = np.where(np.isfinite(mount), np.maximum(mount, 1e-4), LOOSE_RAD)
    return np.array([RANGE_S, *mount, max(np.deg2rad(rig.arm.joint_offset_std_deg), 1e-4)])


def _fit(model: _Model, turns: Sequence[Turn], stds: Array) -> tuple[float, float, int] | None:
    """Offset, its standard deviation and how many turns agree; None if most do not.

    Each turn's residual is weighted by its covariance. What is left over after the fit counts as
    noise of all of them.
    """
    R = np.array([one.R for one in turns])
    covariances = np.array([one.covariance for one in turns]) + KINEMATICS_RAD**2 * np.eye(3)
    whiten = np.linalg.inv(np.linalg.cholesky(covariances))
    n = model.path.positions.shape[1]
    stds = np.concatenate([stds[:4], np.full(n, stds[4])])

    def whitened(state: Array) -> Array:
        return np.asarray(np.einsum("nij,nj->ni", whiten, model.residuals(state, R)))

    grid = np.arange(-RANGE_S, RANGE_S + STEP_S / 2, STEP_S)
    starts = np.zeros((len(grid), 4 + n))
    starts[:, 0] = grid
    distances = np.array([np.linalg.norm(whitened(start), axis=1) for start in starts])
    scale = max(float(np.median(distances.min(axis=0))), 1.0)
    state = starts[int(np.argmin(np.log1p((distances / (3 * scale)) ** 2).sum(axis=1)))]
    steps = np.diag(np.full(len(state), 1e-4))
    for _ in range(20):
        r = whitened(state)
        J = np.stack([(whitened(state + s) - whitened(state - s)) / 2e-4 for s in steps], axis=2)
        distance = np.linalg.norm(r, axis=1)
        scale = max(float(np.median(distance)) / MEDIAN_CHI_3, 1.0)
        weights = 1 / (1 + (distance / (3 * scale)) ** 2) ** 2 / scale**2
        H = np.einsum("n,nik,nil->kl", weights, J, J) + np.diag(stds**-2)
        step = -np.linalg.solve(H, np.einsum("n,nik,ni->k", weights, J, r) + state / stds**2)
        state = state + step
        if abs(step[0]) < 1e-6:
            break
    used = distance < 4 * scale
    plausible = float(np.median(np.linalg.norm(model.residuals(state, R), axis=1))) < PLAUSIBLE_RAD
    if used.sum() < max(FEW, len(R) / 2) or abs(state[0]) > RANGE_S or not plausible:
        return None
    return float(state[0]), float(np.sqrt(np.linalg.inv(H)[0, 0])), int(used.sum())
