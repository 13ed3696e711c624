"""A simulated place with the tower in it: everything that sensors see, and the truth."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray

from lcdata.arm import Arm
from lcdata.geometry import se3
from lcdata.geometry.camera import Camera
from lcdata.pair import Pair
from lcdata.rig import Rig
from lcdata.simulation import camera as cameras
from lcdata.simulation.lidar import RINGS, Ouster
from lcdata.simulation.mesh import rotation
from lcdata.simulation.mounts import Mounts, default_rig, true_mounts
from lcdata.simulation.poses import arm_pose
from lcdata.simulation.raycast import RayCaster
from lcdata.simulation.scenes import Scene, build_scene, scenario_rng

Array = NDArray[np.float64]

_SCENE, _TOWER, _POSE, _MOVING, _LIDAR, _CAMERA = range(6)
"""Streams of chance, see `scenario_rng`."""


@dataclass(frozen=True, eq=False)
class World:
    """A scenario, a rig and a seed.

    Args:
        scenario: parking_lot, gym or yard.
        seed: Fixes layout, mounts, poses and noise.
        rig: The tower as measured by hand.
    """

    scenario: str
    seed: int
    rig: Rig

    @cached_property
    def scene(self) -> Scene:
        """What stands around the tower."""
        return build_scene(self.scenario, self.seed)

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
        """4x4 pose of the arm's base: the tower stands nearly upright, turned a little."""
        rng = scenario_rng(self.seed, self.scenario, _TOWER)
        T = np.eye(4)
        yaw, pitch, roll = rng.normal(scale=np.deg2rad([6.0, 0.7, 0.7]))
        T[:3, :3] = rotation(yaw, pitch, roll)
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

    def scan(
        self, around: RayCaster, lidar: Ouster, pose_index: int, pair_index: int
    ) -> NDArray[np.void]:
        """One LiDAR scan: records of `lidar.POINT`."""
        rng = scenario_rng(self.seed, self.scenario, _LIDAR, pose_index, pair_index)
        return lidar.scan(around, self.T_world_lidar, self.scene.light.near_infrared, rng)

    def picture(
        self,
        around: RayCaster,
        camera: Camera,
        positions: Array,
        pose_index: int,
        pair_index: int,
    ) -> NDArray[np.uint8]:
        """One image, (H, W, 3) RGB, with the arm at joint positions."""
        rng = scenario_rng(self.seed, self.scenario, _CAMERA, pose_index, pair_index)
        T_world_camera = self.T_world_base @ self.T_base_camera(positions)
        return cameras.render(around, self.scene.light, camera, T_world_camera, rng)


@lru_cache(maxsize=4)
def _world(scenario: str, seed: int) -> World:
    return World(scenario, seed, default_rig())


def render_pair(
    scenario: str,
    *,
    pose_index: int = 0,
    pair_index: int = 0,
    seed: int = 0,
    columns: int = 2048,
    width: int = 1280,
    height: int = 720,
) -> Pair:
    """One simulated pair with its exact extrinsic, without a recording in between.

    Args:
        scenario: parking_lot, gym or yard.
        pose_index: Number of the arm pose.
        pair_index: Number of the pair in the pose: other noise, and people and leaves moved.
        seed: Fixes layout, mounts, poses and noise.
        columns: LiDAR measurements a turn: 512, 1024 or 2048.
        width: Image width in pixels.
        height: Image height in pixels.

    Returns:
        The pair. Its `T_camera_lidar` is exact: that of the true mounts and joint positions.
    """
    world = _world(scenario, seed)
    positions = world.pose(pose_index)
    around = world.surroundings(pose_index, pair_index)
    records = world.scan(around, Ouster(columns), pose_index, pair_index)
    camera = cameras.zed2i(width, height)
    points = np.stack([records[axis] for axis in "xyz"], axis=-1)
    points[records["range"] == 0] = np.nan
    pose_id = f"{scenario}/pose_{pose_index:03d}"
    return Pair(
        image=world.picture(around, camera, positions, pose_index, pair_index),
        points=points,
        intensity=np.ascontiguousarray(records["intensity"]),
        camera=camera,
        organised=(RINGS, columns),
        ring=np.ascontiguousarray(records["ring"]),
        pair_id=f"{pose_id}/{pair_index:03d}",
        pose_id=pose_id,
        scenario=scenario,
        T_camera_lidar=world.T_camera_lidar(positions),
        covariance=np.zeros((6, 6)),
    )
