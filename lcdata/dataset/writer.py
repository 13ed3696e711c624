"""Writing a data set: pair after pair into the journal, the index at the end."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from lcdata.dataset import atomic, cloud_file, schema
from lcdata.dataset.schema import DatasetInfo, PairRecord, PoseRecord
from lcdata.errors import MessageError
from lcdata.recording.messages import Cloud


def write_cloud(folder: Path, pair_id: str, cloud: Cloud) -> tuple[str, str, int]:
    """Write the cloud of a pair.

    Args:
        folder: The data set.
        pair_id: The pair's name, which becomes the file's.
        cloud: Every field of it is kept.

    Returns:
        Path relative to the data set, sha256, number of points.

    Raises:
        MessageError: Not a single point in it.
        DatasetError: It cannot be written.
    """
    if not cloud_file.has_points(cloud.records):
        raise MessageError(
            f"cloud of {len(cloud.records)} points, none of them finite", "check the LiDAR's driver"
        )
    name = f"{pair_id}.pcd"
    digest = _write(folder / name, *cloud_file.encode(cloud.records, cloud.height, cloud.width))
    return name, digest, len(cloud.records)


def write_image(folder: Path, pair_id: str, data: bytes, suffix: str) -> tuple[str, str]:
    """Write the image of a pair, given as `Image.encoded` gives it.

    Returns:
        Path relative to the data set, sha256.

    Raises:
        DatasetError: It cannot be written.
    """
    name = f"{pair_id}{suffix}"
    return name, _write(folder / name, data)


def write_index(
    folder: Path,
    info: DatasetInfo,
    pairs: Sequence[PairRecord],
    poses: Sequence[PoseRecord],
) -> DatasetInfo:
    """Write the three index files, dataset.json last: with it the data set is complete.

    Args:
        folder: The data set.
        info: Its ground-truth version is set here.
        pairs: In any order.
        poses: In any order.

    Returns:
        `info` as written.
    """
    atomic.sync_folders((folder / pair.cloud).parent for pair in pairs)
    poses = schema.versioned(poses)
    info = replace(info, groundtruth_version=schema.groundtruth_version(poses))
    pairs = sorted(pairs, key=lambda pair: schema.in_order(pair.pair_id))
    poses = sorted(poses, key=lambda pose: schema.in_order(pose.pose_id))
    atomic.write_parquet(folder / schema.POSES, schema.poses_table(poses))
    atomic.write_parquet(folder / schema.PAIRS, schema.pairs_table(pairs))
    atomic.write_json(folder / schema.INFO, info.to_dict())
    return info


def _write(path: Path, *chunks: bytes | memoryview) -> str:
    """Write a file atomically; returns its sha256."""
    atomic.write_bytes(path, *chunks, sync_folder=False)  # `write_index` does
    digest = hashlib.sha256()
    for chunk in chunks:
        digest.update(chunk)
    return digest.hexdigest()
