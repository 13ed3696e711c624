"""What stands still or is small: arm, tower, transforms over all pairs."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lcdata.arm.urdf import mesh_folder
from lcdata.errors import ArmError, DatasetError, MissingLibraryError
from lcdata.geometry import se3
from lcdata.review import names

if TYPE_CHECKING:
    import rerun as rr

    from lcdata.arm import Arm
    from lcdata.dataset.reader import Dataset
    from lcdata.dataset.schema import PoseRecord

Array = NDArray[np.float64]

MESH_PATH = "ROS_PACKAGE_PATH"
"""Where Rerun looks for `package://`."""

LIDAR_RADIUS_M, LIDAR_HEIGHT_M = 0.045, 0.075
MAST_WIDTH_M, PLATE_M = 0.04, 0.02


def load_arm(dataset: Dataset) -> Arm | None:
    """The arm of a data set, its joint offsets those of the ground truth.

    Returns:
        None without an arm, or if its model is not on this machine.
    """
    try:
        return dataset.load_arm()
    except (ArmError, DatasetError, MissingLibraryError):
        return None


def log_arm(recording: rr.RecordingStream, arm: Arm) -> None:
    """Shapes of the arm, and the transforms of the joints that its poses do not say."""
    import rerun as rr

    tree = _tree(arm)
    solids: dict[str, Any] = {
        "Cylinders3D:lengths": rr.Cylinders3D,
        "Boxes3D:half_sizes": rr.Boxes3D,
        "Ellipsoids3D:half_sizes": rr.Ellipsoids3D,
    }
    with _meshes_of(arm.urdf):
        chunks = tree.stream(include_joint_transforms=False).to_chunks()
    recording.send_chunks(chunks)
    for chunk in chunks:  # simple shapes are wire frames unless told otherwise
        for shape in solids.keys() & chunk.to_record_batch().schema.names:
            solid = solids[shape].from_fields(fill_mode="solid")
            recording.log(chunk.entity_path, solid, static=True)
    moving = set(arm.joint_names)
    for joint in tree.joints():
        if joint.name not in moving:
            transform = joint.compute_transform(0.0, clamp=False)
            recording.log(f"{names.JOINTS}/{joint.name}", transform, static=True)


def send_joints(
    recording: rr.RecordingStream, arm: Arm, poses: Sequence[PoseRecord], indexes: list[Any]
) -> None:
    """Motion of the arm: transforms of its joints, one row a pair.

    Args:
        recording: Where to send them.
        arm: The arm, whose joint offsets are added to the encoders' readings.
        poses: The pose of each pair.
        indexes: Time columns with one entry a pair.
    """
    tree = _tree(arm)
    for i, name in enumerate(arm.joint_names):
        joint = tree.get_joint_by_name(name)
        if joint is None:
            continue
        offset = arm.joint_offsets.get(name, 0.0)
        angles = [float(pose.joint_positions[i]) + offset for pose in poses]
        recording.send_columns(
            f"{names.JOINTS}/{name}",
            indexes,
            joint.compute_transform_columns(angles, clamp=False),
        )


def send_sensors(
    recording: rr.RecordingStream, poses: Sequence[PoseRecord], indexes: list[Any], root: str
) -> None:
    """Where LiDAR and camera are by the ground truth, one row a pair.

    The camera hangs on the LiDAR by the very transform under test. That it sits on the arm's
    end effector in the picture is then a check of the chain.
    """
    if root != names.FRAME_LIDAR:
        links = [pose.T_base_lidar for pose in poses]
        send_transforms(recording, names.LIDAR, indexes, (root, names.FRAME_LIDAR), links)
    cameras = [se3.inverse(pose.T_camera_lidar) for pose in poses]
    frames = names.FRAME_LIDAR, names.FRAME_CAMERA
    send_transforms(recording, names.CAMERA, indexes, frames, cameras)


def send_transforms(
    recording: rr.RecordingStream,
    entity: str,
    indexes: list[Any],
    frames: tuple[str, str],
    transforms: Sequence[Array | None],
) -> None:
    """Transforms `T_parent_child` (4x4) between `frames` (parent, child), one row a pair."""
    import rerun as rr

    rows = [se3.to_xyz_xyzw(np.eye(4) if T is None else T) for T in transforms]
    values = np.array(rows, np.float32)
    recording.send_columns(
        entity,
        indexes,
        rr.Transform3D.columns(
            translation=values[:, :3],
            quaternion=values[:, 3:],
            parent_frame=[frames[0]] * len(rows),
            child_frame=[frames[1]] * len(rows),
        ),
    )


def log_tower(recording: rr.RecordingStream, pose: PoseRecord, root: str) -> None:
    """The tower that carries LiDAR and arm, as a sketch: plate, mast and LiDAR housing."""
    import rerun as rr

    if pose.T_base_lidar is None:
        return
    x, y, z = pose.T_base_lidar[:3, 3]
    top = z - LIDAR_HEIGHT_M / 2 if z > 0 else 0.0
    bottom = 0.0 if z > 0 else z + LIDAR_HEIGHT_M / 2
    margin = 0.12
    low, high = np.minimum([x, y], 0) - margin, np.maximum([x, y], 0) + margin
    grey = [(120, 126, 136), (96, 102, 112)]
    recording.log(
        names.TOWER,
        rr.CoordinateFrame(root),
        rr.Boxes3D(
            mins=[
                [*low, -PLATE_M],
                [x - MAST_WIDTH_M / 2, y - MAST_WIDTH_M / 2, bottom],
            ],
            sizes=[
                [*(high - low), PLATE_M],
                [MAST_WIDTH_M, MAST_WIDTH_M, top - bottom],
            ],
            colors=grey,
            fill_mode="solid",
        ),
        static=True,
    )


def log_lidar(recording: rr.RecordingStream) -> None:
    """Housing of the LiDAR, at its origin."""
    import rerun as rr

    recording.log(
        f"{names.LIDAR}/housing",
        rr.CoordinateFrame(names.FRAME_LIDAR),
        rr.Cylinders3D(
            lengths=[LIDAR_HEIGHT_M],
            radii=[LIDAR_RADIUS_M],
            colors=[(40, 44, 52)],
            fill_mode="solid",
        ),
        static=True,
    )


def _tree(arm: Arm) -> Any:
    from rerun.urdf import UrdfTree

    return UrdfTree.from_file_path(
        arm.urdf, entity_path_prefix=names.ARM, frame_prefix=names.ARM_PREFIX
    )


@contextmanager
def _meshes_of(urdf: Path) -> Iterator[None]:
    """Let Rerun find the meshes of a URDF that lies apart from them."""
    folder, before = mesh_folder(urdf), os.environ.get(MESH_PATH)
    if folder is None:
        yield
        return
    os.environ[MESH_PATH] = os.pathsep.join(filter(None, (before, str(folder))))
    try:
        yield
    finally:
        os.environ.pop(MESH_PATH)
        if before is not None:
            os.environ[MESH_PATH] = before
