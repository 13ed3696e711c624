"""Reading files without a usable index from their beginning, as far as they go.

A recorder that was killed or a copy that was cut off leaves no index: ROS 1 bags, MCAP and
sqlite3 files are then read record by record. MCAP files of other profiles than ROS 2 come this
way, too.
"""

from __future__ import annotations

import bz2
import struct
from collections.abc import Callable, Collection, Iterator
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple
from urllib.parse import quote

from lcdata.errors import RecordingError
from lcdata.recording.storage import TopicInfo, describe, plain, read_errors

RAN_OUT = "it ends in the middle of a record"


class Raw(NamedTuple):
    """A message as it lies in the file."""

    topic: str
    type: str
    encoding: str
    stamp_ns: int
    data: memoryview


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
        self.problems: list[str] = []
        self.start_ns, self.end_ns = 2**63 - 1, 0
        self._stopped = ""
        for raw in self._read():
            name = _normalised(raw.type)
            known = self.topics.setdefault(raw.topic, TopicInfo(raw.topic, name, 0, raw.encoding))
            self.topics[raw.topic] = replace(known, count=known.count + 1)
            self.start_ns = min(self.start_ns, raw.stamp_ns)
            self.end_ns = max(self.end_ns, raw.stamp_ns)
        count = sum(info.count for info in self.topics.values())
        if not count:
            raise RecordingError(
                f"{path} cannot be read ({self._stopped or reason})", "copy or record it again"
            )
        if self._stopped:
            self.problems.append(
                f"{path} is cut off or damaged ({self._stopped}): its first {count} messages "
                "are read"
            )
        elif suffix != ".mcap":
            self.problems.append(f"{path} has no index ({reason}): its {count} messages are read")

    def _read(self) -> Iterator[Raw]:
        try:
            yield from self._scan(self.path)
        except read_errors() as error:
            self._stopped = describe(error)

    def messages(self, topics: Collection[str]) -> Iterator[tuple[str, int, memoryview]]:
        """Topic, the recorder's stamp in ns, and bytes of each message of some topics."""
        for raw in self._read():
            if raw.topic in topics and _normalised(raw.type) == self.topics[raw.topic].type:
                yield raw.topic, raw.stamp_ns, raw.data

    def close(self) -> None:
        """Nothing stays open between two readings."""


def _normalised(type_name: str) -> str:
    """ROS 2 form of a type's name."""
    package, _, rest = type_name.partition("/")
    return f"{package}/msg/{rest}" if rest and "/" not in rest else type_name


def scan_ros1(path: Path) -> Iterator[Raw]:
    """Messages of the chunks of a ROS 1 bag."""
    connections: dict[int, tuple[str, str]] = {}
    with path.open("rb") as file:
        if file.readline() != b"#ROSBAG V2.0\n":
            raise ValueError("it is not a ROS 1 bag of version 2.0")
        while prefix := file.read(4):
            header = _ros1_header(_exactly(file.read, _u32(prefix)))
            size = _u32(_exactly(file.read, 4))
            data = file.read(size)
            if header[b"op"] == b"\x05":
                chunk = _decompress_ros1(header[b"compression"], data)
                yield from _ros1_chunk(memoryview(chunk), connections)
            if len(data) < size:
                raise EOFError(RAN_OUT)


def _ros1_chunk(chunk: memoryview, connections: dict[int, tuple[str, str]]) -> Iterator[Raw]:
    position = 0
    while position + 8 <= len(chunk):
        end = position + 4 + _u32(chunk[position:])
        header = _ros1_header(bytes(chunk[position + 4 : end]))
        size = _u32(chunk[end : end + 4])
        position = end + 4 + size
        if position > len(chunk):
            return  # the chunk is cut off; its reader says so
        data = chunk[end + 4 : position]
        if header[b"op"] == b"\x07":
            fields = _ros1_header(bytes(data))
            topic = "/".join(header[b"topic"].decode().split("/"))
            connections[_u32(header[b"conn"])] = (topic, fields[b"type"].decode())
        elif header[b"op"] == b"\x02":
            topic, type_name = connections[_u32(header[b"conn"])]
            seconds, nanoseconds = struct.unpack("<II", header[b"time"])
            yield Raw(topic, type_name, "ros1", seconds * 10**9 + nanoseconds, data)


def _ros1_header(data: bytes) -> dict[bytes, bytes]:
    fields, position = {}, 0
    while position < len(data):
        size = _u32(data[position : position + 4])
        name, _, value = data[position + 4 : position + 4 + size].partition(b"=")
        fields[name] = value
        position += 4 + size
    return fields


def _decompress_ros1(compression: bytes, data: bytes) -> bytes:
    """As much of a chunk as is there."""
    import lz4.frame  # type: ignore[import-untyped]

    if compression == b"bz2":
        return bz2.BZ2Decompressor().decompress(data)
    if compression == b"lz4":
        return bytes(lz4.frame.LZ4FrameDecompressor().decompress(data))
    return data


def _u32(data: bytes | memoryview) -> int:
    return int(struct.unpack_from("<I", data)[0])


def _exactly(read: Callable[[int], bytes], size: int) -> bytes:
    data = read(size)
    if len(data) < size:
        raise EOFError(RAN_OUT)
    return data


def scan_mcap(path: Path) -> Iterator[Raw]:
    """Messages of an MCAP file in the order of the file."""
    from mcap.records import Channel, Message, Schema
    from mcap.stream_reader import StreamReader

    schemas: dict[int, str] = {}
    channels: dict[int, Channel] = {}
    with path.open("rb") as file:
        for record in StreamReader(file).records:
            if isinstance(record, Schema):
                schemas[record.id] = record.name
            elif isinstance(record, Channel):
                channels[record.id] = record
            elif isinstance(record, Message):
                channel = channels[record.channel_id]
                type_name = schemas.get(channel.schema_id, "")
                encoding = channel.message_encoding
                yield Raw(channel.topic, type_name, encoding, record.log_time, plain(record.data))


def scan_sqlite3(path: Path) -> Iterator[Raw]:
    """Messages of a rosbag2 database in the order in which they were written."""
    import sqlite3

    uri = f"file:{quote(str(path.absolute()))}?immutable=1"
    connection = sqlite3.connect(uri, uri=True)
    try:
        # Without this, SQLite refuses a file that is shorter than its header says.
        connection.execute("PRAGMA writable_schema = ON")
        topics = {
            key: (name, type_name, encoding)
            for key, name, type_name, encoding in connection.execute(
                "SELECT id, name, type, serialization_format FROM topics"
            )
        }
        rows = connection.execute("SELECT topic_id, timestamp, data FROM messages NOT INDEXED")
        for key, stamp, data in rows:
            if key in topics:
                yield Raw(*topics[key], stamp, plain(data))
    finally:
        connection.close()


SCANNERS: dict[str, Callable[[Path], Iterator[Raw]]] = {
    ".bag": scan_ros1,
    ".mcap": scan_mcap,
    ".db3": scan_sqlite3,
}
"""Scanner of each kind of file."""
