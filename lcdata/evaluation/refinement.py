"""Refined links of a data set's tower, and the ground truth that follows from them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lcdata.arm import Arm
from lcdata.dataset import Dataset
from lcdata.dataset.schema import PoseRecord
from lcdata.geometry import se3
from lcdata.groundtruth.budget import drift
from lcdata.groundtruth.chain import PoseTruth, arm_truths
from lcdata.groundtruth.handeye import HandEye
from lcdata.rig import Rig
from lcdata.rig_links import LINKS

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Refinement:
    """Refined links of a data set's tower.

    Args:
        dataset: The data set; nothing in it is changed.
        source: Method whose estimates were used, or "lines" (`--direct`).
        arm: The arm that the data set was made with.
        poses: Its poses, in the order of `found`'s residuals.
        found: The solution.
        undetermined: What was asked for beside the links and no data set can tell, a sentence each.
    """

    dataset: Dataset
    source: str
    arm: Arm
    poses: tuple[PoseRecord, ...]
    found: HandEye
    undetermined: tuple[str, ...] = ()

    @property
    def refined_arm(self) -> Arm:
        """The arm with the joint offsets that were found added to those it had."""
        if not len(self.found.joint_offsets):
            return self.arm
        total = self.arm.with_offsets(self.found.joint_offsets[None])[0]
        named = zip(self.arm.joint_names, total, strict=True)
        covariance = self.found.full_covariance[LINKS:, LINKS:][: len(total), : len(total)]
        return replace(
            self.arm,
            joint_offsets={name: float(x) for name, x in named},
            offset_covariance=covariance,
        )

    @property
    def rig(self) -> Rig:
        """The rig with the refined links.

        Their errors belong together: what moves one link moves the other and the joints' zero
        points with it, and the extrinsics are known better than any of them.
        """
        size = LINKS + len(self.found.joint_offsets)
        covariance = self.found.full_covariance[:size, :size]
        before = self.dataset.rig
        recordings = (*(before.links_refined_from or ()), *recordings_of(self.dataset))
        return Rig.from_dict(
            before.to_dict()
            | {
                "T_camera_effector": _link(self.found.T_camera_effector),
                "T_base_lidar": _link(self.found.T_base_lidar),
                "links_covariance": [[float(f"{x:.12g}") for x in row] for row in covariance],
            }
            | ({"links_refined_from": recordings} if recordings else {})
        )

    @cached_property
    def truths(self) -> list[PoseTruth]:
        """The ground truth of the poses that follows from the refined rig and arm."""
        return arm_truths(
            self.rig,
            self.refined_arm,
            [pose.joint_positions for pose in self.poses],
            [pose.joint_positions_std for pose in self.poses],
            [pose.samples for pose in self.poses],
            [(pose.end_ns - pose.start_ns) * 1e-9 for pose in self.poses],
        )

    def extrinsics(self) -> Array:
        """(N, 4, 4) refined T_camera_lidar of the poses."""
        return np.array([truth.T_camera_lidar for truth in self.truths])

    def covariances(self) -> Array:
        """(N, 6, 6) of the refined extrinsics: links, joints' zero points and encoder noise."""
        return np.array([truth.covariance for truth in self.truths])

    def sigma(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Root mean square (mm, deg) that the ground truth's covariance predicts: now, refined."""
        return _sigma([pose.covariance for pose in self.poses]), _sigma(self.covariances())


def recordings_of(dataset: Dataset) -> list[str]:
    """Scenario and fingerprint of each recording."""
    return [f"{s['scenario']} {str(s['fingerprint'])[:12]}" for s in dataset.info.sources]


def _link(T: Array) -> dict[str, Any]:
    values = [round(float(x), 12) for x in se3.to_xyz_xyzw(T)]
    return {"translation_m": values[:3], "rotation_xyzw": values[3:]}


def _sigma(covariances: Array | Sequence[Array]) -> tuple[float, float]:
    variances = np.einsum("nii->ni", np.asarray(covariances))
    metres, radians = (
        float(np.sqrt(variances[:, part].sum(axis=1).mean())) for part in (slice(3), slice(3, 6))
    )
    return 1e3 * metres, float(np.rad2deg(radians))


def still_clock(poses: Sequence[PoseRecord]) -> str:
    """Why dwells do not determine the offset between arm and camera clock.

    An offset shows as joint velocity times offset, and the pairs of a data set are taken where the
    joints stand still: their scatter within the dwells bounds the velocity.
    """
    fastest = max(
        float(drift(p.joint_positions_std, (p.end_ns - p.start_ns) * 1e-9).max(initial=0.0))
        for p in poses
    )
    degrees = np.rad2deg(fastest)
    return (
        f"clock offset: the arm stands still at all {len(poses)} poses (joints drift by "
        f"{degrees:.2g} deg/s at most), so 10 ms are {0.01 * degrees:.1g} deg; images of the "
        "moving arm tell it: `lcdata arm clock RECORDING`"
    )


def describe(refinement: Refinement) -> dict[str, Any]:
    """A refinement as plain values."""
    found, rig = refinement.found, refinement.dataset.rig
    std = np.sqrt(np.diag(found.covariance))
    links: dict[str, Any] = {}
    for name, T, measured, part in (
        ("T_camera_effector", found.T_camera_effector, rig.T_camera_effector, std[:6]),
        ("T_base_lidar", found.T_base_lidar, rig.T_base_lidar, std[6:]),
    ):
        if measured is not None:
            links[name] = {
                "matrix": T.tolist(),
                "translation_std_m": part[:3].tolist(),
                "rotation_std_deg": np.rad2deg(part[3:]).tolist(),
                "moved_mm": 1e3 * se3.translation_error(T, measured.T),
                "moved_deg": float(np.rad2deg(se3.rotation_error(T, measured.T))),
            }
    ids = [pose.pose_id for pose in refinement.poses]
    rows = zip(
        ids,
        found.residuals.mm,
        found.residuals.deg,
        found.left_out.mm,
        found.left_out.deg,
        strict=True,
    )
    names = ("pose_id", "mm", "deg", "left_out_mm", "left_out_deg")
    now, refined = refinement.sigma()
    joint_names = refinement.arm.joint_names if len(found.joint_offsets) else ()
    return {
        "dataset": str(refinement.dataset.path),
        "source": refinement.source,
        "poses": len(ids),
        **links,
        "covariance": found.covariance.tolist(),
        "groundtruth_sigma": {"mm": now[0], "deg": now[1]},
        "refined_sigma": {"mm": refined[0], "deg": refined[1]},
        "residuals": [dict(zip(names, row, strict=True)) for row in rows],
        "outliers": [ids[i] for i in found.outliers],
        "failed": [ids[i] for i in found.failed],
        "scale": found.scale,
        "observable": found.observable,
        "singular_value_ratio": found.singular_value_ratio,
        "unobservable": [*found.unobservable, *refinement.undetermined],
        "clock_offset_s": None if np.isnan(found.clock_offset_s) else found.clock_offset_s,
        "clock_offset_std_s": (
            None if np.isnan(found.clock_offset_std_s) else found.clock_offset_std_s
        ),
        "joint_offsets_deg": dict(
            zip(joint_names, np.rad2deg(found.joint_offsets).tolist(), strict=True)
        ),
        "joint_offsets_std_deg": dict(
            zip(joint_names, np.rad2deg(found.joint_offsets_std).tolist(), strict=True)
        ),
    }
