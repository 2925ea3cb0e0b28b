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
    """Lines that a thread writes, in the order in which they are given.

    What waits for the disk is bounded in bytes; lines beyond that are dropped, and the next line that is
    written says how many. A file that has its size is renamed to `NAME.1`, which becomes `NAME.2`, and so on.

    Attributes:
        dropped: lines that were not written: the queue was full, or the disk.

    Args:
        settings: see there; with a file.

    Raises:
        OSError: the file cannot be opened.
    """

    def __init__(self, settings: AuditSettings) -> None:
        assert settings.file is not None  # Without a file there is no audit file.
        self._path = settings.file
        self._most_bytes = settings.file_bytes
        self._files = settings.files
        self._most_waiting = settings.queue_bytes
        self._waiting: deque[bytes] = deque()
        self._waiting_bytes = 0
        self._unsaid = 0
        self.dropped = 0
        self._is_over = False
        self._is_torn = False  # The last line may have been cut.
        self._changed = threading.Condition()
        self._file = self._open()
        self._thread = threading.Thread(target=self._run, name="rwt audit", daemon=True)
        self._thread.start()

    def _open(self) -> BinaryIO:
        # For the owner alone: it tells who did what.
        descriptor = os.open(self._path, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o600)
        return os.fdopen(descriptor, "ab", buffering=0)

    def write(self, line: Mapping[str, object]) -> None:
        """Give the thread a line; never waits for the disk."""
        data = _encode(line) + b"\n"
        with self._changed:
            if self._is_over or self._waiting_bytes + len(data) > self._most_waiting:
                self.dropped += 1
                self._unsaid += 1
                return
            self._waiting.append(data)
            self._waiting_bytes += len(data)
            self._changed.notify()

    @property
    def waiting(self) -> int:
        """Bytes that wait for the disk, or are on their way to it."""
        return self._waiting_bytes

    def close(self) -> None:
        """Write what waits, and end the thread; a disk that takes nothing is waited for 5 seconds."""
        with self._changed:
            self._is_over = True
            self._changed.notify()
        self._thread.join(5.0)

    def _run(self) -> None:
        while True:
            with self._changed:
                while not (self._waiting or self._is_over):
                    self._changed.wait()
                lines = list(self._waiting)
                taken = self._waiting_bytes
                unsaid, self._unsaid = self._unsaid, 0
                self._waiting.clear()
                is_over = self._is_over and not lines
            self._put(lines, unsaid)
            with self._changed:
                self._waiting_bytes -= taken
            if is_over:
                self._file.close()
                return

    def _put(self, lines: list[bytes], unsaid: int) -> None:
        """Write lines, and behind them how many were dropped since the last ones that were written."""
        said = {"decision": "left out", "text": f"{unsaid} lines were dropped"}
        data = b"".join([b"\n"] * self._is_torn + lines + [_encode(said) + b"\n"] * bool(unsaid))
        try:
            if self._file.closed:  # A rotation has failed in the middle.
                self._file = self._open()
            if self._file.tell() and self._file.tell() + len(data) > self._most_bytes:
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
                self._unsaid += unsaid + len(lines)

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
    """The file that was begun so many files before the newest one."""
    return path.with_name(f"{path.name}.{number}") if number else path


def read_audit(path: Path) -> Iterator[Mapping[str, object]]:
    """The lines of an audit and of its older files, oldest first; a line that is no object is left out.

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
                    continue  # Cut, by a machine that lost its power.
