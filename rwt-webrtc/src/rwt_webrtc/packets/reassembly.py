"""Reassembly of messages of one SCTP stream (RFC 9260 section 6.9, RFC 8831).

aiortc scans all fragments of a message on each arrival, which is slow for large messages, and keeps endless
messages. Here the cost per fragment is constant, and memory is limited.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Final

from rwt_transports.api import HEAD_BYTES

if TYPE_CHECKING:
    from aiortc.rtcsctptransport import DataChunk

FIRST: Final = 0x02
LAST: Final = 0x01
UNORDERED: Final = 0x04
"""Flags of a DATA chunk (RFC 9260 section 3.3.1)."""

CHUNK_BYTES: Final = 256
"""Overhead of the objects of a fragment, counted in addition to its data."""

_TSN: Final = 2**32
_SEQUENCE: Final = 2**16


class Truncated(bytes):
    """Beginning of a message that exceeds the limit; the rest was dropped.

    Attributes:
        size: bytes of the message.
    """

    size: int = 0


def is_later(one: int, other: int, modulo: int = _TSN) -> bool:
    """Return True if a serial number comes after another (RFC 1982)."""
    return one != other and (one - other) % modulo < modulo // 2


class _Run:
    """Fragments of one message without a gap, in order."""

    __slots__ = ("charge", "end", "has_first", "has_last", "head", "pieces", "protocol", "sequence", "size",
                 "start", "unordered")  # fmt: skip

    def __init__(self, chunk: DataChunk) -> None:
        self.start = self.end = chunk.tsn
        self.has_first = bool(chunk.flags & FIRST)
        self.has_last = bool(chunk.flags & LAST)
        self.unordered = bool(chunk.flags & UNORDERED)
        self.sequence = chunk.stream_seq
        self.protocol = chunk.protocol
        self.pieces: list[bytes] | None = [chunk.user_data]
        self.head = b""
        self.size = len(chunk.user_data)
        self.charge = self.size + CHUNK_BYTES

    def truncate(self) -> None:
        if self.pieces is not None:
            self.head = b"".join(self.pieces)[:HEAD_BYTES] if self.has_first else b""
            self.pieces = None
            self.charge = len(self.head) + CHUNK_BYTES

    def message(self) -> bytes:
        if self.pieces is None:
            head = Truncated(self.head)
            head.size = self.size
            return head
        return self.pieces[0] if len(self.pieces) == 1 else b"".join(self.pieces)


class Reassembly:
    """Incoming stream; has the interface of aiortc's `InboundStream`.

    Args:
        max_size: bytes of the largest message that is kept.
        hold: called with the change of what is kept of incomplete messages, in bytes and in number.

    Attributes:
        sequence_number: number of the next ordered message.
    """

    def __init__(self, stream_id: int, max_size: int, hold: Callable[[int, int], None]) -> None:
        self._stream_id = stream_id
        self._max_size = max_size
        self._hold = hold
        self._starts: dict[int, _Run] = {}
        self._ends: dict[int, _Run] = {}
        self._ordered: dict[int, _Run] = {}
        self._ready: list[_Run] = []
        self.sequence_number = 0

    def add_chunk(self, chunk: DataChunk) -> None:
        """Take a fragment that has not come before."""
        run = self._appended(chunk) or self._put(_Run(chunk), 0, 1)
        follower = None if run.has_last else self._starts.get((run.end + 1) % _TSN)
        if follower is not None and not follower.has_first:
            run = self._joined(run, follower)
        if run.size > self._max_size:
            before = run.charge
            run.truncate()
            self._hold(run.charge - before, 0)
        if run.has_first and run.has_last:
            self._complete(run)

    def _put(self, run: _Run, charged: int, count: int) -> _Run:
        self._starts[run.start] = self._ends[run.end] = run
        self._hold(run.charge - charged, count)
        return run

    def _appended(self, chunk: DataChunk) -> _Run | None:
        """Return the run that the fragment continues, if there is one."""
        if chunk.flags & FIRST:
            return None
        run = self._ends.get((chunk.tsn - 1) % _TSN)
        if run is None or run.has_last:
            return None
        del self._ends[run.end]
        run.end = chunk.tsn
        self._ends[run.end] = run
        run.has_last = bool(chunk.flags & LAST)
        run.size += len(chunk.user_data)
        if run.pieces is not None:
            run.pieces.append(chunk.user_data)
            more = len(chunk.user_data) + CHUNK_BYTES
            run.charge += more
            self._hold(more, 0)
        return run

    def _joined(self, run: _Run, follower: _Run) -> _Run:
        self._forget(run)
        self._forget(follower)
        charged = run.charge + follower.charge
        run.end = follower.end
        run.has_last = follower.has_last
        run.size += follower.size
        if run.pieces is not None and follower.pieces is not None:
            run.pieces += follower.pieces
            run.charge = charged
        else:
            run.truncate()
        return self._put(run, charged, -1)

    def _forget(self, run: _Run) -> None:
        del self._starts[run.start], self._ends[run.end]

    def _complete(self, run: _Run) -> None:
        self._forget(run)
        if run.unordered:
            self._ready.append(run)
        elif is_later(self.sequence_number, run.sequence, _SEQUENCE):
            self._release(run)  # It was given up by its sender.
        else:
            replaced = self._ordered.get(run.sequence)
            self._ordered[run.sequence] = run
            if replaced is not None:
                self._release(replaced)

    def pop_messages(self) -> Iterator[tuple[int, int, bytes]]:
        """Return the complete messages in order: stream, protocol and data; a :class:`Truncated` if too
        large.
        """
        ready, self._ready = self._ready, []
        for run in ready:
            yield self._released(run)
        while (following := self._ordered.pop(self.sequence_number, None)) is not None:
            self.sequence_number = (self.sequence_number + 1) % _SEQUENCE
            yield self._released(following)

    def _released(self, run: _Run) -> tuple[int, int, bytes]:
        self._release(run)
        return self._stream_id, run.protocol, run.message()

    def _release(self, run: _Run) -> None:
        self._hold(-run.charge, -1)

    def prune_chunks(self, tsn: int) -> int:
        """Drop fragments up to `tsn` of incomplete messages, which the sender abandoned (RFC 3758 section
        3.6).

        Returns 0: the window is not counted here.
        """
        for run in tuple(self._starts.values()):
            if not is_later(run.start, tsn) and not (run.has_first and not is_later(tsn, run.end)):
                self._forget(run)
                self._release(run)
        for sequence in tuple(self._ordered):
            if is_later(self.sequence_number, sequence, _SEQUENCE):
                self._release(self._ordered.pop(sequence))
        return 0

    def clear(self) -> None:
        for run in (*self._starts.values(), *self._ordered.values(), *self._ready):
            self._release(run)
        self._starts.clear()
        self._ends.clear()
        self._ordered.clear()
        self._ready.clear()
