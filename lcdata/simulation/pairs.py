"""Simulated pairs with exact extrinsics, without a recording in between."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from lcdata.errors import SimulationError
from lcdata.geometry import se3
from lcdata.geometry.camera import Camera
from lcdata.pair import Pair
from lcdata.recording import fields
from lcdata.simulation import camera as cameras
from lcdata.simulation.echoes import Motion, poses_at
from lcdata.simulation.lidar import Ouster
from lcdata.simulation.lidars import Lidar, make_lidar
from lcdata.simulation.mounts import car_extrinsic, default_rig
from lcdata.simulation.world import World

Array = NDArray[np.float64]

MERGED_SCANS = 20
"""As many as make a dense cloud: two seconds."""


MOUNTS = ("arm", "car")
"""What carries the camera."""


@lru_cache(maxsize=4)
def _world(scenario: str, seed: int, stop: int | None = None) -> World:
    return World(scenario, seed, default_rig(), stop)


@dataclass(frozen=True, eq=False)
class SemanticMasks:
    """What the pixels of a simulated image show, exactly.

    Args:
        lane: (H, W) whether the middle of a pixel sees a road marking.
        pole: (H, W) whether it sees a pole: of a light, a sign, a signal, a telegraph line.
    """

    lane: NDArray[np.bool_]
    pole: NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class _Setting:
    """A world, and where camera and LiDAR are in it."""

    world: World
    T_camera_lidar: Array
    T_world_camera: Array


def _setting(
    scenario: str, pose_index: int, seed: int, mount: str | None, T_camera_lidar: Array | None
) -> _Setting:
    """Place the sensors.

    Raises:
        SimulationError: Unknown mount or scenario.
    """
    mount = mount or ("car" if scenario == "road" else "arm")
    if mount not in MOUNTS:
        raise SimulationError(f"unknown mount {mount!r}", f"choose from {', '.join(MOUNTS)}")
    if mount == "car":
        world = _world(scenario, seed, pose_index)
        T = car_extrinsic(seed) if T_camera_lidar is None else T_camera_lidar
        return _Setting(world, T, world.T_world_lidar @ se3.inverse(T))
    world = _world(scenario, seed)
    if T_camera_lidar is not None:
        return _Setting(world, T_camera_lidar, world.T_world_lidar @ se3.inverse(T_camera_lidar))
    positions = world.pose(pose_index)
    return _Setting(world, world.T_camera_lidar(positions), world.T_world_camera(positions))


def render_pair(
    scenario: str,
    *,
    pose_index: int = 0,
    pair_index: int = 0,
    seed: int = 0,
    lidar: str = "os1_128",
    columns: int | None = None,
    scans: int | None = None,
    moving: bool = False,
    mount: str | None = None,
    camera: Camera | None = None,
    T_camera_lidar: Array | None = None,
    width: int = 1280,
    height: int = 720,
) -> Pair:
    """One simulated pair with its exact extrinsic, without a recording in between.

    Args:
        scenario: parking_lot, gym, yard or road.
        pose_index: Number of the arm pose; of a car, of the place that it has come to. Each place
            is laid out anew, and the extrinsic stays.
        pair_index: Number of the pair in the pose: other noise, and people and leaves moved.
        seed: Fixes layout, mounts, poses and noise.
        lidar: os1_128, os1_64, avia or pandar_64.
        columns: Measurements a turn of a spinning LiDAR: 512, 1024 or 2048; None for 2048 of
            the os1_128, 1024 of the os1_64.
        scans: Scans to merge into one dense cloud without order, of what returned. None: one of
            a spinning LiDAR that stands still, 20 of others. Those of a spinning LiDAR that
            stands still only repeat each other.
        moving: A hand moves the LiDAR up and down; its scans are merged by its true motion, at
            every point's own time, into the frame that it started from.
        mount: arm (the tower of the recordings) or car (a camera that is fixed below the LiDAR
            and looks ahead); None for car on the road, arm elsewhere.
        camera: Any model; by default a ZED 2i of `width` x `height`.
        T_camera_lidar: 4x4 extrinsic of a camera that is fixed to the LiDAR; None for the one on
            the arm, whose extrinsic follows from the pose, or on the car, whose extrinsic
            follows from the seed.
        width: Image width in pixels.
        height: Image height in pixels.

    Returns:
        The pair. Its `T_camera_lidar` is exact: that of the true mounts and joint positions.

    Raises:
        SimulationError: Unknown scenario, LiDAR or mount.
    """
    setting = _setting(scenario, pose_index, seed, mount, T_camera_lidar)
    world = setting.world
    around = world.surroundings(pose_index, pair_index)
    model = make_lidar(lidar, columns)
    spins = isinstance(model, Ouster)
    count = scans or (1 if spins and not moving else MERGED_SCANS)
    motion = world.hand_motion(pose_index, pair_index) if moving else None
    records = [world.scan(around, model, pose_index, pair_index, k, motion) for k in range(count)]
    whole = spins and count == 1 and not moving
    points, intensity = _merged(records, model, motion, keep_order=whole)
    camera = camera or cameras.zed2i(width, height)
    pose_id = f"{scenario}/pose_{pose_index:03d}"
    return Pair(
        image=world.picture(around, camera, setting.T_world_camera, pose_index, pair_index),
        points=points,
        intensity=intensity,
        camera=camera,
        organised=(model.rings, model.columns) if isinstance(model, Ouster) and whole else None,
        ring=np.ascontiguousarray(records[0]["ring"]) if whole else None,
        pair_id=f"{pose_id}/{pair_index:03d}",
        pose_id=pose_id,
        scenario=scenario,
        T_camera_lidar=setting.T_camera_lidar,
        covariance=np.zeros((6, 6)),
    )


def semantic_masks(
    scenario: str = "road",
    *,
    pose_index: int = 0,
    pair_index: int = 0,
    seed: int = 0,
    mount: str | None = None,
    camera: Camera | None = None,
    T_camera_lidar: Array | None = None,
    width: int = 1280,
    height: int = 720,
) -> SemanticMasks:
    """What the image of `render_pair` with the same arguments shows, by one ray a pixel.

    Raises:
        SimulationError: Unknown scenario or mount.
    """
    setting = _setting(scenario, pose_index, seed, mount, T_camera_lidar)
    around = setting.world.surroundings(pose_index, pair_index)
    camera = camera or cameras.zed2i(width, height)
    seen = cameras.kinds(around, camera, setting.T_world_camera, ("lane", "pole"))
    return SemanticMasks(lane=seen["lane"], pole=seen["pole"])


def _merged(
    scans: Sequence[NDArray[np.void]], lidar: Lidar, motion: Motion | None, *, keep_order: bool
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Points of scans in the first one's frame, and their intensities.

    Without the order of the scan only points that returned are left; with it others are NaN.
    """
    clouds, strengths = [], []
    for number, records in enumerate(scans):
        points = fields.points(records)
        name = fields.intensity_name(records.dtype)
        time = fields.point_time(records, unit="ns")
        assert name is not None
        assert time is not None
        kept = slice(None) if keep_order else np.isfinite(points[:, 0])
        points = points[kept]
        if motion is not None:
            times = (records[time.name][kept] + number * lidar.scan_ns) * 1e-9
            T = poses_at(motion, times)
            points = np.einsum("nij,nj->ni", T[:, :3, :3], points) + T[:, :3, 3]
        clouds.append(points)
        strengths.append(records[name][kept])
    return np.concatenate(clouds, dtype=np.float32), np.concatenate(strengths, dtype=np.float32)
