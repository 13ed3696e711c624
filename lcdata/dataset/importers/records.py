"""What the index of a data set says of published pairs."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lcdata.dataset import cloud_file
from lcdata.dataset.importers.pair_files import Planned
from lcdata.dataset.importers.published import Item, Published
from lcdata.dataset.schema import PairRecord, PoseRecord, Scenario
from lcdata.geometry import se3
from lcdata.recording import fields

Array = NDArray[np.float64]


def covariance_of_item(item: Item) -> Array:
    """6x6 covariance of a pair's extrinsic; NaN where it is unknown."""
    return np.full((6, 6), np.nan) if item.covariance is None else item.covariance


def pose_records(plan: Sequence[Planned], records: dict[str, PairRecord]) -> list[PoseRecord]:
    """Poses of the pairs that were written."""
    members: dict[str, list[Item]] = {}
    for planned in plan:
        if planned.pair_id in records:
            members.setdefault(planned.pose_id, []).append(planned.item)
    poses = []
    for pose_id, items in members.items():
        stamps = [stamp for i in items for stamp in (i.stamp_image_ns, i.stamp_lidar_ns)]
        covariance = covariance_of_item(items[0])
        poses.append(
            PoseRecord(
                pose_id=pose_id,
                scenario=pose_id.rpartition("/")[0],
                start_ns=min(stamps),
                end_ns=max(stamps),
                joint_positions=np.empty(0),
                joint_positions_std=np.empty(0),
                samples=0,
                T_camera_lidar=items[0].T_camera_lidar,
                covariance=covariance,
                T_camera_effector=None,
                T_effector_base=None,
                T_base_lidar=None,
                budget={} if np.isnan(covariance).any() else {"T_camera_lidar": covariance},
            )
        )
    return poses


def scenario_entries(
    out: Path,
    scenarios: Sequence[Published],
    plan: Sequence[Planned],
    records: dict[str, PairRecord],
) -> dict[str, Scenario]:
    """What dataset.json says of each scenario that has pairs."""
    first: dict[str, Planned] = {}
    for planned in plan:
        if planned.pair_id in records:
            first.setdefault(planned.scenario.name, planned)
    return {
        scenario.name: Scenario(
            camera=scenario.camera,
            topics={
                "lidar": scenario.lidar,
                "image": scenario.image,
                "camera_info": None,
                "joint_states": None,
            },
            lidar_frame=scenario.lidar,
            camera_frame=scenario.image,
            warnings=(
                *(w.encode(errors="backslashreplace").decode() for w in scenario.warnings),
                *_doubts(out, records[first[scenario.name].pair_id], first[scenario.name]),
            ),
        )
        for scenario in scenarios
        if scenario.name in first
    }


def _doubts(out: Path, record: PairRecord, planned: Planned) -> Iterator[str]:
    """What the first pair of a scenario makes doubtful."""
    records, _, _ = cloud_file.read(out / record.cloud)
    if fields.intensity_name(records.dtype) is None:
        yield (
            f"{planned.scenario.name}: its clouds have no intensity: methods that compare "
            "intensities cannot use them"
        )
    points = fields.points(records).astype(float)
    points = points[np.isfinite(points).all(axis=1)]
    _, inside = planned.scenario.camera.project(se3.apply(planned.item.T_camera_lidar, points))
    if not inside.any():
        yield (
            f"{record.pair_id}: no point of its cloud lies in its image: does T_camera_lidar map "
            "camera points to LiDAR points? It must be the other way round"
        )
