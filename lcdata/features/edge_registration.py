"""Register a cloud's edge points to an image's lines: iterated nearest lines, Gauss-Newton."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lcdata.features.compiled import compiled
from lcdata.features.image_faces import Face
from lcdata.features.view_edges import CloudEdges
from lcdata.geometry import se3

Array = NDArray[np.float64]

GATES = ((0.025, 20.0), (0.018, 15.0), (0.012, 12.0), (0.008, 10.0), (0.005, 8.0), (0.004, 8.0))
"""Largest distance (radians) and angle (degrees) between an edge point and its line, round by
round."""

STEPS = 4
"""Gauss-Newton steps a round, each with lines chosen anew."""

POINTS = 2500
"""Edge points of a cloud that are used."""

SOFT = 0.3
"""Width of the Cauchy loss, in gates."""


@dataclass(frozen=True, eq=False)
class FaceLines:
    """The lines of all faces of an image.

    Args:
        lines: (M, 4) x1 y1 x2 y2 in normalised image coordinates of their face.
        first: (F + 1,) where the lines of each face begin.
        R_face_camera: (F, 3, 3).
        limits: (4,) smallest and largest x, smallest and largest y of a face.
    """

    lines: Array
    first: NDArray[np.int64]
    R_face_camera: Array
    limits: Array


def normalised_lines(faces: Sequence[Face], lines: Sequence[Array]) -> FaceLines:
    """Lines in normalised coordinates.

    Args:
        faces: Of one image.
        lines: (M, 4) of each face, pixels.
    """
    camera = faces[0].camera
    fx, fy, cx, cy = camera.intrinsics
    joined = (np.concatenate(lines) - [cx, cy, cx, cy]) / [fx, fy, fx, fy]
    first = np.cumsum([0, *(len(found) for found in lines)])
    low, high = (np.array([x, y]) for x, y in ((-0.5, -0.5), (camera.width, camera.height)))
    low, high = (low - [cx, cy]) / [fx, fy], (high - 0.5 - [cx, cy]) / [fx, fy]
    limits = np.array([low[0], high[0], low[1], high[1]])
    return FaceLines(joined, first, np.stack([f.R_face_camera for f in faces]), limits)


def register(
    images: Sequence[FaceLines], clouds: Sequence[CloudEdges], T_camera_lidar: Array
) -> Array:
    """The pose near a given one in which edge points lie on lines.

    Args:
        images: Lines of each pair.
        clouds: Edge points of each pair.
        T_camera_lidar: 4x4 pose to begin with, a degree or two off at most.

    Returns:
        4x4 `T_camera_lidar`.
    """
    T = np.array(T_camera_lidar)
    for distance, degrees in GATES:
        for _ in range(STEPS):
            normal, gradient = np.zeros((6, 6)), np.zeros(6)
            for image, cloud in zip(images, clouds, strict=True):
                _accumulate(
                    T,
                    cloud.points[:POINTS],
                    cloud.tangents[:POINTS],
                    image.lines,
                    image.first,
                    image.R_face_camera,
                    image.limits,
                    distance,
                    np.cos(np.deg2rad(degrees)),
                    normal,
                    gradient,
                )
            damping = 1e-3 * np.diag(normal).mean() + 1e-9
            step = -np.linalg.solve(normal + damping * np.eye(6), gradient)
            size = max(np.linalg.norm(step[:3]) / 0.1, np.linalg.norm(step[3:]) / 0.02)
            T = se3.exp(step / max(1.0, size)) @ T
            if size < 1e-3:
                break
    return T


@compiled
def _accumulate(  # noqa: PLR0912 - one pass over points
    T: Array,
    points: Array,
    tangents: Array,
    lines: Array,
    first: NDArray[np.int64],
    rotations: Array,
    limits: Array,
    gate: float,
    cosine: float,
    normal: Array,
    gradient: Array,
) -> None:
    """Add J^T W J and J^T W r of the distances of points to their nearest lines.

    J is by a left perturbation of T, translation then rotation.
    """
    soft = (SOFT * gate) ** 2
    row = np.empty(6)
    q, d, g = np.empty(3), np.empty(3), np.empty(3)
    for n in range(points.shape[0]):
        for i in range(3):
            q[i] = T[i, 3]
            d[i] = 0.0
            for j in range(3):
                q[i] += T[i, j] * points[n, j]
                d[i] += T[i, j] * tangents[n, j]
        for f in range(rotations.shape[0]):
            R = rotations[f]
            z = R[2, 0] * q[0] + R[2, 1] * q[1] + R[2, 2] * q[2]
            if z < 0.1:
                continue
            u = (R[0, 0] * q[0] + R[0, 1] * q[1] + R[0, 2] * q[2]) / z
            v = (R[1, 0] * q[0] + R[1, 1] * q[1] + R[1, 2] * q[2]) / z
            if u < limits[0] or u > limits[1] or v < limits[2] or v > limits[3]:
                continue
            dz = R[2, 0] * d[0] + R[2, 1] * d[1] + R[2, 2] * d[2]
            du = R[0, 0] * d[0] + R[0, 1] * d[1] + R[0, 2] * d[2] - u * dz
            dv = R[1, 0] * d[0] + R[1, 1] * d[1] + R[1, 2] * d[2] - v * dz
            size = np.sqrt(du * du + dv * dv) + 1e-12
            # Off the axis an angle is longer in a face.
            stretch = np.sqrt(1.0 + u * u + v * v)
            best, bx, by = gate * stretch, 0.0, 0.0
            for m in range(first[f], first[f + 1]):
                lx, ly = lines[m, 2] - lines[m, 0], lines[m, 3] - lines[m, 1]
                length = np.sqrt(lx * lx + ly * ly)
                lx, ly = lx / length, ly / length
                x, y = u - lines[m, 0], v - lines[m, 1]
                across = lx * y - ly * x
                if abs(across) >= abs(best):
                    continue
                along = lx * x + ly * y
                if along < -gate or along > length + gate:
                    continue
                if abs(lx * du + ly * dv) < cosine * size:
                    continue
                best, bx, by = across, -ly, lx
            if bx != 0.0 or by != 0.0:
                r = best / stretch
                w = 1.0 / (1.0 + r * r / soft)
                for i in range(3):
                    g[i] = (bx * (R[0, i] - u * R[2, i]) + by * (R[1, i] - v * R[2, i])) / (
                        z * stretch
                    )
                    row[i] = g[i]
                row[3] = q[1] * g[2] - q[2] * g[1]
                row[4] = q[2] * g[0] - q[0] * g[2]
                row[5] = q[0] * g[1] - q[1] * g[0]
                for i in range(6):
                    gradient[i] += w * row[i] * r
                    for j in range(6):
                        normal[i, j] += w * row[i] * row[j]
            break
