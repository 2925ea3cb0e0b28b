"""Buffers in which large messages are received: they grow with the bytes that come, and are used again."""

from __future__ import annotations

STAGING_BYTES = 256 * 1024
"""First size of the buffer of a large message; it grows only as bytes really come."""
POOLED_BYTES = 4 * 1024 * 1024
"""A buffer of up to this size is kept for the next large message."""


class ReceiveBufferPool:
    """One used buffer, kept for the next large message of any connection of a listener."""

    __slots__ = ("_kept",)

    def __init__(self) -> None:
        self._kept: bytearray | None = None

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
