"""Hand-eye refinement: both hand-measured links from estimates over many arm poses.

lcdata.handeye.solve(T_effector_base, T_camera_lidar).T_camera_effector
"""

from __future__ import annotations

from lcdata.groundtruth.handeye import HandEye, Joints, Prior, Residuals, solve

__all__ = ["HandEye", "Joints", "Prior", "Residuals", "solve"]
