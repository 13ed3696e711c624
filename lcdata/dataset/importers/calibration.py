"""Cameras and extrinsics out of the matrices that are published, checked on the way."""

from __future__ import annotations

import difflib
import json
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lcdata.errors import GeometryError, SourceError
from lcdata.geometry import se3
from lcdata.geometry.camera import Camera

Array = NDArray[np.float64]

FARTHEST = 1e6
"""No element of a transform between two sensors is larger (metres)."""

SKEW_PX = 1e-3
"""What a published K may have off its diagonal by rounding."""


def read_json(path: Path, hook: Callable[[dict[str, Any]], Any] | None = None) -> Any:
    """Content of a JSON file.

    Args:
        path: The file.
        hook: Called with each object; what it returns takes its place.

    Raises:
        SourceError: Not there, or no JSON.
    """
    try:
        return json.loads(path.read_text(encoding="utf-8"), object_hook=hook)
    except (OSError, ValueError) as error:  # a UnicodeDecodeError is a ValueError
        reason = getattr(error, "strerror", None) or f"no JSON: {error}"
        raise SourceError(f"{path}: cannot be read ({reason})", "check the file") from error


def numbers(values: Any, what: str) -> Array:
    """Finite numbers of any shape.

    Raises:
        SourceError: Something else.
    """
    try:
        array = np.array(values, float)
    except (TypeError, ValueError) as error:
        shown = str(values)
        raise SourceError(f"{what} is {shown[:60]}", "give numbers") from error
    if not np.isfinite(array).all():
        raise SourceError(f"{what} has values that are not finite", "give numbers")
    return array


def intrinsics_of(K: ArrayLike, what: str) -> tuple[float, float, float, float]:
    """fx, fy, cx, cy of an intrinsic matrix.

    Args:
        K: Those four, or 3x3, or its nine values row by row.
        what: What to call it in an error.

    Raises:
        SourceError: Another size, or no such matrix.
    """
    values = numbers(K, what)
    if values.shape == (4,):
        fx, fy, cx, cy = values.tolist()
        return fx, fy, cx, cy
    if values.size != 9:
        shape = "x".join(map(str, values.shape)) or "1"
        raise SourceError(f"{what} has {shape} values", "give fx fy cx cy, or 3x3")
    M = values.reshape(3, 3)
    if np.abs(M[2] - [0, 0, 1]).max() > SKEW_PX or max(abs(M[0, 1]), abs(M[1, 0])) > SKEW_PX:
        raise SourceError(
            f"{what} is {M.tolist()}", "give fx 0 cx, 0 fy cy, 0 0 1 row by row (no skew)"
        )
    return float(M[0, 0]), float(M[1, 1]), float(M[0, 2]), float(M[1, 2])


def split_projection(P: ArrayLike, what: str) -> tuple[tuple[float, float, float, float], Array]:
    """A rectified camera's projection matrix as intrinsics and baseline.

    P = K [I | t] maps points of the rectified reference camera to pixels of this camera, so that
    this camera's points are those plus t = K^-1 P[:, 3], also along its axis.

    Args:
        P: 3x4, or its twelve values row by row.
        what: What to call it in an error.

    Returns:
        fx, fy, cx, cy in pixels, and 4x4 `T_camera_reference`.

    Raises:
        SourceError: Another size, or no such matrix.
    """
    values = numbers(P, what)
    if values.size != 12:
        raise SourceError(f"{what} has {values.size} values", "it must have 3x4")
    values = values.reshape(3, 4)
    fx, fy, cx, cy = intrinsics_of(values[:, :3], what)
    if fx == 0 or fy == 0:
        raise SourceError(f"{what} has a focal length of 0", "check the file")
    x, y, z = values[:, 3]
    T = np.eye(4)
    T[:3, 3] = (x - cx * z) / fx, (y - cy * z) / fy, z
    return (fx, fy, cx, cy), T


def rigid(values: ArrayLike, what: str) -> Array:
    """A 4x4 rigid transform.

    Args:
        values: 4x4, or 3x4, or as many values row by row.
        what: What to call it in an error.

    Raises:
        SourceError: Another size, or not rigid.
    """
    T = numbers(values, what)
    if T.size not in (12, 16):
        shape = "x".join(map(str, T.shape)) or "1"
        raise SourceError(f"{what} has {shape} values", "give 4x4 or 3x4")
    if np.abs(T).max() > FARTHEST:
        raise SourceError(f"{what} has a value of {np.abs(T).max():.3g}", "give metres")
    T = T.reshape(-1, 4)
    try:
        return se3.check_transform(T if len(T) == 4 else np.vstack([T, [0, 0, 0, 1]]), what)
    except GeometryError as error:
        raise SourceError(error.message, error.remedy or "check the file") from error


def covariance_of(values: ArrayLike, what: str) -> Array:
    """A 6x6 covariance, translation (m) then rotation (rad), in the camera frame.

    Raises:
        SourceError: Another size, not symmetric, or a negative eigenvalue.
    """
    C = numbers(values, what)
    if C.size != 36:
        raise SourceError(f"{what} has {C.size} values", "give 6x6: translation, then rotation")
    C = C.reshape(6, 6)
    scale = np.sqrt(np.maximum(np.outer(np.diag(C), np.diag(C)), 1e-300))
    if (np.diag(C) < 0).any() or (np.abs(C - C.T) > 1e-6 * scale).any():
        raise SourceError(f"{what} is not symmetric, or has negative variances", "check it")
    C = (C + C.T) / 2
    if np.linalg.eigvalsh(C / scale).min() < -1e-6:
        raise SourceError(f"{what} is no covariance: it has a negative eigenvalue", "check it")
    return np.asarray(C)


def camera_of(
    what: str,
    size: tuple[int, int],
    intrinsics: Iterable[float],
    distortion: Iterable[float] = (),
    model: str = "pinhole",
    *,
    size_given: bool = False,
) -> Camera:
    """A camera.

    Args:
        what: What to call it in an error.
        size: Width and height of its images in pixels.
        intrinsics: As of `Camera`.
        distortion: As of `Camera`; zeros are none.
        model: As of `Camera`.
        size_given: Whether the size was published with the intrinsics, not taken from an image.

    Raises:
        SourceError: Impossible parameters, or such as belong to images of another size.
    """
    coefficients = tuple(distortion)
    try:
        camera = Camera(model, *size, tuple(intrinsics), coefficients if any(coefficients) else ())
    except GeometryError as error:
        raise SourceError(f"{what}: {error.message}", error.remedy or "check it") from error
    if size_given or model == "equirectangular":
        return camera
    cx, cy = camera.intrinsics[-2:]
    if not (0 <= cx < camera.width and 0 <= cy < camera.height):
        raise SourceError(
            f"{what}: its principal point ({cx:g}, {cy:g}) lies outside the images of "
            f"{camera.width}x{camera.height}",
            "it belongs to images of another size: scale it, or say width and height with it",
        )
    return camera


def check_keys(path: Path, content: Any, known: Iterable[str]) -> dict[str, Any]:
    """An object of a JSON file, without keys that look like misspelt ones.

    Raises:
        SourceError: No object, or a key that nearly has another's name.
    """
    if not isinstance(content, dict):
        raise SourceError(f"{path}: holds no object with keys", f"give {', '.join(known)}")
    known = list(known)
    for key in content:
        close = difflib.get_close_matches(key, known, n=1, cutoff=0.8)
        if key not in known and close:
            raise SourceError(f"{path}: unknown key {key}", f"did you mean {close[0]}?")
    return content
