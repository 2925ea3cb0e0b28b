"""Buffers in which large messages are received: they grow with the bytes that come, and are used again."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

STAGING_BYTES = 256 * 1024
"""First size of the buffer of a large message; it grows only as bytes really come."""
POOLED_BYTES = 4 * 1024 * 1024
"""A buffer of up to this size is kept for the next large message."""


class Incomplete(Protocol):
    """Who has bytes of a message whose end has not come."""

    def give_up(self, reason: str) -> None:
        """Drop them, and close the connection."""


class ReceiveBufferPool:
    """What the connections of a server receive large messages in: one used buffer that is kept for the next
    one, and how much they hold of messages whose end has not come.

    Beyond the most there may be, the one that began first is given up: one whose sender goes on with it is
    there soon, so that it is one that nobody ends.

    Args:
        most: bytes of incomplete messages, over all connections; while a quarter as many are complete and
            wait to be read by whom they are for, nothing more of large messages is received or inflated.
    """

    __slots__ = (
        "_arriving",
        "_held",
        "_incomplete",
        "_inflating",
        "_kept",
        "_most",
        "_unread",
        "_unread_bytes",
    )

    def __init__(self, most: int = 96 * 1024 * 1024) -> None:
        self._kept: bytearray | None = None
        self._most = most
        self._held = 0
        self._incomplete: dict[Incomplete, int] = {}
        self._unread: dict[Incomplete, int] = {}
        self._unread_bytes = 0
        self._inflating: set[Incomplete] = set()
        self._arriving = 0  # bytes of the large message that is handed on at the moment

    def take(self, size: int) -> bytearray:
        """A buffer for a message of `size` bytes; smaller than that when none large enough is kept."""
        kept = self._kept
        if kept is not None and len(kept) >= min(size, STAGING_BYTES):
            self._kept = None
            return kept
        return bytearray(min(size, STAGING_BYTES))

    def give(self, buffer: bytearray) -> None:
        """Keep `buffer` if it is larger than the one that is kept, and not too large."""
        if len(buffer) <= POOLED_BYTES and (self._kept is None or len(self._kept) < len(buffer)):
            self._kept = buffer

    def hold(self, holder: Incomplete, size: int) -> None:
        """Count that `holder` has so many bytes of an incomplete message now."""
        self._held += size - self._incomplete.get(holder, 0)
        self._incomplete[holder] = size
        while self._held > self._most and len(self._incomplete) > 1:
            oldest = next(iter(self._incomplete))
            self.release(oldest)
            oldest.give_up(
                f"{self._most} bytes of incomplete messages wait here, and this one for longest"
                " (limits.incoming_bytes)"
            )

    def release(self, holder: Incomplete) -> None:
        """Count that `holder` has none."""
        self._held -= self._incomplete.pop(holder, 0)

    def hand_on(self, receive: Callable[[bytes, bool], None], message: bytes, binary: bool) -> None:
        """Hand a large message on. Who takes it may pause its connection meanwhile, and so says that it keeps
        it unread (:meth:`keep_unread`)."""
        self._arriving = len(message)
        try:
            receive(message, binary)
        finally:
            self._arriving = 0

    def keep_unread(self, holder: Incomplete) -> None:
        """Count what arrives as complete and unread, if it is large, until :meth:`is_read`."""
        if self._arriving:
            self.count_unread(holder, self._arriving)

    def count_unread(self, holder: Incomplete, size: int) -> None:
        """Count that `holder` keeps so many bytes, until :meth:`is_read`."""
        self._unread_bytes += size - self._unread.get(holder, 0)
        self._unread[holder] = size

    def may_inflate(self, holder: Incomplete, most: int) -> bool:
        """Whether `holder` may inflate a message now, which is then counted as unread, with the `most` bytes
        that it may come to. One at a time always may, until it :meth:`is_read`."""
        if holder not in self._inflating:
            if self._inflating and self.has_much_unread():
                return False
            self._inflating.add(holder)
            self.count_unread(holder, most)
        return True

    def is_read(self, holder: Incomplete) -> None:
        """Count that `holder` keeps nothing unread."""
        self._unread_bytes -= self._unread.pop(holder, 0)
        self._inflating.discard(holder)

    def has_much_unread(self) -> bool:
        """Whether nothing more of large messages is to be received for now."""
        return self._unread_bytes > self._most // 4
