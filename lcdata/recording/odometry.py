"""How a LiDAR moved while it scanned, from its scans alone.

Each scan is registered to all before it by small_gicp's voxelised GICP. Within a scan the LiDAR
moves too: points are brought to the scan's middle by the velocity there, and registered again
with the velocity that follows. The middles' poses, joined by a spline, are the motion.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lcdata.errors import IntegrationError, MissingLibraryError
from lcdata.geometry import se3

Array = NDArray[np.float64]

POINTS = 10_000
"""As many of a scan are registered; more cost time and change nothing."""
NEAREST_M = 1.0
"""Nearer points may be of the person who carries the LiDAR."""
_CELL_SHARE, _CELL_M = 1 / 160, (0.02, 0.1)
"""Cell in which one point is kept: a share of the median range, within limits."""
_VOXEL = 5.0
"""Voxels of the map, in cells. Cells four times as large leave a Livox's first scans too few points
to overlap."""
_ROUNDS = 2
_NEIGHBOURS = 20
_FOR_EVER = 1_000_000
_LEAST_SHARE = 0.3
"""Of a scan's points that must find the map."""
_LARGEST_JUMP = (0.5, np.deg2rad(15.0))
"""Metres and radians that a hand's motion may differ from what its velocity foretold."""


@dataclass(frozen=True, eq=False)
class ThinScan:
    """What registration needs of a scan.

    Args:
        stamp_ns: Its stamp.
        points: (N, 3) each in the LiDAR's frame of its own moment, metres.
        seconds: (N,) since the stamp.
    """

    stamp_ns: int
    points: Array
    seconds: Array


def cell_size(points: NDArray[np.floating[Any]]) -> float:
    """Size of the cells to thin scans of such points with, metres."""
    ranges = np.linalg.norm(points[np.isfinite(points).all(axis=1)], axis=1)
    if not len(ranges):
        return _CELL_M[1]
    return float(np.clip(_CELL_SHARE * np.median(ranges), *_CELL_M))


def thin(
    stamp_ns: int, points: NDArray[np.floating[Any]], seconds: Array, cell_m: float
) -> ThinScan:
    """One point of each cell, `POINTS` at most.

    Args:
        stamp_ns: Of the scan.
        points: (N, 3) metres; those that are not finite are left out.
        seconds: (N,) since the stamp.
        cell_m: Size of a cell.
    """
    there = np.isfinite(points).all(axis=1) & np.isfinite(seconds)
    there[there] = np.linalg.norm(points[there], axis=1) >= NEAREST_M
    kept = np.flatnonzero(there)
    _, first = np.unique(np.floor(points[kept] / cell_m), axis=0, return_index=True)
    kept = kept[np.sort(first)]
    if len(kept) > POINTS:
        chosen = np.random.default_rng(len(kept)).choice(len(kept), POINTS, replace=False)
        kept = kept[np.sort(chosen)]
    return ThinScan(stamp_ns, points[kept].astype(np.float64), seconds[kept].astype(np.float64))


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Poses of the LiDAR over time, as a smooth curve.

    Args:
        start_ns: What its seconds count from.
        seconds: (N,) increasing.
        poses: (N, 4, 4) `T_map_lidar` then.
    """

    start_ns: int
    seconds: Array
    poses: Array

    def at(self, stamp_ns: int, seconds: ArrayLike = 0.0) -> Array:
        """(..., 4, 4) `T_map_lidar` at seconds (...,) since a stamp."""
        since = (stamp_ns - self.start_ns) * 1e-9 + np.asarray(seconds, float)
        result = np.zeros((*since.shape, 4, 4))
        result[..., 3, 3] = 1.0
        if len(self.seconds) == 1:
            result[:] = self.poses[0]
            return result
        translation, rotation = self._curves
        result[..., :3, 3] = translation(since)
        R = rotation(since.reshape(-1)).as_matrix()
        result[..., :3, :3] = R.reshape(*since.shape, 3, 3)
        return result

    @cached_property
    def _curves(self) -> tuple[Any, Any]:
        from scipy.interpolate import CubicSpline
        from scipy.spatial.transform import Rotation, RotationSpline

        rotations = Rotation.from_matrix(self.poses[:, :3, :3])
        translation = CubicSpline(self.seconds, self.poses[:, :3, 3], bc_type="natural")
        return translation, RotationSpline(self.seconds, rotations)

    @property
    def way_m(self) -> float:
        """How far the LiDAR went from where it started, at most."""
        return float(np.linalg.norm(self.poses[:, :3, 3] - self.poses[0, :3, 3], axis=1).max())

    @property
    def turn_rad(self) -> float:
        """How far it turned from how it started, at most."""
        R = self.poses[:, :3, :3] @ self.poses[0, :3, :3].T
        return float(np.arccos(np.clip((np.trace(R, axis1=1, axis2=2) - 1) / 2, -1, 1)).max())


def register(scans: Sequence[ThinScan], cell_m: float) -> Trajectory:
    """The motion over scans, in the frame of the first one's middle.

    Args:
        scans: One or more, in the order of time.
        cell_m: What they were thinned with.

    Raises:
        IntegrationError: A scan that does not fit those before it, named with its time.
        MissingLibraryError: small_gicp is not installed.
    """
    start_ns = scans[0].stamp_ns
    seconds = np.array([(s.stamp_ns - start_ns) * 1e-9 + _middle(s) for s in scans])
    poses = [np.eye(4)]
    if len(scans) > 1:
        # What the first scan's own motion was, the second one tells.
        voxels = _Map(cell_m)
        voxels.add(_deskewed(scans[0], np.zeros(6)), poses[0])
        _, rate = _follow(voxels, scans[1], poses[0], [], float(seconds[1] - seconds[0]))
        voxels, rates = _Map(cell_m), [rate]
        voxels.add(_deskewed(scans[0], rate), poses[0])
    for k in range(1, len(scans)):
        step = float(seconds[k] - seconds[k - 1])
        try:
            pose, rate = _follow(voxels, scans[k], poses[-1], rates, step)
        except IntegrationError as error:
            when = f"scan {k + 1} of {len(scans)}, {seconds[k]:.1f} s after the first"
            raise IntegrationError(f"{when}, {error.message}", error.remedy) from error
        voxels.add(_deskewed(scans[k], rate + (rate - rates[-1]) / 2), pose)
        poses.append(pose)
        rates.append(rate)
    return Trajectory(start_ns, seconds, np.array(poses))


def _follow(
    voxels: _Map, scan: ThinScan, before: Array, rates: list[Array], step: float
) -> tuple[Array, Array]:
    """Pose of a scan's middle, and the mean velocity since the one before it.

    Args:
        voxels: The scans so far.
        scan: The next one.
        before: 4x4 pose of the last one's middle.
        rates: Mean velocities from scan to scan so far, (6,) m/s and rad/s in the LiDAR's frame.
        step: Seconds from middle to middle.
    """
    rate = np.zeros(6) if not rates else 2 * rates[-1] - rates[-2] if rates[1:] else rates[-1]
    pose = foretold = before @ se3.exp(rate * step)
    share = 0.0
    for _ in range(_ROUNDS):
        at_middle = rate + (rate - rates[-1]) / 2 if rates else rate
        pose, share = voxels.align(_deskewed(scan, at_middle), pose)
        rate = se3.log(se3.inverse(before) @ pose) / step
    if share < _LEAST_SHARE:
        raise IntegrationError(
            f"finds only {share:.0%} of its points again", "move the LiDAR slowly, in one place"
        )
    jump = se3.log(se3.inverse(foretold) @ pose)
    far, turn = np.linalg.norm(jump[:3]), np.linalg.norm(jump[3:])
    if far > _LARGEST_JUMP[0] or turn > _LARGEST_JUMP[1]:
        raise IntegrationError(
            f"would be {far:.2f} m and {np.rad2deg(turn):.0f} deg off the motion so far",
            "move the LiDAR smoothly",
        )
    return pose, rate


def _middle(scan: ThinScan) -> float:
    """Middle of a scan, seconds since its stamp."""
    if not len(scan.seconds):
        raise IntegrationError("a scan has no point farther than 1 m", "check the LiDAR's driver")
    return float(scan.seconds.min() + scan.seconds.max()) / 2


def _deskewed(scan: ThinScan, velocity: Array) -> Array:
    """(N, 3) points in the LiDAR's frame of the scan's middle, by a velocity (m/s, rad/s)."""
    from scipy.spatial.transform import Rotation

    since = (scan.seconds - _middle(scan))[:, None]
    turned = Rotation.from_rotvec(since * velocity[3:]).apply(scan.points)
    return np.asarray(turned + since * velocity[:3])


class _Map:
    """All scans so far, as Gaussians in voxels."""

    def __init__(self, cell_m: float) -> None:
        try:
            small_gicp = import_module("small_gicp")  # an extension without type hints
        except ImportError as error:
            raise MissingLibraryError(
                "integration: dynamic needs small_gicp, which is not installed",
                "pip install 'lcdata[dynamic]'",
            ) from error
        self._gicp: Any = small_gicp
        self._reach = 2 * _VOXEL * cell_m
        self._voxels = small_gicp.GaussianVoxelMap(_VOXEL * cell_m)
        self._voxels.set_lru(_FOR_EVER, _FOR_EVER)

    def _cloud(self, points: Array) -> Any:
        cloud = self._gicp.PointCloud(points)
        self._gicp.estimate_covariances(cloud, self._gicp.KdTree(cloud), _NEIGHBOURS, 1)
        return cloud

    def add(self, points: Array, T_map_lidar: Array) -> None:
        """Add a scan."""
        self._voxels.insert(self._cloud(points), T_map_lidar)

    def align(self, points: Array, guess: Array) -> tuple[Array, float]:
        """4x4 pose of a scan, and the share of its points that found a voxel."""
        result = self._gicp.align(
            self._voxels,
            self._cloud(points),
            guess,
            max_correspondence_distance=self._reach,
            max_iterations=30,
            translation_epsilon=1e-4,
            rotation_epsilon=1e-4,
        )
        return np.array(result.T_target_source), result.num_inliers / max(len(points), 1)
