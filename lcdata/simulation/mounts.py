"""The tower: the rig as measured by hand, and the mounts as they truly are."""

from __future__ import annotations

from dataclasses import dataclass
from zlib import crc32

import numpy as np
import yaml
from numpy.typing import NDArray

from lcdata.arm import Arm
from lcdata.errors import SimulationError
from lcdata.geometry import se3
from lcdata.rig import Rig
from lcdata.rig_links import Link
from lcdata.simulation.mesh import rotation
from lcdata.simulation.poses import FORWARD

Array = NDArray[np.float64]

RIG = """\
ground_truth: arm
note: Simulated tower with an Ouster OS1-128, a ZED 2i-like camera and a Kinova Gen3 lite.
simulated: true
arm:
  model: gen3_lite
  base_frame: base_link
  effector_frame: end_effector_link
  joint_offset_std_deg: 0.0
  encoder_std_deg: 0.02
T_camera_effector:
  translation_m: [0.062, 0.041, -0.035]
  rotation_rpy_deg: [1.5, -2.0, 90.0]
  translation_std_m: 0.003
  rotation_std_deg: 0.15
T_base_lidar:
  translation_m: [-0.18, 0.03, 0.82]
  rotation_rpy_deg: [0.5, 1.0, -2.0]
  translation_std_m: 0.004
  rotation_std_deg: 0.15
"""
"""What somebody with a ruler and a level wrote down about the simulated tower."""


def default_rig(
    joint_offset_std_deg: float = 0.0, lidar: str = "os1_128", camera: str = "zed2i"
) -> Rig:
    """The simulated tower as measured by hand.

    Args:
        joint_offset_std_deg: How far its joints' zero points may be off.
        lidar: What stands on it; an avia's scans are to be merged.
        camera: What the arm carries.
    """
    content = yaml.safe_load(RIG)
    content["arm"]["joint_offset_std_deg"] = joint_offset_std_deg
    if (lidar, camera) != ("os1_128", "zed2i"):
        content["note"] = (
            f"Simulated tower with an {lidar} LiDAR, a {camera} camera and a Kinova Gen3 lite."
        )
    if lidar == "avia":
        content["integration"] = "static"
    return Rig.from_dict(content, "the simulator's rig")


@dataclass(frozen=True, eq=False)
class Mounts:
    """Two rigid links of the tower.

    Args:
        T_camera_effector: 4x4.
        T_base_lidar: 4x4.
    """

    T_camera_effector: Array
    T_base_lidar: Array


def true_mounts(rig: Rig, seed: int) -> Mounts:
    """Where the sensors truly sit: off the rig's values by errors drawn from its deviations.

    They depend on the rig and the seed only, so that all scenarios of one seed share a tower.

    Raises:
        SimulationError: The rig is not of an arm or has no standard deviations.
    """
    camera, lidar = rig.T_camera_effector, rig.T_base_lidar
    if camera is None or lidar is None:
        raise SimulationError(
            f"the rig has ground_truth: {rig.ground_truth}", "a simulation needs ground_truth: arm"
        )
    rng = np.random.default_rng([seed, crc32(b"mounts")])
    return Mounts(_moved(camera, "T_camera_effector", rng), _moved(lidar, "T_base_lidar", rng))


def _moved(link: Link, name: str, rng: np.random.Generator) -> Array:
    if not np.isfinite(link.covariance).all():
        raise SimulationError(
            f"{name} has no standard deviations to draw its error from",
            "give translation_std_m and rotation_std_deg",
        )
    xi = rng.normal(size=6) * np.sqrt(np.diag(link.covariance))
    return se3.exp(xi) @ link.T


def joint_offsets(arm: Arm, seed: int, std_deg: float) -> Array:
    """(n,) constant errors of the joints' zero points in radians: truth minus reading."""
    rng = np.random.default_rng([seed, crc32(b"joint offsets")])
    return np.deg2rad(rng.normal(size=len(arm.joint_names)) * std_deg)


def car_extrinsic(seed: int) -> Array:
    """4x4 T_camera_lidar of a car: the camera below the LiDAR on its roof, looking ahead.

    It depends on the seed only: all scenarios of one seed share a car.
    """
    rng = np.random.default_rng([seed, crc32(b"car")])
    T_lidar_camera = np.eye(4)
    yaw, pitch, roll = np.deg2rad(rng.normal([0.0, 2.0, 0.0], [1.5, 1.5, 1.0]))
    T_lidar_camera[:3, :3] = rotation(yaw, pitch, roll) @ FORWARD
    T_lidar_camera[:3, 3] = rng.uniform([0.1, -0.3, -0.45], [0.6, 0.3, -0.1])
    return se3.inverse(T_lidar_camera)
