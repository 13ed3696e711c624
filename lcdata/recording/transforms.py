"""Transforms that do not change: the chain between two frames."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from lcdata.errors import RecordingError
from lcdata.geometry import se3
from lcdata.recording.conversion import TRANSFORMS
from lcdata.recording.messages import StaticTransform, Transforms
from lcdata.recording.source import Recording

Array = NDArray[np.float64]
SAME = 1e-9
"""Two transforms that differ by less in any element are the same."""


def static_transforms(recording: Recording, *, unchanged: bool = False) -> list[StaticTransform]:
    """Transforms of /tf_static.

    Args:
        recording: An open recording.
        unchanged: Whether to read all of /tf, too, for transforms that stay the same: in ROS 1,
            a static_transform_publisher publishes there, again and again.
    """
    topics = [t for t, info in recording.topics.items() if info.type in TRANSFORMS]
    static = [t for t in topics if t.endswith("tf_static")]
    found = _last(recording, static)
    moving = [t for t in topics if t not in static] if unchanged else []
    for edge, transform in _unchanged(recording, moving).items():
        found.setdefault(edge, transform)
    return list(found.values())


def _last(recording: Recording, topics: list[str]) -> dict[tuple[str, str], StaticTransform]:
    found = {}
    for transform in _all(recording, topics):
        found[transform.parent, transform.child] = transform
    return found


def _unchanged(recording: Recording, topics: list[str]) -> dict[tuple[str, str], StaticTransform]:
    found: dict[tuple[str, str], StaticTransform] = {}
    moving: set[tuple[str, str]] = set()
    for transform in _all(recording, topics):
        edge = transform.parent, transform.child
        first = found.setdefault(edge, transform)
        if edge not in moving and not np.allclose(
            first.T_parent_child, transform.T_parent_child, rtol=0, atol=SAME
        ):
            moving.add(edge)
    return {edge: transform for edge, transform in found.items() if edge not in moving}


def _all(recording: Recording, topics: list[str]) -> Iterable[StaticTransform]:
    for _, message in recording.messages(topics) if topics else ():
        if isinstance(message, Transforms):
            yield from message.transforms


def static_extrinsic(recording: Recording, camera_frame: str, lidar_frame: str) -> Array:
    """`T_camera_lidar` by the static transforms between the two sensors' frames.

    Args:
        recording: With /tf_static, or a /tf that does not change.
        camera_frame: Frame of the images.
        lidar_frame: Frame of the clouds.

    Returns:
        4x4 transform of LiDAR coordinates to camera coordinates.

    Raises:
        RecordingError: The transforms do not join the two frames.
    """
    transforms: list[StaticTransform] = []
    T_camera_lidar: Array | None = None
    for unchanged in (False, True):  # /tf may be long: only where /tf_static is not enough
        if T_camera_lidar is None:
            transforms = static_transforms(recording, unchanged=unchanged)
            T_camera_lidar = chain(transforms, camera_frame, lidar_frame)
    if T_camera_lidar is None:
        frames = sorted({f for t in transforms for f in (t.parent, t.child)})
        known = f"they join {', '.join(frames)}" if frames else "there are none"
        raise RecordingError(
            f"{recording.path}: no static transforms from {lidar_frame!r} to {camera_frame!r}; "
            f"{known}",
            "give T_camera_lidar in the rig",
        )
    return T_camera_lidar


def chain(transforms: Iterable[StaticTransform], target: str, source: str) -> Array | None:
    """`T_target_source` along the fewest transforms, in either direction; None if not joined."""
    steps: dict[str, list[tuple[str, Array]]] = {}
    for transform in transforms:
        T = transform.T_parent_child
        steps.setdefault(transform.parent, []).append((transform.child, T))
        steps.setdefault(transform.child, []).append((transform.parent, se3.inverse(T)))
    reached = {target: np.eye(4)}
    queue = deque([target])
    while queue:
        frame = queue.popleft()
        for neighbour, T in steps.get(frame, ()):
            if neighbour not in reached:
                reached[neighbour] = reached[frame] @ T
                queue.append(neighbour)
    return reached.get(source)
