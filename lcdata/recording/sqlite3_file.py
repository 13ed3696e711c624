"""ROS 2 databases (.db3)."""

from __future__ import annotations

import sqlite3
from collections.abc import Collection, Iterator
from pathlib import Path
from urllib.parse import quote

from lcdata.recording.storage import (
    HEAD,
    ZSTD_MAGIC,
    Raw,
    TopicInfo,
    describe,
    normalised,
    plain,
    read_errors,
)


class Sqlite3File:
    """A whole database.

    Args:
        path: The file.

    Raises:
        sqlite3.Error: It is damaged.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.topics: dict[str, TopicInfo] = {}
        self.problems: list[str] = []
        self._keys: dict[int, str] = {}
        self._connection = _connect(path)
        try:
            self._open()
        except sqlite3.Error:
            self._connection.close()
            raise
        log = path.with_name(f"{path.name}-wal")
        if log.is_file() and log.stat().st_size:
            self.problems.append(
                f"{log} holds messages that its recorder, when killed, had not moved into "
                f"{path.name} yet: `sqlite3 {path.name} 'PRAGMA wal_checkpoint'` moves them"
            )

    def _open(self) -> None:
        summary = {
            key: (count, first, last)
            for key, count, first, last in self._connection.execute(
                "SELECT topic_id, COUNT(*), MIN(timestamp), MAX(timestamp) "
                "FROM messages GROUP BY topic_id"
            )
        }
        for key, info in _topics(self._connection).items():
            count = summary.get(key, (0, 0, 0))[0]
            self.topics[info.name] = TopicInfo(info.name, info.type, count, info.encoding)
            self._keys[key] = info.name
        self.start_ns = min((first for _, first, _ in summary.values()), default=0)
        self.end_ns = max((last for _, _, last in summary.values()), default=0)

    def messages(self, topics: Collection[str], heads: Collection[str] = ()) -> Iterator[Raw]:
        """Messages of some topics, in the order in which they were written."""
        keys = [key for key, name in self._keys.items() if name in topics]
        cut = [key for key, name in self._keys.items() if name in heads]
        query = (
            f"SELECT id, topic_id, timestamp, CASE WHEN topic_id IN ({_marks(cut)}) "
            f"THEN NULL ELSE data END FROM messages NOT INDEXED "
            f"WHERE topic_id IN ({_marks(keys)})"
        )
        read = 0
        try:
            for row, key, stamp, data in self._connection.execute(query, [*cut, *keys]):
                name = self._keys[key]
                yield Raw(name, stamp, self._head(row) if data is None else plain(data))
                read += 1
        except read_errors() as error:
            total = sum(self.topics[self._keys[key]].count for key in keys)
            self.problems.append(
                f"{self.path}: damaged after {read} of {total} messages ({describe(error)}): "
                "the rest of it is lost"
            )

    def _head(self, row: int) -> memoryview:
        """The beginning of a message, of which SQLite reads no more than that."""
        with self._connection.blobopen("messages", "data", row, readonly=True) as blob:
            data = blob.read(HEAD)
            whole = data[:4] == ZSTD_MAGIC  # its beginning alone cannot be decompressed
            return plain(data + blob.read() if whole else data, head=True)

    # data[:4] == ZSTD_MAGIC else data, head=True)

    def close(self) -> None:
        """Release the file."""
        self._connection.close()


def scan(path: Path) -> Iterator[tuple[TopicInfo, int, memoryview]]:
    """Topic (its count 0), stamp and bytes of messages, from the beginning as far as it goes."""
    connection = _connect(path)
    try:
        # Without this, SQLite refuses a file that is shorter than its header says.
        connection.execute("PRAGMA writable_schema = ON")
        topics = _topics(connection)
        rows = connection.execute("SELECT topic_id, timestamp, data FROM messages NOT INDEXED")
        for key, stamp, data in rows:
            if key in topics:
                yield topics[key], stamp, plain(data)
    finally:
        connection.close()


def _connect(path: Path) -> sqlite3.Connection:
    # Immutable: neither locks nor side files, so that a read-only medium will do.
    return sqlite3.connect(f"file:{quote(str(path.absolute()))}?immutable=1", uri=True)


def _topics(connection: sqlite3.Connection) -> dict[int, TopicInfo]:
    """Topics by key, their counts 0."""
    rows = connection.execute("SELECT id, name, type, serialization_format FROM topics")
    return {
        key: TopicInfo(name, normalised(type_name), 0, encoding)
        for key, name, type_name, encoding in rows
    }


def _marks(values: Collection[int]) -> str:
    return ",".join("?" * len(values))
