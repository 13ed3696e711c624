"""Offset between the clocks of arm and camera of a recording, by the one way or the other.

Where the arm's motion was filmed, from the images alone (`recording.clock_offset`). Where there are
single images of the moving arm only, from the LiDAR's scans: such an image has an extrinsic of its
own, which a line method finds against a scan (the LiDAR stands still, so any scan near it will do).
The joints say where the camera was by their clock; along the arm's velocity the difference is the
clock's. Images in dwells, which no clock changes, hold the links in the same problem
(`handeye.solve` with velocities).
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lcdata.calibrators.projection import Projection
from lcdata.errors import GroundTruthError
from lcdata.geometry import se3
from lcdata.geometry.camera import Camera
from lcdata.groundtruth.handeye import Joints, Prior, solve
from lcdata.pair import Pair
from lcdata.recording import fields
from lcdata.recording.clock_offset import IMAGES, ClockOffset, motion_offset
from lcdata.recording.joint_log import open_joint_log
from lcdata.recording.messages import Cloud, Image
from lcdata.recording.source import Recording, open_recording
from lcdata.recording.survey import Survey, survey
from lcdata.recording.topics import choose_topics
from lcdata.rig import Rig

Array = NDArray[np.float64]
Stamps = NDArray[np.int64]
Progress = Callable[[str, int, int], None]

HALF_STEP_NS = 50_000_000
"""A velocity is the difference of the joints' positions so long before and after."""

MOVING_RAD_S = np.deg2rad(5.0)
"""Slower than this, an image says little of clocks: 0.05 deg are then 10 ms."""

STILL_RAD_S = np.deg2rad(0.5)
"""Slower than this is a dwell."""

SINGLE_IMAGES = 10
"""Single images to calibrate, which takes longer than to track points."""

FEW = 3
"""Fewer images in motion than this are no measurement."""


def clock_offset(
    path: Path, rig: Rig, *, images: int | None = None, progress: Progress | None = None
) -> ClockOffset:
    """Estimate the offset between the clocks of arm and camera of one recording.

    Args:
        path: A recording with images of the moving arm.
        rig: Its rig; for scans with standard deviations of the links.
        images: At most so many neighbouring ones, or so many single ones in motion and as many in
            dwells; None for as many as are worth it.
        progress: Called with stage, images done and images in all.

    Raises:
        GroundTruthError: No arm, or too few images in motion that can be used, either way.
    """
    if rig.ground_truth != "arm":
        raise GroundTruthError(f"{path} is of a rig without an arm", "there is one clock only")
    arm = rig.load_arm()
    with open_recording(path, rig.stamps, open_joint_log(path, rig)) as recording:
        topics = choose_topics(recording, rig)
        read = survey(recording, topics, arm)
        try:
            return motion_offset(recording, topics, read, arm, rig, images=images or IMAGES)
        except GroundTruthError as error:
            no_motion = error
    try:
        return scan_offset(path, rig, images=images or SINGLE_IMAGES, progress=progress)
    except GroundTruthError as error:
        message = error.message.removeprefix(f"{path}: ")
        raise GroundTruthError(
            f"{no_motion.message}; against the scans: {message}", no_motion.remedy
        ) from error


def scan_offset(
    path: Path, rig: Rig, *, images: int = SINGLE_IMAGES, progress: Progress | None = None
) -> ClockOffset:
    """The same from single images of the moving arm, each calibrated against a scan.

    Args:
        path: A recording with images of the moving arm.
        rig: Its rig, with standard deviations of the links.
        images: At most so many in motion, the fastest, and as many in dwells.
        progress: Called with stage, images done and images in all.

    Raises:
        GroundTruthError: Fewer than three images in motion that can be used.
    """
    arm, prior = rig.load_arm(), Prior.of_rig(rig)
    with open_recording(path, rig.stamps, open_joint_log(path, rig)) as recording:
        topics = choose_topics(recording, rig)
        read = survey(recording, topics, arm)
        stamps, positions, velocities = _chosen(read, images)
        speeds = np.abs(velocities).max(axis=1, initial=0.0)
        if (speeds > MOVING_RAD_S).sum() < FEW or not len(read.lidar_ns):
            raise GroundTruthError(
                f"{path}: {(speeds > MOVING_RAD_S).sum()} images in motion, {FEW} are needed",
                "record on while the arm moves",
            )
        camera = rig.camera_model() or (read.camera_info.camera() if read.camera_info else None)
        if camera is None:
            raise GroundTruthError(f"{path}: no camera info", "give the camera in the rig")
        pairs = _pairs(recording, topics.image, topics.lidar, stamps, read.lidar_ns, camera)
    chain = arm.chain()
    A = se3.inverse(chain.forward(arm.with_offsets(positions)))
    T, covariances = np.full((len(A), 4, 4), np.nan), np.full((len(A), 6, 6), np.nan)
    method = Projection(search_rotation_deg=5.0, search_translation_m=0.2)
    for i, stamp in enumerate(stamps):
        pair = pairs.get(int(stamp))
        if pair is not None:
            found = method.calibrate([pair], prior.T_camera_effector @ A[i] @ prior.T_base_lidar)
            if found.converged:
                T[i], covariances[i] = found.T_camera_lidar, found.covariance
        if progress:
            progress("clock", i + 1, len(stamps))
    usable = np.isfinite(T[:, 0, 0])
    moving = speeds > MOVING_RAD_S
    if (usable & moving).sum() < FEW:
        raise GroundTruthError(
            f"{path}: {(usable & moving).sum()} of {moving.sum()} images in motion could be "
            f"calibrated, {FEW} are needed",
            "record on while the arm moves slowly",
        )
    solved = solve(
        A,
        T,
        weights=covariances,
        prior=prior,
        joints=Joints(arm, positions, 0.0, velocities),
    )
    usable[list(solved.outliers)] = False
    return ClockOffset(
        solved.clock_offset_s,
        solved.clock_offset_std_s,
        moving=int((usable & moving).sum()),
        still=int((usable & ~moving).sum()),
        failed=int((~usable).sum()),
        source="scans",
    )


def _chosen(read: Survey, images: int) -> tuple[Stamps, Array, Array]:
    """Stamps of the fastest images and of some in dwells, with joint positions and velocities."""
    order = np.argsort(read.joint_ns, kind="stable")
    joint_ns, q = read.joint_ns[order], read.positions[order]
    if not len(joint_ns):
        return np.zeros(0, np.int64), np.zeros((0, 0)), np.zeros((0, 0))
    inside = (read.image_ns > joint_ns[0] + HALF_STEP_NS) & (
        read.image_ns < joint_ns[-1] - HALF_STEP_NS
    )
    stamps = read.image_ns[inside]

    def at(when: Stamps) -> Array:
        seconds, known = (when - joint_ns[0]) * 1e-9, (joint_ns - joint_ns[0]) * 1e-9
        return np.column_stack([np.interp(seconds, known, column) for column in q.T])

    before, after = at(stamps - HALF_STEP_NS), at(stamps + HALF_STEP_NS)
    velocities = (after - before) / (2e-9 * HALF_STEP_NS)
    speeds = np.abs(velocities).max(axis=1, initial=0.0)
    fastest = np.argsort(-speeds)[:images]
    fastest = fastest[speeds[fastest] > MOVING_RAD_S]
    still = np.flatnonzero(speeds < STILL_RAD_S)
    spread = still[np.linspace(0, len(still) - 1, min(images, len(still))).astype(int)]
    keep = np.sort(np.concatenate([fastest, spread]))
    return stamps[keep], at(stamps[keep]), velocities[keep]


def _pairs(
    recording: Recording,
    image_topic: str,
    lidar_topic: str,
    stamps: Stamps,
    lidar_ns: Stamps,
    camera: Camera,
) -> dict[int, Pair]:
    """Images by stamp, each with the scan nearest to it."""
    nearest = lidar_ns[np.abs(lidar_ns[None] - stamps[:, None]).argmin(axis=1)]
    scans, images = set(nearest.tolist()), set(stamps.tolist())

    def wanted(topic: str, stamp: int) -> bool:
        return stamp in (images if topic == image_topic else scans)

    pictures: dict[int, Any] = {}
    clouds: dict[int, Cloud] = {}
    for _, message in recording.messages([image_topic, lidar_topic], wanted):
        if isinstance(message, Image):
            pictures[message.stamp_ns] = message.decode()
        elif isinstance(message, Cloud):
            clouds[message.stamp_ns] = message
    return {
        int(stamp): _pair(pictures[stamp], clouds[scan], camera)
        for stamp, scan in zip(stamps.tolist(), nearest.tolist(), strict=True)
        if stamp in pictures and scan in clouds
    }


def _pair(image: NDArray[np.uint8], cloud: Cloud, camera: Camera) -> Pair:
    records = cloud.records
    points = fields.points(records)
    points[~np.isfinite(points).all(axis=1)] = np.nan
    intensity, ring = fields.intensity_name(records.dtype), fields.ring_name(records.dtype)
    return Pair(
        image=image,
        points=points,
        intensity=records[intensity].astype(np.float32) if intensity else None,
        camera=camera,
        organised=cloud.organised,
        ring=records[ring].astype(np.int32) if ring else None,
    )
