"""Every version of the ground truth that a data set has had, on disk.

`groundtruth/<version>.parquet` holds the poses of every version, poses.parquet those of the
present one. dataset.json is written last: until then the former version counts.
"""

from __future__ import annotations

from lcdata.dataset import atomic, schema
from lcdata.dataset.arms import store_urdf
from lcdata.dataset.groundtruth_change import Regeneration
from lcdata.dataset.lock import locked
from lcdata.dataset.reader import Dataset, read_info, read_poses, read_table
from lcdata.dataset.schema import PoseRecord
from lcdata.errors import DatasetError


def versions(dataset: Dataset) -> list[str]:
    """Versions of the ground truth, oldest first, the present one last."""
    history = [entry["version"] for entry in dataset.info.groundtruth_history]
    return [*history, dataset.info.groundtruth_version]


def poses_of(dataset: Dataset, version: str) -> list[PoseRecord]:
    """Poses as they were in a version of the ground truth.

    Raises:
        DatasetError: There was no such version.
    """
    if version == dataset.info.groundtruth_version:
        return list(dataset.poses)
    if version not in versions(dataset):
        raise DatasetError(
            f"{dataset.path} has no ground truth version {version!r}",
            f"it has {', '.join(versions(dataset))}",
        )
    return read_poses(dataset.path / schema.version_file(version))


def write_version(result: Regeneration) -> None:
    """Write the new version beside the former one; dataset.json, the last file, makes it count.

    Raises:
        DatasetError: Another process is writing the data set, or has changed it meanwhile.
    """
    with locked(result.dataset.path):
        if read_info(result.dataset.path).to_dict() != result.dataset.info.to_dict():
            raise DatasetError(
                f"{result.dataset.path} was changed by another lcdata command meanwhile",
                "run the same command again",
            )
        _write(result)


def _write(result: Regeneration) -> None:
    folder, old = result.dataset.path, result.dataset
    column = read_table(folder / schema.POSES).column("groundtruth_version")
    on_disk = set(column.to_pylist())
    has_budget = all(
        a.budget.keys() == b.budget.keys() for a, b in zip(old.poses, result.poses, strict=True)
    )
    if not result.inputs and has_budget and on_disk == {result.after}:
        return
    table = schema.poses_table(result.poses)
    if result.before != result.after:
        former = folder / schema.version_file(result.before)
        if on_disk == {result.before}:
            atomic.write_bytes(former, (folder / schema.POSES).read_bytes())
        elif not former.is_file():
            atomic.write_parquet(former, schema.poses_table(old.poses))
        atomic.write_parquet(folder / schema.version_file(result.after), table)
    if result.arm is not None:
        store_urdf(folder, result.arm)
    with atomic.write_atomically(folder / schema.INFO) as info:
        info.write_text(atomic.json_text(result.info.to_dict()), encoding="utf-8")
        # Both files are complete before the first of them takes its name.
        atomic.write_parquet(folder / schema.POSES, table)
