"""What wires have in common whose protocol says nothing but messages: no handshake, no pings, no close."""

from __future__ import annotations

from collections.abc import Callable

from rwt_transports.api import Framing, WireEvents


class StreamWire:
    """A buffer of what has come, out of which a subclass takes messages.

    Args:
        events: what the wire reports to, messages excepted.
        max_size: largest message in bytes.
        framing: how outgoing frames become bytes.
    """

    __slots__ = ("_buffer", "_events", "_framing", "_max_size", "_over", "message")

    def __init__(self, events: WireEvents, max_size: int, framing: Framing) -> None:
        self._events = events
        self._max_size = max_size
        self._framing = framing
        self.message: Callable[[bytes, bool], None] = _ignore
        self._buffer = bytearray()
        self._over = False

    @property
    def framing(self) -> Framing:
        """How outgoing frames become bytes."""
        return self._framing

    def close(self, code: int, reason: str) -> bytes:
        """Nothing is said at the end of this protocol."""
        self._over = True
        self.message = _ignore
        return b""

    def ping(self) -> bytes:
        """There is none."""
        return b""

    def get_buffer(self) -> None:
        """Messages are put together in a buffer of the wire's own."""

    def buffer_updated(self, count: int) -> None:
        """Never called, since there is no :meth:`get_buffer`."""


def _ignore(_data: bytes, _binary: bool) -> None:
    """Where messages go before an endpoint is there, and after the connection began to close."""
