"""Reading files without a usable index from their beginning, as far as they go.

A recorder that was killed or a copy that was cut off leaves no index.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from dataclasses import replace
from pathlib import Path

from lcdata.errors import RecordingError
from lcdata.recording import mcap_file, ros1, sqlite3_file
from lcdata.recording.storage import Raw, TopicInfo, describe, normalised, read_errors

SCANNERS: dict[str, Callable[[Path], Iterator[tuple[TopicInfo, int, memoryview]]]] = {
    ".bag": ros1.scan,
    ".mcap": mcap_file.scan,
    ".db3": sqlite3_file.scan,
}
"""Scanner of each kind of file."""


class Scanned:
    """A file read from its beginning as far as it goes.

    Args:
        path: The file.
        suffix: `.bag`, `.mcap` or `.db3`.
        reason: Why its index cannot be used.

    Raises:
        RecordingError: Not a single message can be read.
    """

    def __init__(self, path: Path, suffix: str, reason: str) -> None:
        self.path, self._scan = path, SCANNERS[suffix]
        self.topics: dict[str, TopicInfo] = {}
        self.start_ns, self.end_ns = 2**63 - 1, 0
        self._stopped = ""
        for info, stamp, _ in self._read():
            known = self.topics.setdefault(info.name, info)
            self.topics[info.name] = replace(known, count=known.count + 1)
            self.start_ns, self.end_ns = min(self.start_ns, stamp), max(self.end_ns, stamp)
        count = sum(info.count for info in self.topics.values())
        if not count:
            if not self._stopped:
                raise RecordingError(f"{path} has no messages", "copy or record it again")
            raise RecordingError(
                f"{path} cannot be read ({self._stopped})", "copy or record it again"
            )
        self.problems = [
            f"{path} is cut off or damaged ({self._stopped}): the {count} messages before are "
            "read: copy it again for the rest"
            if self._stopped
            else f"{path} has no usable index ({reason}): its {count} messages are read"
        ]

    def _read(self) -> Iterator[tuple[TopicInfo, int, memoryview]]:
        try:
            for info, stamp, data in self._scan(self.path):
                yield replace(info, type=normalised(info.type)), stamp, data
        except read_errors() as error:
            self._stopped = describe(error)

    def messages(self, topics: Collection[str], heads: Collection[str] = ()) -> Iterator[Raw]:
        """Messages of some topics, in the order of the file; always whole."""
        for info, stamp, data in self._read():
            if info.name in topics and info.type == self.topics[info.name].type:
                yield Raw(info.name, stamp, data)

    def close(self) -> None:
        """Nothing stays open between two readings."""
