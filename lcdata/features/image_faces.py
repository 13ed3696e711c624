"""Any camera's image as a few pinhole images, and where their straight edges are.

A pinhole camera's image is one face, undistorted; a wider camera's is a cube of six. Lines of the
world are straight in faces, whatever the lens.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lcdata.features.distance_fields import ORIENTATIONS, distance_fields
from lcdata.features.image_lines import extract_image_lines
from lcdata.geometry.camera import Camera

Array = NDArray[np.float64]

FOCAL = 400.0
"""Largest focal length of faces, pixels: an initial guess needs no more."""

MIN_SHARE = 0.02
"""Part of a face that must show the image."""

CLUTTER = 0.2
"""Side of the square whose mean is subtracted from the fields, radians: what counts is a place
better than its surroundings, not a cluttered part of the image."""

NOTHING = -128
"""Entry of the tables where there is no image."""

UNIT = 127.0
"""Entry of the tables that stands for the truncation distance."""


@dataclass(frozen=True, eq=False)
class Face:
    """A pinhole image.

    Args:
        camera: Pinhole without distortion.
        R_face_camera: 3x3; faces share the camera's centre.
        image: (h, w) uint8 grey.
        valid: (h, w) whether the camera's image reaches there.
    """

    camera: Camera
    R_face_camera: Array
    image: NDArray[np.uint8]
    valid: NDArray[np.bool_]


def image_faces(image: NDArray[np.uint8], camera: Camera) -> list[Face]:
    """Cut an image into faces.

    Args:
        image: (H, W) or (H, W, 3) RGB, as recorded.
        camera: Its camera.
    """
    import cv2

    grey = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
    if camera.model == "pinhole":
        return [_flat_face(grey, camera)]
    focal = min(FOCAL, *camera.pixels_per_radian)
    size = 2 * round(focal)
    centre = 0.5 * (size - 1)
    view = Camera("pinhole", size, size, (focal, focal, centre, centre))
    faces = []
    for R in _cube():
        pixels, inside = camera.project(_rays(view) @ R)
        where = np.where(inside[:, None], pixels, -1e4).astype(np.float32).reshape(size, size, 2)
        valid = inside.reshape(size, size)
        if valid.mean() < MIN_SHARE:
            continue
        # Wrapped borders: an equirectangular image goes on at its other side.
        picture = cv2.remap(grey, where, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        faces.append(Face(view, R, np.where(valid, picture, 0).astype(np.uint8), valid))
    return faces


def _flat_face(grey: NDArray[np.uint8], camera: Camera) -> Face:
    """The undistorted image, made smaller."""
    import cv2

    flat = camera.undistorted()
    picture = camera.undistort(grey)
    valid = np.full(grey.shape, True)
    if camera.is_distorted:
        valid = camera.undistort(np.full_like(grey, 255)) == 255
    scale = FOCAL / np.sqrt(flat.intrinsics[0] * flat.intrinsics[1])
    if scale < 1.0:
        size = (round(flat.width * scale), round(flat.height * scale))
        flat = flat.resized(*size)
        picture = cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
        valid = cv2.resize(valid.astype(np.uint8), size, interpolation=cv2.INTER_AREA) > 0
    return Face(flat, np.eye(3), picture, valid)


def _cube() -> Array:
    """(6, 3, 3) rotations to views along the camera's axes."""
    from scipy.spatial.transform import Rotation

    turns = [[0, a, 0] for a in (0, 90, 180, 270)] + [[90, 0, 0], [-90, 0, 0]]
    return np.rint(Rotation.from_euler("xyz", turns, degrees=True).as_matrix())


def _rays(camera: Camera) -> Array:
    """(h * w, 3) bearings of a pinhole's pixels, z = 1."""
    fx, fy, cx, cy = camera.intrinsics
    v, u = np.indices((camera.height, camera.width), float)
    return np.stack([(u.ravel() - cx) / fx, (v.ravel() - cy) / fy, np.ones(u.size)], 1)


@dataclass(frozen=True, eq=False)
class FaceFields:
    """How much nearer than its surroundings a pixel is to a line of some orientation.

    Args:
        tables: (F, ORIENTATIONS, h, w) int8, in truncation distances over 127; positive is near.
        stride: Pixels of a face a cell.
        intrinsics: (4,) fx fy cx cy of the faces, cells.
        R_face_camera: (F, 3, 3).
    """

    tables: NDArray[np.int8]
    stride: float
    intrinsics: Array
    R_face_camera: Array


def face_lines(faces: Sequence[Face]) -> list[Array]:
    """(M, 4) straight edges of each face, pixels of the face."""
    return [extract_image_lines(face.image, valid=face.valid) for face in faces]


def face_fields(
    faces: Sequence[Face], lines: Sequence[Array], truncation: float, angle_reach_deg: float
) -> FaceFields:
    """Fields of all faces at one resolution.

    Args:
        faces: One or more, of one size.
        lines: See `face_lines`.
        truncation: Distance beyond which a line is not seen, radians.
        angle_reach_deg: How far beside its orientation a line counts, degrees.
    """
    import cv2

    camera = faces[0].camera
    focal = float(np.sqrt(camera.intrinsics[0] * camera.intrinsics[1]))
    tables = []
    for face, found in zip(faces, lines, strict=True):
        field = distance_fields(found, camera, truncation * focal, angle_reach_deg)
        height, width = field.table.shape[1:]
        valid = cv2.resize(face.valid.astype(np.uint8), (width, height)) > 0
        box = max(3, round(CLUTTER * focal / field.stride) | 1)
        unit = np.float32(UNIT / 255.0)
        share = np.maximum(cv2.blur(valid.astype(np.float32), (box, box)), 1e-3)
        table = np.empty((ORIENTATIONS, height, width), np.int8)
        for k, layer in enumerate(field.table):
            distance = np.where(valid, layer, 0).astype(np.float32)
            gain = unit * (cv2.blur(distance, (box, box)) / share - distance)
            table[k] = np.where(valid, np.clip(np.rint(gain), -127, 127), NOTHING)
        tables.append(table)
    fx, fy, cx, cy = camera.intrinsics
    cells = np.array([fx, fy, cx + 0.5, cy + 0.5]) / field.stride
    rotations = np.stack([face.R_face_camera for face in faces])
    return FaceFields(np.stack(tables), field.stride, cells, rotations)
