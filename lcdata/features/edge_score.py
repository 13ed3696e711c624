"""How well a pose lays a cloud's edges on the lines of an image from any camera.

A point gains how much nearer to an image line of its own orientation it is than its surroundings
are. The score of a pose is that of chance: in each patch of the image the sum of the gains divided
by the root of their number, and the same again of the patches. Wrong poses score 0 on average
whatever they bring into view, so that poses that look at different parts of the scene can be
compared; and one long line that many points lie on counts little against many that agree.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lcdata.errors import CalibrationError
from lcdata.features.compiled import compiled
from lcdata.features.distance_fields import ORIENTATIONS
from lcdata.features.edge_registration import FaceLines, normalised_lines
from lcdata.features.image_faces import FaceFields, face_fields, face_lines, image_faces
from lcdata.features.view_edges import CloudEdges, extract_cloud_edges
from lcdata.pair import Pair

Array = NDArray[np.float64]

FIELDS = {0.1: 20.0, 0.06: 15.0, 0.02: 10.0, 0.008: 5.0}
"""Truncation distances in radians, coarse to fine, and the angles in degrees that a line reaches
beyond its own bin."""

NEAR = 0.1
"""Points closer to the camera's centre along a face's axis are not in it, metres."""

PATCH = 0.2
"""Side of a patch, radians."""

FEW_POINTS = 0.0005
"""Share of the points that a patch must have for its gain to count in full."""

FEW_PATCHES = 6.0
"""Patches that must have points for the score to count in full."""


@dataclass(frozen=True, eq=False)
class EdgeFeatures:
    """What the search knows of one pair.

    Args:
        cloud: Edge points, in random order.
        fields: Fields of the image by truncation distance.
        lines: The image's lines.
    """

    cloud: CloudEdges
    fields: dict[float, FaceFields]
    lines: FaceLines


def extract_edge_features(pair: Pair) -> EdgeFeatures:
    """Edges and fields of one pair.

    Raises:
        CalibrationError: A cloud without edges or an image without lines.
    """
    cloud = extract_cloud_edges(pair.points, pair.intensity)
    faces = image_faces(pair.image, pair.camera)
    lines = face_lines(faces)
    count = sum(len(found) for found in lines)
    name = f"pair {pair.pair_id}" if pair.pair_id else "the pair"
    if len(cloud.points) < 100 or count < 5:
        raise CalibrationError(
            f"{name}: {len(cloud.points)} edge points in the cloud, {count} lines in the image",
            "too few for an initial guess: give one, or pick matches by hand",
        )
    fields = {
        truncation: face_fields(faces, lines, truncation, reach)
        for truncation, reach in FIELDS.items()
    }
    order = np.random.default_rng(0).permutation(len(cloud.points))
    cloud = CloudEdges(cloud.points[order], cloud.tangents[order], cloud.painted[order])
    return EdgeFeatures(cloud, fields, normalised_lines(faces, lines))


def scores(pairs: Sequence[EdgeFeatures], poses: Array, truncation: float, points: int) -> Array:
    """Scores of (P, 4, 4) poses `T_camera_lidar`, (P,): 0 of chance, 5 and more of a good one."""
    flat = np.concatenate([poses[:, :3, :3].reshape(-1, 9), poses[:, :3, 3]], 1)
    total = np.zeros((len(poses), 2))
    for pair in pairs:
        field = pair.fields[truncation]
        where, tangents = pair.cloud.points[:points], pair.cloud.tangents[:points]
        _add_scores(
            flat,
            where,
            tangents,
            field.tables,
            field.intrinsics,
            field.R_face_camera,
            *_BINS,
            max(1, round(PATCH * field.intrinsics[0])),
            FEW_POINTS * len(where),
            total,
        )
    return np.asarray(total[:, 0] / np.sqrt(total[:, 1] + FEW_PATCHES))


SLOPES = 128
"""Steps from a slope of 0 to one of 1 in the look-up of orientations."""


def _orientation_bins() -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Orientation bins of flat lines by their slope dy/dx, and of steep ones by dx/dy."""
    slope = (np.arange(2 * SLOPES + 1) + 0.5) / SLOPES - 1.0
    angles = np.arctan(slope), 0.5 * np.pi - np.arctan(slope)
    flat, steep = (np.floor(a % np.pi * ORIENTATIONS / np.pi).astype(np.int64) for a in angles)
    return np.minimum(flat, ORIENTATIONS - 1), np.minimum(steep, ORIENTATIONS - 1)


_BINS = _orientation_bins()


@compiled
def _add_scores(  # noqa: PLR0912 - one pass over points
    poses: Array,
    points: Array,
    tangents: Array,
    tables: NDArray[np.int8],
    intrinsics: Array,
    rotations: Array,
    flat_bins: NDArray[np.int64],
    steep_bins: NDArray[np.int64],
    patch: int,
    few: float,
    total: Array,
) -> None:
    """Add the gains of all patches and the number of patches that have points."""
    faces, _, height, width = tables.shape
    across_patches, patches = width // patch + 1, (width // patch + 1) * (height // patch + 1)
    gained, count = np.zeros(faces * patches), np.zeros(faces * patches)
    fx, fy, cx, cy = intrinsics
    a = np.empty((faces, 3, 4))
    for k in range(poses.shape[0]):
        for f in range(faces):
            for i in range(3):
                for j in range(3):
                    a[f, i, j] = 0.0
                    for m in range(3):
                        a[f, i, j] += rotations[f, i, m] * poses[k, 3 * m + j]
                a[f, i, 3] = 0.0
                for m in range(3):
                    a[f, i, 3] += rotations[f, i, m] * poses[k, 9 + m]
        gained[:], count[:] = 0.0, 0.0
        for n in range(points.shape[0]):
            px, py, pz = points[n, 0], points[n, 1], points[n, 2]
            for f in range(faces):
                z = a[f, 2, 0] * px + a[f, 2, 1] * py + a[f, 2, 2] * pz + a[f, 2, 3]
                if z < NEAR:
                    continue
                x = a[f, 0, 0] * px + a[f, 0, 1] * py + a[f, 0, 2] * pz + a[f, 0, 3]
                y = a[f, 1, 0] * px + a[f, 1, 1] * py + a[f, 1, 2] * pz + a[f, 1, 3]
                inverse = 1.0 / z
                u = fx * x * inverse + cx
                v = fy * y * inverse + cy
                if u < 0.0 or v < 0.0 or u >= width or v >= height:
                    continue
                qx, qy, qz = tangents[n, 0], tangents[n, 1], tangents[n, 2]
                tx = a[f, 0, 0] * qx + a[f, 0, 1] * qy + a[f, 0, 2] * qz
                ty = a[f, 1, 0] * qx + a[f, 1, 1] * qy + a[f, 1, 2] * qz
                tz = a[f, 2, 0] * qx + a[f, 2, 1] * qy + a[f, 2, 2] * qz
                across, down = fx * (tx * z - tz * x), fy * (ty * z - tz * y)
                if abs(across) >= abs(down):
                    b = flat_bins[int(SLOPES * (1.0 + down / (across + 1e-300)))]
                else:
                    b = steep_bins[int(SLOPES * (1.0 + across / down))]
                row, column = int(v), int(u)
                entry = tables[f, b, row, column]
                if entry != -128:
                    cell = f * patches + (row // patch) * across_patches + column // patch
                    gained[cell] += entry
                    count[cell] += 1.0
                break
        for cell in range(len(count)):
            if count[cell] > 0.0:
                total[k, 0] += gained[cell] / (127.0 * np.sqrt(count[cell] + few))
                total[k, 1] += count[cell] / (count[cell] + few)
