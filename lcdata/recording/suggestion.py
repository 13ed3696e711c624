"""A rig file to start from, out of what a recording shows."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from lcdata.recording.summary import Summary

LINK = """\
{name}:  # MEASURE: {what}
  translation_m: [0.0, 0.0, 0.0]  # MEASURE
  rotation_rpy_deg: [0.0, 0.0, 0.0]  # MEASURE: about the fixed x, then y, then z axis
  translation_std_m: 0.005  # how well you measured, one standard deviation
  rotation_std_deg: 0.5
"""

NOT_IDENTITY = """\
# Zeros stand where you must measure: with them, build runs and its ground truth is wrong.
"""


def suggest_rig(summary: Summary) -> str:
    """YAML that `load_rig` accepts.

    Where something must be measured or named by hand, a comment in capitals says so.
    """
    parts = [f"# Rig for {summary.scenario}, suggested by `lcdata info`."]
    parts.append(_arm(summary) if summary.ground_truth == "arm" else _static(summary))
    parts.append(_topics(summary))
    if summary.camera is None and not summary.candidates.get("camera_info"):
        parts.append(_camera(summary))
    if any(clock.note for clock in summary.clocks):
        parts.append("stamps: bag  # the headers' clocks do not agree\n")
    if summary.cloud and summary.cloud.livox:
        parts.append("integration: static  # no two scans are alike: together they are dense")
    return "\n".join(part.rstrip() for part in parts if part) + "\n"


def _static(summary: Summary) -> str:
    if summary.T_camera_lidar is not None:
        source = "the extrinsic comes from the static transforms"
        return f"ground_truth: static  # {source}"
    return (
        "ground_truth: static\n"
        + NOT_IDENTITY
        + _link("T_camera_lidar", f"{_lidar(summary)} in {_camera_frame(summary)}")
    )


def _arm(summary: Summary) -> str:
    model = summary.arm_model
    named = f"  model: {model}" if model else "  model: gen3_lite  # NAME: your arm's URDF file"
    return (
        "ground_truth: arm\n"
        f"arm:\n{named}\n"
        "  base_frame: base_link\n"
        "  effector_frame: end_effector_link  # the frame that T_camera_effector starts from\n"
        "  encoder_std_deg: 0.02\n"
        + NOT_IDENTITY
        + _link("T_camera_effector", f"the effector's frame in {_camera_frame(summary)}")
        + _link("T_base_lidar", f"{_lidar(summary)} in the arm's base frame")
    )


def _lidar(summary: Summary) -> str:
    return f"the LiDAR's frame {summary.cloud.frame}" if summary.cloud else "the LiDAR's frame"


def _camera_frame(summary: Summary) -> str:
    named = f" {summary.image.frame}" if summary.image else ""
    return f"the camera's frame{named} (x right, y down, z forward)"


def _link(name: str, what: str) -> str:
    return LINK.format(name=name, what=what)


def _topics(summary: Summary) -> str:
    """The first candidate of each ambiguous role; nothing if `auto` finds all of them."""
    if any(topic.role for topic in summary.topics):
        return ""
    lines = [
        f"  {role}: {names[0]}  # NAME: or {', '.join(names[1:])}"
        for role, names in summary.candidates.items()
        if len(names) > 1
    ]
    return "\n".join(["topics:", *lines]) if lines else ""


def _camera(summary: Summary) -> str:
    size = (summary.image.width, summary.image.height) if summary.image else (1280, 720)
    width, height = (int(n) or d for n, d in zip(size, (1280, 720), strict=True))
    focal = float(np.round(width / 1.2, 1))
    centre = ((width - 1) / 2, (height - 1) / 2)
    return (
        "camera:  # CALIBRATE: no CameraInfo in the recording\n"
        f"  model: pinhole\n  width: {width}\n  height: {height}\n"
        f"  intrinsics: [{focal}, {focal}, {centre[0]}, {centre[1]}]  # CALIBRATE: fx fy cx cy\n"
        "  distortion: []  # CALIBRATE: k1 k2 p1 p2 k3"
    )
