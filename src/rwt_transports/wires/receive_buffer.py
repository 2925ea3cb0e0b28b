"""Receive buffers of large messages: they grow with the bytes that arrive, and are reused."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from functools import partial
from typing import Final, Protocol

from rwt_transports.shared_pool import Holder, PoolRow, Share, SharedPool

STAGING_BYTES = 256 * 1024
"""Initial size of the buffer of a large message; it grows as bytes arrive."""
POOLED_BYTES = 4 * 1024 * 1024
"""A buffer of up to this size is kept for the next large message."""
LENT_BUFFERS = 8
"""Maximum number of buffers that wait for the end of the views of them."""
LENT_BYTES = 8 * 1024 * 1024
"""Maximum size of such a buffer."""


RECEIVING: Final = PoolRow("receive buffers", "limits.incoming_bytes", "bytes of incomplete messages")


class Incomplete(Protocol):
    """Receiver of an incomplete message."""

    def give_up(self, reason: str) -> None:
        """Drop the message, and close the connection."""


class ReceiveBufferPool:
    """Receive buffers of the connections of a server, and limits on their large messages.

    Incomplete messages are shares of a :class:`~rwt_transports.shared_pool.SharedPool`: beyond its capacity,
    the client that holds most of it loses the message that began first. A message whose sender continues is
    complete soon, so the oldest is most likely abandoned.

    Attributes by purpose:

    * Buffers: ``_kept`` (one used buffer, for the next large message), ``_lent`` (used ones, of which views
      may exist).
    * Incomplete messages: ``_shares``, ``_incomplete`` (shares by receiver).
    * Complete messages that wait for a paused endpoint: ``_unread`` (bytes by receiver), ``_unread_bytes``
      (their sum), ``_inflating`` (receivers that inflate one), ``_arriving`` (size of the large message being
      delivered).

    Args:
        most: maximum bytes of incomplete messages, over all connections. While a quarter as many bytes are
            complete and unread, no more of large messages is received or inflated.
    """

    def __init__(self, most: int = 96 * 1024 * 1024) -> None:
        self._kept: bytearray | None = None
        self._lent: deque[bytearray] = deque(maxlen=LENT_BUFFERS)
        self._shares = SharedPool(RECEIVING, most)
        self._incomplete: dict[Incomplete, Share] = {}
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

    def hold(self, receiver: Incomplete, size: int, holder: Holder) -> None:
        """Set the bytes of an incomplete message of `receiver`; give up messages over the limit.

        Args:
            holder: client that sends the message.
        """
        share = self._incomplete.get(receiver)
        if share is None:
            share = self._shares.take(holder, partial(self._give_up, receiver), 0)
            self._incomplete[receiver] = share
        self._shares.resize(share, size)

    def _give_up(self, receiver: Incomplete, reason: str) -> None:
        del self._incomplete[receiver]
        receiver.give_up(reason)

    def release(self, receiver: Incomplete) -> None:
        """Note that `receiver` has no incomplete message."""
        share = self._incomplete.pop(receiver, None)
        if share is not None:
            self._shares.release(share)

    def hand_on(self, receive: Callable[[bytes, bool], None], message: bytes, binary: bool) -> None:
        """Deliver a large message. If the endpoint pauses its connection meanwhile, it keeps the message
        unread, see :meth:`keep_unread`."""
        self._arriving = len(message)
        try:
            receive(message, binary)
        finally:
            self._arriving = 0

    def keep_unread(self, receiver: Incomplete) -> None:
        """Count the large message being delivered as unread until :meth:`is_read`."""
        if self._arriving:
            self.count_unread(receiver, self._arriving)

    def count_unread(self, receiver: Incomplete, size: int) -> None:
        """Count `size` bytes of `receiver` as unread until :meth:`is_read`."""
        self._unread_bytes += size - self._unread.get(receiver, 0)
        self._unread[receiver] = size

    def may_inflate(self, receiver: Incomplete, most: int) -> bool:
        """Return True if `receiver` may inflate a message now, and count `most` bytes as unread until
        :meth:`is_read`. One receiver at a time always may."""
        if receiver not in self._inflating:
            if self._inflating and self.has_much_unread():
                return False
            self._inflating.add(receiver)
            self.count_unread(receiver, most)
        return True

    def is_read(self, receiver: Incomplete) -> None:
        """Note that `receiver` keeps nothing unread."""
        self._unread_bytes -= self._unread.pop(receiver, 0)
        self._inflating.discard(receiver)

    def has_much_unread(self) -> bool:
        """Return True if large messages must not be received for now."""
        return self._unread_bytes > self._shares.capacity // 4


def _is_free(buffer: bytearray) -> bool:
    """Return True if no view of a buffer exists: only then, its size may change."""
    try:
        buffer.append(0)
    except BufferError:
        return False
    buffer.pop()
    return True
