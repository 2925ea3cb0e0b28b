"""Contract of wires and drivers: a *wire* knows a protocol and does no I/O, a *driver* moves bytes.

A :class:`~rwt_transports.connection.Connection` stands between them. The driver gives it a :class:`Link` and
received bytes, and takes bytes to send whenever the link was woken. The connection feeds its :class:`Wire`,
which calls back with whole messages. Everything is synchronous and runs on the event loop's thread: a message
costs no task.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractAsyncContextManager
from dataclasses import dataclass, field
from enum import Enum
from ssl import SSLContext
from typing import Final, Protocol, runtime_checkable

from anyio.abc import TaskGroup

from rwt_protocol.frames import Buffer, Framing
from rwt_transports.http.addresses import AddressCount
from rwt_transports.limits import Limits
from rwt_transports.shared_pool import Holder


class Link(Protocol):
    """Byte stream of one peer, as a driver offers it to a connection. No method blocks."""

    def set_callbacks(self, callbacks: DriverCallbacks) -> None:
        """Deliver events to `callbacks` from now on, in place of former ones: of the handshake, for
        example."""

    def wake(self) -> None:
        """Ask the driver to take bytes to send; it does so later, not within this call."""

    def finish(self) -> None:
        """Half-close: end the sending side and keep reading. Closes if the transport cannot half-close."""

    def close(self) -> None:
        """Close once everything taken has reached the network."""

    def abort(self) -> None:
        """Drop the connection immediately."""

    def pause(self) -> None:
        """Pause reading until :meth:`resume`. Bytes that were read before may still be delivered. No-op for
        transports that cannot pause a peer."""

    def resume(self) -> None:
        """Resume reading after :meth:`pause`."""


class HangUp(Enum):
    """State of a peer while reading from it is paused."""

    NO = "no"
    SENDS_NO_MORE = "sends no more"
    """The peer closed its sending side. Sending something shows whether it still reads."""
    GONE = "gone"


@runtime_checkable
class HangUpAware(Protocol):
    """Link that detects a disconnected peer while reading is paused."""

    def hang_up(self) -> HangUp:
        """Return the current state of the peer."""


@dataclass(frozen=True, slots=True)
class Delivery:
    """Progress of sent bytes.

    Attributes:
        unacknowledged: bytes that the peer's system has not acknowledged.
        unsent: part of them that has not left.
        queue_seconds: delay of the path above the shortest that was seen.
    """

    unacknowledged: int = 0
    unsent: int = 0
    queue_seconds: float = 0.0


@runtime_checkable
class DeliveryAware(Protocol):
    """Link that reports the progress of sent bytes."""

    def delivery(self) -> Delivery:
        """Return the current progress; zeros if the system does not report it."""


HEAD_BYTES: Final = 1024
"""Number of bytes kept of a skipped message, to identify it."""


class WireEvents(Protocol):
    """Events that a wire reports while it is fed."""

    @property
    def holder(self) -> Holder:
        """Client to which incomplete messages count."""

    def oversized(self, size: int) -> bool:
        """Called when a message larger than the limit begins; `size` is in bytes, as far as known.

        Returns True to skip the message; :meth:`oversized_head` is then called once.
        """

    def oversized_head(self, size: int, head: bytes) -> None:
        """Called with the first bytes of a message that is skipped, at most :data:`HEAD_BYTES`."""

    def answer(self, data: bytes) -> None:
        """Send bytes of the protocol itself: the reply to a close."""

    def pong(self, data: bytes) -> None:
        """Send the reply to a ping; optional while the peer does not read (RFC 6455 section 5.5.3)."""

    def read_on_later(self) -> None:
        """Called by a wire that holds itself: it has read as much as it may in this turn of the event loop.

        :meth:`HoldableWire.go_on` follows in a later turn.
        """

    def ended(self, code: int, reason: str, *, agreed: bool) -> None:
        """Called when no message follows; `agreed` is False if the peer broke the protocol."""


TakeSteps = Callable[[Iterator[None], Callable[[], bool]], None]
"""Function that takes work in short steps, some in each turn of the event loop in which its second argument
returns True. Nothing is read from the peer until all steps are taken."""


@runtime_checkable
class StepTaking(Protocol):
    """Endpoint that runs the steps of its wire as part of its own work."""

    def take_steps(self, steps: Iterator[None], may_go_on: Callable[[], bool]) -> None:
        """Run steps, see :data:`TakeSteps`."""


@runtime_checkable
class HoldingWire(Protocol):
    """Endpoint that decides whether it gets more messages of the same read once it pauses its connection."""

    @property
    def holds_wire(self) -> bool:
        """True if it gets no more; asked at each pause."""


@runtime_checkable
class HoldableWire(Protocol):
    """Wire that can stop between two messages of a read."""

    def hold(self) -> None:
        """Queue received messages instead of delivering them."""

    def go_on(self) -> None:
        """Deliver the queued messages."""


class Wire(Protocol):
    """Protocol of one connection: bytes in, messages out; frames in, bytes out. No I/O and no
    clock."""

    message: Callable[[bytes, bool], None]
    """Called with each whole message, and True if it is binary."""

    @property
    def framing(self) -> Framing:
        """Conversion of outgoing frames to bytes; the same object for all connections that can share
        bytes."""

    def feed(self, data: bytes) -> None:
        """Read received bytes."""

    def get_buffer(self) -> memoryview | None:
        """Return the buffer to receive the next bytes of a large message into; None: receive anywhere and
        feed."""

    def buffer_updated(self, count: int) -> None:
        """Called when `count` bytes were received into the buffer from :meth:`get_buffer`."""

    def give_up(self, reason: str) -> None:
        """Drop an incomplete message, and end the connection."""

    def close(self, code: int, reason: str) -> bytes:
        """Begin to close: later messages are not reported. Returns the bytes to send, which may be none."""

    def ping(self) -> bytes:
        """Return the bytes of a ping; none if the protocol has no pings."""


def drop_message(_data: bytes, _binary: bool) -> None:
    """Drop a message; :attr:`Wire.message` without an endpoint, or while the connection closes."""


@runtime_checkable
class SizeLimitedWire(Protocol):
    """Wire that receives messages piece by piece, and can therefore refuse one by its size."""

    def limit(self, size: int) -> None:
        """Set the maximum size in bytes of the messages that begin from now on."""


@runtime_checkable
class SizeLimiting(Protocol):
    """Endpoint with a limit of its own on the size of messages, in place of ``limits.message_bytes``."""

    @property
    def largest_bytes(self) -> int:
        """Maximum size of a message in bytes."""


@runtime_checkable
class OversizeAware(Protocol):
    """Endpoint that answers messages which are too large to receive."""

    def oversized(self, size: int, limit: int, head: bytes) -> None:
        """Called when a message of at least `size` bytes is skipped. Never raises.

        Args:
            size: size of the message in bytes, as far as known.
            limit: maximum message size.
            head: first bytes of the message, at most :data:`HEAD_BYTES`.
        """


class FlowControl(Protocol):
    """Flow control of one connection, for endpoints that pause their peer."""

    def pause(self) -> None:
        """Pause reading until :meth:`resume`; messages that have arrived may still be delivered."""

    def resume(self) -> None:
        """Resume reading."""

    def when_empty(self, callback: Callable[[], None]) -> None:
        """Call `callback` once the network has accepted everything sent to this peer.

        A new callback replaces the former one. None is called once the connection is lost.
        """


@runtime_checkable
class FlowControlled(Protocol):
    """Endpoint that uses the flow control of its connection, which it gets before the first message."""

    def set_flow_control(self, flow_control: FlowControl) -> None:
        """Store `flow_control` for the life of the connection."""


class DriverCallbacks(Protocol):
    """Receiver of a link's events: a connection, or the client's handshake before it."""

    def receive(self, data: bytes) -> None:
        """Called with received bytes."""

    def get_buffer(self) -> memoryview | None:
        """Return the buffer to receive the next bytes into; None: receive anywhere."""

    def buffer_updated(self, count: int) -> None:
        """Called when `count` bytes were received into the buffer from :meth:`get_buffer`."""

    def take(self, limit: int = ..., /) -> tuple[Sequence[Buffer], bool]:
        """Return the next pieces to write, and True if the driver must call again once they are written.

        There are no pieces if nothing is queued. They have about `limit` bytes at most: large messages are
        cut there, and small ones may exceed it.
        """

    def put_back(self, pieces: Sequence[Buffer]) -> None:
        """Put back taken pieces that the network has not accepted: they are sent first next
        time."""

    def progress(self) -> None:
        """Called when the network accepts bytes again: the peer is alive."""

    def eof(self) -> None:
        """Called when the peer sends nothing more."""

    def lost(self) -> None:
        """Called once, last, when the link is gone for any reason."""


class UnbufferedCallbacks:
    """Base of :class:`DriverCallbacks` without a receive buffer, which ignore progress."""

    __slots__ = ()

    def get_buffer(self) -> None:
        """Return None: receive anywhere."""

    def buffer_updated(self, count: int) -> None:
        """No-op: there is no buffer."""

    def progress(self) -> None:
        """No-op."""


class NoCallbacks(UnbufferedCallbacks):
    """Callbacks of a link without a connection; they drop everything, so that the link does not keep the
    connection.
    """

    def receive(self, data: bytes) -> None:
        """Drop `data`."""

    def take(self, limit: int = 0, /) -> tuple[Sequence[Buffer], bool]:
        """Return no pieces: there is nothing to send."""
        return (), False

    def put_back(self, pieces: Sequence[Buffer]) -> None:
        """Drop `pieces`."""

    def eof(self) -> None:
        """No-op."""

    def lost(self) -> None:
        """No-op."""


NO_CALLBACKS: Final[DriverCallbacks] = NoCallbacks()


Attach = Callable[[Link, str, int], object]
"""Called by a driver with the link, address ("" if there is none) and port (or 0) of each new peer. Calls
:meth:`Link.set_callbacks` before it returns."""


OWNER_ONLY: Final = 0o600
"""Permissions of the file of a Unix socket that only programs of the same user can connect to."""


@dataclass(frozen=True, slots=True)
class BindAddress:
    """Address that a driver listens on.

    Attributes:
        host: name or address, for TCP.
        port: TCP port; 0 lets the system choose.
        path: path of a Unix socket; the host is then empty.
        mode: permissions of the file of a Unix socket.
        tls: encrypts the connections; None for plain connections.
        shared: True if other processes of this user listen on the same TCP port.
        handshake_seconds: timeout of a TLS handshake.
        addresses: counts each peer until its TLS handshake has ended.
        is_held_back: returns True while large messages must not be received, because many others wait to be
            read. Connections of one event loop with the same function share turns.
    """

    host: str = ""
    port: int = 0
    path: str = ""
    mode: int = OWNER_ONLY
    tls: SSLContext | None = None
    shared: bool = False
    handshake_seconds: float = 10.0
    addresses: AddressCount = field(default_factory=AddressCount)
    is_held_back: Callable[[], bool] = bool

    def __str__(self) -> str:
        return self.path or f"port {self.port} on {self.host}"


@dataclass(frozen=True, slots=True)
class RemoteAddress:
    """Address that a driver connects to.

    Attributes:
        host: name or address, without brackets, for TCP.
        port: 1 to 65535.
        path: path of a Unix socket, or command of a program; the host is then empty.
        tls: encrypts the connection, and verifies the server; None for a plain connection.
        target: path and query of the HTTP request, for drivers that send one.
        limits: bounds of the connection, for drivers that enforce some of them.
        seconds: timeout of connecting.
        ice_servers: STUN and TURN servers, each like the W3C's ``RTCIceServer``, for drivers that use them;
            None for those that the server names.
        is_held_back: see :class:`BindAddress`.
    """

    host: str = ""
    port: int = 0
    path: str = ""
    tls: SSLContext | None = None
    target: str = ""
    headers: Mapping[str, str] = field(default_factory=dict)
    limits: Limits = field(default_factory=Limits)
    seconds: float = 10.0
    ice_servers: Sequence[Mapping[str, str]] | None = None
    is_held_back: Callable[[], bool] = bool

    def __str__(self) -> str:
        return self.path or f"{self.host}:{self.port}"


@runtime_checkable
class FindsPath(Protocol):
    """Connector whose path is found while connecting, not given by the address."""

    @property
    def path(self) -> str:
        """Description of the path; empty before the connection is open."""


class Connector(Protocol):
    """Opens connections to other programs."""

    async def connect(self, address: RemoteAddress, attach: Attach, tasks: TaskGroup) -> None:
        """Connect, attach the link, and move its bytes, in `tasks` if that needs tasks.

        Raises:
            OSError: the connection could not be opened.
        """


class Driver(Protocol):
    """Driver that accepts connections."""

    def serve(self, address: BindAddress, attach: Attach) -> AbstractAsyncContextManager[int]:
        """Accept connections inside the block. Yields the port in use.

        Raises:
            ListenError: the address is not available.
        """
