"""An arm: its URDF, its joints' zero points, forward kinematics of one pose or of a million."""

from __future__ import annotations

from lcdata.arm.model import Arm, read_joint_offsets
from lcdata.arm.urdf import find_urdf, model_directory

__all__ = ["Arm", "find_urdf", "model_directory", "read_joint_offsets"]
