"""Cameras as others write them down: CameraInfo, Kalibr's camchain, the NID toolbox's calib.json.

Orders differ: Kalibr has xi before fx, the toolbox after cy, a CameraInfo at the end of its D.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lcdata.errors import GeometryError
from lcdata.geometry.camera import Camera

Array = NDArray[np.float64]

ROS_MODELS = {
    "plumb_bob": ("pinhole", (4, 5)),
    "radtan": ("pinhole", (4, 5)),
    "rational_polynomial": ("pinhole", (8, 12, 14)),
    "equidistant": ("fisheye", (4,)),
    "fisheye": ("fisheye", (4,)),
    "fov": ("atan", (1,)),
    "atan": ("atan", (1,)),
    "omnidirectional": ("omni", (5,)),
    "omnidir": ("omni", (5,)),
    "omni": ("omni", (5,)),
    "mei": ("omni", (5,)),
    "unified": ("omni", (5,)),
    "equirectangular": ("equirectangular", (0,)),
    "": ("pinhole", (0, 4, 5)),
    "none": ("pinhole", (0,)),
}
"""`sensor_msgs/CameraInfo.distortion_model` to our model and its numbers of coefficients."""

KALIBR_MODELS = {
    ("pinhole", "radtan"): "pinhole",
    ("pinhole", "equidistant"): "fisheye",
    ("pinhole", "equi"): "fisheye",
    ("pinhole", "fov"): "atan",
    ("pinhole", "none"): "pinhole",
    ("omni", "radtan"): "omni",
    ("omni", "none"): "omni",
}
"""Kalibr's camera_model and distortion_model to our model."""

CALIB_JSON_MODELS = {
    "plumb_bob": "pinhole",
    "fisheye": "fisheye",
    "equidistant": "fisheye",
    "atan": "atan",
    "omnidir": "omni",
    "equirectangular": "equirectangular",
}
"""Camera models of direct_visual_lidar_calibration to ours."""


def camera_of_info(
    distortion_model: str, width: int, height: int, k: ArrayLike, d: ArrayLike
) -> Camera:
    """Camera of a `sensor_msgs/CameraInfo`; see `Camera.from_ros`."""
    name = distortion_model.strip().lower().replace(" ", "_")
    if name not in ROS_MODELS:
        raise GeometryError(
            f"unknown distortion model {distortion_model!r}",
            f"known are {', '.join(name for name in ROS_MODELS if name)}",
        )
    model, counts = ROS_MODELS[name]
    matrix = np.asarray(k, float).reshape(-1)
    coefficients = np.asarray(d, float).reshape(-1)
    if model == "equirectangular":
        return Camera(model, int(width), int(height))
    if matrix.shape != (9,):
        raise GeometryError(f"CameraInfo has {matrix.size} values in K", "it must have 9")
    if not coefficients.any() and model != "omni":
        coefficients = coefficients[:0]
    elif coefficients.size not in counts:
        raise GeometryError(
            f"CameraInfo with {distortion_model} and {coefficients.size} coefficients",
            f"give {', '.join(map(str, counts))}" + (": k1 k2 p1 p2 xi" if model == "omni" else ""),
        )
    intrinsics = matrix[[0, 4, 2, 5]]
    if model == "omni":
        intrinsics = np.append(coefficients[4], intrinsics)
        coefficients = coefficients[:4]
    return Camera(model, int(width), int(height), tuple(intrinsics), tuple(coefficients))


def info_of_camera(camera: Camera) -> tuple[str, Array, Array]:
    """A camera as a `sensor_msgs/CameraInfo` says it; `camera_of_info` reads it back.

    Returns:
        Its distortion_model, (9,) K and D; K is zero of a panorama, which has none.
    """
    d = np.array(camera.distortion)
    if camera.model == "equirectangular":
        return camera.model, np.zeros(9), d
    if camera.model == "omni":
        padded = camera.distortion or (0.0,) * 4
        return "omnidirectional", camera.K.reshape(-1), np.array([*padded, camera.intrinsics[0]])
    name = "rational_polynomial" if len(d) > 5 else "plumb_bob"
    return (
        {"fisheye": "equidistant", "atan": "fov"}.get(camera.model, name),
        camera.K.reshape(-1),
        d,
    )


def read_kalibr(path: Path, cam: str) -> Camera:
    """Camera of a Kalibr camchain; see `Camera.from_kalibr`."""
    import yaml

    try:
        chain = yaml.safe_load(_text(path))
    except yaml.YAMLError as error:
        raise GeometryError(f"{path}: not YAML ({' '.join(str(error).split())})") from error
    if not isinstance(chain, Mapping) or cam not in chain:
        known = [str(name) for name in chain] if isinstance(chain, Mapping) else []
        raise GeometryError(
            f"{path}: no camera {cam!r}", f"it has {', '.join(known)}" if known else ""
        )
    section = chain[cam]
    named = [_value(path, section, key) for key in ("camera_model", "distortion_model")]
    if (named[0], named[1]) not in KALIBR_MODELS:
        raise GeometryError(
            f"{path}: {cam} is {named[0]}-{named[1]}, which lcdata does not have",
            f"calibrate as {', '.join('-'.join(pair) for pair in KALIBR_MODELS)}",
        )
    model = KALIBR_MODELS[named[0], named[1]]
    size = _numbers(path, section, "resolution")
    if len(size) != 2:
        raise GeometryError(f"{path}: resolution of {cam} has {len(size)} values", "give 2")
    return _camera(
        path,
        model,
        (int(size[0]), int(size[1])),
        _numbers(path, section, "intrinsics"),
        _numbers(path, section, "distortion_coeffs"),
    )


def read_calib_json(path: Path, size: tuple[int, int] | None) -> Camera:
    """Camera of a toolbox's calib.json; see `Camera.from_calib_json`."""
    try:
        content = json.loads(_text(path))
    except json.JSONDecodeError as error:
        raise GeometryError(f"{path}: not JSON ({error})") from error
    section = _value(path, content, "camera")
    name = _value(path, section, "camera_model")
    if name not in CALIB_JSON_MODELS:
        raise GeometryError(
            f"{path}: unknown camera model {name!r}", f"known are {', '.join(CALIB_JSON_MODELS)}"
        )
    model = CALIB_JSON_MODELS[name]
    intrinsics = _numbers(path, section, "intrinsics")
    distortion = _numbers(path, section, "distortion_coeffs")
    if model == "omni" and len(intrinsics) == 5:
        intrinsics = (intrinsics[4], *intrinsics[:4])
    if model == "equirectangular" and size is None and len(intrinsics) == 2:
        size = (int(intrinsics[0]), int(intrinsics[1]))
    return _camera(
        path,
        model,
        size or _image_size(path, content),
        intrinsics,
        distortion if any(distortion) else (),
    )


def _image_size(path: Path, content: Mapping[str, Any]) -> tuple[int, int]:
    """Width and height of the first image that lies beside a calib.json."""
    import cv2

    meta = content.get("meta")
    names = meta.get("bag_names") if isinstance(meta, Mapping) else None
    for name in names if isinstance(names, list) else []:
        image = cv2.imread(str(path.with_name(f"{name}.png")), cv2.IMREAD_GRAYSCALE)
        if image is not None:
            return image.shape[1], image.shape[0]
    raise GeometryError(
        f"{path}: says no image size, and none of its images lies beside it",
        "give size=(width, height)",
    )


def _camera(
    path: Path,
    model: str,
    size: tuple[int, int],
    intrinsics: tuple[float, ...],
    distortion: tuple[float, ...],
) -> Camera:
    try:
        return Camera(model, *size, intrinsics, distortion)
    except GeometryError as error:
        raise GeometryError(f"{path}: {error}") from error


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise GeometryError(f"{path}: cannot be read ({error})") from error


def _value(path: Path, section: Any, key: str) -> Any:
    if not isinstance(section, Mapping) or key not in section:
        raise GeometryError(f"{path}: no {key}", "is it the right kind of file?")
    return section[key]


def _numbers(path: Path, section: Any, key: str) -> tuple[float, ...]:
    values = _value(path, section, key)
    try:
        return tuple(float(value) for value in values)
    except (TypeError, ValueError) as error:
        raise GeometryError(f"{path}: {key} is {values!r}", "give a list of numbers") from error
