"""Is a data set whole: schema, checksums, geometry."""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from lcdata.dataset import atomic, cloud_file, schema
from lcdata.dataset.reader import Dataset, read_image, read_poses, read_table
from lcdata.dataset.schema import PairRecord, PoseRecord
from lcdata.errors import DatasetError, LcdataError
from lcdata.geometry import se3

CHAIN_TOLERANCE_M = 1e-9
PSD_TOLERANCE = 1e-9
"""How negative an eigenvalue of a covariance may be, relative to the largest."""


def validate(path: Path, *, progress: Callable[[str, int, int], None] | None = None) -> list[str]:
    """Check a data set.

    Args:
        path: Its folder.
        progress: Called with what is done, how many pairs are, and of how many.

    Returns:
        Problems, a line each; empty for a data set that is whole.
    """
    path = Path(path)
    try:
        dataset = Dataset.open(path)
    except DatasetError as error:
        return [str(error)]
    problems = [*_index(dataset), *_leftovers(dataset), *_versions(dataset)]
    for pose in dataset.poses:
        problems += [f"{pose.pose_id}: {problem}" for problem in _pose(dataset, pose)]
    for number, record in enumerate(dataset.pairs, start=1):
        problems += [f"{record.pair_id}: {problem}" for problem in _times(dataset, record)]
        problems += [f"{record.pair_id}: {problem}" for problem in _files(dataset, record)]
        if progress:
            progress("checking", number, len(dataset.pairs))
    for file in dataset.result_files():
        try:
            read_table(file)
        except DatasetError as error:
            problems.append(str(error))
    return problems


def _index(dataset: Dataset) -> Iterator[str]:
    """Ids are unique and refer to what is there; the rig is one."""
    for kind, ids in (
        ("pair", [record.pair_id for record in dataset.pairs]),
        ("pose", [record.pose_id for record in dataset.poses]),
    ):
        yield from (f"{kind} {name!r} is there {n} times" for name, n in _repeated(ids))
    poses = {record.pose_id for record in dataset.poses}
    for record in dataset.pairs:
        if record.pose_id not in poses:
            yield f"{record.pair_id}: pose {record.pose_id!r} is not in {schema.POSES}"
        if record.scenario not in dataset.info.scenarios:
            yield f"{record.pair_id}: scenario {record.scenario!r} is not in {schema.INFO}"
    try:
        _ = dataset.rig
    except LcdataError as error:
        yield str(error)


def _versions(dataset: Dataset) -> Iterator[str]:
    """The poses of every version of the ground truth are there, those of the present one twice."""
    present = dataset.info.groundtruth_version
    found = {pose.groundtruth_version for pose in read_poses(dataset.path / schema.POSES)}
    if (dataset.path / schema.version_file(present)).is_file() and found != {present}:
        yield (
            f"{schema.POSES} is of version {', '.join(sorted(found))}, the data set has {present}: "
            "run `lcdata groundtruth` again"
        )
    for entry in dataset.info.groundtruth_history:
        name = schema.version_file(str(entry.get("version")))
        try:
            poses = read_poses(dataset.path / name)
        except DatasetError as error:
            yield str(error)
            continue
        if {pose.groundtruth_version for pose in poses} != {entry["version"]}:
            yield f"{name}: its poses are of another version"


def _repeated(names: list[str]) -> list[tuple[str, int]]:
    return [(name, count) for name, count in Counter(names).items() if count > 1]


def _leftovers(dataset: Dataset) -> Iterator[str]:
    """Files that no row speaks of."""
    known = {name for record in dataset.pairs for name in (record.image, record.cloud)}
    for scenario in dataset.info.scenarios:
        for file in sorted((dataset.path / scenario).rglob("*")):
            name = file.relative_to(dataset.path).as_posix()
            if file.is_file() and name not in known:
                kind = "unfinished file" if atomic.MARK in file.name else "file"
                yield f"{name}: {kind} that is not in {schema.PAIRS}"


def _pose(dataset: Dataset, pose: PoseRecord) -> Iterator[str]:
    """Rotations, the chain's product, the covariance, the dwell."""
    links = [pose.T_camera_effector, pose.T_effector_base, pose.T_base_lidar]
    given = [link for link in links if link is not None]
    if len(given) == 3:
        product = given[0] @ given[1] @ given[2]
        deviation = float(np.abs(product - pose.T_camera_lidar).max())
        if not deviation <= CHAIN_TOLERANCE_M:
            yield f"T_camera_lidar differs from the product of its links by {deviation:.3g}"
    elif given:
        yield "some links of the chain are missing"
    try:
        for T in (pose.T_camera_lidar, *given):
            se3.check_transform(T)
    except LcdataError as error:
        yield str(error)
    yield from _covariance(pose)
    if pose.budget:
        gap = float(np.abs(sum(pose.budget.values()) - pose.covariance).max())
        if gap > PSD_TOLERANCE * float(np.abs(pose.covariance).max()):
            yield f"the parts of its covariance add up to another one (by {gap:.3g})"
    if pose.start_ns > pose.end_ns:
        yield f"dwell ends ({pose.end_ns}) before it starts ({pose.start_ns})"
    if pose.groundtruth_version != dataset.info.groundtruth_version:
        yield (
            f"ground truth version {pose.groundtruth_version}, the data set has "
            f"{dataset.info.groundtruth_version}"
        )
    names = (dataset.info.arm or {}).get("joint_names", ())
    if not len(pose.joint_positions) == len(pose.joint_positions_std) == len(names):
        yield f"{len(pose.joint_positions)} joint positions for {len(names)} joints"


def _covariance(pose: PoseRecord) -> Iterator[str]:
    covariance = pose.covariance
    if np.isnan(covariance).all():  # unknown, as in a static recording
        return
    if not np.isfinite(covariance).all():
        yield "covariance has values that are not finite"
        return
    scale = float(np.abs(covariance).max())
    if np.abs(covariance - covariance.T).max() > PSD_TOLERANCE * scale:
        yield "covariance is not symmetric"
    elif np.linalg.eigvalsh(covariance).min() < -PSD_TOLERANCE * scale:
        yield "covariance has a negative eigenvalue"


def _times(dataset: Dataset, record: PairRecord) -> Iterator[str]:
    """Both stamps lie in the dwell, and near each other."""
    dt = record.stamp_image_ns - record.stamp_lidar_ns
    if dt != record.dt_ns:
        yield f"dt_ns is {record.dt_ns}, its stamps say {dt}"
    try:
        pose, tolerance = dataset.pose(record.pose_id), dataset.rig.pairing.tolerance_ms
    except LcdataError:  # reported by _index
        return
    if abs(dt) > tolerance * 1e6:
        yield f"image {abs(dt) / 1e6:.1f} ms from the scan (limit {tolerance:g} ms)"
    for name, stamp in (("scan", record.stamp_lidar_ns), ("image", record.stamp_image_ns)):
        if not pose.start_ns <= stamp <= pose.end_ns:
            yield f"{name} at {stamp} ns is outside its dwell [{pose.start_ns}, {pose.end_ns}]"


def _files(dataset: Dataset, record: PairRecord) -> Iterator[str]:
    """Both files are there, unchanged, and can be loaded."""
    damaged = False
    for name, expected in (
        (record.image, record.image_sha256),
        (record.cloud, record.cloud_sha256),
    ):
        found = checksum(dataset.path / name)
        if found != expected:
            damaged = True
            yield f"{name}: not there" if found is None else f"{name}: checksum differs"
    if damaged:
        return
    try:
        records, _, _ = cloud_file.read(dataset.path / record.cloud)
        image = read_image(dataset.path / record.image)
    except DatasetError as error:
        yield str(error)
        return
    if len(records) != record.points:
        yield f"{record.cloud}: {len(records)} points, {schema.PAIRS} says {record.points}"
    camera = dataset.info.scenarios.get(record.scenario)
    if camera and image.shape[:2] != (camera.camera.height, camera.camera.width):
        yield (
            f"{record.image}: {image.shape[1]}x{image.shape[0]}, the camera has "
            f"{camera.camera.width}x{camera.camera.height}"
        )


def checksum(path: Path) -> str | None:
    """sha256 of a file; None if there is none that can be read."""
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError:
        return None
