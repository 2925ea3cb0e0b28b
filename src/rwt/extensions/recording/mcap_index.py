"""Records and indexes of MCAP files, read without trusting a length, a count or a size in them.

The work and the memory for a file are limited by its size on the disk and by what a chunk may have unpacked:
a chunk of a few kilobytes can claim, or contain, gigabytes or millions of records.
"""

from __future__ import annotations

import logging
import struct
import zlib
from array import array
from collections.abc import Collection, Iterable, Iterator
from dataclasses import dataclass
from io import SEEK_END, BytesIO
from typing import IO, Final

from mcap import records
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.summary import Summary

from rwt.extensions.recording.unpacking import too_large, unpack

logger = logging.getLogger(__name__)

MAGIC: Final = b"\x89MCAP0\r\n"

CHUNK_MESSAGES: Final = 1_000_000
"""Maximum number of messages in a chunk. Writers begin another after some megabytes."""
CHUNK_RECORDS: Final = 10_000
"""Maximum number of other records in a chunk."""
DESCRIPTION_BYTES: Final = 64 * 1024 * 1024
"""Maximum size of all schemas and channels of a file."""

HEAD: Final = struct.Struct("<BQ")
_MESSAGE: Final = struct.Struct("<HIQQ")
_FOOTER_BYTES: Final = HEAD.size + 20

#: As plain numbers: they are compared for each record.
_NO_RECORD: Final = 0
_SCHEMA: Final = int(Opcode.SCHEMA)
_CHANNEL: Final = int(Opcode.CHANNEL)
_MESSAGE_RECORD: Final = int(Opcode.MESSAGE)

_INVALID: Final = (McapError, ValueError, OverflowError, struct.error, MemoryError)
"""Errors of the library for content that is not a record."""

ChannelMessage = tuple[records.Schema | None, records.Channel, records.Message]
Head = tuple[int, int, int]
"""Opcode of a record, and where its content begins and ends."""


@dataclass(frozen=True, slots=True)
class MessageFilter:
    """Selection of messages.

    Attributes:
        channels: ids of the selected channels.
        start_ns: first log time.
        end_ns: log time after the last one; None without such a limit.
    """

    channels: Collection[int]
    start_ns: int
    end_ns: int | None

    def accepts(self, channel: int, log_time: int) -> bool:
        """Return True if a message is selected."""
        if log_time < self.start_ns or (self.end_ns is not None and log_time >= self.end_ns):
            return False
        return channel in self.channels


class MessagePositions:
    """Positions of selected messages in log time order; arrays, since there may be millions of them."""

    def __init__(self) -> None:
        self._times = array("Q")
        self._begins = array("Q")
        self._ends = array("Q")
        self._is_sorted = True

    def add(self, log_time: int, begin: int, end: int) -> None:
        """Add a message."""
        times = self._times
        if times and log_time < times[-1]:
            self._is_sorted = False
        times.append(log_time)
        self._begins.append(begin)
        self._ends.append(end)

    def in_order(self) -> Iterator[tuple[int, int, int]]:
        """Yield log times, begins and ends; those of one time in the order of the file."""
        order: Iterable[int] = range(len(self._times))
        if not self._is_sorted:
            order = sorted(order, key=self._times.__getitem__)
        for number in order:
            yield self._times[number], self._begins[number], self._ends[number]


# -- records of the file -------------------------------------------------------------------------------------


def file_records(file: IO[bytes], begin: int, end: int | None = None) -> Iterator[Head]:
    """Yield the heads of the complete records between two positions; the file's position may be changed."""
    size = file.seek(0, SEEK_END) if end is None else end
    while begin + HEAD.size <= size:
        file.seek(begin)
        opcode, length = HEAD.unpack(file.read(HEAD.size))
        begin += HEAD.size
        # A file that was not written to its end may have zeros there, gigabytes of them without any disk.
        if begin + length > size or opcode == _NO_RECORD:
            return
        yield opcode, begin, begin + length
        begin += length


def data_records(file: IO[bytes]) -> Iterator[Head]:
    """Yield the heads of the records before the index."""
    for head in file_records(file, len(MAGIC)):
        if head[0] in (Opcode.DATA_END, Opcode.FOOTER):
            return
        yield head


def read_content(file: IO[bytes], head: Head, most_bytes: int) -> bytes:
    """Return the content of a record.

    Raises:
        ValueError: it is larger than a record that has `most_bytes` of data.
    """
    _, begin, end = head
    # Data that cannot be compressed becomes a little larger.
    if end - begin > most_bytes + most_bytes // 64 + 64 * 1024:
        raise too_large(most_bytes)
    file.seek(begin)
    return file.read(end - begin)


def read_metadata(content: bytes) -> records.Metadata | None:
    """Return a metadata record; None if it is damaged."""
    try:
        found: records.Metadata = records.Metadata.read(ReadDataStream(BytesIO(content)))
    except _INVALID:
        return None
    return found


def read_message(content: bytes | memoryview) -> records.Message:
    """Return a message record, of at least 22 bytes."""
    channel, sequence, log_time, publish_time = _MESSAGE.unpack_from(content)
    data = bytes(content[_MESSAGE.size :])
    return records.Message(channel, log_time, data, publish_time, sequence)


# -- chunks --------------------------------------------------------------------------------------------------


def chunk_content(record: bytes, most_bytes: int) -> bytes | bytearray:
    """Return the unpacked content of a chunk record.

    Raises:
        Exception: it is damaged, has another size than it claims, or is larger than `most_bytes`.
    """
    return _unpacked(records.Chunk.read(ReadDataStream(BytesIO(record))), most_bytes)


def _unpacked(chunk: records.Chunk, most_bytes: int) -> bytes | bytearray:
    if chunk.uncompressed_size > most_bytes:
        raise too_large(most_bytes)
    content = unpack(chunk.data, chunk.compression, chunk.uncompressed_size)
    if len(content) != chunk.uncompressed_size:
        raise ValueError(f"it has {len(content)} bytes unpacked, and claims {chunk.uncompressed_size}")
    if chunk.uncompressed_crc and zlib.crc32(content) != chunk.uncompressed_crc:
        raise ValueError("its checksum is wrong")
    return content


def chunk_records(content: bytes | bytearray) -> Iterator[Head]:
    """Yield the heads of the records in the content of a chunk.

    Raises:
        ValueError: a record is longer than the rest, or there are too many.
        struct.error: the content ends within a head.
    """
    size, end = len(content), 0
    messages = others = 0
    while end < size:
        opcode, length = HEAD.unpack_from(content, end)
        begin = end + HEAD.size
        end = begin + length
        if end > size:
            raise ValueError("a record is longer than its chunk")
        if opcode == _MESSAGE_RECORD:
            if length < _MESSAGE.size:
                raise ValueError("a message is too short")
            messages += 1
        else:
            others += 1
        if messages > CHUNK_MESSAGES or others > CHUNK_RECORDS:
            raise ValueError(
                f"it has too many records: the limit is {CHUNK_MESSAGES} messages and {CHUNK_RECORDS} others"
            )
        yield opcode, begin, end


def message_positions(content: bytes | bytearray, wanted: MessageFilter) -> MessagePositions:
    """Return the positions of selected messages in the content of a chunk."""
    found = MessagePositions()
    for opcode, begin, end in chunk_records(content):
        if opcode == _MESSAGE_RECORD:
            channel, _, log_time, _ = _MESSAGE.unpack_from(content, begin)
            if wanted.accepts(channel, log_time):
                found.add(log_time, begin, end)
    return found


def unchunked_positions(file: IO[bytes], wanted: MessageFilter, most_bytes: int) -> MessagePositions:
    """Return the positions of selected messages outside of chunks, without those above `most_bytes`."""
    found = MessagePositions()
    for opcode, begin, end in data_records(file):
        if opcode == _MESSAGE_RECORD and _MESSAGE.size <= end - begin <= most_bytes:
            file.seek(begin)
            channel, _, log_time, _ = _MESSAGE.unpack(file.read(_MESSAGE.size))
            if wanted.accepts(channel, log_time):
                found.add(log_time, begin, end)
    return found


# -- indexes -------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class RecoveryReport:
    """Contents of a file without a usable index.

    Attributes:
        summary: the index that the file should have had.
        damaged: chunks and records that could not be read.
        lost_bytes: bytes at the end that belong to no whole record.
        is_unchunked: True if messages stand in the file itself rather than in chunks.
    """

    summary: Summary
    damaged: int
    lost_bytes: int
    is_unchunked: bool


class _IndexBuilder:
    """Index of the records that it is given."""

    def __init__(self) -> None:
        self.summary = Summary()
        self.counts: dict[int, int] = {}
        self._described_bytes = 0

    def describe(self, opcode: int, content: bytes) -> None:
        """Add a schema or channel."""
        self._described_bytes += len(content)
        if self._described_bytes > DESCRIPTION_BYTES:
            raise ValueError(f"schemas and channels are larger than {DESCRIPTION_BYTES} bytes")
        stream = ReadDataStream(BytesIO(content))
        if opcode == _SCHEMA:
            schema = records.Schema.read(stream)
            self.summary.schemas[schema.id] = schema
        else:
            channel = records.Channel.read(stream)
            self.summary.channels[channel.id] = channel

    def count(self, channel: int, messages: int = 1) -> None:
        self.counts[channel] = self.counts.get(channel, 0) + messages

    def add_chunk(self, content: bytes | bytearray) -> None:
        """Add the content of a chunk."""
        counts: dict[int, int] = {}
        for opcode, begin, end in chunk_records(content):
            if opcode == _MESSAGE_RECORD:
                channel = content[begin] | content[begin + 1] << 8
                counts[channel] = counts.get(channel, 0) + 1
            elif opcode in (_SCHEMA, _CHANNEL):
                self.describe(opcode, bytes(content[begin:end]))
        for channel, messages in counts.items():
            self.count(channel, messages)


def read_index(file: IO[bytes], most_bytes: int) -> Summary | None:
    """Return the index at the end of a file; None if there is none that can be used."""
    size = file.seek(0, SEEK_END)
    footer_begin = size - len(MAGIC) - _FOOTER_BYTES
    builder = _IndexBuilder()
    summary = builder.summary
    try:
        file.seek(footer_begin)
        opcode, _, begin = struct.unpack("<BQQ", file.read(HEAD.size + 8))
        if opcode != Opcode.FOOTER or not begin:
            return None
        for head in file_records(file, begin, footer_begin):
            if head[0] in (_SCHEMA, _CHANNEL):
                builder.describe(head[0], read_content(file, head, most_bytes))
            elif head[0] in (Opcode.STATISTICS, Opcode.CHUNK_INDEX):
                stream = ReadDataStream(BytesIO(read_content(file, head, most_bytes)))
                if head[0] == Opcode.STATISTICS:
                    summary.statistics = records.Statistics.read(stream)
                else:
                    summary.chunk_indexes.append(records.ChunkIndex.read(stream))
    except (*_INVALID, OSError):
        # A cut file can have any bytes where its footer should be.
        return None
    statistics = summary.statistics
    if statistics is None or (statistics.message_count and not summary.chunk_indexes):
        return None
    summary.chunk_indexes = _without_overlaps(summary.chunk_indexes)
    return summary


def _without_overlaps(chunks: list[records.ChunkIndex]) -> list[records.ChunkIndex]:
    """Return the chunks that do not begin within another: a file could name the same bytes many times."""
    found: list[records.ChunkIndex] = []
    free = len(MAGIC)
    for chunk in sorted(chunks, key=lambda chunk: chunk.chunk_start_offset):
        if chunk.chunk_start_offset >= free:
            found.append(chunk)
            free = chunk.chunk_start_offset + chunk.chunk_length
    return found


def rebuild_index(file: IO[bytes], most_bytes: int) -> RecoveryReport:
    """Rebuild the index of a file by reading all of it."""
    builder, damaged, whole = _IndexBuilder(), 0, len(MAGIC)
    earliest, latest, is_unchunked = 2**64, -1, False
    for head in data_records(file):
        opcode, begin, whole = head
        try:
            if opcode == Opcode.CHUNK:
                chunk = records.Chunk.read(ReadDataStream(BytesIO(read_content(file, head, most_bytes))))
                builder.add_chunk(_unpacked(chunk, most_bytes))
                builder.summary.chunk_indexes.append(_chunk_index(chunk, begin, whole))
                earliest = min(earliest, chunk.message_start_time)
                latest = max(latest, chunk.message_end_time)
            elif opcode in (_SCHEMA, _CHANNEL):
                builder.describe(opcode, read_content(file, head, most_bytes))
            elif opcode == _MESSAGE_RECORD:
                file.seek(begin)
                channel, _, log_time, _ = _MESSAGE.unpack(file.read(min(_MESSAGE.size, whole - begin)))
                builder.count(channel)
                earliest, latest, is_unchunked = min(earliest, log_time), max(latest, log_time), True
        except Exception as error:
            # A damaged chunk fails in as many ways as there are compressions; the next one may be whole.
            logger.warning(
                "the record before byte %d is left out: %s", whole, str(error) or type(error).__name__
            )
            damaged += 1
    builder.summary.statistics = _statistics(builder, max(0, latest), earliest if latest >= 0 else 0)
    return RecoveryReport(builder.summary, damaged, file.seek(0, SEEK_END) - whole, is_unchunked)


def _chunk_index(chunk: records.Chunk, begin: int, end: int) -> records.ChunkIndex:
    return records.ChunkIndex(
        chunk_length=end - begin + HEAD.size,
        chunk_start_offset=begin - HEAD.size,
        compression=chunk.compression,
        compressed_size=len(chunk.data),
        message_end_time=chunk.message_end_time,
        message_index_length=0,
        message_index_offsets={},
        message_start_time=chunk.message_start_time,
        uncompressed_size=chunk.uncompressed_size,
    )


def _statistics(builder: _IndexBuilder, end_time: int, start_time: int) -> records.Statistics:
    summary, counts = builder.summary, builder.counts
    return records.Statistics(
        attachment_count=0,
        channel_count=len(summary.channels),
        channel_message_counts=counts,
        chunk_count=len(summary.chunk_indexes),
        message_count=sum(counts.values()),
        message_end_time=end_time,
        message_start_time=start_time,
        metadata_count=0,
        schema_count=len(summary.schemas),
    )
