"""Reads MCAP files, also those whose end is missing because the program that wrote them was killed.

Imported only where such a file is read: it needs the extra ``mcap``.
"""

from __future__ import annotations

import struct
import time
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass
from io import SEEK_END, BytesIO
from pathlib import Path
from typing import IO, Final

from mcap import records
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.reader import SeekingReader
from mcap.stream_reader import breakup_chunk
from mcap.summary import Summary

from rwt_interfaces.distro import JAZZY, NOETIC, Distro, closest_distro
from rwt_nodes.recording.channels import DEFINITION, ChannelForm, Encoding
from rwt_nodes.recording.errors import RecordingUnreadable
from rwt_nodes.recording.recorded_qos import read_offered_qos
from rwt_nodes.recording.recording import (
    MessageEncoding,
    RecordedMessage,
    RecordedTopic,
    Recording,
    merged_topics,
)
from rwt_nodes.recording.writer import METADATA, RecordedChannel, RecordingWriter

MAGIC: Final = b"\x89MCAP0\r\n"

_ENCODINGS: Final[dict[str, MessageEncoding]] = {"cdr": "cdr", "ros1": "ros1", "json": "json"}
_Found = tuple[records.Schema | None, records.Channel, records.Message]

_HEAD: Final = struct.Struct("<BQ")
_MOST_WAITING: Final = 64 * 1024 * 1024
_KINDS: Final[dict[int, Callable[[ReadDataStream], records.McapRecord]]] = {
    Opcode.HEADER: records.Header.read,
    Opcode.SCHEMA: records.Schema.read,
    Opcode.CHANNEL: records.Channel.read,
    Opcode.CHUNK: records.Chunk.read,
    Opcode.METADATA: records.Metadata.read,
}


@dataclass(frozen=True, slots=True)
class RecoveryReport:
    """What was found in a file without a usable index.

    Attributes:
        summary: the index that the file should have had.
        damaged: chunks that could not be read.
        lost_bytes: bytes at the end that belong to no whole record.
        is_unchunked: whether messages stand in the file itself rather than in chunks.
    """

    summary: Summary
    damaged: int
    lost_bytes: int
    is_unchunked: bool


class McapRecording(Recording):
    """One MCAP file.

    Attributes:
        recovery: set when the file has no index, and was searched.
        index: the file's, or the one that was found by searching.

    Raises:
        RecordingUnreadable: it is not an MCAP file.
    """

    def __init__(self, path: Path) -> None:
        self.paths = (path,)
        self._path = path
        self.recovery: RecoveryReport | None = None
        self._file = _opened(path)
        try:
            self.index = self._indexed()
            self.complete = self.recovery is None
            self._describe()
        except BaseException:
            self._file.close()
            raise

    def _indexed(self) -> Summary:
        """The file's index, or one made by reading all of it."""
        try:
            summary = _reader(self._file).get_summary()
        except (McapError, OSError, ValueError, struct.error, MemoryError):
            # What a cut file holds where its footer should be can be anything.
            summary = None
        counted = None if summary is None else summary.statistics
        if summary is None or counted is None or (counted.message_count and not summary.chunk_indexes):
            self.recovery = rebuild_index(self._file, self._path)
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
        """What the file's own note says, or else its profile and its channels."""
        for _, record in walk(self._file, self._path):
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
            for schema, channel, message in self.records(file, topics, start_ns, end_ns):
                name = "" if schema is None else schema.name
                published = message.publish_time or message.log_time
                yield RecordedMessage(channel.topic, name, message.log_time, published, message.data)

    def records(
        self, file: IO[bytes], topics: Collection[str] | None, start_ns: int, end_ns: int | None
    ) -> Iterator[_Found]:
        """The messages as the file has them, with their channels."""
        if self.recovery is not None and self.recovery.is_unchunked:
            return iter(self._unchunked(file, topics, start_ns, end_ns))
        if not self.index.chunk_indexes:
            return iter(())
        chosen = None if topics is None else list(topics)
        return _reader(file, self.index).iter_messages(chosen, starting_at=start_ns, ending_before=end_ns)

    def _unchunked(
        self, file: IO[bytes], topics: Collection[str] | None, start_ns: int, end_ns: int | None
    ) -> list[_Found]:
        """The messages of a file without chunks, which nothing but memory can sort."""
        found: list[_Found] = []
        for _, message in walk(file, self._path):
            if isinstance(message, records.Message) and message.channel_id in self.index.channels:
                channel = self.index.channels[message.channel_id]
                in_time = start_ns <= message.log_time and (end_ns is None or message.log_time < end_ns)
                if in_time and (topics is None or channel.topic in topics):
                    found.append((self.index.schemas.get(channel.schema_id), channel, message))
        return sorted(found, key=lambda each: each[2].log_time)

    def close(self) -> None:
        """Close the file."""
        self._file.close()


def _opened(path: Path) -> IO[bytes]:
    try:
        file = path.open("rb")
    except OSError as error:
        raise RecordingUnreadable(f"{path}: cannot be read: {error.strerror}") from None
    if file.read(len(MAGIC)) != MAGIC:
        file.close()
        raise RecordingUnreadable(
            f"{path} is not a recording: expected an MCAP file, a .bag of ROS 1 or a folder of rosbag2"
        )
    file.seek(0)
    return file


def _reader(file: IO[bytes], summary: Summary | None = None) -> SeekingReader:
    file.seek(0)
    return _IndexedReader(file, summary)


class _IndexedReader(SeekingReader):
    """A reader that is given the index of its file."""

    def __init__(self, file: IO[bytes], index: Summary | None) -> None:
        super().__init__(file)
        self._index = index

    def get_summary(self) -> Summary | None:
        return super().get_summary() if self._index is None else self._index


def _topic(channel: records.Channel, schema: records.Schema | None, count: int) -> RecordedTopic:
    encoding = _ENCODINGS.get(channel.message_encoding, "")
    definition = channel.metadata.get(DEFINITION, "")
    if schema is not None and schema.encoding in ("ros2msg", "ros1msg"):
        definition = schema.data.decode("utf-8", "replace")
    name = "" if schema is None else schema.name
    return RecordedTopic(channel.topic, name, encoding, definition, count, read_offered_qos(channel.metadata))


# -- files without an index ----------------------------------------------------------------------------------


def walk(file: IO[bytes], path: Path) -> Iterator[tuple[int, records.McapRecord | None]]:
    """The records of a file up to its index or to the last one that is whole, chunks unopened.

    With each comes the place where it ends. Records of kinds that are of no use here are None.

    Raises:
        RecordingUnreadable: a record's content is not what its head says.
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
        yield (
            end,
            _record(opcode, file.read(length), f"{path}: damaged at byte {begin}") if is_wanted else None,
        )


def _record(opcode: int, content: bytes, complaint: str) -> records.McapRecord:
    stream = ReadDataStream(BytesIO(content))
    try:
        if opcode != Opcode.MESSAGE:
            return _KINDS[opcode](stream)
        message: records.McapRecord = records.Message.read(stream, len(content))
        return message
    except (McapError, ValueError, struct.error) as error:
        raise RecordingUnreadable(complaint) from error


def rebuild_index(file: IO[bytes], path: Path) -> RecoveryReport:
    """Rebuild the index of a file by reading all of it.

    Raises:
        RecordingUnreadable: it is damaged before its first chunk ends.
    """
    summary, counts, unchunked = Summary(), dict[int, int](), list[int]()
    damaged, whole = 0, len(MAGIC)
    for whole, record in walk(file, path):
        if record is None:
            continue
        if isinstance(record, records.Message):
            unchunked.append(record.log_time)
        if not isinstance(record, records.Chunk):
            _note(summary, [record], counts)
            continue
        try:
            inner = breakup_chunk(record, validate_crc=True)
        except Exception:
            # A damaged chunk fails in as many ways as there are compressions; the next one may be whole.
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
    """What the index says of a chunk that ends at byte `end`. That no message index is named makes readers
    look into every chunk."""
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


def recover(path: Path, to: Path, *, overwrite: bool = False) -> McapRecording:
    """Copy what can be read of a file into a complete one; gives what was found in the first.

    Raises:
        RecordingUnreadable: `path` is not an MCAP file.
        RecordingNotWritten: `to` is there already, or cannot be written.
    """
    with McapRecording(path) as recording:
        channels = recording.index.channels.values()
        encoding: Encoding = "json" if any(each.message_encoding == "json" for each in channels) else "ros"
        writer = RecordingWriter(to, recording.distro, encoding, overwrite=overwrite)
        with writer, _opened(path) as file:
            _copy(recording, file, writer)
    return recording


def _copy(recording: McapRecording, file: IO[bytes], writer: RecordingWriter) -> None:
    channels: dict[int, RecordedChannel] = {}
    for schema, channel, message in recording.records(file, None, 0, None):
        recorded = channels.get(channel.id)
        if recorded is None:
            kind = ("", "", b"") if schema is None else (schema.name, schema.encoding, schema.data)
            form = ChannelForm(channel.topic, *kind, channel.message_encoding, channel.metadata)
            recorded = channels[channel.id] = writer.add_channel(form)
        while writer.waiting_bytes > _MOST_WAITING and writer.failure is None:
            time.sleep(0.01)
        writer.write(recorded, message.log_time, message.publish_time, message.data)
