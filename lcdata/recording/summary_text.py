"""A summary as plain text."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import TYPE_CHECKING

import numpy as np

from lcdata.geometry.camera_models import MODELS

if TYPE_CHECKING:
    from lcdata.recording.summary import Summary


def render(summary: Summary) -> list[str]:
    """Lines for a terminal."""
    lines = [f"{summary.scenario}   {summary.path}"]
    start = datetime.fromtimestamp(summary.start_ns * 1e-9, UTC)
    lines.append(f"  {start:%Y-%m-%d %H:%M:%S} UTC, {summary.duration_s:.1f} s")
    lines += [f"  ! {problem}" for problem in summary.problems]
    lines += ["", *_topics(summary), *_sensors(summary), *_poses(summary)]
    lines += ["", _verdict(summary)]
    lines += [f"  ! {obstacle}" for obstacle in summary.obstacles]
    if summary.rig_yaml:
        lines += ["", "A rig to start from (rig.yaml):", ""]
        lines += [f"    {line}" for line in summary.rig_yaml.splitlines()]
    return lines


def _topics(summary: Summary) -> list[str]:
    rows: list[tuple[str, ...]] = [("topic", "type", "messages", "rate", "longest gap", "used as")]
    rows += [
        (
            t.name,
            t.type.replace("/msg/", "/"),
            str(t.messages),
            f"{t.rate_hz:.4g} Hz" if t.rate_hz else "",
            f"{t.longest_gap_s:.3g} s" if t.longest_gap_s is not None else "",
            t.role,
        )
        for t in summary.topics
    ]
    return _table(rows, right=(2, 3, 4))


def _sensors(summary: Summary) -> list[str]:
    lines = [""]
    for clock in summary.clocks:
        lines.append(
            f"  clock      {clock.topic}: header {clock.median_ms:+.3g} ms from the recorder's "
            f"stamp (median), {clock.largest_ms:.3g} ms at most"
        )
        lines += [f"  !          {clock.note}"] if clock.note else []
    lines += [f"  clock      {summary.clock_offset.line}"] if summary.clock_offset else []
    lines += [f"  joint log  {summary.joint_log}"] if summary.joint_log else []
    lines += [f"  !          {summary.joint_log_note}"] if summary.joint_log_note else []
    if cloud := summary.cloud:
        shape = (
            "{} rings x {} columns".format(*cloud.organised) if cloud.organised else "unorganised"
        )
        lines.append(
            f"  cloud      {cloud.points} points, {shape}, {cloud.usable} with a return, frame "
            f"{cloud.frame!r}"
        )
        lines.append(f"             fields {', '.join(cloud.fields)}")
        lines.append(
            f"             intensity {cloud.intensity or 'none'}, ring {cloud.ring or 'none'}"
        )
        time = cloud.time
        lines.append(
            f"             time {time.name} in {time.unit} ({time.reason}), "
            f"{'absolute' if time.absolute else 'relative'}"
            if time
            else "             time none"
        )
        if cloud.livox:
            lines.append(
                "             a Livox: no two of its scans are alike, together they are dense "
                "(integration: static)"
            )
    if image := summary.image:
        lines.append(
            f"  image      {image.width}x{image.height}, {image.encoding}, frame {image.frame!r}"
        )
    if camera := summary.camera:
        names = " ".join(MODELS[camera["model"]].intrinsics)
        numbers = " ".join(f"{value:.6g}" for value in camera["intrinsics"])
        distortion = " ".join(f"{value:.4g}" for value in camera["distortion"]) or "none"
        lines.append(
            f"  camera     {camera['model']} {camera['width']}x{camera['height']} "
            f"({camera['source']}), {names} {numbers}, distortion {distortion}"
        )
    if summary.transforms:
        lines.append(f"  transforms {', '.join(summary.transforms)}")
    if summary.T_camera_lidar is not None:
        lines.append(f"  extrinsic  T_camera_lidar {_pose(np.array(summary.T_camera_lidar))}")
    return lines if len(lines) > 1 else []


def _pose(T: np.ndarray) -> str:
    from scipy.spatial.transform import Rotation

    angles = Rotation.from_matrix(T[:3, :3]).as_euler("xyz", degrees=True)
    metres = " ".join(f"{v:.4f}" for v in T[:3, 3])
    return f"xyz {metres} m, rpy {' '.join(f'{v:.3f}' for v in angles)} deg"


def _poses(summary: Summary) -> list[str]:
    if not summary.poses:
        return []
    lines = [""]
    if summary.ground_truth == "arm":
        lines.append(
            f"  arm        {summary.arm_model or 'unknown'}: {', '.join(summary.joint_names)}"
        )
    rows: list[tuple[str, ...]] = [
        ("pose", "start", "length", "scans", "images", "pairs", "joints (deg)", "scatter")
    ]
    for pose in summary.poses:
        rows.append(
            (
                pose.pose_id,
                f"{pose.start_s:.2f} s",
                f"{pose.duration_s:.2f} s",
                str(pose.scans),
                str(pose.images),
                str(pose.pairs),
                " ".join(f"{v:.2f}" for v in pose.joints_deg),
                f"{max(pose.joints_std_deg):.3f}" if pose.joints_std_deg else "",
            )
        )
        if pose.reason:
            rows[-1] = (*rows[-1][:-1], f"{rows[-1][-1]}  {pose.reason}".strip())
    return lines + _table(rows, right=(1, 2, 3, 4, 5))


def _verdict(summary: Summary) -> str:
    if not summary.pairs or summary.obstacles:
        return "build would stop:" if summary.obstacles else "build would take nothing."
    taken = sum(bool(pose.pairs) for pose in summary.poses)
    kind = "from the arm" if summary.ground_truth == "arm" else "static"
    merged = sum(pose.merged for pose in summary.poses)
    made = f" of {merged} scans merged" if merged else ""
    return (
        f"build would take {summary.pairs} pair{'s' * (summary.pairs > 1)}{made}, at {taken} of "
        f"{len(summary.poses)} pose{'s' * (len(summary.poses) > 1)}, ground truth {kind}."
    )


def _table(rows: list[tuple[str, ...]], right: tuple[int, ...]) -> list[str]:
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    return [
        "  "
        + "  ".join(
            cell.rjust(width) if i in right else cell.ljust(width)
            for i, (cell, width) in enumerate(zip(row, widths, strict=True))
        ).rstrip()
        for row in rows
    ]
