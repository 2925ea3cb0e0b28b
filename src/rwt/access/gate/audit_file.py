"""The audit's file: a JSON object a line, written by a thread, rotated and bounded."""

from __future__ import annotations

import logging
import os
import threading
from collections import deque
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Final

import msgspec

if TYPE_CHECKING:
    from typing import BinaryIO

    from rwt.access.settings.gate import AuditSettings

logger: Final = logging.getLogger("rwt.bridge")

_encode: Final = msgspec.json.Encoder().encode


class AuditFile:
    """Audit file, written by a thread in the order of the calls.

    The queue is limited in bytes. Lines over the limit are dropped, and a line about their number is written
    later. A file of maximum size is renamed to `NAME.1`, an older one from `NAME.1` to `NAME.2`, and so on.

    ``_changed`` guards the queue (``_queue``, ``_queued_bytes``), the counts and ``_is_closing``. The file
    and ``_is_torn`` belong to the thread.

    Attributes:
        dropped: number of lines that were not written: the queue was full, or writing failed.

    Args:
        settings: settings of the audit, with a file.

    Raises:
        OSError: the file cannot be opened.
    """

    def __init__(self, settings: AuditSettings) -> None:
        assert settings.file is not None  # Checked by the caller.
        self._path = settings.file
        self._max_bytes = settings.file_bytes
        self._files = settings.files
        self._max_queued_bytes = settings.queue_bytes
        self._queue: deque[bytes] = deque()
        self._queued_bytes = 0
        self._unreported = 0
        self.dropped = 0
        self._is_closing = False
        self._is_torn = False  # The last line may be incomplete.
        self._changed = threading.Condition()
        self._file = self._open()
        self._thread = threading.Thread(target=self._run, name="rwt audit", daemon=True)
        self._thread.start()

    def _open(self) -> BinaryIO:
        # Readable by the owner only: it names clients and what they did.
        descriptor = os.open(self._path, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o600)
        return os.fdopen(descriptor, "ab", buffering=0)

    def write(self, line: Mapping[str, object]) -> None:
        """Queue a line; never blocks."""
        data = _encode(line) + b"\n"
        with self._changed:
            if self._is_closing or self._queued_bytes + len(data) > self._max_queued_bytes:
                self.dropped += 1
                self._unreported += 1
                return
            self._queue.append(data)
            self._queued_bytes += len(data)
            self._changed.notify()

    @property
    def waiting(self) -> int:
        """Number of bytes that are queued or being written."""
        return self._queued_bytes

    def close(self) -> None:
        """Write the queue and end the thread; gives up after 5 seconds."""
        with self._changed:
            self._is_closing = True
            self._changed.notify()
        self._thread.join(5.0)

    def _run(self) -> None:
        while True:
            with self._changed:
                while not (self._queue or self._is_closing):
                    self._changed.wait()
                lines = list(self._queue)
                written = self._queued_bytes
                unreported, self._unreported = self._unreported, 0
                self._queue.clear()
                is_last = self._is_closing and not lines
            self._put(lines, unreported)
            with self._changed:
                self._queued_bytes -= written
            if is_last:
                self._file.close()
                return

    def _put(self, lines: list[bytes], unreported: int) -> None:
        """Write lines, followed by one about the number of dropped ones."""
        report = {"decision": "left out", "text": f"{unreported} lines were dropped"}
        data = b"".join([b"\n"] * self._is_torn + lines + [_encode(report) + b"\n"] * bool(unreported))
        try:
            if self._file.closed:  # A rotation failed halfway.
                self._file = self._open()
            if self._file.tell() and self._file.tell() + len(data) > self._max_bytes:
                self._rotate()
            while data:
                data = data[self._file.write(data) :]
            self._is_torn = False
        except OSError as error:
            self._is_torn = True
            with self._changed:
                if not self.dropped:
                    logger.error("the audit cannot be written: %s: %s", self._path, error.strerror)
                self.dropped += len(lines)
                self._unreported += unreported + len(lines)

    def _rotate(self) -> None:
        self._file.close()
        for number in range(self._files - 1, 0, -1):
            older = numbered(self._path, number - 1)
            if older.exists():
                older.replace(numbered(self._path, number))
        if self._files == 1:
            self._path.unlink(missing_ok=True)
        self._file = self._open()


def numbered(path: Path, number: int) -> Path:
    """Return the path of an older file; 0 is the newest."""
    return path.with_name(f"{path.name}.{number}") if number else path


def read_audit(path: Path) -> Iterator[Mapping[str, object]]:
    """Iterate over the lines of an audit and of its older files, oldest first; skip invalid lines.

    Raises:
        OSError: the newest file cannot be read.
    """
    older: list[Path] = []
    while (file := numbered(path, len(older) + 1)).exists():
        older.append(file)
    for file in (*reversed(older), path):
        with file.open("rb") as lines:
            for line in lines:
                try:
                    yield msgspec.json.decode(line, type=dict[str, object])
                except msgspec.MsgspecError:
                    continue  # Truncated by a power failure.
