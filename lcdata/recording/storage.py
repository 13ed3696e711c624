"""What every kind of recording file offers: topics, and serialised messages."""

from __future__ import annotations

import sqlite3
import struct
from abc import ABC, abstractmethod
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple, Protocol

ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"
HEAD = 64
"""Bytes of a message that are enough for its header's stamp."""


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


class Raw(NamedTuple):
    """A serialised message.

    Args:
        topic: Topic.
        stamp_ns: The recorder's stamp.
        data: Its bytes.
    """

    topic: str
    stamp_ns: int
    data: memoryview


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

    def messages(self, topics: Collection[str], heads: Collection[str] = ()) -> Iterator[Raw]:
        """Messages of some topics, in the order of the file.

        Args:
            topics: Which.
            heads: Topics of which the first `HEAD` bytes of a message are enough; they may come
                cut, which spares decompressing the clouds and images of a recording just to
                know their stamps.
        """
        ...

    def close(self) -> None:
        """Release files."""
        ...


class ChunkedFile(ABC):
    """A file of chunks that hold messages. A damaged chunk costs its own messages only.

    Args:
        path: The file.

    Raises:
        Any of `read_errors`: It has no index, or a damaged one.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.topics: dict[str, TopicInfo] = {}
        self.start_ns = self.end_ns = 0
        self._mixed: dict[str, str] = {}
        self._damaged: dict[int, str] = {}
        self._cut = True
        self._file = path.open("rb")
        self._chunks: Sequence[Any] = ()
        try:
            self._chunks = self._open()
        except BaseException:
            self._file.close()
            raise

    @abstractmethod
    def _open(self) -> Sequence[Any]:
        """Read the index: set topics and stamps, return chunks in the order of the file."""

    @abstractmethod
    def _holds(self, chunk: Any, topics: Collection[str]) -> bool:
        """Whether a chunk has messages of some topics."""

    @abstractmethod
    def _read(self, chunk: Any, topics: Collection[str], heads: Collection[str]) -> list[Raw]:
        """Messages of a chunk, those of `heads` perhaps cut."""

    @abstractmethod
    def _position(self, chunk: Any) -> int:
        """Where a chunk begins in the file."""

    def _add(self, info: TopicInfo) -> bool:
        """Count a connection of a topic; False if the topic has another type already."""
        info = replace(info, type=normalised(info.type))
        known = self.topics.setdefault(info.name, replace(info, count=0))
        if known.type != info.type:
            self._mixed[info.name] = f"{known.type} and {info.type}"
            return False
        self.topics[info.name] = replace(known, count=known.count + info.count)
        return True

    @property
    def problems(self) -> list[str]:
        """What was wrong with the file so far, one line each."""
        lines = [
            f"{self.path}: topic {topic} has messages of {types}: the latter are ignored"
            for topic, types in self._mixed.items()
        ]
        if self._damaged:
            position, reason = next(iter(self._damaged.items()))
            lines.append(
                f"{self.path}: {len(self._damaged)} of {len(self._chunks)} chunks are damaged "
                f"(the first at byte {position}: {reason}): their messages are lost"
            )
        return lines

    def messages(self, topics: Collection[str], heads: Collection[str] = ()) -> Iterator[Raw]:
        """Messages of some topics, in the order of the file."""
        for chunk in self._chunks:
            if not self._holds(chunk, topics):
                continue
            try:
                found = self._read(chunk, topics, heads if self._cut else ())
                if self._cut and any(raw.data[:4] == ZSTD_MAGIC for raw in found):
                    # Compressed one by one: the beginning of one may not be decompressible.
                    self._cut = False
                    found = self._read(chunk, topics, ())
                found = [raw._replace(data=plain(raw.data, raw.topic in heads)) for raw in found]
            except read_errors() as error:
                self._damaged[self._position(chunk)] = describe(error)
                continue
            yield from found

    def close(self) -> None:
        """Release the file."""
        self._file.close()


def bytes_needed(
    index: Sequence[tuple[int, str]], size: int, heads: Collection[str], head: int
) -> int:
    """How much of a chunk must be decompressed.

    Args:
        index: Offset and topic of its messages.
        size: Bytes of the whole chunk.
        heads: Topics of which the beginning is enough.
        head: Bytes from a message's offset to the end of its beginning.
    """
    ordered = sorted(index)
    ends = [offset for offset, _ in ordered[1:]] + [size]
    needed = (
        min(offset + head, end) if topic in heads else end
        for (offset, topic), end in zip(ordered, ends, strict=True)
    )
    return max(needed, default=size)


def plain(data: bytes | memoryview, head: bool = False) -> memoryview:
    """Bytes of a message that may have been compressed alone.

    Outside a ROS 2 folder nothing else tells: no serialised message begins with this number.

    Args:
        data: Bytes of the message.
        head: Whether its first `HEAD` bytes are enough.
    """
    if data[:4] != ZSTD_MAGIC:
        return memoryview(data)
    import zstandard

    decompressor = zstandard.ZstdDecompressor()
    if head:
        with decompressor.stream_reader(data) as reader:
            return memoryview(reader.read(HEAD))
    return memoryview(decompressor.decompressobj().decompress(data))


def normalised(type_name: str) -> str:
    """ROS 2 form of a type's name."""
    package, _, rest = type_name.partition("/")
    return f"{package}/msg/{rest}" if rest and "/" not in rest else type_name


def read_errors() -> tuple[type[Exception], ...]:
    """What readers raise on damaged files; most do not have errors of their own."""
    import zstandard
    from mcap.exceptions import McapError

    return (
        McapError,
        sqlite3.Error,
        zstandard.ZstdError,
        struct.error,
        LookupError,
        ValueError,
        TypeError,
        EOFError,
        RuntimeError,
        OSError,
    )


def describe(error: Exception) -> str:
    """An error in one line."""
    if type(error).__name__ == "EndOfFile":
        return RAN_OUT
    return (str(error).strip().splitlines() or [type(error).__name__])[0].rstrip(".")


RAN_OUT = "it ends in the middle of a record"
