"""The files of one published pair into a data set."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from lcdata.dataset import atomic, cloud_file, schema
from lcdata.dataset.importers.published import Item, Published
from lcdata.dataset.schema import PairRecord
from lcdata.dataset.writer import write_cloud, write_image
from lcdata.errors import MessageError
from lcdata.geometry import se3
from lcdata.recording import images
from lcdata.recording.messages import Cloud

HEADS = {".png": images.PNG, ".jpg": images.JPEG}
"""First bytes of the images that a data set holds, by suffix."""


@dataclass(frozen=True, eq=False)
class Planned:
    """A pair on its way into the data set."""

    pair_id: str
    pose_id: str
    scenario: Published
    item: Item


def write_pair(folder: Path, planned: Planned) -> PairRecord:
    """Write the files of a pair.

    Raises:
        MessageError: One of them is of no use; then neither image nor cloud is there.
        DatasetError: The disk is full, or cannot be written.
    """
    item, pair_id = planned.item, planned.pair_id
    data, suffix = _read_image(item.image, planned.scenario)
    cloud = _read_cloud(item)
    _write_masks(folder / schema.MASKS, pair_id, item)
    cloud_name, cloud_sha256, points = write_cloud(folder, pair_id, cloud)
    image_name, image_sha256 = write_image(folder, pair_id, data, suffix)
    return PairRecord(
        pair_id=pair_id,
        scenario=planned.scenario.name,
        pose_id=planned.pose_id,
        stamp_lidar_ns=item.stamp_lidar_ns,
        stamp_image_ns=item.stamp_image_ns,
        dt_ns=item.stamp_image_ns - item.stamp_lidar_ns,
        image=image_name,
        cloud=cloud_name,
        image_sha256=image_sha256,
        cloud_sha256=cloud_sha256,
        points=points,
    )


def _read_image(path: Path, scenario: Published) -> tuple[bytes, str]:
    """Bytes of an image as they are, and the suffix of its kind."""
    data = _bytes(path)
    kind = next((s for s, head in HEADS.items() if data.startswith(head)), None)
    if kind is None:
        raise MessageError(
            f"{path}: neither PNG nor JPEG (its {len(data)} bytes start with {data[:4].hex()})",
            "convert it, or copy it again",
        )
    try:
        images.check_whole(data, kind)
    except MessageError as error:
        raise MessageError(f"{path}: the image is cut off", "copy it again") from error
    height, width = images.size(data)
    camera = scenario.camera
    if (width, height) != (camera.width, camera.height):
        raise MessageError(
            f"{path}: image of {width}x{height}, its camera has {camera.width}x{camera.height}",
            "give it a camera of its own, in an import of its own",
        )
    return data, kind


def _read_cloud(item: Item) -> Cloud:
    """Every field of a cloud, its points moved to the image's time where that is asked for."""
    records, height, width = item.read(item.cloud)
    names = records.dtype.names or ()
    if not {"x", "y", "z"} <= set(names):
        raise MessageError(
            f"{item.cloud}: a cloud without x, y, z; its fields are {', '.join(names) or 'none'}",
            "export it again",
        )
    if item.T_moved is not None:
        points = np.stack([records[name] for name in "xyz"], axis=1).astype(float)
        returned = points.any(axis=1)  # a pulse without return stays at the origin
        moved = se3.apply(item.T_moved, points)
        records = records.copy()
        for axis, name in enumerate("xyz"):
            records[name][returned] = moved[returned, axis]
    if not cloud_file.has_points(records):
        raise MessageError(f"{item.cloud}: {len(records)} points, none of them finite", "check it")
    return Cloud(item.stamp_lidar_ns, item.stamp_lidar_ns, "lidar", records, height, width)


def _write_masks(folder: Path, pair_id: str, item: Item) -> None:
    """One mask as `<pair_id>.png` or .jpg, segments as files of `<pair_id>/`."""
    if isinstance(item.masks, Path):
        atomic.write_bytes(
            folder / f"{pair_id}{item.masks.suffix.lower()}", _bytes(item.masks), sync_folder=False
        )
        return
    for mask in item.masks:
        atomic.write_bytes(folder / pair_id / mask.name, _bytes(mask), sync_folder=False)


def _bytes(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise MessageError(
            f"{path}: cannot be read ({error.strerror})", "check the file"
        ) from error
