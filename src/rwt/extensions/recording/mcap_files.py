"""Reader of MCAP files, including incomplete ones of killed programs.

Imported only to read such a file, because it needs the extra ``mcap``.
"""

from __future__ import annotations

import logging
import os
import time
from collections.abc import Collection, Iterator
from heapq import heapify, heappop, heappush
from io import BufferedReader, FileIO
from pathlib import Path
from typing import IO, Final

from mcap import records
from mcap.opcode import Opcode

from rwt.extensions.recording.channels import DEFINITION, TYPE, ChannelForm, Encoding, read_offered_qos
from rwt.extensions.recording.errors import RecordingNotWritten, RecordingUnreadable
from rwt.extensions.recording.mcap_index import (
    MAGIC,
    ChannelMessage,
    MessageFilter,
    MessagePositions,
    RecoveryReport,
    chunk_content,
    data_records,
    file_records,
    message_positions,
    read_content,
    read_index,
    read_message,
    read_metadata,
    rebuild_index,
    unchunked_positions,
)
from rwt.extensions.recording.recording import (
    CHUNK_BYTES,
    MessageEncoding,
    RecordedMessage,
    RecordedTopic,
    Recording,
    merged_topics,
)
from rwt.extensions.recording.writer import METADATA, RecordedChannel, RecordingOptions, RecordingWriter
from rwt_interfaces.distro import JAZZY, NOETIC, Distro, closest_distro

logger = logging.getLogger(__name__)

_ENCODINGS: Final[dict[str, MessageEncoding]] = {"cdr": "cdr", "ros1": "ros1", "json": "json"}
_MOST_WAITING: Final = 64 * 1024 * 1024

#: Bytes from which on a reading is compared with what the file still has.
_MUCH: Final = 64 * 1024


class McapRecording(Recording):
    """MCAP file opened for reading.

    Attributes:
        recovery: set when the file has no index, and was searched.
        index: the file's, or the one that was found by searching.

    Args:
        chunk_bytes: maximum unpacked size of a chunk, of all chunks that overlap in time, and of a message
            outside of chunks. Larger ones are left out.

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
            index = read_index(self._file, chunk_bytes)
            if index is None:
                self.recovery = rebuild_index(self._file, chunk_bytes)
                index = self.recovery.summary
            self.index = index
            self.complete = self.recovery is None
            self._describe()
        except BaseException:
            self._file.close()
            raise

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
        for head in data_records(self._file):
            if head[0] == Opcode.METADATA:
                note = read_metadata(read_content(self._file, head, self._chunk_bytes))
                if note is not None and note.name == METADATA:
                    ros1 = note.metadata.get("ros_version") == "1"
                    return closest_distro(note.metadata.get("distro", ""), 1 if ros1 else 2)
            elif head[0] != Opcode.HEADER:
                break
        encodings = {channel.message_encoding for channel in self.index.channels.values()}
        return NOETIC if "ros1" in encodings else JAZZY

    def messages(
        self, topics: Collection[str] | None = None, start_ns: int = 0, end_ns: int | None = None
    ) -> Iterator[RecordedMessage]:
        """Yield messages; see :meth:`Recording.messages`."""
        with _opened(self._path) as file:
            for schema, channel, message in self.channel_messages(file, topics, start_ns, end_ns):
                name = _type_name(channel, schema)
                published = message.publish_time or message.log_time
                yield RecordedMessage(channel.topic, name, message.log_time, published, message.data)

    def channel_messages(
        self, file: IO[bytes], topics: Collection[str] | None, start_ns: int, end_ns: int | None
    ) -> Iterator[ChannelMessage]:
        """Yield the messages as the file has them, by log time, with their channels."""
        channels = {
            id: channel
            for id, channel in self.index.channels.items()
            if topics is None or channel.topic in topics
        }
        wanted = MessageFilter(channels, start_ns, end_ns)
        is_unchunked = self.recovery is not None and self.recovery.is_unchunked
        for message in (self._unchunked if is_unchunked else self._chunked)(file, wanted):
            channel = channels[message.channel_id]
            yield self.index.schemas.get(channel.schema_id), channel, message

    def _chunked(self, file: IO[bytes], wanted: MessageFilter) -> Iterator[records.Message]:
        """Yield the messages of all readable chunks by log time; chunks are opened when due."""
        start_ns, end_ns = wanted.start_ns, wanted.end_ns
        # Sorted by time, and then as they are in the file. A chunk stands before its own messages.
        due: list[tuple[int, int, int, records.ChunkIndex | _OpenChunk]] = [
            (chunk.message_start_time, chunk.chunk_start_offset, -1, chunk)
            for chunk in self.index.chunk_indexes
            if chunk.message_end_time >= start_ns and (end_ns is None or chunk.message_start_time < end_ns)
        ]
        heapify(due)
        open_bytes = 0
        while due:
            _, offset, number, item = heappop(due)
            if isinstance(item, _OpenChunk):
                yield item.message
            else:
                opened = self._opened(file, item, self._chunk_bytes - open_bytes, wanted)
                if opened is None:
                    continue
                item = opened
                open_bytes += item.size
            if item.advance():
                heappush(due, (item.log_time, offset, number + 1, item))
            else:
                open_bytes -= item.size

    def _opened(
        self, file: IO[bytes], chunk: records.ChunkIndex, most_bytes: int, wanted: MessageFilter
    ) -> _OpenChunk | None:
        """Unpack a chunk. Returns None if it is damaged, which is noted."""
        offset = chunk.chunk_start_offset
        try:
            head = next(file_records(file, offset), None)
            if head is None or head[0] != Opcode.CHUNK or head[2] - offset != chunk.chunk_length:
                raise ValueError("the index is wrong")
            content = chunk_content(read_content(file, head, self._chunk_bytes), most_bytes)
            return _OpenChunk(content, message_positions(content, wanted))
        except Exception as error:
            # A damaged chunk fails in as many ways as there are compressions; the next one may be whole.
            if offset not in self._damaged:
                self._damaged.add(offset)
                logger.warning("%s: the chunk at byte %d is left out: %s", self._path, offset, error)
            return None

    @property
    def damaged(self) -> int:
        """Chunks and records that could not be read, as far as the file was read."""
        return len(self._damaged) + (0 if self.recovery is None else self.recovery.damaged)

    def _unchunked(self, file: IO[bytes], wanted: MessageFilter) -> Iterator[records.Message]:
        for _, begin, end in unchunked_positions(file, wanted, self._chunk_bytes).in_order():
            yield read_message(read_content(file, (Opcode.MESSAGE, begin, end), self._chunk_bytes))

    def close(self) -> None:
        """Close the file."""
        self._file.close()


class _OpenChunk:
    """Unpacked chunk, and its next message.

    Attributes:
        message: the next message, after :meth:`advance`.
    """

    message: records.Message

    def __init__(self, content: bytes | bytearray, positions: MessagePositions) -> None:
        self.size = len(content)
        self._content = memoryview(content)
        self._positions = positions.in_order()

    @property
    def log_time(self) -> int:
        return self.message.log_time

    def advance(self) -> bool:
        position = next(self._positions, None)
        if position is None:
            return False
        _, begin, end = position
        self.message = read_message(self._content[begin:end])
        return True


class _File(BufferedReader):
    """File that limits reads to its size: reads allocate what is requested, any number in a damaged file."""

    def __init__(self, path: Path) -> None:
        super().__init__(FileIO(path))
        self._size = os.fstat(self.fileno()).st_size

    def read(self, size: int | None = -1, /) -> bytes:
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
