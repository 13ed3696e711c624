"""ROS 1 bags, version 2.0: chunks of messages, each chunk compressed or not."""

from __future__ import annotations

import bz2
import re
import struct
from collections.abc import Collection, Iterator, Sequence
from pathlib import Path
from typing import BinaryIO, NamedTuple

from lcdata.recording.storage import (
    HEAD,
    RAN_OUT,
    ChunkedFile,
    Raw,
    TopicInfo,
    bytes_needed,
)

MAGIC = b"#ROSBAG V2.0\n"
MESSAGE, BAG, INDEX, CHUNK, CHUNK_INFO, CONNECTION = (bytes([op]) for op in range(2, 8))
"""Kinds of records."""

LONGEST_RECORD = 2**30
"""A longer one is damage."""

Header = dict[bytes, bytes]


class Connection(NamedTuple):
    """A publisher of a topic."""

    topic: str
    type: str


class Chunk(NamedTuple):
    """Where a chunk lies, and how many messages of each connection are in it."""

    position: int
    counts: dict[int, int]


class Ros1Bag(ChunkedFile):
    """An indexed bag."""

    def _open(self) -> Sequence[Chunk]:
        file = self._file
        check_magic(file)
        bag = read_header(file)
        position = int.from_bytes(bag[b"index_pos"], "little")
        if not position:
            raise ValueError("its recorder was killed before it wrote the index")
        file.seek(position)
        self._connections: dict[int, Connection] = {}
        for _ in range(_u32(bag[b"conn_count"])):
            header = read_header(file)
            fields = parse_header(read_exactly(file, read_u32(file)))
            self._connections[_u32(header[b"conn"])] = connection(header, fields)
        chunks, times = [], []
        counts: dict[int, int] = {}
        for _ in range(_u32(bag[b"chunk_count"])):
            header = read_header(file)
            pairs = struct.iter_unpack("<II", read_exactly(file, read_u32(file)))
            chunk = Chunk(int.from_bytes(header[b"chunk_pos"], "little"), dict(pairs))
            chunks.append(chunk)
            if chunk.counts:
                times += [_time(header[b"start_time"]), _time(header[b"end_time"])]
            for key, count in chunk.counts.items():
                counts[key] = counts.get(key, 0) + count
        for key, (topic, type_name) in list(self._connections.items()):
            if not self._add(TopicInfo(topic, type_name, counts.get(key, 0), "ros1")):
                del self._connections[key]
        self.start_ns, self.end_ns = min(times, default=0), max(times, default=0)
        if chunks:  # a copy that was cut off has its index at the end, or none
            file.seek(chunks[-1].position)
            read_header(file)
        return sorted(chunks)

    def _position(self, chunk: Chunk) -> int:
        return chunk.position

    def _holds(self, chunk: Chunk, topics: Collection[str]) -> bool:
        known = self._connections
        return any(key in known and known[key].topic in topics for key in chunk.counts)

    def _read(self, chunk: Chunk, topics: Collection[str], heads: Collection[str]) -> list[Raw]:
        file = self._file
        file.seek(chunk.position)
        header = read_header(file)
        stored, size = read_u32(file), _u32(header[b"size"])
        if heads:
            begin = file.tell()
            file.seek(begin + stored)
            index = [e for e in self._index(len(chunk.counts)) if e[1] in topics]
            size = bytes_needed(index, size, heads, 256 + HEAD)
            file.seek(begin)
        compression = header[b"compression"]
        data = read_exactly(file, min(stored, size) if compression == b"none" else stored)
        view = memoryview(decompress(compression, data, size))
        if len(view) < size:
            raise EOFError(RAN_OUT)
        found = chunk_messages(view, dict(self._connections), cut=bool(heads))
        return [Raw(c.topic, stamp, raw) for c, stamp, raw in found if c.topic in topics]

    def _index(self, records: int) -> list[tuple[int, str]]:
        """Offset and topic of the messages of the chunk that ends here."""
        found = []
        for _ in range(records):
            header = read_header(self._file)
            data = read_exactly(self._file, read_u32(self._file))
            known = self._connections.get(_u32(header[b"conn"]))
            if known:
                found += [(o, known.topic) for _, _, o in struct.iter_unpack("<III", data)]
        return found


def scan(path: Path) -> Iterator[tuple[TopicInfo, int, memoryview]]:
    """Topic (its count 0), stamp and bytes of messages, from the beginning as far as it goes."""
    connections: dict[int, Connection] = {}
    with path.open("rb") as file:
        check_magic(file)
        while prefix := file.read(4):
            header = parse_header(read_exactly(file, _u32(prefix)))
            if (size := read_u32(file)) > LONGEST_RECORD:
                raise ValueError(f"it has a record of {size} bytes")
            data = file.read(size)
            if header[b"op"] == CHUNK:
                chunk = memoryview(decompress(header[b"compression"], data))
                for (topic, type_name), stamp, raw in chunk_messages(chunk, connections):
                    yield TopicInfo(topic, type_name, 0, "ros1"), stamp, raw
            if len(data) < size:
                raise EOFError(RAN_OUT)


def chunk_messages(
    chunk: memoryview, connections: dict[int, Connection], cut: bool = False
) -> Iterator[tuple[Connection, int, memoryview]]:
    """Messages of a chunk that may be cut off.

    Args:
        chunk: Decompressed bytes.
        connections: Known connections; those in the chunk are added.
        cut: Whether to yield the beginning of a message that is cut off.
    """
    position = 0
    while position + 8 <= len(chunk):
        end = position + 4 + _u32(chunk[position:])
        if end + 4 > len(chunk):
            return
        header = parse_header(bytes(chunk[position + 4 : end]))
        position = end + 4 + _u32(chunk[end:])
        data = chunk[end + 4 : position]
        if position > len(chunk) and not cut:
            return
        if header[b"op"] == CONNECTION and position <= len(chunk):
            found = connection(header, parse_header(bytes(data)))
            connections.setdefault(_u32(header[b"conn"]), found)
        elif header[b"op"] == MESSAGE:
            key = _u32(header[b"conn"])
            if key in connections:
                yield connections[key], _time(header[b"time"]), data


def connection(header: Header, fields: Header) -> Connection:
    """Connection of its record's header and data."""
    topic = re.sub("/+", "/", header[b"topic"].decode())
    return Connection(topic, fields[b"type"].decode())


def decompress(compression: bytes, data: bytes, size: int = -1) -> bytes:
    """The first `size` bytes of a chunk, or as many as are there."""
    import lz4.frame  # type: ignore[import-untyped]

    if compression == b"bz2":
        return bz2.BZ2Decompressor().decompress(data, size)
    if compression == b"lz4":
        return bytes(lz4.frame.LZ4FrameDecompressor().decompress(data, size))
    if compression != b"none":
        raise ValueError(f"unknown compression {compression.decode(errors='replace')!r}")
    return data


def check_magic(file: BinaryIO) -> None:
    """Read the first line."""
    if (magic := file.read(len(MAGIC))) != MAGIC:
        raise ValueError(f"it begins with {magic!r}, not {MAGIC!r}")


def read_header(file: BinaryIO) -> Header:
    """Header of the record that begins here."""
    return parse_header(read_exactly(file, read_u32(file)))


def parse_header(data: bytes) -> Header:
    """Fields of a header."""
    fields, position = {}, 0
    while position < len(data):
        size = _u32(data[position : position + 4])
        name, _, value = data[position + 4 : position + 4 + size].partition(b"=")
        fields[name] = value
        position += 4 + size
    return fields


def read_u32(file: BinaryIO) -> int:
    """An unsigned number of 32 bits."""
    return _u32(read_exactly(file, 4))


def read_exactly(file: BinaryIO, size: int) -> bytes:
    """So many bytes.

    Raises:
        EOFError: There are not so many.
    """
    data = file.read(size)
    if len(data) < size:
        raise EOFError(RAN_OUT)
    return data


def _u32(data: bytes | memoryview) -> int:
    return int(struct.unpack_from("<I", data)[0])


def _time(data: bytes) -> int:
    seconds, nanoseconds = struct.unpack("<II", data)
    return int(seconds) * 10**9 + int(nanoseconds)
