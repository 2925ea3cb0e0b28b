"""The two seams of this package: a *wire* knows a protocol and does no I/O, a *driver* moves bytes and
knows none.

A :class:`~rwt_transports.connection.Connection` stands between them. The driver gives it a :class:`Link`,
hands it what arrives, and takes what is to be sent whenever the link was woken; the connection feeds its
:class:`Wire`, which calls back with whole messages. Everything is synchronous and runs on the loop's
thread, so a message costs no task.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractAsyncContextManager
from dataclasses import dataclass, field
from enum import Enum
from ssl import SSLContext
from typing import Final, Protocol, runtime_checkable

from anyio.abc import TaskGroup

from rwt_protocol.frames import Buffer, Frame
from rwt_transports.http.addresses import AddressCount
from rwt_transports.limits import Limits


@dataclass(frozen=True, slots=True)
class Framing:
    """How frames become a wire's bytes; depends on nothing but the frame, so that connections share the
    outcome.

    Attributes:
        whole: the frame as one piece.
        pieces: the same bytes in several pieces, of which the large ones are the frame's own parts, uncopied.
        shared: False where the bytes depend on what was sent before on the same connection: then every frame
            is framed exactly once each time it is sent, in the order of sending.
        joined: several frames as one piece, where that is cheaper than to join what `whole` makes of each.
        apart: several frames that have a gap (:class:`~rwt_protocol.frames.GapFrame`) in the pieces
            between which each receiver's own bytes go, one more than there are frames.
    """

    whole: Callable[[Frame], bytes]
    pieces: Callable[[Frame], tuple[Buffer, ...]]
    shared: bool = True
    joined: Callable[[Sequence[Frame]], bytes] | None = None
    apart: Callable[[Sequence[Frame]], Sequence[bytes]] | None = None


class Link(Protocol):
    """One peer's pipe of bytes, as a driver offers it to a connection. No method blocks."""

    def set_callbacks(self, callbacks: DriverCallbacks) -> None:
        """Call `callbacks` from now on, in place of any before them: a connection takes over from its
        handshake."""

    def wake(self) -> None:
        """Ask the driver to take what there is to send; it does so later, not within this call."""

    def finish(self) -> None:
        """Half-close: end the sending side and keep reading; closes where there is no such thing."""

    def close(self) -> None:
        """Close once what was taken has reached the network."""

    def abort(self) -> None:
        """Drop the connection at once."""

    def pause(self) -> None:
        """Read nothing from the peer until :meth:`resume`; what is read already may still be handed over.
        Where nothing can hold a peer back, this does nothing."""

    def resume(self) -> None:
        """Read from the peer again after :meth:`pause`."""


class HangUp(Enum):
    """What is known of a peer from which nothing is read at the moment."""

    NO = "no"
    SENDS_NO_MORE = "sends no more"
    """It has closed its sending side. Whether it still reads, it shows when it is sent something."""
    GONE = "gone"


@runtime_checkable
class HangUpAware(Protocol):
    """A link that can tell whether its peer has hung up while nothing is read from it."""

    def hang_up(self) -> HangUp:
        """What is known now."""


HEAD_BYTES: Final = 1024
"""What is kept of a message that is skipped, so that it can be told which."""


class WireEvents(Protocol):
    """What a wire reports while it is fed."""

    def oversized(self, size: int) -> bool:
        """A message larger than the limit has begun; `size` in bytes as far as known. True: skip it and go
        on; then :meth:`oversized_head` is called once."""

    def oversized_head(self, size: int, head: bytes) -> None:
        """The first bytes of a message that is skipped, at most :data:`HEAD_BYTES`."""

    def answer(self, data: bytes) -> None:
        """The protocol itself owes the peer these bytes: the reply to a close."""

    def pong(self, data: bytes) -> None:
        """The reply to a ping; may be left out while the peer does not read (RFC 6455 section 5.5.3)."""

    def ended(self, code: int, reason: str, *, agreed: bool) -> None:
        """No message follows. `agreed`: both sides have said so; otherwise the peer broke the protocol."""


@runtime_checkable
class Holding(Protocol):
    """A wire that can stop in the midst of what it was fed."""

    def hold(self) -> None:
        """Hand over no message more until :meth:`go_on`."""

    def go_on(self) -> None:
        """Hand over what has come meanwhile."""


TakeSteps = Callable[[Iterator[None], Callable[[], bool]], None]
"""Takes work in short steps, some of them in each turn of the event loop, once the function says that it may
be gone on with, which is asked before each turn. Until all are taken nothing is read from the peer."""


@runtime_checkable
class StepWise(Protocol):
    """A wire on which one message may take long to read, and does so in steps.

    Attributes:
        take_steps: takes them; None where nobody does, and they are taken at once.
    """

    take_steps: TakeSteps | None


@runtime_checkable
class StepTaking(Protocol):
    """An endpoint that takes the steps of its wire as it does its own work."""

    def take_steps(self, steps: Iterator[None], may_go_on: Callable[[], bool]) -> None:
        """As :data:`TakeSteps` says."""


class Wire(Protocol):
    """One connection's protocol: bytes in, messages out; a frame in, bytes out. Does no I/O and reads no
    clock."""

    message: Callable[[bytes, bool], None]
    """Called with each whole message, and whether it is binary."""

    @property
    def framing(self) -> Framing:
        """How outgoing frames become bytes; the same object for every connection of the wire that can
        share."""

    def feed(self, data: bytes) -> None:
        """Take what arrived."""

    def get_buffer(self) -> memoryview | None:
        """Where the next bytes may be received directly, inside a large message; None: receive anywhere and
        feed."""

    def buffer_updated(self, count: int) -> None:
        """`count` bytes were received into the buffer that :meth:`get_buffer` gave."""

    def give_up(self, reason: str) -> None:
        """Drop what has come of a message whose end has not, and end the connection."""

    def close(self, code: int, reason: str) -> bytes:
        """Begin to close: later messages are not reported. Returns what to send, perhaps nothing."""

    def ping(self) -> bytes:
        """What to send to learn whether the peer is alive; nothing where the protocol has no ping."""


@runtime_checkable
class OversizeAware(Protocol):
    """An endpoint that wants to answer a message which was too large to take."""

    def oversized(self, size: int, limit: int, head: bytes) -> None:
        """A message of at least `size` bytes is skipped; `limit` is the setting, and `head` what it begins
        with, at most :data:`HEAD_BYTES`. Never raises."""


class FlowControl(Protocol):
    """How an endpoint that passes messages on holds back their sender."""

    def pause(self) -> None:
        """Take nothing from this peer until :meth:`resume`; what has arrived may still be handed over."""

    def resume(self) -> None:
        """Take messages from this peer again."""

    def when_empty(self, callback: Callable[[], None]) -> None:
        """Call `callback` once, when everything sent to this peer has been handed to the network. The last
        callback given counts; none is called once the connection is lost."""


@runtime_checkable
class FlowControlled(Protocol):
    """An endpoint that is given the flow control of its connection, before its first message."""

    def set_flow_control(self, flow_control: FlowControl) -> None:
        """Keep `flow_control` for the life of the connection."""


class DriverCallbacks(Protocol):
    """What a driver calls for one peer; a connection, or the client's handshake before it."""

    def receive(self, data: bytes) -> None:
        """Bytes arrived."""

    def get_buffer(self) -> memoryview | None:
        """Where the next bytes may be received directly, or None."""

    def buffer_updated(self, count: int) -> None:
        """`count` bytes were received into the buffer that :meth:`get_buffer` gave."""

    def take(self) -> Buffer | None:
        """The next bytes to write, None when there are none for now."""

    def progress(self) -> None:
        """The network took bytes again after it had refused some: the peer is alive."""

    def eof(self) -> None:
        """The peer will send nothing more."""

    def lost(self) -> None:
        """The link is gone, for whatever reason. Called once, last."""


@runtime_checkable
class Gathering(Protocol):
    """Callbacks that can give several pieces for one call of the system, and take back what it left."""

    def take_pieces(self) -> Sequence[Buffer]:
        """The next pieces to write, empty when there are none for now."""

    def put_back(self, pieces: Sequence[Buffer]) -> None:
        """The network has not taken these, the last of the pieces that were taken: they go first next."""


Attach = Callable[[Link, str, int], object]
"""Called by a driver for each new peer: its link, its address (or "") and its port (or 0). Calls
:meth:`Link.set_callbacks` before it returns."""


@dataclass(frozen=True, slots=True)
class BindAddress:
    """Where a driver listens.

    Attributes:
        host: name or address, for TCP.
        port: 0 to let the system choose.
        path: of a Unix socket; the host is then empty.
        tls: encrypts the connections.
        shared: whether other processes of this user listen on the same TCP port.
        handshake_seconds: how long a handshake in TLS may take.
        addresses: counts each peer until its handshake in TLS has ended.
        is_held_back: whether nothing more of large messages is to be received for now, since many that came
            before wait to be read. Connections of one event loop for which it is the same share turns.
    """

    host: str = ""
    port: int = 0
    path: str = ""
    tls: SSLContext | None = None
    shared: bool = False
    handshake_seconds: float = 10.0
    addresses: AddressCount = field(default_factory=AddressCount)
    is_held_back: Callable[[], bool] = bool

    def __str__(self) -> str:
        return self.path or f"port {self.port} on {self.host}"


@dataclass(frozen=True, slots=True)
class RemoteAddress:
    """Where a driver connects to.

    Attributes:
        host: name or address, without brackets, for TCP.
        port: 1 to 65535.
        path: of a Unix socket, or the command of a program; the host is then empty.
        tls: encrypts the connection, and checks the other side.
        target: path and query of a request by HTTP, for drivers that make one.
        headers: of that request.
        limits: bounds of the connection, for drivers that keep some of them.
        seconds: that connecting may take.
        ice_servers: STUN and TURN servers, each as the W3C's ``RTCIceServer``, for drivers that ask some;
            None for those that the other side names.
        is_held_back: as of :class:`BindAddress`.
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
    """What connects by a path that is found, and not given by the address."""

    @property
    def path(self) -> str:
        """The path in words, once there is a connection."""


class Connector(Protocol):
    """Opens connections to other programs."""

    async def connect(self, address: RemoteAddress, attach: Attach, tasks: TaskGroup) -> None:
        """Reach the other side, attach it, and move its bytes, in `tasks` where that needs tasks. Raises
        OSError."""


class Driver(Protocol):
    """Moves bytes between an address and connections."""

    def serve(self, address: BindAddress, attach: Attach) -> AbstractAsyncContextManager[int]:
        """Accept peers within the block; gives the port in use. Raises
        :exc:`~rwt_transports.errors.ListenError`."""


class Listener(Protocol):
    """An open listener."""

    @property
    def url(self) -> str:
        """Where it listens, with the actual port."""

    @property
    def connections(self) -> int:
        """How many peers are connected, plain HTTP included."""

    async def ended(self) -> None:
        """Wait until there is nothing left to serve: the end of standard input for ``stdio:``, else for
        ever."""
