"""Serialised messages out of a whole recording, through rosbags."""

from __future__ import annotations

import struct
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Protocol

ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"
COMPRESSED_SUFFIXES = (".zstd", ".zst")


@dataclass(frozen=True)
class TopicInfo:
    """A topic of a recording.

    Args:
        name: Topic.
        type: Message type, `sensor_msgs/msg/PointCloud2` also in ROS 1.
        count: Messages.
        encoding: `ros1`, `cdr`, or the encoding of a recording that is not from ROS.
    """

    name: str
    type: str
    count: int
    encoding: str


class Storage(Protocol):
    """A recording's serialised messages.

    `start_ns` and `end_ns` are the recorder's first and last stamp, both 0 without messages.
    """

    topics: dict[str, TopicInfo]
    start_ns: int
    end_ns: int

    @property
    def problems(self) -> Sequence[str]:
        """What was wrong with the files so far, one line each."""
        ...

    def messages(self, topics: Collection[str]) -> Iterator[tuple[str, int, memoryview]]:
        """Topic, the recorder's stamp in ns, and bytes of each message of some topics."""
        ...

    def close(self) -> None:
        """Release files."""
        ...


class Indexed:
    """A ROS 1 bag, ROS 2 storage file or ROS 2 folder with its index."""

    def __init__(self, path: Path) -> None:
        from rosbags.rosbag1 import Reader as Reader1
        from rosbags.rosbag2 import Reader as Reader2

        ros1 = path.suffix == ".bag"
        self.path = path
        self.topics: dict[str, TopicInfo] = {}
        self.problems: list[str] = []
        self._reader: Any = Reader1(path) if ros1 else Reader2(path)
        self._reader.open()
        self._connections: dict[str, list[Any]] = {}
        for connection in self._reader.connections:
            encoding = "ros1" if ros1 else connection.ext.serialization_format
            self._add(connection, encoding)
        empty = not any(info.count for info in self.topics.values())
        self.start_ns = 0 if empty else int(self._reader.start_time)
        self.end_ns = 0 if empty else int(self._reader.end_time) - 1
        for log in path.parent.glob(f"{path.name}-wal") if path.suffix == ".db3" else ():
            if log.stat().st_size:
                self.problems.append(
                    f"{log} holds messages that were not merged into {path.name}: open it once "
                    "with write access, sqlite3 FILE 'PRAGMA wal_checkpoint'"
                )

    def _add(self, connection: Any, encoding: str) -> None:
        info = TopicInfo(connection.topic, connection.msgtype, connection.msgcount, encoding)
        known = self.topics.setdefault(info.name, replace(info, count=0))
        if known.type != info.type:
            self.problems.append(
                f"{self.path}: topic {info.name} has messages of {known.type} and {info.type}: "
                "the latter are ignored"
            )
            return
        self.topics[info.name] = replace(known, count=known.count + info.count)
        self._connections.setdefault(info.name, []).append(connection)

    def messages(self, topics: Collection[str]) -> Iterator[tuple[str, int, memoryview]]:
        """Topic, the recorder's stamp in ns, and bytes of each message of some topics."""
        connections = [c for topic in topics for c in self._connections.get(topic, ())]
        if not connections:
            return
        read = 0
        try:
            for connection, stamp, data in self._reader.messages(connections=connections):
                yield connection.topic, stamp, plain(data)
                read += 1
        except read_errors() as error:
            total = sum(self.topics[topic].count for topic in topics if topic in self.topics)
            self.problems.append(
                f"{self.path}: damaged after {read} of {total} messages ({describe(error)}): "
                "the rest of it is lost"
            )

    def close(self) -> None:
        """Release files."""
        self._reader.close()


def read_errors() -> tuple[type[Exception], ...]:
    """What readers raise on damaged files; most do not have errors of their own."""
    import sqlite3
    import sys

    import apsw
    import zstandard
    from mcap.exceptions import McapError
    from rosbags.rosbag1 import ReaderError as ReaderError1
    from rosbags.rosbag2 import ReaderError as ReaderError2

    if sys.version_info >= (3, 14):
        from compression import zstd
    else:
        from backports import zstd

    return (
        ReaderError1,
        ReaderError2,
        McapError,
        apsw.Error,
        sqlite3.Error,
        zstandard.ZstdError,
        zstd.ZstdError,
        struct.error,
        AssertionError,
        LookupError,
        ValueError,
        TypeError,
        EOFError,
        RuntimeError,
        OSError,
    )


def describe(error: Exception) -> str:
    """An error in one line, its file's name left out."""
    if type(error).__name__ == "EndOfFile":
        return "it ends in the middle of a record"
    text = " ".join(str(a) for a in error.args) if len(error.args) != 2 else str(error)
    return (text.strip().splitlines() or [type(error).__name__])[0].rstrip(".")


def plain(data: bytes) -> memoryview:
    """Bytes of a message that may have been compressed alone.

    Outside a ROS 2 folder nothing else tells: no serialised message begins with this number.
    """
    if data[:4] != ZSTD_MAGIC:
        return memoryview(data)
    import zstandard

    return memoryview(zstandard.ZstdDecompressor().decompressobj().decompress(data))
