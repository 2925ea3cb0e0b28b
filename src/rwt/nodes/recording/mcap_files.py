"""Reader of MCAP files, including incomplete ones of killed programs.

Imported only to read such a file, because it needs the extra ``mcap``.
"""

from __future__ import annotations

import logging
import os
import struct
import time
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass
from enum import Enum, auto
from heapq import heapify, heappop, heappush
from io import SEEK_END, BufferedReader, BytesIO, FileIO
from pathlib import Path
from typing import IO, Final

from mcap import records
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.reader import SeekingReader
from mcap.stream_reader import breakup_chunk
from mcap.summary import Summary

from rwt.nodes.recording.channels import DEFINITION, TYPE, ChannelForm, Encoding, read_offered_qos
from rwt.nodes.recording.errors import RecordingNotWritten, RecordingUnreadable
from rwt.nodes.recording.recording import (
    CHUNK_BYTES,
    MessageEncoding,
    RecordedMessage,
    RecordedTopic,
    Recording,
    merged_topics,
)
from rwt.nodes.recording.writer import METADATA, RecordedChannel, RecordingOptions, RecordingWriter
from rwt_interfaces.distro import JAZZY, NOETIC, Distro, closest_distro

logger = logging.getLogger(__name__)

MAGIC: Final = b"\x89MCAP0\r\n"

_ENCODINGS: Final[dict[str, MessageEncoding]] = {"cdr": "cdr", "ros1": "ros1", "json": "json"}
_Found = tuple[records.Schema | None, records.Channel, records.Message]

_HEAD: Final = struct.Struct("<BQ")
_MOST_WAITING: Final = 64 * 1024 * 1024

#: Bytes from which on a reading is compared with what the file still has.
_MUCH: Final = 64 * 1024
_KINDS: Final[dict[int, Callable[[ReadDataStream], records.McapRecord]]] = {
    Opcode.HEADER: records.Header.read,
    Opcode.SCHEMA: records.Schema.read,
    Opcode.CHANNEL: records.Channel.read,
    Opcode.CHUNK: records.Chunk.read,
    Opcode.METADATA: records.Metadata.read,
}


class _Damaged(Enum):
    """Mark of a record that cannot be read."""

    DAMAGED = auto()


DAMAGED: Final = _Damaged.DAMAGED


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


class McapRecording(Recording):
    """MCAP file opened for reading.

    Attributes:
        recovery: set when the file has no index, and was searched.
        index: the file's, or the one that was found by searching.

    Args:
        chunk_bytes: what a chunk may have unpacked; one that says more is left out.

    Raises:
        RecordingUnreadable: it is not an MCAP file.
    """

    def __init__(self, path: Path, chunk_bytes: int = CHUNK_BYTES) -> None:
        self.paths = (path,)
        self._path = path
        self._chunk_bytes = chunk_bytes
        self.recovery: RecoveryReport | None = None
        self._damaged: set[int] = set()  # by where the chunk begins
        self._file = _opened(path)
        try:
            self.index = self._indexed()
            self.complete = self.recovery is None
            self._describe()
        except BaseException:
            self._file.close()
            raise

    def _indexed(self) -> Summary:
        """Return the file's index, or one made by reading all of it."""
        try:
            self._file.seek(0)
            summary = SeekingReader(self._file).get_summary()
        except (McapError, OSError, ValueError, OverflowError, struct.error, MemoryError):
            # What a cut file holds where its footer should be can be anything.
            summary = None
        counted = None if summary is None else summary.statistics
        if summary is None or counted is None or (counted.message_count and not summary.chunk_indexes):
            self.recovery = rebuild_index(self._file, self._chunk_bytes)
            return self.recovery.summary
        return summary

    def _describe(self) -> None:
        summary, statistics = self.index, self.index.statistics
        assert statistics is not None  # Both ways to an index count.
        self.start_ns, self.end_ns = statistics.message_start_time, statistics.message_end_time
        self.distro = self._distro()
        counts = statistics.channel_message_counts
        self.topics = merged_topics(
            [
                _topic(channel, summary.schemas.get(channel.schema_id), counts.get(channel.id, 0))
                for channel in summary.channels.values()
            ]
        )

    def _distro(self) -> Distro:
        """Return the distribution from the file's metadata, or else from its profile and channels."""
        for _, record in walk(self._file):
            if isinstance(record, records.Metadata) and record.name == METADATA:
                note = record.metadata
                return closest_distro(note.get("distro", ""), 1 if note.get("ros_version") == "1" else 2)
            if not isinstance(record, records.Header):
                break
        encodings = {channel.message_encoding for channel in self.index.channels.values()}
        return NOETIC if "ros1" in encodings else JAZZY

    def messages(
        self, topics: Collection[str] | None = None, start_ns: int = 0, end_ns: int | None = None
    ) -> Iterator[RecordedMessage]:
        """The messages of `topics` from `start_ns` to before `end_ns`, by log time."""
        with _opened(self._path) as file:
            for schema, channel, message in self.channel_messages(file, topics, start_ns, end_ns):
                name = _type_name(channel, schema)
                published = message.publish_time or message.log_time
                yield RecordedMessage(channel.topic, name, message.log_time, published, message.data)

    def channel_messages(
        self, file: IO[bytes], topics: Collection[str] | None, start_ns: int, end_ns: int | None
    ) -> Iterator[_Found]:
        """The messages as the file has them, with their channels."""
        if self.recovery is not None and self.recovery.is_unchunked:
            return iter(self._unchunked(file, topics, start_ns, end_ns))
        return self._chunked(file, topics, start_ns, end_ns)

    def _chunked(
        self, file: IO[bytes], topics: Collection[str] | None, start_ns: int, end_ns: int | None
    ) -> Iterator[_Found]:
        """Yield the messages of all readable chunks by log time; chunks are opened when due."""
        channels, schemas = self.index.channels, self.index.schemas
        # Sorted by time, and then as they are in the file. A chunk stands before its own messages.
        due: list[tuple[int, int, int, records.ChunkIndex | _Found]] = [
            (chunk.message_start_time, chunk.chunk_start_offset, -1, chunk)
            for chunk in self.index.chunk_indexes
            if chunk.message_end_time >= start_ns and (end_ns is None or chunk.message_start_time < end_ns)
        ]
        heapify(due)
        while due:
            _, begin, _, item = heappop(due)
            if isinstance(item, tuple):
                yield item
                continue
            for number, message in enumerate(self._opened(file, item)):
                channel = channels.get(message.channel_id) if isinstance(message, records.Message) else None
                if channel is None or not isinstance(message, records.Message):
                    continue
                in_time = start_ns <= message.log_time and (end_ns is None or message.log_time < end_ns)
                if in_time and (topics is None or channel.topic in topics):
                    found = (schemas.get(channel.schema_id), channel, message)
                    heappush(due, (message.log_time, begin, number, found))

    def _opened(self, file: IO[bytes], chunk: records.ChunkIndex) -> list[records.McapRecord]:
        """Return the messages of a chunk; none if it is damaged, which is noted."""
        begin = chunk.chunk_start_offset
        try:
            file.seek(begin + _HEAD.size)
            return _contents(records.Chunk.read(ReadDataStream(file)), self._chunk_bytes)
        except Exception as error:
            # A damaged chunk fails in as many ways as there are compressions; the next one may be whole.
            if begin not in self._damaged:
                self._damaged.add(begin)
                logger.warning("%s: the chunk at byte %d is left out: %s", self._path, begin, error)
            return []

    @property
    def damaged(self) -> int:
        """Chunks and records that could not be read, as far as the file was read."""
        return len(self._damaged) + (0 if self.recovery is None else self.recovery.damaged)

    def _unchunked(
        self, file: IO[bytes], topics: Collection[str] | None, start_ns: int, end_ns: int | None
    ) -> list[_Found]:
        found: list[_Found] = []
        for _, message in walk(file):
            if isinstance(message, records.Message) and message.channel_id in self.index.channels:
                channel = self.index.channels[message.channel_id]
                in_time = start_ns <= message.log_time and (end_ns is None or message.log_time < end_ns)
                if in_time and (topics is None or channel.topic in topics):
                    found.append((self.index.schemas.get(channel.schema_id), channel, message))
        return sorted(found, key=lambda each: each[2].log_time)

    def close(self) -> None:
        """Close the file."""
        self._file.close()


class _File(BufferedReader):
    """File that limits reads to its size: reads allocate what is requested, any number in a damaged file."""

    def __init__(self, path: Path) -> None:
        super().__init__(FileIO(path))
        self._size = os.fstat(self.fileno()).st_size

    def read(self, size: int | None = -1, /) -> bytes:
        """Up to `size` bytes; fewer at the end."""
        if size is None or size > _MUCH:
            size = min(self._size if size is None else size, max(0, self._size - self.tell()))
        return super().read(size)


def _opened(path: Path) -> IO[bytes]:
    try:
        file = _File(path)
    except OSError as error:
        raise RecordingUnreadable(f"{path}: cannot be read: {error.strerror}") from None
    if file.read(len(MAGIC)) != MAGIC:
        file.close()
        raise RecordingUnreadable(
            f"{path} is not a recording: expected an MCAP file, a .bag of ROS 1 or a folder of rosbag2"
        )
    file.seek(0)
    return file


def _topic(channel: records.Channel, schema: records.Schema | None, count: int) -> RecordedTopic:
    encoding = _ENCODINGS.get(channel.message_encoding, "")
    definition = channel.metadata.get(DEFINITION, "")
    if not definition and schema is not None and schema.encoding in ("ros2msg", "ros1msg"):
        definition = schema.data.decode("utf-8", "replace")
    name = _type_name(channel, schema)
    return RecordedTopic(channel.topic, name, encoding, definition, count, read_offered_qos(channel.metadata))


def _type_name(channel: records.Channel, schema: records.Schema | None) -> str:
    return channel.metadata.get(TYPE) or ("" if schema is None else schema.name)


# -- files without an index ----------------------------------------------------------------------------------


def walk(file: IO[bytes]) -> Iterator[tuple[int, records.McapRecord | _Damaged | None]]:
    """Yield the records up to the index or the last complete one, chunks unopened, with their end positions.

    Unused kinds of records are None, and invalid records :data:`DAMAGED`.
    """
    size = file.seek(0, SEEK_END)
    end = len(MAGIC)
    while end + _HEAD.size <= size:
        begin = end
        file.seek(begin)
        opcode, length = _HEAD.unpack(file.read(_HEAD.size))
        end = begin + _HEAD.size + length
        if end > size or opcode in (Opcode.DATA_END, Opcode.FOOTER):
            return
        is_wanted = opcode in _KINDS or opcode == Opcode.MESSAGE
        yield end, _record(opcode, file.read(length)) if is_wanted else None


def _record(opcode: int, content: bytes) -> records.McapRecord | _Damaged:
    stream = ReadDataStream(BytesIO(content))
    try:
        if opcode != Opcode.MESSAGE:
            return _KINDS[opcode](stream)
        message: records.McapRecord = records.Message.read(stream, len(content))
        return message
    except (McapError, ValueError, struct.error):
        return DAMAGED


def _contents(chunk: records.Chunk, most_bytes: int) -> list[records.McapRecord]:
    if chunk.uncompressed_size > most_bytes:
        raise ValueError(
            f"it would have {chunk.uncompressed_size} bytes unpacked, and {most_bytes} are the most;"
            " --chunk-bytes allows more"
        )
    return breakup_chunk(chunk, validate_crc=True)


def rebuild_index(file: IO[bytes], chunk_bytes: int = CHUNK_BYTES) -> RecoveryReport:
    """Rebuild the index of a file by reading all of it; see :class:`McapRecording`."""
    summary, counts, unchunked = Summary(), dict[int, int](), list[int]()
    damaged, whole = 0, len(MAGIC)
    for whole, record in walk(file):
        if record is None:
            continue
        if isinstance(record, _Damaged):
            damaged += 1
            continue
        if isinstance(record, records.Message):
            unchunked.append(record.log_time)
        if not isinstance(record, records.Chunk):
            _note(summary, [record], counts)
            continue
        try:
            inner = _contents(record, chunk_bytes)
        except Exception as error:
            # A damaged chunk fails in as many ways as there are compressions; the next one may be whole.
            logger.warning("the chunk before byte %d is left out: %s", whole, error)
            damaged += 1
            continue
        _note(summary, inner, counts)
        summary.chunk_indexes.append(_chunk_index(record, whole))
    times = [chunk.message_start_time for chunk in summary.chunk_indexes] + unchunked
    times += [chunk.message_end_time for chunk in summary.chunk_indexes]
    summary.statistics = _statistics(summary, counts, times)
    return RecoveryReport(summary, damaged, file.seek(0, SEEK_END) - whole, bool(unchunked))


def _note(summary: Summary, found: list[records.McapRecord], counts: dict[int, int]) -> None:
    for record in found:
        if isinstance(record, records.Schema):
            summary.schemas[record.id] = record
        elif isinstance(record, records.Channel):
            summary.channels[record.id] = record
        elif isinstance(record, records.Message):
            counts[record.channel_id] = counts.get(record.channel_id, 0) + 1


def _chunk_index(chunk: records.Chunk, end: int) -> records.ChunkIndex:
    length = _HEAD.size + 8 + 8 + 8 + 4 + 4 + len(chunk.compression.encode()) + 8 + len(chunk.data)
    return records.ChunkIndex(
        chunk_length=length,
        chunk_start_offset=end - length,
        compression=chunk.compression,
        compressed_size=len(chunk.data),
        message_end_time=chunk.message_end_time,
        message_index_length=0,
        message_index_offsets={},
        message_start_time=chunk.message_start_time,
        uncompressed_size=chunk.uncompressed_size,
    )


def _statistics(summary: Summary, counts: dict[int, int], times: list[int]) -> records.Statistics:
    return records.Statistics(
        attachment_count=0,
        channel_count=len(summary.channels),
        channel_message_counts=counts,
        chunk_count=len(summary.chunk_indexes),
        message_count=sum(counts.values()),
        message_end_time=max(times, default=0),
        message_start_time=min(times, default=0),
        metadata_count=0,
        schema_count=len(summary.schemas),
    )


def recover(
    path: Path, to: Path, *, overwrite: bool = False, chunk_bytes: int = CHUNK_BYTES
) -> McapRecording:
    """Copy the readable part of a file into a complete one; return the report on the original.

    The copy has a temporary name until it is complete, so `to` may be the file itself, and is unchanged on
    failure.

    Raises:
        RecordingUnreadable: `path` is not an MCAP file.
        RecordingNotWritten: `to` is there already, or cannot be written.
    """
    if not overwrite and to.exists():
        raise RecordingNotWritten(f"{to} is there already: name another file, or overwrite it")
    part = to.with_name(f".{to.name}.{os.getpid()}.part")
    with McapRecording(path, chunk_bytes) as recording:
        channels = recording.index.channels.values()
        encoding: Encoding = "json" if any(each.message_encoding == "json" for each in channels) else "ros"
        try:
            with (
                RecordingWriter(part, recording.distro, RecordingOptions(encoding)) as writer,
                _opened(path) as file,
            ):
                _copy(recording, file, writer)
            _replace(part, to)
        finally:
            part.unlink(missing_ok=True)
    return recording


def _replace(part: Path, to: Path) -> None:
    try:
        with part.open("rb+") as file:
            os.fsync(file.fileno())
        part.replace(to)
    except OSError as error:
        raise RecordingNotWritten(f"{to}: cannot be written: {error.strerror}") from None


def _copy(recording: McapRecording, file: IO[bytes], writer: RecordingWriter) -> None:
    channels: dict[int, RecordedChannel] = {}
    for schema, channel, message in recording.channel_messages(file, None, 0, None):
        recorded = channels.get(channel.id)
        if recorded is None:
            kind = ("", "", b"") if schema is None else (schema.name, schema.encoding, schema.data)
            form = ChannelForm(channel.topic, *kind, channel.message_encoding, channel.metadata)
            recorded = channels[channel.id] = writer.add_channel(form)
        while writer.waiting_bytes > _MOST_WAITING and writer.failure is None:
            time.sleep(0.01)
        writer.write(recorded, message.log_time, message.publish_time, message.data)
