"""Where large messages are received: a place that grows with what really comes, and is used again."""

from __future__ import annotations

STAGING_BYTES = 256 * 1024
"""First size of the place where a large message is received; it grows only as bytes really come."""
SPARE_BYTES = 4 * 1024 * 1024
"""A place of up to this size is kept for the next large message."""


class Spare:
    """One used receiving place, kept for the next large message of any connection of a listener."""

    __slots__ = ("_kept",)

    def __init__(self) -> None:
        self._kept: bytearray | None = None

    def take(self, size: int) -> bytearray:
        """A place for a message of `size` bytes; smaller than that when nothing large enough is at hand."""
        kept = self._kept
        if kept is not None and len(kept) >= min(size, STAGING_BYTES):
            self._kept = None
            return kept
        return bytearray(min(size, STAGING_BYTES))

    def give(self, place: bytearray) -> None:
        """Keep `place` if it is larger than what is kept, and not too large."""
        if len(place) <= SPARE_BYTES and (self._kept is None or len(self._kept) < len(place)):
            self._kept = place
