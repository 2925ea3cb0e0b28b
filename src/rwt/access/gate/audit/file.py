"""Audit files: JSON lines that are chained by hash, written by a thread, rotated and bounded."""

from __future__ import annotations

import hashlib
import heapq
import logging
import os
import sys
import threading
import time
from collections import deque
from collections.abc import Iterator, Mapping
from contextlib import suppress
from datetime import datetime
from itertools import groupby
from operator import itemgetter
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO, Final, NamedTuple

import msgspec

from rwt.access.audit import visible_json

if TYPE_CHECKING:
    from rwt.access.settings import AuditSettings

logger: Final = logging.getLogger("rwt.bridge")

_encode: Final = msgspec.json.Encoder().encode

#: Hash that the first line of a new audit names as that of the line before.
NO_LINE: Final = "0" * 64


def encode(value: object) -> bytes:
    """Return a value as JSON that can be shown on a terminal."""
    return visible_json(_encode(value).decode()).encode()


#: Bytes at the end of a file in which its last line is found; lines are shorter.
_TAIL_BYTES: Final = 256 * 1024

_DAY_SECONDS: Final = 86_400.0


class _Head(NamedTuple):
    """Last line of a file: its number, its sequence number and its hash."""

    line: int
    sequence: int
    hash: str


_NO_HEAD: Final = _Head(0, 0, NO_LINE)


class _ChainedFile:
    """Audit file with its older files; used by one thread at a time.

    Attributes:
        head: last line that was written.

    Args:
        path: newest file; the one before is ``NAME.1``, and so on.
    """

    def __init__(self, path: Path, settings: AuditSettings) -> None:
        self.path = path
        self.head = _NO_HEAD
        self._max_bytes = settings.file_bytes
        self._max_seconds = settings.file_days * _DAY_SECONDS
        self._files = settings.files
        self._began = 0.0
        self._file: BinaryIO | None = None
        self._open()

    def _open(self) -> BinaryIO:
        # Readable by the owner only: it names clients and what they did.
        descriptor = os.open(self.path, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o600)
        file = self._file = os.fdopen(descriptor, "ab", buffering=0)
        self._began = _begun_at(self.path)
        if file.tell() and (cut := _tail(self.path).rpartition(b"\n")[2]):
            file.write(b"\n")
            logger.warning("the audit %s has an incomplete line: %d bytes", self.path, len(cut))
        self.head = _last_head(self.path) or self.head
        return file

    def write(self, lines: list[bytes], sequence: int) -> bytes:
        """Write lines with consecutive sequence numbers; return them as written.

        Raises:
            OSError: nothing was written, or an incomplete line at the end.
        """
        file = self._file or self._open()
        size = file.tell()
        if size and (size + sum(map(len, lines)) > self._max_bytes or self._is_old()):
            file = self._rotate()
            size = 0
        data, head = chained(lines, sequence, self.head)
        rest = data
        try:
            while rest:
                rest = rest[file.write(rest) :]
        except OSError:
            with suppress(OSError):
                os.ftruncate(file.fileno(), size)
            self.close()  # Opened again for the next lines, which finds what was left of these.
            raise
        self.head = head
        return data

    def _is_old(self) -> bool:
        return 0 < self._max_seconds <= time.time() - self._began

    def _rotate(self) -> BinaryIO:
        self.close()
        for number in range(self._files - 1, 0, -1):
            older = numbered(self.path, number - 1)
            if older.exists():
                older.replace(numbered(self.path, number))
        if self._files == 1:
            self.path.unlink(missing_ok=True)
        self.say_head("continues in a new file after")
        return self._open()

    def say_head(self, what: str) -> None:
        """Log the last line's number and hash, against which the file can be checked later."""
        logger.info("the audit %s %s line %d, hash %s", self.path, what, self.head.line, self.head.hash)

    def close(self) -> None:
        """Close the file; the next line opens it again."""
        if self._file is not None:
            self._file.close()
            self._file = None


class AuditFile:
    """Audit, written by a thread in the order of the calls.

    Security events and allowed traffic have separate files, so that traffic never rotates events away
    (:func:`traffic_file`). Each line has a ``sequence`` number over both files, the number of the ``line`` in
    its own, and in ``previous`` the SHA-256 of the line before. The chain continues across rotations and
    restarts.

    The queue is limited in bytes, and traffic may use half of it. Lines over the limit are dropped, and a
    line about their number is written later.

    ``_changed`` guards the queue (``_queue``, ``_queued_bytes``), the counts and ``_is_closing``. The files
    and ``_sequence`` belong to the thread.

    Attributes:
        dropped: number of lines that were not written: the queue was full, or writing failed.

    Args:
        settings: settings of the audit, with a file or with standard output.

    Raises:
        OSError: a file cannot be opened.
    """

    def __init__(self, settings: AuditSettings) -> None:
        path = settings.file
        paths = () if path is None else (path, traffic_file(path))
        self._files = tuple(_ChainedFile(each, settings) for each in paths)
        self._sequence = max((each.head.sequence for each in self._files), default=0)
        self._head = _NO_HEAD  # Of the chain on standard output, where there is no file.
        self._to_stdout = settings.stdout
        self._max_queued_bytes = settings.queue_bytes
        self._queue: deque[tuple[bytes, bool]] = deque()
        self._queued_bytes = 0
        self._unreported = 0
        self.dropped = 0
        self._failures = ["", ""]  # Why the last lines of events and of traffic were not written.
        self._is_closing = False
        self._changed = threading.Condition()
        self._thread = threading.Thread(target=self._run, name="rwt audit", daemon=True)
        self._thread.start()

    def write(self, line: bytes, *, is_traffic: bool = False) -> None:
        """Queue a line, a JSON object; never blocks."""
        limit = self._max_queued_bytes // 2 if is_traffic else self._max_queued_bytes
        with self._changed:
            if self._is_closing or self._queued_bytes + len(line) > limit:
                self.dropped += 1
                self._unreported += 1
                return
            self._queue.append((line, is_traffic))
            self._queued_bytes += len(line)
            self._changed.notify()

    @property
    def waiting(self) -> int:
        """Number of bytes that are queued or being written."""
        return self._queued_bytes

    @property
    def failure(self) -> str:
        """Reason why the last lines were not written; empty if they were."""
        return self._failures[False] or self._failures[True]

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
                queued = list(self._queue)
                written = self._queued_bytes
                unreported, self._unreported = self._unreported, 0
                self._queue.clear()
                is_last = self._is_closing and not queued
            if unreported:
                report = {"decision": "left out", "text": f"{unreported} lines were dropped"}
                queued.append((encode(report), False))
            self._put(queued, unreported)
            with self._changed:
                self._queued_bytes -= written
            if is_last:
                for file in self._files:
                    file.say_head("ends with")
                    file.close()
                return

    def _put(self, queued: list[tuple[bytes, bool]], unreported: int) -> None:
        """Write lines; the last one may be about dropped lines."""
        for is_traffic, group in groupby(queued, itemgetter(1)):
            lines = [line for line, _ in group]
            try:
                if self._files:
                    written = self._files[is_traffic].write(lines, self._sequence + 1)
                else:
                    written, self._head = chained(lines, self._sequence + 1, self._head)
                self._sequence += len(lines)
                if self._to_stdout:
                    sys.stdout.buffer.write(written)
                    sys.stdout.flush()
                if self._failures[is_traffic]:
                    logger.info("the audit is written again: %s", self._name(is_traffic))
                self._failures[is_traffic] = ""
            except OSError as error:
                if not self._failures[is_traffic]:
                    text = "the audit cannot be written: %s: %s"
                    logger.error(text, self._name(is_traffic), error.strerror)
                self._failures[is_traffic] = str(error.strerror)
                with self._changed:
                    has_report = bool(unreported) and lines[-1] is queued[-1][0]
                    self.dropped += len(lines) - has_report
                    self._unreported += unreported * has_report + len(lines) - has_report

    def _name(self, is_traffic: bool) -> str:
        return str(self._files[is_traffic].path) if self._files else "standard output"


def chained(lines: list[bytes], sequence: int, head: _Head) -> tuple[bytes, _Head]:
    """Return lines with their numbers and hashes, and the new head of the chain."""
    written = []
    for number, line in enumerate(lines):
        data = b'{"sequence":%d,"line":%d,%s,"previous":"%s"}' % (
            sequence + number, head.line + 1, line[1:-1], head.hash.encode(),
        )  # fmt: skip
        head = _Head(head.line + 1, sequence + number, hash_of(data))
        written.append(data + b"\n")
    return b"".join(written), head


def hash_of(line: bytes) -> str:
    """Return the hash of a line, without its line break."""
    return hashlib.sha256(line).hexdigest()


def numbered(path: Path, number: int) -> Path:
    """Return the path of an older file; 0 is the newest."""
    return path.with_name(f"{path.name}.{number}") if number else path


def traffic_file(path: Path) -> Path:
    """Return the path of the file with allowed traffic, such as ``audit.traffic.jsonl``."""
    return path.with_name(f"{path.stem}.traffic{path.suffix}")


def files_of(path: Path) -> list[Path]:
    """Return a file with its older files, oldest first."""
    older: list[Path] = []
    while (file := numbered(path, len(older) + 1)).exists():
        older.append(file)
    return [*reversed(older), path]


def audit_files(path: Path) -> list[Path]:
    """Return the newest file of an audit and that of its traffic, if there is one."""
    traffic = traffic_file(path)
    return [path, traffic] if traffic.exists() else [path]


def read_audit(path: Path) -> Iterator[Mapping[str, object]]:
    """Return the lines of an audit, its traffic and their older files, oldest first; skip invalid lines.

    Raises:
        OSError: the newest file cannot be read.
    """
    return heapq.merge(*map(_lines_of, audit_files(path)), key=lambda line: number_in(line, "sequence"))


def values_of(line: bytes) -> Mapping[str, object] | None:
    """Return the members of a line; None for one that a power failure has cut."""
    try:
        return msgspec.json.decode(line, type=dict[str, object])
    except msgspec.MsgspecError:
        return None


def number_in(line: Mapping[str, object], key: str) -> int:
    """Return a number in a line; 0 if it is missing or something else."""
    value = line.get(key)
    return value if isinstance(value, int) else 0


def _lines_of(path: Path) -> Iterator[Mapping[str, object]]:
    for file in files_of(path):
        with file.open("rb") as lines:
            yield from filter(None, map(values_of, lines))


def _tail(path: Path) -> bytes:
    """Return the last bytes of a regular file; none of a device."""
    with path.open("rb") as file:
        size = os.fstat(file.fileno()).st_size
        file.seek(max(0, size - _TAIL_BYTES))
        return file.read(_TAIL_BYTES) if size else b""


def _begun_at(path: Path) -> float:
    """Return the time of the first line of a file, in seconds since 1970; that of a new file is now."""
    with path.open("rb") as file:
        first = file.readline(_TAIL_BYTES) if os.fstat(file.fileno()).st_size else b""
    try:
        return datetime.fromisoformat(str((values_of(first) or {}).get("time"))).timestamp()
    except ValueError:
        return time.time()


def _last_head(path: Path) -> _Head | None:
    """Return the last line of an audit that is continued; None if it has none.

    An incomplete line, which a power failure has cut, is hashed like every other.
    """
    for file in (path, numbered(path, 1)):
        lines = _tail(file).split(b"\n")[:-1] if file.exists() else []
        for line in reversed(lines):
            values = values_of(line)
            if values is not None and isinstance(values.get("line"), int):
                head = number_in(values, "line"), number_in(values, "sequence")
                return _Head(*head, hash_of(lines[-1]))
    return None
