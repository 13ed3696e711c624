"""Cameras as drivers, Kalibr and the NID toolbox write them down."""

from __future__ import annotations

import json

import cv2
import numpy as np
import pytest

from lcdata.errors import GeometryError, RigError
from lcdata.geometry.camera import Camera
from lcdata.geometry.camera_files import info_of_camera
from lcdata.rig import Rig, load_rig

CAMERAS = {
    "pinhole": Camera("pinhole", 640, 480, (500, 501, 320, 240)),
    "plumb_bob": Camera("pinhole", 640, 480, (500, 501, 320, 240), (0.1, 0.2, 0.3, 0.4, 0.5)),
    "rational": Camera("pinhole", 640, 480, (500, 501, 320, 240), (0.1,) * 8),
    "fisheye": Camera("fisheye", 640, 480, (500, 501, 320, 240), (0.1, 0.2, 0.3, 0.4)),
    "atan": Camera("atan", 640, 480, (500, 501, 320, 240), (0.9,)),
    "omni": Camera("omni", 640, 480, (1.1, 500, 501, 320, 240), (0.1, 0.2, 0.3, 0.4)),
    "equirectangular": Camera("equirectangular", 1920, 960),
}
K = [500, 0, 320, 0, 501, 240, 0, 0, 1]

CAMCHAIN = """
cam0:
  cam_overlaps: [1]
  camera_model: pinhole
  distortion_coeffs: [-0.28, 0.07, 0.0002, -0.00002]
  distortion_model: radtan
  intrinsics: [458.654, 457.296, 367.215, 248.375]
  resolution: [752, 480]
  rostopic: /cam0/image_raw
cam1:
  T_cn_cnm1:
  - [1.0, 0.0, 0.0, -0.11]
  - [0.0, 1.0, 0.0, 0.0]
  - [0.0, 0.0, 1.0, 0.0]
  - [0.0, 0.0, 0.0, 1.0]
  camera_model: {camera_model}
  distortion_coeffs: {distortion}
  distortion_model: {distortion_model}
  intrinsics: {intrinsics}
  resolution: [752, 480]
"""


def camchain(tmp_path, camera_model, intrinsics, distortion_model="none", distortion=()):
    path = tmp_path / "camchain.yaml"
    path.write_text(
        CAMCHAIN.format(
            camera_model=camera_model,
            intrinsics=list(intrinsics),
            distortion_model=distortion_model,
            distortion=list(distortion),
        )
    )
    return path


def calib_json(tmp_path, camera_model, intrinsics, distortion=(), bags=("first", "second")):
    path = tmp_path / "calib.json"
    content = {
        "camera": {
            "camera_model": camera_model,
            "intrinsics": list(intrinsics),
            "distortion_coeffs": list(distortion),
        },
        "meta": {"bag_names": list(bags)},
    }
    path.write_text(json.dumps(content))
    return path


@pytest.mark.parametrize(
    ("name", "d", "expected"),
    [
        ("plumb_bob", [0.1, 0, 0, 0, 0], Camera("pinhole", 640, 480, (500, 501, 320, 240))),
        ("rational_polynomial", [0.1] * 8, Camera("pinhole", 640, 480, (500, 501, 320, 240))),
        ("equidistant", [0.1, 0, 0, 0], Camera("fisheye", 640, 480, (500, 501, 320, 240))),
        ("fov", [0.9], Camera("atan", 640, 480, (500, 501, 320, 240))),
        ("atan", [0.9], Camera("atan", 640, 480, (500, 501, 320, 240))),
    ],
)
def test_names_that_drivers_use(name, d, expected):
    camera = Camera.from_ros(name, 640, 480, K, d)
    assert (camera.model, camera.intrinsics) == (expected.model, expected.intrinsics)
    assert camera.distortion == tuple(d)


@pytest.mark.parametrize("name", ["omnidirectional", "mei", "MEI", "unified", "omni"])
def test_xi_of_a_driver_comes_last(name):
    camera = Camera.from_ros(name, 640, 480, K, [0.1, 0.2, 0.3, 0.4, 1.2])
    assert camera == Camera("omni", 640, 480, (1.2, 500, 501, 320, 240), (0.1, 0.2, 0.3, 0.4))
    assert Camera.from_ros(name, 640, 480, K, [0, 0, 0, 0, 1.2]).intrinsics[0] == 1.2
    with pytest.raises(GeometryError, match=r"4 coefficients: give 5: k1 k2 p1 p2 xi"):
        Camera.from_ros(name, 640, 480, K, [0.1, 0.2, 0.3, 0.4])


@pytest.mark.parametrize("camera", CAMERAS.values(), ids=CAMERAS)
def test_camera_info_gives_the_camera_back(camera):
    name, k, d = info_of_camera(camera)
    assert Camera.from_ros(name, camera.width, camera.height, k, d) == camera


def test_a_panorama_needs_no_matrix():
    camera = Camera.from_ros("equirectangular", 1920, 960, np.zeros(9), [])
    assert camera == Camera("equirectangular", 1920, 960)


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (
            ("omni", (0.8, 833, 830, 373, 253), "radtan", (-0.3, 0.1, 0.001, 0.002)),
            ("omni", (0.8, 833, 830, 373, 253), (-0.3, 0.1, 0.001, 0.002)),
        ),
        (("omni", (0.8, 833, 830, 373, 253)), ("omni", (0.8, 833, 830, 373, 253), ())),
        (
            ("pinhole", (461, 460, 362, 246), "equidistant", (0.01, 0.05, -0.04, 0.01)),
            ("fisheye", (461, 460, 362, 246), (0.01, 0.05, -0.04, 0.01)),
        ),
        (
            ("pinhole", (461, 460, 362, 246), "fov", (0.92,)),
            ("atan", (461, 460, 362, 246), (0.92,)),
        ),
    ],
)
def test_kalibr(tmp_path, arguments, expected):
    path = camchain(tmp_path, *arguments)
    model, intrinsics, distortion = expected
    assert Camera.from_kalibr(path, "cam1") == Camera(model, 752, 480, intrinsics, distortion)
    first = Camera.from_kalibr(path)
    assert (first.model, first.distortion) == ("pinhole", (-0.28, 0.07, 0.0002, -0.00002))


def test_kalibr_files_that_cannot_be_used(tmp_path):
    double_sphere = camchain(tmp_path, "ds", (-0.2, 0.6, 317, 316, 724, 546))
    with pytest.raises(GeometryError, match="cam1 is ds-none, which lcdata does not have"):
        Camera.from_kalibr(double_sphere, "cam1")
    with pytest.raises(GeometryError, match="no camera 'cam2': it has cam0, cam1"):
        Camera.from_kalibr(double_sphere, "cam2")
    short = camchain(tmp_path, "omni", (461, 460, 362, 246))
    with pytest.raises(GeometryError, match=r"camchain.yaml: .*give xi fx fy cx cy"):
        Camera.from_kalibr(short, "cam1")
    words = camchain(tmp_path, "omni", ("a", "b"))
    with pytest.raises(GeometryError, match="give a list of numbers"):
        Camera.from_kalibr(words, "cam1")
    for text, reason in (("[1, 2]", "no camera"), ("a: [", "not YAML"), ("cam0: 3", "no camera_")):
        words.write_text(text)
        with pytest.raises(GeometryError, match=reason):
            Camera.from_kalibr(words)
    with pytest.raises(GeometryError, match="cannot be read"):
        Camera.from_kalibr(tmp_path / "none.yaml")


def test_calib_json_takes_the_size_from_its_images(tmp_path):
    distortion = (-0.04, 0.08, 0.0002, -0.0003, -0.04)
    path = calib_json(tmp_path, "plumb_bob", (810, 811, 822, 622), distortion)
    with pytest.raises(GeometryError, match="says no image size"):
        Camera.from_calib_json(path)
    cv2.imwrite(str(tmp_path / "second.png"), np.zeros((24, 32), np.uint8))
    assert Camera.from_calib_json(path) == Camera(
        "pinhole", 32, 24, (810, 811, 822, 622), distortion
    )
    assert Camera.from_calib_json(path, (1632, 1248)).width == 1632


def test_calib_json_has_xi_last(tmp_path):
    path = calib_json(tmp_path, "omnidir", (833, 830, 373, 253, 0.8), (-0.3, 0.1, 0.001, 0.002))
    camera = Camera.from_calib_json(path, (752, 480))
    assert camera.intrinsics == (0.8, 833, 830, 373, 253)
    panorama = calib_json(tmp_path, "equirectangular", (1920, 960))
    assert Camera.from_calib_json(panorama) == Camera("equirectangular", 1920, 960)
    zeros = calib_json(tmp_path, "atan", (833, 830, 373, 253), (0.0,))
    assert Camera.from_calib_json(zeros, (752, 480)).distortion == ()


def test_calib_json_files_that_cannot_be_used(tmp_path):
    path = calib_json(tmp_path, "eucm", (1, 2, 3, 4))
    with pytest.raises(GeometryError, match="unknown camera model 'eucm': known are plumb_bob"):
        Camera.from_calib_json(path)
    path.write_text("{}")
    with pytest.raises(GeometryError, match="no camera"):
        Camera.from_calib_json(path)
    path.write_text("{")
    with pytest.raises(GeometryError, match="not JSON"):
        Camera.from_calib_json(path)


def test_a_rig_takes_a_camera_from_its_file(tmp_path):
    camchain(tmp_path, "omni", (0.8, 833, 830, 373, 253), "radtan", (-0.3, 0.1, 0.001, 0.002))
    rig_file = tmp_path / "rig.yaml"
    rig_file.write_text("ground_truth: static\ncamera: {file: camchain.yaml, cam: cam1}\n")
    rig = load_rig(rig_file)
    expected = Camera("omni", 752, 480, (0.8, 833, 830, 373, 253), (-0.3, 0.1, 0.001, 0.002))
    assert rig.camera_model() == expected
    (tmp_path / "camchain.yaml").unlink()
    assert Rig.from_dict(rig.to_dict()).camera_model() == expected
    calib_json(tmp_path, "atan", (833, 830, 373, 253), (0.9,))
    rig_file.write_text(
        "ground_truth: static\ncamera: {file: calib.json, width: 752, height: 480}\n"
    )
    assert load_rig(rig_file).camera_model() == Camera(
        "atan", 752, 480, (833, 830, 373, 253), (0.9,)
    )


@pytest.mark.parametrize(
    ("camera", "words"),
    [
        ("{file: none.yaml}", r"rig.yaml:2: camera is .*cannot be read"),
        ("none.yaml", r"rig.yaml:2: camera is 'none.yaml'.*cannot be read"),
        ("{file: none.yaml, model: omni}", "give file or model, not both"),
        ("{width: 640, height: 480}", "0 values as intrinsics: give fx fy cx cy"),
        (
            "{model: mei, width: 640, height: 480, intrinsics: [1, 2]}",
            "unknown camera model 'mei'",
        ),
    ],
)
def test_a_rig_with_a_wrong_camera(tmp_path, camera, words):
    rig_file = tmp_path / "rig.yaml"
    rig_file.write_text(f"ground_truth: static\ncamera: {camera}\n")
    with pytest.raises(RigError, match=words):
        load_rig(rig_file)


def test_a_rig_with_a_panorama(tmp_path):
    rig_file = tmp_path / "rig.yaml"
    rig_file.write_text(
        "ground_truth: static\ncamera: {model: equirectangular, width: 1920, height: 960}\n"
    )
    rig = load_rig(rig_file)
    assert rig.camera_model() == Camera("equirectangular", 1920, 960)
    assert Rig.from_dict(rig.to_dict()).camera == rig.camera
