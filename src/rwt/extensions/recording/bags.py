"""Reader of bags: `.bag` files of ROS 1 and folders of rosbag2.

Compressed files and messages of folders are unpacked here, with limits, and not by rosbags.

Imported only to read a bag, because it needs rosbags (extra ``mcap``).
"""

from __future__ import annotations

import re
import sqlite3
from collections.abc import Collection, Iterator
from contextlib import closing
from pathlib import Path, PurePath
from tempfile import TemporaryDirectory
from typing import Final
from urllib.parse import quote

from msgspec import ValidationError, convert
from msgspec.structs import replace
from rosbags.interfaces import (
    Connection,
    ConnectionExtRosbag1,
    MessageDefinitionFormat,
    Qos,
    QosDurability,
    QosReliability,
)
from rosbags.interfaces import QosHistory as BagHistory
from rosbags.rosbag1 import Reader
from rosbags.rosbag1.reader import Chunk, IndexData, decompressors
from rosbags.rosbag2 import Reader as Reader2
from ruamel.yaml import YAML

from rwt.extensions.recording.errors import RecordingUnreadable
from rwt.extensions.recording.recording import (
    CHUNK_BYTES,
    MergedRecording,
    RecordedMessage,
    RecordedTopic,
    Recording,
    merged_topics,
)
from rwt.extensions.recording.unpacking import too_large, unpack, unpacked_pieces
from rwt_interfaces.distro import JAZZY, NOETIC
from rwt_participant.qos import LATCHED, MOST_DEPTH, Durability, History, QoS, Reliability

#: Both kinds of bags have 64 bits for a time.
_END_OF_TIMES_NS: Final = 2**64


_COMPRESSIONS: Final = {function: name for name, function in decompressors.items()}


class Reader1(Reader):
    """Reader of ROS 1 bags that limits chunks by their contents, and the index by the size of the file."""

    def __init__(self, path: Path, chunk_bytes: int) -> None:
        super().__init__(path)
        self._chunk_bytes = chunk_bytes
        self._index_bytes = path.stat().st_size

    def read_chunk(self) -> Chunk:
        """Return the chunk at the current position, with a decompressor that has a limit."""
        chunk = super().read_chunk()
        compression = _COMPRESSIONS[chunk.decompressor]
        if chunk.datasize > self._chunk_bytes:
            raise too_large(self._chunk_bytes)
        return chunk._replace(decompressor=lambda data: bytes(unpack(data, compression, self._chunk_bytes)))

    def read_index_data(self, pos: int, indexes: dict[int, list[IndexData]]) -> None:
        """Add the index at the current position, unless the same bytes are read again and again."""
        assert self.bio is not None  # Called by open().
        begin = self.bio.tell()
        super().read_index_data(pos, indexes)
        self._index_bytes -= self.bio.tell() - begin
        if self._index_bytes < 0:
            raise ValueError("its index is larger than the file")


class BagRecording(Recording):
    """Bag opened for reading.

    Args:
        chunk_bytes: maximum size of a chunk of a ROS 1 bag, as stored and unpacked.

    Raises:
        RecordingUnreadable: it is not a bag, or was not ended properly.
    """

    def __init__(self, path: Path, chunk_bytes: int = CHUNK_BYTES) -> None:
        self.paths = (path,)
        self._chunk_bytes = chunk_bytes
        self._is_ros1 = path.suffix == ".bag" and not path.is_dir()
        self.distro = NOETIC if self._is_ros1 else JAZZY
        try:
            with self._opened() as reader:
                self._describe(reader)
        except Exception as error:
            # A damaged bag fails in as many ways as the library has places that read it.
            hint = "" if self._is_ros1 else "; a folder of rosbag2 has a file metadata.yaml"
            raise RecordingUnreadable(
                f"{path} is not a bag that can be read: {_first_line(error)}{hint}"
            ) from None

    def _opened(self) -> Reader1 | Reader2:
        """Return a new reader: sqlite3 must be used by the thread that opened it."""
        return Reader1(self.paths[0], self._chunk_bytes) if self._is_ros1 else Reader2(self.paths[0])

    def _describe(self, reader: Reader1 | Reader2) -> None:
        self.topics = merged_topics([self._topic(connection) for connection in reader.connections])
        filled = reader.message_count > 0
        self.start_ns = reader.start_time if filled else 0
        # The library's end is the moment after the last message.
        self.end_ns = reader.end_time - 1 if filled else 0
        for time in (self.start_ns, self.end_ns):
            if not isinstance(time, int) or not 0 <= time < _END_OF_TIMES_NS:
                raise ValueError(
                    f"it says that it begins or ends at {time!s:.40}: expected nanoseconds since 1970"
                )

    def _topic(self, connection: Connection) -> RecordedTopic:
        definition = connection.msgdef
        text = definition.data if definition.format is MessageDefinitionFormat.MSG else ""
        return RecordedTopic(
            connection.topic,
            connection.msgtype,
            "ros1" if self._is_ros1 else "cdr",
            text,
            connection.msgcount,
            _offered_qos(connection),
        )

    def messages(
        self, topics: Collection[str] | None = None, start_ns: int = 0, end_ns: int | None = None
    ) -> Iterator[RecordedMessage]:
        """Yield messages by log time, the only time in bags; see :meth:`Recording.messages`."""
        try:
            with self._opened() as reader:
                chosen = [each for each in reader.connections if topics is None or each.topic in topics]
                # Without connections, the library would read all of them.
                for connection, stamp, data in reader.messages(chosen, start_ns, end_ns) if chosen else ():
                    yield RecordedMessage(connection.topic, connection.msgtype, stamp, stamp, bytes(data))
        except Exception as error:
            # Any error of the library, as for a damaged header; the messages before it are whole.
            raise RecordingUnreadable(f"{self.paths[0]} is damaged: {_first_line(error)}") from None

    def close(self) -> None:
        """No-op: no file is open between readings."""


def _first_line(error: Exception) -> str:
    text = str(error).strip() or type(error).__name__
    return text.splitlines()[0][:300]


def _offered_qos(connection: Connection) -> tuple[QoS, ...]:
    extension = connection.ext
    if isinstance(extension, ConnectionExtRosbag1):
        return (LATCHED,) if extension.latching else ()
    return tuple(_qos(profile) for profile in extension.offered_qos_profiles)


def _qos(profile: Qos) -> QoS:
    kept = profile.durability is QosDurability.TRANSIENT_LOCAL
    lossy = profile.reliability is QosReliability.BEST_EFFORT
    return QoS(
        history=History.KEEP_ALL if profile.history is BagHistory.KEEP_ALL else History.KEEP_LAST,
        depth=min(max(0, profile.depth), MOST_DEPTH),
        reliability=Reliability.BEST_EFFORT if lossy else Reliability.RELIABLE,
        durability=Durability.TRANSIENT_LOCAL if kept else Durability.VOLATILE,
    )


METADATA: Final = "metadata.yaml"

MAX_RATIO: Final = 100
"""Maximum ratio of a file's size unpacked and compressed, if `chunk_bytes` is less."""

_METADATA_BYTES: Final = 16 * 1024 * 1024
_INFORMATION: Final = "rosbag2_bagfile_information"

#: A table with a computed column, or one that a module of SQLite computes.
_COMPUTED: Final = re.compile(r"\bas\b|^\s*create\s+virtual\b", re.IGNORECASE)


class Rosbag2Folder:
    """Folder of rosbag2, with its files unpacked in a temporary folder if necessary.

    Args:
        chunk_bytes: maximum unpacked size of a file, if it is more than `MAX_RATIO` times its size.

    Attributes:
        path: the folder to read, without compression.
        storage: storage plugin, ``sqlite3`` or ``mcap``.
        has_packed_messages: True if each message is compressed.

    Raises:
        RecordingUnreadable: the metadata is damaged, a file is missing, or is not what its storage says.
    """

    def __init__(self, path: Path, chunk_bytes: int) -> None:
        self.path = path
        self._folder: TemporaryDirectory[str] | None = None
        try:
            self._open(chunk_bytes)
        except Exception as error:
            # Damaged metadata fails in as many ways as the libraries have places that read it.
            self.close()
            raise RecordingUnreadable(
                f"{path} is not a bag that can be read: {_first_line(error)}; a folder of rosbag2 has a file"
                f" {METADATA}"
            ) from None

    def _open(self, chunk_bytes: int) -> None:
        file = self.path / METADATA
        if not file.is_file() or file.stat().st_size > _METADATA_BYTES:
            raise ValueError(f"{METADATA} is not a file of at most {_METADATA_BYTES} bytes")
        metadata = YAML(typ="safe").load(file.read_text())
        try:
            information = convert(metadata[_INFORMATION], dict[str, object])
            names = convert(information["relative_file_paths"], list[str])
            self.storage = convert(information["storage_identifier"], str)
            mode = convert(information.get("compression_mode") or "none", str).lower()
            compression = convert(information.get("compression_format") or "", str)
        except (ValidationError, KeyError, TypeError) as error:
            raise ValueError(f"{METADATA}: {error}") from None
        self.files = tuple(self.path / PurePath(name).name for name in names)
        if len(set(self.files)) != len(self.files) or not all(each.is_file() for each in self.files):
            raise ValueError(f"{METADATA} names files that are missing, or one twice")
        self.has_packed_messages = mode == "message"
        if mode != "none":
            if compression != "zstd" or mode not in ("file", "message"):
                raise ValueError(f"compression {compression!r} of mode {mode!r} is not supported")
            self._unpack(chunk_bytes)
            packed = {"compression_mode": "", "compression_format": ""}
            listed = {"relative_file_paths": [each.name for each in self.files]}
            with (self.path / METADATA).open("w") as output:
                YAML(typ="safe").dump({_INFORMATION: {**information, **packed, **listed}}, output)
        if self.storage == "sqlite3":
            for each in self.files:
                _check_tables(each)

    def _unpack(self, chunk_bytes: int) -> None:
        self._folder = TemporaryDirectory()
        folder = Path(self._folder.name)
        for file in self.files:
            if self.has_packed_messages:
                (folder / file.name).symlink_to(file.absolute())
            else:
                _unpack_file(file, folder / file.stem, max(chunk_bytes, MAX_RATIO * file.stat().st_size))
        self.files = tuple(folder / (it.name if self.has_packed_messages else it.stem) for it in self.files)
        self.path = folder

    def close(self) -> None:
        """Remove what was unpacked. Idempotent."""
        if self._folder is not None:
            self._folder.cleanup()


def _unpack_file(file: Path, to: Path, most_bytes: int) -> None:
    size = 0
    with file.open("rb") as source, to.open("wb") as output:
        for piece in unpacked_pieces(source, "zstd"):
            size += len(piece)
            if size > most_bytes:
                raise too_large(most_bytes)
            output.write(piece)


def _check_tables(file: Path) -> None:
    """Reject a database that computes rows or values: reading them may take forever."""
    with closing(sqlite3.connect(f"file:{quote(str(file.absolute()))}?mode=ro", uri=True)) as database:
        for kind, text in database.execute("SELECT type, sql FROM sqlite_master"):
            if kind == "view" or (kind == "table" and _COMPUTED.search(text or "")):
                raise ValueError("the database has views or computed columns")


class FolderRecording(MergedRecording):
    """Recording of a folder, whose compressed messages are unpacked."""

    def __init__(self, path: Path, parts: list[Recording], folder: Rosbag2Folder, chunk_bytes: int) -> None:
        super().__init__(parts)
        self.paths = (path,)
        self._folder = folder
        self._chunk_bytes = chunk_bytes

    def messages(
        self, topics: Collection[str] | None = None, start_ns: int = 0, end_ns: int | None = None
    ) -> Iterator[RecordedMessage]:
        """Yield unpacked messages; see :meth:`Recording.messages`."""
        messages = super().messages(topics, start_ns, end_ns)
        return self._unpacked(messages) if self._folder.has_packed_messages else messages

    def _unpacked(self, messages: Iterator[RecordedMessage]) -> Iterator[RecordedMessage]:
        for message in messages:
            try:
                data = bytes(unpack(message.data, "zstd", self._chunk_bytes))
            except Exception as error:
                # The library has errors of its own.
                raise RecordingUnreadable(f"{self.paths[0]} is damaged: {error}") from None
            yield replace(message, data=data)

    def close(self) -> None:
        """Close the files, and remove what was unpacked."""
        super().close()
        self._folder.close()
