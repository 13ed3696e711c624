"""A simulated place with the tower in it: everything that sensors see, and the truth."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from lcdata.arm import Arm
from lcdata.geometry import se3
from lcdata.geometry.camera import Camera
from lcdata.rig import Rig
from lcdata.simulation import camera as cameras
from lcdata.simulation.echoes import Motion
from lcdata.simulation.lidars import Lidar
from lcdata.simulation.mesh import rotation
from lcdata.simulation.motion import HandMotion
from lcdata.simulation.mounts import Mounts, true_mounts
from lcdata.simulation.poses import arm_pose
from lcdata.simulation.raycast import RayCaster
from lcdata.simulation.scenes import Scene, build_scene, scenario_rng

Array = NDArray[np.float64]

_SCENE, _TOWER, _POSE, _MOVING, _LIDAR, _CAMERA = range(6)
_HAND = 7
"""Streams of chance, see `scenario_rng`."""


@dataclass(frozen=True, eq=False)
class World:
    """A scenario, a rig and a seed.

    Args:
        scenario: parking_lot, gym, yard or road.
        seed: Fixes layout, mounts, poses and noise.
        rig: The tower as measured by hand.
        stop: Number of the place that a car with the LiDAR has come to, each laid out on its
            own; None for the tower, which stays.
    """

    scenario: str
    seed: int
    rig: Rig
    stop: int | None = None

    @cached_property
    def scene(self) -> Scene:
        """What stands around the tower."""
        return build_scene(self.scenario, self.seed, self.stop or 0)

    @cached_property
    def mounts(self) -> Mounts:
        """Where the sensors truly sit."""
        return true_mounts(self.rig, self.seed)

    @cached_property
    def arm(self) -> Arm:
        """The arm; its true joint positions are what `pose` gives."""
        return self.rig.load_arm()

    @cached_property
    def T_world_base(self) -> Array:
        """4x4 pose of the arm's base: the tower stands nearly upright, turned a little.

        A car keeps to its lane, so what it carries is turned less.
        """
        later = () if self.stop is None else (1 + self.stop,)
        rng = scenario_rng(self.seed, self.scenario, _TOWER, *later)
        T = np.eye(4)
        spread_deg = [6.0, 0.7, 0.7] if self.stop is None else [1.0, 0.5, 0.5]
        yaw, pitch, roll = rng.normal(scale=np.deg2rad(spread_deg))
        T[:3, :3] = rotation(yaw, pitch, roll)
        if self.stop is not None:
            T[1, 3] = rng.normal(scale=0.15)
        T[2, 3] = self.scene.base_height_m
        return T

    @cached_property
    def T_world_lidar(self) -> Array:
        """4x4 true pose of the LiDAR."""
        return self.T_world_base @ self.mounts.T_base_lidar

    def pose(self, index: int) -> Array:
        """(n,) true joint positions of an arm pose, radians."""
        start = scenario_rng(self.seed, self.scenario, _POSE).uniform(size=3)
        rng = scenario_rng(self.seed, self.scenario, _POSE, index)
        T_effector_camera = se3.inverse(self.mounts.T_camera_effector)
        return arm_pose(self.arm, T_effector_camera, index, start, rng)

    def T_world_camera(self, positions: Array) -> Array:
        """4x4 true pose of the camera on the arm at joint positions."""
        return self.T_world_base @ self.T_base_camera(positions)

    def T_base_camera(self, positions: Array) -> Array:
        """4x4 true pose of the camera on the arm at joint positions."""
        return self.arm.forward(positions) @ se3.inverse(self.mounts.T_camera_effector)

    def T_camera_lidar(self, positions: Array) -> Array:
        """4x4 true extrinsic at joint positions."""
        return se3.inverse(self.T_base_camera(positions)) @ self.mounts.T_base_lidar

    def surroundings(self, pose_index: int, pair_index: int) -> RayCaster:
        """The scene with people and leaves as they are for one pair."""
        rng = scenario_rng(self.seed, self.scenario, _MOVING, pose_index, pair_index)
        return RayCaster(self.scene.fixed + self.scene.moving(rng))

    def hand_motion(self, pose_index: int, pair_index: int) -> HandMotion:
        """How a hand would move the LiDAR from here."""
        return HandMotion.draw(
            scenario_rng(self.seed, self.scenario, _HAND, pose_index, pair_index)
        )

    def scan(
        self,
        around: RayCaster,
        lidar: Lidar,
        pose_index: int,
        pair_index: int,
        number: int = 0,
        motion: Motion | None = None,
    ) -> NDArray[np.void]:
        """One LiDAR scan, the first or a later one of a pair.

        Args:
            around: From `surroundings`.
            lidar: Which.
            pose_index: Number of the arm pose.
            pair_index: Number of the pair in the pose.
            number: Number of the scan in the pair; they follow each other without a gap.
            motion: `T_start_now` of a LiDAR that moves, at seconds since the first scan.

        Returns:
            Records as the driver lays them out, each point in the LiDAR's frame of its moment.
        """
        later = (number,) if number else ()
        rng = scenario_rng(self.seed, self.scenario, _LIDAR, pose_index, pair_index, *later)
        start_s = number * lidar.scan_ns * 1e-9
        T_world_lidar: Array | Motion = self.T_world_lidar
        if motion is not None:

            def T_world_lidar(times: Array) -> Array:
                return self.T_world_lidar @ motion(start_s + times)

        # every pair starts at another phase of a rosette
        phase_s = start_s + 60.0 * float(np.modf(0.618034 * (pair_index + 1))[0])
        return lidar.scan(around, T_world_lidar, self.scene.light.near_infrared, rng, phase_s)

    def picture(
        self,
        around: RayCaster,
        camera: Camera,
        T_world_camera: Array,
        pose_index: int,
        pair_index: int,
    ) -> NDArray[np.uint8]:
        """One image, (H, W, 3) RGB, of a camera at a 4x4 pose."""
        rng = scenario_rng(self.seed, self.scenario, _CAMERA, pose_index, pair_index)
        return cameras.render(around, self.scene.light, camera, T_world_camera, rng)
