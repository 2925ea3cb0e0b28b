"""Writer of MCAP files in a thread of its own, so that recording never waits for a disk.

`write` only queues a message. The thread writes complete chunks at least once a second, so a killed program
loses at most that second. Records that did not fit on a full disk are truncated.
"""

from __future__ import annotations

import errno
import logging
import os
import threading
import time
from collections import deque
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import IO, TYPE_CHECKING, Final, Literal, cast

from rwt.extensions.recording.errors import RecordingExists, RecordingNotWritten, require

if TYPE_CHECKING:
    from mcap.writer import Writer

    from rwt.extensions.recording.channels import ChannelForm, Encoding
    from rwt_interfaces.distro import Distro

logger = logging.getLogger(__name__)

Compression = Literal["zstd", "lz4", "none"]

COMPRESSIONS: Final[tuple[Compression, ...]] = ("zstd", "lz4", "none")

FLUSH_SECONDS: Final = 1.0
"""Maximum age of a message before it is written, in seconds."""

WAITING_BYTES: Final = 256 * 1024 * 1024
"""Messages that wait for a slow disk; what comes beyond is dropped and counted."""

METADATA: Final = "rwt"
"""Name of the metadata record that says who wrote the file, and for which distribution."""

START_BYTES: Final = 4 * 1024 * 1024
"""Space on the disk that a file needs to begin: some chunks, so that a full disk is noticed at once."""

_POLL_SECONDS: Final = 0.05
_CHUNK_BYTES: Final = 1024 * 1024


@dataclass(frozen=True, slots=True)
class Split:
    """When a new file is begun: at a size in bytes, or after some seconds of recorded time; 0 is never.

    Attributes:
        keep: number of files of the recording that are kept; older ones are removed. 0 keeps all.
    """

    size: int = 0
    seconds: float = 0.0
    keep: int = 0


@dataclass(frozen=True, slots=True)
class RecordingOptions:
    """Format and limits of a recording.

    Attributes:
        encoding: ``ros`` (CDR, or the ROS 1 serialisation on ROS 1) or ``json``.
        dated: True if the name contains codes of :func:`time.strftime`. If the file is there already, its
            name gets a number.
        largest_bytes: maximum content, including definitions and before compression; 0 for no maximum.
    """

    encoding: Encoding = "ros"
    compression: Compression = "zstd"
    split: Split | None = None
    overwrite: bool = False
    dated: bool = False
    largest_bytes: int = 0


DEFAULT_OPTIONS: Final = RecordingOptions()


@dataclass(eq=False, slots=True)
class RecordedChannel:
    """Topic of one type in the recording, with counters.

    Attributes:
        size: bytes of their content.
    """

    form: ChannelForm
    messages: int = 0
    size: int = 0


_Item = tuple[RecordedChannel, int, int, "bytes | memoryview", int]


class RecordingWriter:
    """Writer of one recording.

    Args:
        path: file to write; with `options.split` the first is `NAME_0000.mcap`.

    Attributes:
        dropped: number of messages that the disk was too slow for.
        failure: error that ended writing; None without one.

    Raises:
        RecordingExists: the file is there already.
        RecordingNotWritten: it cannot be made.
        ExtraMissing: the extra ``mcap`` is not installed.
    """

    def __init__(self, path: Path, distro: Distro, options: RecordingOptions = DEFAULT_OPTIONS) -> None:
        require("mcap")
        self.options = options
        self.channels: list[RecordedChannel] = []
        self.dropped = 0
        self.failure: RecordingNotWritten | None = None
        self._queue: deque[_Item] = deque()
        self._taken = 0
        self._closing = threading.Event()
        note = {"distro": distro.name, "ros_version": str(distro.ros_version), "encoding": options.encoding}
        self._files = _Files(path, f"ros{distro.ros_version}", note, options)
        self._thread = threading.Thread(target=self._run, name="recording", daemon=True)
        self._thread.start()

    @property
    def paths(self) -> tuple[Path, ...]:
        """The files that were begun so far."""
        return tuple(self._files.paths)

    @property
    def messages(self) -> int:
        """Number of accepted messages."""
        return sum(channel.messages for channel in self.channels)

    @property
    def content_bytes(self) -> int:
        """The bytes of their content, before compression."""
        return sum(channel.size for channel in self.channels)

    @property
    def waiting_bytes(self) -> int:
        """The bytes of those that wait for the disk."""
        return self._taken - self._files.written

    @property
    def bytes_on_disk(self) -> int:
        """The bytes of the files."""
        return self._files.bytes_on_disk

    def add_channel(self, form: ChannelForm) -> RecordedChannel:
        """Begin to record a topic; the file tells of it with its first message."""
        channel = RecordedChannel(form)
        self.channels.append(channel)
        return channel

    def write(
        self, channel: RecordedChannel, log_time: int, publish_time: int, data: bytes | memoryview
    ) -> None:
        """Record one message. Returns at once; `data` must not change afterwards.

        Args:
            log_time, publish_time: nanoseconds since the epoch.
        """
        size = len(data)
        if self.waiting_bytes > WAITING_BYTES or self.failure is not None:
            self.dropped += 1
            return
        self._taken += size
        channel.size += size
        channel.messages += 1
        self._queue.append((channel, log_time, publish_time, data, channel.messages))

    @property
    def is_writing(self) -> bool:
        """True while the writing thread runs."""
        return self._thread.is_alive()

    def finish_soon(self) -> None:
        """Take nothing more; what waits is written and the file ended, which :meth:`close` waits for."""
        self._closing.set()

    def close(self) -> None:
        """Write the queue, complete the file and wait for it. Idempotent.

        Raises:
            RecordingNotWritten: not everything could be written.
        """
        self._closing.set()
        self._thread.join()
        if self.failure is not None:
            raise self.failure

    def __enter__(self) -> RecordingWriter:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()

    # -- the thread ----------------------------------------------------------------------------------------

    def _run(self) -> None:
        try:
            while not self._closing.wait(_POLL_SECONDS):
                self._write_waiting()
                self._files.flush_if_due()
            self._write_waiting()
            self._files.finish()
        except OSError as error:
            self._fail(reason := _reason(error), reason)
        except RecordingNotWritten as error:
            self._fail(str(error), error.reason)  # The next file of a recording that splits.
        except Exception:
            # Otherwise no caller would learn of it, and the recording would go on without being written.
            logger.exception("recording failed")
            self._fail("internal error, see the log", "internal error")

    def _write_waiting(self) -> None:
        queue, add = self._queue, self._files.add
        while queue:
            add(queue.popleft())

    def _fail(self, text: str, reason: str) -> None:
        self._files.abandon()
        self._queue.clear()
        self.failure = RecordingNotWritten(
            f"{self._files.paths[-1]}: cannot be written any more: {text}; what was written until"
            " then can be played, and `rwt bag recover` makes a complete file of it",
            reason,
        )
        logger.error("%s", self.failure)


def _not_written(path: Path, error: OSError) -> RecordingNotWritten:
    reason = _reason(error)
    return RecordingNotWritten(f"{path}: cannot be written: {reason}", reason)


def _reason(error: OSError) -> str:
    return "the disk is full" if error.errno in (errno.ENOSPC, errno.EDQUOT) else str(error.strerror)


class _Files:
    """Consecutive files of one recording; belongs to the writing thread."""

    def __init__(self, path: Path, profile: str, note: Mapping[str, str], options: RecordingOptions) -> None:
        self.paths: list[Path] = []
        self.written = 0
        self.bytes_on_disk = 0
        self._candidates = _file_names(path, options)
        self._profile = profile
        self._note = note
        self._options = options
        self._begin()

    def _begin(self) -> None:
        self._disk = self._open()
        split = self._options.split
        if split is not None and 0 < split.keep < len(self.paths):
            oldest = self.paths.pop(0)
            try:
                oldest.unlink(missing_ok=True)
            except OSError as error:
                logger.warning("%s cannot be removed: %s", oldest, error.strerror)
        try:
            self._disk.reserve(min(START_BYTES, self._options.largest_bytes or START_BYTES))
        except OSError as error:
            self._disk.close()
            path = self.paths.pop() if self.paths[1:] else self.paths[0]
            if not self._options.overwrite:
                path.unlink()
            raise _not_written(path, error) from None
        self._ids: dict[RecordedChannel, int] = {}
        self._schemas: dict[tuple[str, str], int] = {}
        self._started_at: int | None = None
        self._dirty = False
        self._flushed_at = time.monotonic()
        self._writer = _mcap_writer(self._disk, self._options.compression)
        self._writer.start(profile=self._profile, library="robot-web-tools")
        self._writer.add_metadata(METADATA, dict(self._note))
        self._disk.keep()

    def _open(self) -> _Disk:
        while True:
            path = next(self._candidates)
            try:
                disk = _Disk(path, self._options.overwrite)
            except RecordingExists:
                if not self._options.dated:
                    raise
            else:
                self.paths.append(path)
                return disk

    def add(self, item: _Item) -> None:
        channel, log_time, publish_time, data, sequence = item
        split = self._options.split
        if self._started_at is None:
            self._started_at = log_time
        elif split is not None and (
            0 < split.size <= self._disk.size or 0 < split.seconds * 1e9 <= log_time - self._started_at
        ):
            self.finish()
            self._begin()
            self._started_at = log_time
        channel_id = self._ids.get(channel) or self._register(channel)
        # The library writes any buffer.
        content = cast("bytes", data)
        self._writer.add_message(channel_id, log_time, content, publish_time, sequence)
        self._disk.keep()  # If it ended a chunk, that is written whole now.
        self.written += len(data)
        self._dirty = True

    def _register(self, channel: RecordedChannel) -> int:
        form = channel.form
        key = (form.schema_name, form.schema_encoding)
        schema = self._schemas.get(key)
        if schema is None:
            schema = self._schemas[key] = self._writer.register_schema(*key, form.schema)
        found = self._writer.register_channel(form.topic, form.message_encoding, schema, form.metadata)
        self._ids[channel] = found
        return found

    def flush_if_due(self) -> None:
        now = time.monotonic()
        if self._dirty and now - self._flushed_at >= FLUSH_SECONDS:
            self._flush()
            self._flushed_at = now
            self._dirty = False
            self.bytes_on_disk = self._finished_bytes() + self._disk.size

    def _flush(self) -> None:
        self._writer.flush()
        self._disk.keep()

    def _finished_bytes(self) -> int:
        return sum(path.stat().st_size for path in self.paths[:-1])

    def finish(self) -> None:
        self._flush()
        self._writer.finish()
        self._disk.keep()
        self.bytes_on_disk = self._finished_bytes() + self._disk.size
        self._disk.close()

    def abandon(self) -> None:
        self._disk.cut()
        self._disk.close()


def _file_names(path: Path, options: RecordingOptions) -> Iterator[Path]:
    """Yield the names for the files of one recording, dated when they are requested."""
    for number in count():
        dated = path.with_name(time.strftime(path.name)) if options.dated else path
        is_numbered = options.split is not None or number
        yield dated.with_name(f"{dated.stem}_{number:04}{dated.suffix}") if is_numbered else dated


class _Disk:
    """File that knows its last complete position, for :class:`mcap.writer.Writer`."""

    def __init__(self, path: Path, overwrite: bool) -> None:
        flags = os.O_WRONLY | os.O_CREAT | getattr(os, "O_BINARY", 0) | getattr(os, "O_CLOEXEC", 0)
        try:
            self._file = os.open(path, flags | (os.O_TRUNC if overwrite else os.O_EXCL), 0o666)
        except FileExistsError:
            raise RecordingExists(
                f"{path} is there already: name another file, or overwrite it", "the file is there already"
            ) from None
        except OSError as error:
            raise _not_written(path, error) from None
        self.size = 0
        self._whole = 0
        self._closed = False

    def write(self, data: bytes) -> int:
        view = memoryview(data)
        while view:
            count = os.write(self._file, view)
            self.size += count
            view = view[count:]
        return len(data)

    def reserve(self, size: int) -> None:
        """Check that so many bytes can be written now, by writing and removing them.

        File systems report quotas and limits on file sizes only to those that write.

        Raises:
            OSError: they cannot be written; the file is empty.
        """
        try:
            self.write(bytes(size))
        finally:
            self.size = 0
            with suppress(OSError):  # Not a regular file.
                os.lseek(self._file, 0, os.SEEK_SET)
                os.ftruncate(self._file, 0)

    def tell(self) -> int:
        return self.size

    def flush(self) -> None:
        """No-op: nothing is buffered."""

    def keep(self) -> None:
        self._whole = self.size

    def cut(self) -> None:
        """Truncate to the last :meth:`keep`; if that fails, readers skip the rest."""
        if not self._closed:
            with suppress(OSError):
                os.ftruncate(self._file, self._whole)

    def close(self) -> None:
        """Close the file. Idempotent: the descriptor may be reused by then."""
        if not self._closed:
            self._closed = True
            os.close(self._file)


def _mcap_writer(disk: _Disk, compression: Compression) -> Writer:
    from mcap.writer import CompressionType, Writer  # an extra, loaded where something is recorded

    # All that the library uses of a file is write, tell and flush.
    output = cast("IO[bytes]", disk)
    return Writer(output, chunk_size=_CHUNK_BYTES, compression=CompressionType[compression.upper()])
