"""What a new ground truth changes: which inputs, and how far the poses move."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from lcdata.arm import Arm
from lcdata.dataset import schema
from lcdata.dataset.reader import Dataset
from lcdata.dataset.schema import DatasetInfo, PoseRecord
from lcdata.geometry import se3
from lcdata.groundtruth.budget import Variances, variances

SAME = 1e-9
"""Metres, and relative for covariances: smaller differences make no other version."""


@dataclass(frozen=True)
class PoseChange:
    """What became of one pose.

    Args:
        pose_id: The pose.
        translation_mm: How far the extrinsic's translation moved.
        rotation_deg: How far it turned.
        before: Variances of the former ground truth, m^2 and rad^2; NaN where unknown.
        after: Of the new one.
    """

    pose_id: str
    translation_mm: float
    rotation_deg: float
    before: Variances
    after: Variances


@dataclass(frozen=True, eq=False)
class Regeneration:
    """A new ground truth, and how it differs from the former one.

    Args:
        dataset: The data set as it was.
        info: dataset.json as it will be.
        poses: Rows of poses.parquet as they will be.
        arm: The arm of the new ground truth; None without one.
        changes: What changed, pose by pose.
        inputs: Which values of rig and arm changed, a line each.
        ignored: Parts of the rig that differ and were not used: they chose the pairs.
    """

    dataset: Dataset
    info: DatasetInfo
    poses: tuple[PoseRecord, ...]
    arm: Arm | None
    changes: tuple[PoseChange, ...]
    inputs: tuple[str, ...]
    ignored: tuple[str, ...]

    @property
    def before(self) -> str:
        """The former version."""
        return self.dataset.info.groundtruth_version

    @property
    def after(self) -> str:
        """The new version; the former one if no value changed."""
        return self.info.groundtruth_version

    @cached_property
    def moved(self) -> dict[str, float]:
        """Medians and maxima over the poses, and the root mean square uncertainties."""
        table = np.array([(c.translation_mm, c.rotation_deg) for c in self.changes])
        sigma = np.array([(*c.before, *c.after) for c in self.changes]).mean(axis=0) ** 0.5
        return {
            "median_mm": float(np.median(table[:, 0])),
            "max_mm": float(table[:, 0].max()),
            "median_deg": float(np.median(table[:, 1])),
            "max_deg": float(table[:, 1].max()),
            "sigma_before_mm": float(1e3 * sigma[0]),
            "sigma_before_deg": float(np.rad2deg(sigma[1])),
            "sigma_after_mm": float(1e3 * sigma[2]),
            "sigma_after_deg": float(np.rad2deg(sigma[3])),
        }

    def to_dict(self) -> dict[str, Any]:
        """Plain values."""
        return {
            "dataset": self.dataset.path,
            "before": self.before,
            "after": self.after,
            "changed": self.before != self.after,
            "inputs": list(self.inputs),
            "ignored": list(self.ignored),
            **self.moved,
            "poses": [
                {
                    "pose_id": c.pose_id,
                    "translation_mm": c.translation_mm,
                    "rotation_deg": c.rotation_deg,
                    "sigma_before_mm": 1e3 * c.before.translation**0.5,
                    "sigma_before_deg": float(np.rad2deg(c.before.rotation**0.5)),
                    "sigma_after_mm": 1e3 * c.after.translation**0.5,
                    "sigma_after_deg": float(np.rad2deg(c.after.rotation**0.5)),
                }
                for c in self.changes
            ],
        }


def is_same(old: PoseRecord, new: PoseRecord) -> bool:
    """Whether only rounding differs, as it does from one machine to another."""
    scale = SAME * float(np.abs(old.covariance).max())
    return np.allclose(new.T_camera_lidar, old.T_camera_lidar, rtol=0, atol=SAME) and np.allclose(
        new.covariance, old.covariance, rtol=0, atol=scale, equal_nan=True
    )


def change(old: PoseRecord, new: PoseRecord) -> PoseChange:
    """What became of a pose."""
    return PoseChange(
        old.pose_id,
        1e3 * se3.translation_error(new.T_camera_lidar, old.T_camera_lidar),
        float(np.rad2deg(se3.rotation_error(new.T_camera_lidar, old.T_camera_lidar))),
        variances(old.T_camera_lidar, old.covariance),
        variances(new.T_camera_lidar, new.covariance),
    )


def differences(old: DatasetInfo, new: DatasetInfo) -> Iterator[str]:
    """Values of rig and arm that are not as before: key, before, after."""
    pairs = [
        ({"rig": schema.plain(info.rig), "arm_model": schema.plain(info.arm)})
        for info in (old, new)
    ]
    before, after = (dict(_flat(content, "")) for content in pairs)
    for key in dict.fromkeys([*before, *after]):
        a, b = before.get(key), after.get(key)
        if a != b:
            yield f"{key}: {shown(a)} -> {shown(b)}"


def _flat(value: Any, prefix: str) -> Iterator[tuple[str, Any]]:
    if isinstance(value, Mapping):
        for key, item in value.items():
            yield from _flat(item, f"{prefix}.{key}" if prefix else str(key))
    else:
        yield prefix, None if value == "" else value


def shown(value: Any) -> str:
    """A value in a few words."""
    if value is None:
        return "none"
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, Sequence) and not isinstance(value, str):
        text = f"[{', '.join(shown(item) for item in value)}]"
        return text if len(text) <= 80 else f"{text[:77]}..."
    return str(value)
