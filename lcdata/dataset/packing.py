"""Pairs of one recording onto the disk."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path

from lcdata.dataset.journal import Journal
from lcdata.dataset.pair_jobs import finished, grouped, write_each
from lcdata.dataset.schema import PairRecord
from lcdata.dataset.writer import write_cloud, write_image
from lcdata.errors import MessageError
from lcdata.geometry.camera import Camera
from lcdata.recording.integration import Merger
from lcdata.recording.plan import PosePlan, RecordedPair, stream_pairs
from lcdata.recording.source import Recording
from lcdata.recording.topics import Topics
from lcdata.rig import Rig


def write_pairs(
    recording: Recording,
    topics: Topics,
    plans: Sequence[PosePlan],
    *,
    camera: Camera,
    rig: Rig,
    journal: Journal,
    progress: Callable[[str, int, int], None] | None = None,
) -> tuple[list[PairRecord], list[str]]:
    """Write the pairs of a plan that are not there yet.

    Args:
        recording: Open.
        topics: Its topics.
        plans: Poses and the pairs to take.
        camera: What its images must fit.
        rig: How its scans are merged.
        journal: Notes each finished pair, and knows those of an interrupted run.
        progress: See `lcdata.dataset.build.Progress`.

    Returns:
        All pairs of the plan that could be taken, and why others could not, a line each.

    Raises:
        DatasetError: The disk is full, or cannot be written.
    """
    stage = f"packaging {recording.scenario}"
    planned = {
        plan.pair_id(number): (int(plan.lidar_ns[number]), int(plan.image_ns[number]))
        for plan in plans
        for number in range(len(plan.lidar_ns))
    }
    records = finished(planned, journal)
    lost = set(planned) - set(records)
    merger = None
    pairs: Iterable[RecordedPair] = ()
    if lost and rig.integration is not None and rig.integration.mode != "none":
        merger = Merger(recording, topics, rig.integration, rig.point_time)
        registering = partial(progress, f"registering {recording.scenario}") if progress else None
        pairs = merger.pairs(plans, records, registering)
    elif lost:
        pairs = stream_pairs(recording, topics, plans, skip=records)

    def jobs() -> Iterator[tuple[str, Callable[[], PairRecord]]]:
        for pair in pairs:
            lost.discard(pair.pair_id)
            yield pair.pair_id, partial(write_pair, journal.folder, pair, topics, camera)

    def done(count: int) -> None:
        if progress:
            progress(stage, count, len(planned))

    unusable = write_each(jobs(), journal, records, done)
    unusable |= dict.fromkeys(sorted(lost), "its messages cannot be read")
    unusable |= merger.failures if merger else {}
    return list(records.values()), grouped(recording.path, unusable)


def write_pair(folder: Path, pair: RecordedPair, topics: Topics, camera: Camera) -> PairRecord:
    """Write both files of a pair.

    Raises:
        MessageError: The image does not fit the camera, or one of the two is of no use; then
            neither file is there.
        DatasetError: The disk is full, or cannot be written.
    """
    pair_id, cloud, image = pair.pair_id, pair.cloud, pair.image
    with _about(topics.image):
        data, suffix = image.encoded()
        if (image.width, image.height) != (camera.width, camera.height):
            raise MessageError(
                f"image of {image.width}x{image.height}, the camera has "
                f"{camera.width}x{camera.height}",
                "give the camera of these images in the rig",
            )
    with _about(topics.lidar):
        cloud_name, cloud_sha256, points = write_cloud(folder, pair_id, cloud)
    image_name, image_sha256 = write_image(folder, pair_id, data, suffix)
    return PairRecord(
        pair_id=pair_id,
        scenario=pair.pose.pose_id.rpartition("/")[0],
        pose_id=pair.pose.pose_id,
        stamp_lidar_ns=cloud.stamp_ns,
        stamp_image_ns=image.stamp_ns,
        dt_ns=image.stamp_ns - cloud.stamp_ns,
        image=image_name,
        cloud=cloud_name,
        image_sha256=image_sha256,
        cloud_sha256=cloud_sha256,
        points=points,
        scans=pair.scans,
    )


@contextmanager
def _about(topic: str) -> Iterator[None]:
    """Name the topic in an error of one of its messages."""
    try:
        yield
    except MessageError as error:
        raise MessageError(f"topic {topic}: {error.message}", error.remedy) from error
