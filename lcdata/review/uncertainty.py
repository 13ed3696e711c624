"""How well the ground truth itself is known: an ellipsoid at the camera, and a line of text."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lcdata.groundtruth.budget import TITLES, shares
from lcdata.review import colours, names

if TYPE_CHECKING:
    import rerun as rr

    from lcdata.dataset.schema import PoseRecord

Array = NDArray[np.float64]

SIGMAS = 3.0
VISIBLE_M = 0.1
"""Half axis that the largest sigma of a typical pose should at least have in the picture."""

SCALES = (1, 2, 5, 10, 20, 50, 100)


def ellipsoid(covariance: Array) -> tuple[Array, Array]:
    """Where the camera may be: half axes of one sigma (m), and their directions.

    To first order a left perturbation (u, w) moves the camera's centre by -u in its own axes.

    Args:
        covariance: 6x6 of an extrinsic, translation then rotation.

    Returns:
        (3,) half axes and the rotation whose columns are their directions in the camera frame.
    """
    values, vectors = np.linalg.eigh(covariance[:3, :3])
    if np.linalg.det(vectors) < 0:
        vectors[:, 0] *= -1
    return np.sqrt(np.maximum(values, 0.0)), vectors


def scale_of(poses: Sequence[PoseRecord]) -> int:
    """How much larger than life the ellipsoids are drawn; 0 where nothing is known."""
    known = [p for p in poses if np.isfinite(p.covariance).all()]
    if not known:
        return 0
    axis = SIGMAS * float(np.median([ellipsoid(p.covariance)[0].max() for p in known]))
    return next((s for s in SCALES if s * axis >= VISIBLE_M), SCALES[-1])


def send_ellipsoids(
    recording: rr.RecordingStream, poses: Sequence[PoseRecord], indexes: list[Any], scale: int
) -> None:
    """An ellipsoid around the ground truth's camera, one row a pair; none without a scale."""
    import rerun as rr
    from scipy.spatial.transform import Rotation

    if not scale:
        return
    half, turned = [], []
    for pose in poses:
        known = np.isfinite(pose.covariance).all()
        axes, R = ellipsoid(pose.covariance) if known else (np.zeros(3), np.eye(3))
        half.append(SIGMAS * scale * axes)
        turned.append(Rotation.from_matrix(R).as_quat())
    recording.log(
        names.UNCERTAINTY,
        rr.CoordinateFrame(names.FRAME_CAMERA),
        rr.Ellipsoids3D.from_fields(
            colors=[colours.GREEN], fill_mode="densewireframe", line_radii=[0.0008]
        ),
        static=True,
    )
    columns = rr.Ellipsoids3D.columns(half_sizes=half, quaternions=turned)
    recording.send_columns(names.UNCERTAINTY, indexes, columns)


def legend(scale: int) -> str:
    """What the ellipsoid is; empty without one."""
    if not scale:
        return ""
    size = f"drawn {scale} times larger than life" if scale > 1 else "true to scale"
    return (
        f"The green ellipsoid around it is where the camera may truly be: {SIGMAS:g} sigma of the "
        f"ground truth's own uncertainty, {size}."
    )


def budget_text(pose: PoseRecord) -> str:
    """Which sources a pose's uncertainty comes from, the largest first; empty if not known."""
    parts = shares(pose.T_camera_lidar, pose.budget)
    if not parts or not np.isfinite(list(parts.values())).all():
        return ""
    texts = []
    for what, k in (("translation", 0), ("rotation", 1)):
        largest = sorted(parts, key=lambda source: parts[source][k], reverse=True)
        listed = [f"{TITLES[s]} {parts[s][k]:.0%}" for s in largest if parts[s][k] >= 0.005]
        texts.append(f"{what} {', '.join(listed)}")
    return f"Its variance comes from: {'; '.join(texts)}."
