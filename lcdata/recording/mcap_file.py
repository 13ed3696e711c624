"""MCAP files: chunks of messages, each chunk compressed or not."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Collection, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

from lcdata.recording.storage import (
    HEAD,
    RAN_OUT,
    ChunkedFile,
    Raw,
    TopicInfo,
    bytes_needed,
    plain,
)

if TYPE_CHECKING:
    from mcap.records import ChunkIndex

MAGIC = b"\x89MCAP0\r\n"
FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK = range(2, 7)
"""Kinds of records."""
LONGEST_RECORD = 2**30
"""A longer one is damage."""
RECORD = struct.Struct("<BQ")
"""Kind and length in front of every record."""
MESSAGE_HEADER = struct.Struct("<HIQQ")
"""Channel, sequence, log time and publish time in front of a message's bytes."""


class McapFile(ChunkedFile):
    """An indexed MCAP file."""

    def _open(self) -> Sequence[ChunkIndex]:
        from mcap.reader import SeekingReader

        summary = SeekingReader(self._file).get_summary()
        statistics = summary.statistics if summary else None
        if summary is None or statistics is None or not summary.chunk_indexes:
            raise ValueError("it has no index")
        self._names: dict[int, str] = {}
        for key, channel in summary.channels.items():
            schema = summary.schemas.get(channel.schema_id)
            count = statistics.channel_message_counts.get(key, 0)
            type_name = schema.name if schema else ""
            if self._add(TopicInfo(channel.topic, type_name, count, channel.message_encoding)):
                self._names[key] = channel.topic
        if statistics.message_count:
            self.start_ns, self.end_ns = (
                statistics.message_start_time,
                statistics.message_end_time,
            )
        return sorted(summary.chunk_indexes, key=lambda chunk: chunk.chunk_start_offset)

    def _position(self, chunk: ChunkIndex) -> int:
        return chunk.chunk_start_offset

    def _holds(self, chunk: ChunkIndex, topics: Collection[str]) -> bool:
        offsets = chunk.message_index_offsets
        return not offsets or any(self._names.get(key) in topics for key in offsets)

    def _read(
        self, chunk: ChunkIndex, topics: Collection[str], heads: Collection[str]
    ) -> list[Raw]:
        size, file = chunk.uncompressed_size, self._file
        if heads and chunk.message_index_offsets:
            index = [entry for entry in self._index(chunk) if entry[1] in topics]
            size = bytes_needed(index, size, heads, RECORD.size + MESSAGE_HEADER.size + HEAD)
        # Kind and length of the record, first and last time, uncompressed size: then the CRC.
        file.seek(chunk.chunk_start_offset + RECORD.size + 24)
        (crc,) = struct.unpack("<I", _exactly(file, 4))
        file.seek(4 + len(chunk.compression) + 8, 1)
        stored = chunk.compressed_size
        data = _exactly(file, stored if chunk.compression else min(stored, size))
        view = memoryview(_decompress(chunk.compression, data, size, chunk.uncompressed_size))
        if len(view) < size:
            raise EOFError(RAN_OUT)
        if crc and size == chunk.uncompressed_size and zlib.crc32(view) != crc:
            raise ValueError("its checksum is wrong")
        return list(self._messages(view, topics))

    def _index(self, chunk: ChunkIndex) -> Iterator[tuple[int, str]]:
        """Offset and topic of the messages of a chunk."""
        self._file.seek(chunk.chunk_start_offset + chunk.chunk_length)
        data = _exactly(self._file, chunk.message_index_length)
        position = 0
        while position < len(data):
            _, length = RECORD.unpack_from(data, position)
            body = position + RECORD.size
            channel, _ = struct.unpack_from("<HI", data, body)
            position = body + length
            topic = self._names.get(channel)
            if topic is not None:
                for _, offset in struct.iter_unpack("<QQ", data[body + 6 : position]):
                    yield offset, topic

    def _messages(self, view: memoryview, topics: Collection[str]) -> Iterator[Raw]:
        position = 0
        while position + RECORD.size + MESSAGE_HEADER.size <= len(view):
            kind, length = RECORD.unpack_from(view, position)
            body = position + RECORD.size
            position = body + length
            if kind == MESSAGE:
                channel, _, stamp, _ = MESSAGE_HEADER.unpack_from(view, body)
                topic = self._names.get(channel)
                if topic is not None and topic in topics:
                    yield Raw(topic, stamp, view[body + MESSAGE_HEADER.size : position])


def scan(path: Path) -> Iterator[tuple[TopicInfo, int, memoryview]]:
    """Topic (its count 0), stamp and bytes of messages, from the beginning as far as it goes."""
    schemas: dict[int, str] = {}
    infos: dict[int, TopicInfo] = {}
    with path.open("rb") as file:
        if (magic := file.read(len(MAGIC))) != MAGIC:
            raise ValueError(f"it begins with {magic!r}, not {MAGIC!r}")
        while True:
            head = _exactly(file, RECORD.size)
            kind, length = RECORD.unpack(head)
            if kind == FOOTER:
                return
            if length > LONGEST_RECORD:
                raise ValueError(f"it has a record of {length} bytes")
            body = file.read(length)
            data = _chunk_data(body) if kind == CHUNK else head + body
            yield from _scan_records(memoryview(data), schemas, infos)
            if len(body) < length:
                raise EOFError(RAN_OUT)


def _scan_records(
    view: memoryview, schemas: dict[int, str], infos: dict[int, TopicInfo]
) -> Iterator[tuple[TopicInfo, int, memoryview]]:
    """Messages of records; schemas and channels are noted. The last record may be cut off."""
    position = 0
    while position + RECORD.size <= len(view):
        kind, length = RECORD.unpack_from(view, position)
        body = view[position + RECORD.size : position + RECORD.size + length]
        position += RECORD.size + length
        if position > len(view):
            return
        if kind == SCHEMA:
            schemas[_u16(body)] = _strings(body[2:], 1)[0]
        elif kind == CHANNEL:
            topic, encoding = _strings(body[4:], 2)
            infos[_u16(body)] = TopicInfo(topic, schemas.get(_u16(body[2:]), ""), 0, encoding)
        elif kind == MESSAGE:
            channel, _, stamp, _ = MESSAGE_HEADER.unpack_from(body)
            yield infos[channel], stamp, plain(body[MESSAGE_HEADER.size :])


def _chunk_data(body: bytes) -> bytes:
    """Uncompressed records of a chunk, as many as are there."""
    import lz4.frame  # type: ignore[import-untyped]
    import zstandard

    (compression,) = _strings(memoryview(body)[28:], 1)
    data = body[28 + 4 + len(compression) + 8 :]
    if compression == "zstd":
        return zstandard.ZstdDecompressor().decompressobj().decompress(data)
    if compression == "lz4":
        return bytes(lz4.frame.LZ4FrameDecompressor().decompress(data))
    return _decompress(compression, data, -1, len(data))


def _strings(data: memoryview, count: int) -> list[str]:
    found, position = [], 0
    for _ in range(count):
        (size,) = struct.unpack_from("<I", data, position)
        found.append(bytes(data[position + 4 : position + 4 + size]).decode())
        position += 4 + size
    return found


def _u16(data: memoryview) -> int:
    return int(struct.unpack_from("<H", data)[0])


def _decompress(compression: str, data: bytes, size: int, whole: int) -> bytes:
    """The first `size` bytes of the `whole` chunk."""
    import lz4.frame
    import zstandard

    if compression == "zstd":
        decompressor = zstandard.ZstdDecompressor()
        if size == whole:
            return decompressor.decompress(data, max_output_size=whole)
        with decompressor.stream_reader(data) as reader:
            return reader.read(size)
    if compression == "lz4":
        return bytes(lz4.frame.LZ4FrameDecompressor().decompress(data, size))
    if compression:
        raise ValueError(f"unknown compression {compression!r}")
    return data


def _exactly(file: BinaryIO, size: int) -> bytes:
    data = file.read(size)
    if len(data) < size:
        raise EOFError(RAN_OUT)
    return data
