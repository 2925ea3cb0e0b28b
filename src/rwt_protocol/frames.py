"""The narrow waist between bytes and ops: what a transport moves, and the two faces of a connection."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import IntEnum
from typing import Protocol

Buffer = bytes | memoryview


class Frame:
    """One outgoing message: text (UTF-8 JSON) or binary. Immutable; shared by every connection it goes to.

    It is kept as `parts`, so that a payload is spliced into its envelope without a copy; a wire joins header
    and parts once, and :meth:`framed` keeps the outcome for the next connection.
    """

    __slots__ = ("_framed", "_framing", "_pieces", "binary", "parts", "size")

    def __init__(self, *parts: Buffer, binary: bool = False) -> None:
        self.parts = parts
        self.binary = binary
        size = 0
        for part in parts:
            size += len(part)
        self.size = size
        self._framing: object = None
        self._framed = b""
        self._pieces: dict[int, Sequence[Frame]] | None = None

    @property
    def data(self) -> bytes:
        """The whole message as one piece."""
        return b"".join(self.parts)

    def framed(self, framing: Callable[[Frame], bytes]) -> bytes:
        """The bytes of this frame on a wire whose `framing` needs nothing but the frame; computed once."""
        if self._framing is not framing:
            self._framed = framing(self)
            self._framing = framing
        return self._framed

    def pieces(self, size: int, cut: Callable[[Frame, int], Sequence[Frame]]) -> Sequence[Frame]:
        """This message cut into frames by `cut`; done once for each `size`, whoever it goes to."""
        if self._pieces is None:
            self._pieces = {}
        pieces = self._pieces.get(size)
        if pieces is None:
            pieces = self._pieces[size] = cut(self, size)
        return pieces

    def __repr__(self) -> str:
        kind = "binary" if self.binary else "text"
        return f"<Frame {kind} {self.size} bytes>"


class Lane(IntEnum):
    """How a frame may be treated when the reader is slow."""

    CONTROL = 0
    """Replies, requests, goals, status: never dropped; overflow disconnects, saying why."""
    DATA = 1
    """Published samples: overflow drops the oldest of the same topic."""


@dataclass(frozen=True, slots=True)
class PeerInfo:
    """What a transport knows about the other side when it connects.

    Attributes:
        transport: URL scheme, for example ``ws``.
        address: the peer's address without its port, empty where there is none.
        port: the peer's port, 0 where there is none.
        path: path and query of the request, for transports that have one.
        headers: request headers, names in lower case, for transports that have them.
    """

    transport: str
    address: str = ""
    port: int = 0
    path: str = "/"
    headers: Mapping[str, str] = field(default_factory=dict)


class Sink(Protocol):
    """Where an endpoint writes. All is synchronous, does not block, and is called on the loop's thread."""

    def send(self, frame: Frame, lane: Lane = Lane.CONTROL, topic: str = "") -> None:
        """Queue one frame. `topic` names the flow within which a frame of the data lane may be dropped.

        After :meth:`close` or the loss of the connection this does nothing.
        """

    def close(self, code: int = 1000, reason: str = "") -> None:
        """Close the connection after what the control lane holds. RFC 6455 section 7.4 names the codes."""

    @property
    def backlog(self) -> int:
        """Bytes queued and not yet handed to the network."""


class Endpoint(Protocol):
    """What a driver feeds: one peer. Every method is synchronous and is called on the loop's thread."""

    def receive(self, data: bytes, binary: bool) -> None:
        """Take one whole message, in order. Never raises."""

    def closed(self, code: int, reason: str) -> None:
        """The connection has ended; called exactly once, nothing follows. Never raises."""


Accept = Callable[[Sink, PeerInfo], Endpoint]
"""Called by a listener for each new connection, before its first frame."""
