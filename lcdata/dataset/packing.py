"""Pairs of one recording onto the disk.

The main thread reads, two others write: checksums, PNG encoding and the wait for the disk do
not stop the reading. Few pairs are under way at a time, which bounds the memory.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from functools import partial
from pathlib import Path

from lcdata.dataset.journal import Journal
from lcdata.dataset.schema import PairRecord
from lcdata.dataset.validate import checksum
from lcdata.dataset.writer import write_cloud, write_image
from lcdata.errors import MessageError
from lcdata.geometry.camera import Camera
from lcdata.recording.integration import Merger
from lcdata.recording.plan import PosePlan, RecordedPair, stream_pairs
from lcdata.recording.source import Recording
from lcdata.recording.topics import Topics
from lcdata.rig import Rig

WRITERS = 2
UNDER_WAY = 4
NAMED = 5
"""How many pairs or poses a line names that have failed for the same reason."""


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
    records = {
        pair_id: record
        for pair_id, record in journal.finished.items()
        if planned.get(pair_id) == (record.stamp_lidar_ns, record.stamp_image_ns)
        and is_whole(journal.folder, record)
    }
    unusable: dict[str, str] = {}
    lost = set(planned) - set(records)
    under_way: deque[tuple[str, Future[PairRecord]]] = deque()

    def collect() -> None:
        pair_id, future = under_way.popleft()
        try:
            records[pair_id] = future.result()
            journal.add(records[pair_id])
        except MessageError as error:
            unusable[pair_id] = str(error)
        if progress:
            progress(stage, len(records) + len(unusable), len(planned))

    if progress:
        progress(stage, len(records), len(planned))
    merger = None
    pairs: Iterable[RecordedPair] = ()
    if lost and rig.integration is not None and rig.integration.mode != "none":
        merger = Merger(recording, topics, rig.integration, rig.point_time)
        registering = partial(progress, f"registering {recording.scenario}") if progress else None
        pairs = merger.pairs(plans, records, registering)
    elif lost:
        pairs = stream_pairs(recording, topics, plans, skip=records)
    pool = ThreadPoolExecutor(WRITERS, thread_name_prefix="lcdata-write")
    try:
        for pair in pairs:
            lost.discard(pair.pair_id)
            future = pool.submit(write_pair, journal.folder, pair, topics, camera)
            under_way.append((pair.pair_id, future))
            if len(under_way) >= UNDER_WAY:
                collect()
        while under_way:
            collect()
    finally:  # also on Ctrl-C: what has begun is completed, nothing is begun any more
        pool.shutdown(cancel_futures=True)
    unusable |= dict.fromkeys(sorted(lost), "its messages cannot be read")
    unusable |= merger.failures if merger else {}
    return list(records.values()), grouped(recording.path, unusable)


def grouped(path: Path, reasons: Mapping[str, str]) -> list[str]:
    """A line for each reason, with the first few of those whom it concerns.

    Args:
        path: The recording.
        reasons: Reason by pair or pose.
    """
    concerned: dict[str, list[str]] = {}
    for name, reason in reasons.items():
        concerned.setdefault(reason, []).append(name)
    return [
        f"{path}: {', '.join(names[:NAMED])}"
        f"{f' and {len(names) - NAMED} more' if len(names) > NAMED else ''}: {reason}"
        for reason, names in concerned.items()
    ]


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


def is_whole(folder: Path, record: PairRecord) -> bool:
    """Whether both files of a pair are there and unchanged."""
    return (
        checksum(folder / record.image) == record.image_sha256
        and checksum(folder / record.cloud) == record.cloud_sha256
    )
