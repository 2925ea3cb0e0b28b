"""Folders of rosbag2: compressed files and messages are unpacked here, with limits, and not by rosbags.

Imported only to read such a folder, because it needs rosbags (extra ``mcap``).
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
from ruamel.yaml import YAML

from rwt.nodes.recording.errors import RecordingUnreadable
from rwt.nodes.recording.recording import MergedRecording, RecordedMessage, Recording
from rwt.nodes.recording.unpacking import too_large, unpack, unpacked_pieces

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
            reason = (str(error).strip() or type(error).__name__).splitlines()[0][:300]
            raise RecordingUnreadable(
                f"{path} is not a bag that can be read: {reason}; a folder of rosbag2 has a file {METADATA}"
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
