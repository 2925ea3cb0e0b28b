"""Receive buffers of large messages: they grow with the bytes that arrive, and are reused."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import Protocol

STAGING_BYTES = 256 * 1024
"""Initial size of the buffer of a large message; it grows as bytes arrive."""
POOLED_BYTES = 4 * 1024 * 1024
"""A buffer of up to this size is kept for the next large message."""
LENT_BUFFERS = 8
"""Maximum number of buffers that wait for the end of the views of them."""
LENT_BYTES = 8 * 1024 * 1024
"""Maximum size of such a buffer."""


class Incomplete(Protocol):
    """Holder of an incomplete message."""

    def give_up(self, reason: str) -> None:
        """Drop the message, and close the connection."""


class ReceiveBufferPool:
    """Receive buffers of the connections of a server, and limits on their large messages.

    Beyond the limit of incomplete messages, the one that began first is given up. A message whose sender
    continues is complete soon, so the oldest is most likely abandoned.

    Attributes by purpose:

    * Buffers: ``_kept`` (one used buffer, for the next large message), ``_lent`` (used ones, of which views
      may exist).
    * Incomplete messages: ``_incomplete`` (bytes by holder, oldest first), ``_held`` (their sum), ``_most``.
    * Complete messages that wait for a paused endpoint: ``_unread`` (bytes by holder), ``_unread_bytes``
      (their sum), ``_inflating`` (holders that inflate one), ``_arriving`` (size of the large message being
      delivered).

    Args:
        most: maximum bytes of incomplete messages, over all connections. While a quarter as many bytes are
            complete and unread, no more of large messages is received or inflated.
    """

    def __init__(self, most: int = 96 * 1024 * 1024) -> None:
        self._kept: bytearray | None = None
        self._lent: deque[bytearray] = deque(maxlen=LENT_BUFFERS)
        self._most = most
        self._held = 0
        self._incomplete: dict[Incomplete, int] = {}
        self._unread: dict[Incomplete, int] = {}
        self._unread_bytes = 0
        self._inflating: set[Incomplete] = set()
        self._arriving = 0

    def take(self, size: int) -> bytearray:
        """Return a buffer for a message of `size` bytes; smaller if no kept one is large enough."""
        kept = self._kept
        if kept is not None and len(kept) >= min(size, STAGING_BYTES):
            self._kept = None
            return kept
        for index, buffer in enumerate(self._lent):
            # Not much larger: a view of a message keeps the whole buffer.
            if min(size, LENT_BYTES) <= len(buffer) <= 4 * size and _is_free(buffer):
                del self._lent[index]
                return buffer
        return bytearray(min(size, STAGING_BYTES))

    def lend(self, buffer: bytearray, size: int) -> memoryview:
        """Return the message of `size` bytes in a buffer from :meth:`take` without a copy; the buffer is
        reused once no view of it exists."""
        if len(buffer) <= LENT_BYTES:
            self._lent.append(buffer)
        return memoryview(buffer)[:size].toreadonly()

    def give(self, buffer: bytearray) -> None:
        """Keep `buffer` for reuse if it is larger than the current one, and not too large."""
        if len(buffer) <= POOLED_BYTES and (self._kept is None or len(self._kept) < len(buffer)):
            self._kept = buffer

    def hold(self, holder: Incomplete, size: int) -> None:
        """Set the bytes of an incomplete message of `holder`; give up the oldest ones over the limit."""
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
        """Note that `holder` has no incomplete message."""
        self._held -= self._incomplete.pop(holder, 0)

    def hand_on(self, receive: Callable[[bytes, bool], None], message: bytes, binary: bool) -> None:
        """Deliver a large message. If the endpoint pauses its connection meanwhile, it keeps the message
        unread, see :meth:`keep_unread`."""
        self._arriving = len(message)
        try:
            receive(message, binary)
        finally:
            self._arriving = 0

    def keep_unread(self, holder: Incomplete) -> None:
        """Count the large message being delivered as unread until :meth:`is_read`."""
        if self._arriving:
            self.count_unread(holder, self._arriving)

    def count_unread(self, holder: Incomplete, size: int) -> None:
        """Count `size` bytes of `holder` as unread until :meth:`is_read`."""
        self._unread_bytes += size - self._unread.get(holder, 0)
        self._unread[holder] = size

    def may_inflate(self, holder: Incomplete, most: int) -> bool:
        """Return True if `holder` may inflate a message now, and count `most` bytes as unread until
        :meth:`is_read`. One holder at a time always may."""
        if holder not in self._inflating:
            if self._inflating and self.has_much_unread():
                return False
            self._inflating.add(holder)
            self.count_unread(holder, most)
        return True

    def is_read(self, holder: Incomplete) -> None:
        """Note that `holder` keeps nothing unread."""
        self._unread_bytes -= self._unread.pop(holder, 0)
        self._inflating.discard(holder)

    def has_much_unread(self) -> bool:
        """Return True if large messages must not be received for now."""
        return self._unread_bytes > self._most // 4


def _is_free(buffer: bytearray) -> bool:
    """Return True if no view of a buffer exists: only then, its size may change."""
    try:
        buffer.append(0)
    except BufferError:
        return False
    buffer.pop()
    return True
