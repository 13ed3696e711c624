"""The cost of the NID methods along the axes of a pose: what a search sees around it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lcdata.errors import CalibrationError
from lcdata.features.nid_objective import nid_features, objective
from lcdata.features.nid_views import whereabouts
from lcdata.geometry import se3
from lcdata.pair import Pair

Array = NDArray[np.float64]

REACH_M, REACH_DEG = 0.2, 2.0
MOST_M, MOST_DEG = 2.0, 45.0
STEPS = 81
POINTS = 20_000
"""Points of a slice: more change it by less than its line is thick."""


@dataclass(frozen=True, eq=False)
class Slice:
    """The cost along six lines through a pose, one an axis.

    Args:
        at: (6,) the pose itself, metres then radians from the landscape's middle.
        cost: Of the pose, soft bins.
        soft: (6, K) with soft bins, as the gradient methods minimise it.
        hard: (6, K) with hard bins, as the paper counts; infinite where too few points are in
            view.
    """

    at: Array
    cost: float
    soft: Array
    hard: Array


@dataclass(frozen=True, eq=False)
class Landscape:
    """Slices of the cost through several poses, in the coordinates of one of them.

    A pose is exp(xi) T with xi = (translation, rotation) in the camera frame and T the middle.
    A slice through a pose keeps five of its coordinates and varies the sixth.

    Args:
        offsets: (6, K) coordinates, metres then radians; 0, the middle, is one of them.
        slices: By the pose's name.
        with_edges: Whether the cost is NID / 0.01 + edges / 0.05 instead of NID.
    """

    offsets: Array
    slices: Mapping[str, Slice]
    with_edges: bool

    def lowest(self, name: str) -> Array:
        """(6,) where each line through a pose has its lowest soft cost, metres then radians."""
        least = np.argmin(self.slices[name].soft, axis=1)
        return np.asarray(self.offsets[np.arange(6), least])


def landscape(
    pair: Pair,
    poses: Mapping[str, Array],
    middle: str,
    *,
    reach_m: float = REACH_M,
    reach_deg: float = REACH_DEG,
    steps: int = STEPS,
    with_edges: bool = False,
) -> Landscape:
    """Slices of the NID of a pair through poses.

    What is hidden is decided once, at the middle, as the methods do between their rounds: costs
    of different poses compare the same points.

    Args:
        pair: The pair; its ground truth is not used.
        poses: 4x4 `T_camera_lidar` by name.
        middle: Name of the pose that offsets are measured from.
        reach_m: How far the translations reach to each side, metres.
        reach_deg: How far the rotations reach to each side, degrees.
        steps: Poses on each axis; made odd.
        with_edges: Slice the cost of `nid_edge` instead of NID.

    Raises:
        CalibrationError: No intensities or all alike, no point in view, impossible options.
    """
    check_reach(reach_m, reach_deg)
    if not 3 <= steps <= 1001:
        raise CalibrationError(f"{steps} steps in a landscape", "give 3 to 1001")
    T_middle = poses[middle]
    features = nid_features(pair, with_edges)
    current = objective([features], T_middle, with_edges)
    if not current.inside:
        raise CalibrationError(
            f"pair {pair.pair_id}: no point in view: "
            + whereabouts(features.image, features.points, T_middle),
            "a landscape needs a pose from which the camera sees points",
        )
    current = current.thinned(POINTS, np.random.default_rng(0))
    shares = np.linspace(-1.0, 1.0, steps | 1)
    offsets = np.repeat([reach_m, np.deg2rad(reach_deg)], 3)[:, None] * shares

    def slice_through(T: Array) -> Slice:
        at = se3.log(T @ se3.inverse(T_middle))
        lines = np.tile(at, (6, len(shares), 1))
        lines[np.arange(6), :, np.arange(6)] = offsets
        line_poses = np.array([se3.exp(xi) @ T_middle for xi in lines.reshape(-1, 6)])
        soft = np.array([current.soft(pose)[0] for pose in line_poses])
        hard = current.hard(line_poses)
        return Slice(at, current.soft(T)[0], soft.reshape(6, -1), hard.reshape(6, -1))

    return Landscape(offsets, {name: slice_through(T) for name, T in poses.items()}, with_edges)


def check_reach(reach_m: float, reach_deg: float) -> None:
    """Refuse half-widths that make no sense.

    Raises:
        CalibrationError: Not above 0, or too large.
    """
    for value, most, unit in ((reach_m, MOST_M, "m"), (reach_deg, MOST_DEG, "deg")):
        if not 0 < value <= most:
            raise CalibrationError(
                f"the landscape cannot reach {value:g} {unit} to each side",
                f"give a number above 0, at most {most:g}",
            )
