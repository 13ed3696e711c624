"""Pairs onto the disk: those that are not there yet, a few at a time.

The main thread reads, two others write: checksums, PNG encoding and the wait for the disk do
not stop the reading. Few pairs are under way at a time, which bounds the memory.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path

from lcdata.dataset.journal import Journal
from lcdata.dataset.schema import PairRecord
from lcdata.dataset.validate import checksum
from lcdata.errors import MessageError

WRITERS = 2
UNDER_WAY = 4
NAMED = 5
"""How many pairs or poses a line names that have failed for the same reason."""


def finished(planned: Mapping[str, tuple[int, int]], journal: Journal) -> dict[str, PairRecord]:
    """Pairs of a plan that an interrupted run has written and that are whole, by pair_id.

    Args:
        planned: Stamps of scan and image (ns) by pair_id.
        journal: Knows what was written.
    """
    return {
        pair_id: record
        for pair_id, record in journal.finished.items()
        if planned.get(pair_id) == (record.stamp_lidar_ns, record.stamp_image_ns)
        and is_whole(journal.folder, record)
    }


def write_each(
    jobs: Iterable[tuple[str, Callable[[], PairRecord]]],
    journal: Journal,
    records: dict[str, PairRecord],
    done: Callable[[int], None],
) -> dict[str, str]:
    """Write pairs and note each in the journal as it is complete.

    Args:
        jobs: pair_id, and what writes its files; taken one by one.
        journal: Of the build.
        records: Takes the pairs that are written.
        done: Called with the number of pairs that are written or have failed.

    Returns:
        Why pairs could not be written, by pair_id.

    Raises:
        DatasetError: The disk is full, or cannot be written.
    """
    unusable: dict[str, str] = {}
    under_way: deque[tuple[str, Future[PairRecord]]] = deque()

    def collect() -> None:
        pair_id, future = under_way.popleft()
        try:
            records[pair_id] = future.result()
            journal.add(records[pair_id])
        except MessageError as error:
            unusable[pair_id] = str(error)
        done(len(records) + len(unusable))

    done(len(records))
    pool = ThreadPoolExecutor(WRITERS, thread_name_prefix="lcdata-write")
    try:
        for pair_id, write in jobs:
            under_way.append((pair_id, pool.submit(write)))
            if len(under_way) >= UNDER_WAY:
                collect()
        while under_way:
            collect()
    finally:  # also on Ctrl-C: what has begun is completed, nothing is begun any more
        pool.shutdown(cancel_futures=True)
    return unusable


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


def is_whole(folder: Path, record: PairRecord) -> bool:
    """Whether both files of a pair are there and unchanged."""
    return (
        checksum(folder / record.image) == record.image_sha256
        and checksum(folder / record.cloud) == record.cloud_sha256
    )
