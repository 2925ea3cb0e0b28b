"""TCPROS connections: a header from each side, then frames."""

from __future__ import annotations

import os
import time
from collections.abc import AsyncIterator, Callable, Mapping
from contextlib import AbstractAsyncContextManager, asynccontextmanager
from functools import partial
from typing import TYPE_CHECKING, Final, Literal, TypeAlias

import anyio

from rwt.extensions.ros1.wire import rpc
from rwt.extensions.ros1.wire.network import Unreachable, listening
from rwt.extensions.ros1.wire.tcpros import MESSAGE_BYTES, TcprosWire, decode_header, encode_header, frame_of
from rwt_graph.errors import Ros1Error
from rwt_graph.names import is_printable
from rwt_protocol.frames import Buffer, Frame
from rwt_transports.api import RemoteAddress
from rwt_transports.background import background_tasks
from rwt_transports.connection import ListenerState
from rwt_transports.limits import Limits
from rwt_transports.schemes import stream_driver
from rwt_transports.websocket.close_codes import ABNORMAL

if TYPE_CHECKING:
    from rwt.extensions.ros1.wire.network import Network
    from rwt_transports.api import FlowControl
    from rwt_transports.endpoint import Accept, DropReason, Flow, PeerInfo, Sink, Traffic

#: Seconds to connect, and seconds to wait for the peer's header.
CONNECT_SECONDS: Final = 5.0

#: Reason of a connection that the peer has closed.
PEER_CLOSED: Final = "the other program has closed the connection"

#: Maximum bytes that wait for a slow reader, before the oldest messages are dropped. The readers of a topic
#: share them.
QUEUE_BYTES: Final = 16 * 1024 * 1024

#: Maximum connections of other programs to one node.
_MOST_LINKS: Final = 1000

_LIMITS: Final = Limits(
    connections=_MOST_LINKS, data_bytes=QUEUE_BYTES, message_bytes=MESSAGE_BYTES, outgoing_bytes=2**32
)

OnLink: TypeAlias = "Callable[[Link], None]"
OnFrame: TypeAlias = "Callable[[Link, bytes | memoryview], None]"


class Link:
    """TCPROS connection, as the endpoint of a transport.

    When the budget of a turn for handling frames is used up, the connection pauses until a later one.

    Attributes:
        header: fields that the peer sent; empty before.
        peer: address of the peer.
        on_header: called with the peer's header.
        on_frame: called with each frame after it.
        on_close: called once when the peer has closed the connection or has broken the rules.
        ready: set when the header has arrived, or the connection is closed.
        ended: set when the connection is closed by either side.
        reason: why the peer's side has ended it.
        is_success: status of the last frame, on connections to services.
    """

    holds_wire: Literal[True] = True

    def __init__(self, network: Network, sink: Sink, peer: str) -> None:
        self.header: dict[str, str] = {}
        self.peer = peer
        self.on_header: OnLink = _ignore
        self.on_frame: OnFrame = _ignore
        self.on_close: OnLink = _ignore
        self.ready = anyio.Event()
        self.ended = anyio.Event()
        self.reason = ""
        self.is_success = True
        self._scheduler = network.scheduler
        self._sink = sink
        self._flow_control: FlowControl | None = None
        self._has_header = False
        self._is_paused = False
        self._opened = time.monotonic()

    @property
    def caller(self) -> str:
        """Name of the peer's node; empty if it has none that can be listed."""
        name = self.header.get("callerid", "")
        return name if is_printable(name) else ""

    @property
    def traffic(self) -> Traffic:
        """Counts since the connection began."""
        return self._sink.traffic

    # What the connection calls

    def set_flow_control(self, flow_control: FlowControl) -> None:
        self._flow_control = flow_control

    def receive(self, data: bytes, binary: bool) -> None:
        """Handle a frame, of which `binary` is the status. Raises WireError if it breaks the rules."""
        scheduler = self._scheduler
        began = scheduler.monotonic()
        try:
            if self._has_header:
                self.is_success = binary
                self.on_frame(self, data)
            else:
                self._has_header = True
                self.header = decode_header(bytes(data))
                self.on_header(self)
                self.ready.set()
        finally:
            scheduler.note(scheduler.monotonic() - began)
        if scheduler.is_full and not self._is_paused and self._flow_control is not None:
            self._is_paused = True
            self._flow_control.pause()
            scheduler.wait(self._resume)

    def _resume(self) -> None:
        self._is_paused = False
        if self._flow_control is not None and not self.ended.is_set():
            self._flow_control.resume()

    def closed(self, code: int, reason: str) -> None:
        if not self.ended.is_set():
            self.reason = PEER_CLOSED if code == ABNORMAL else reason
            self._release()
            self.on_close(self)

    # What the graph calls

    def send(self, *parts: Buffer, status: bytes = b"") -> None:
        """Send a request, or a response with its status; they are never dropped."""
        self._sink.send(frame_of(parts, status))

    def send_header(self, fields: Mapping[str, str]) -> None:
        """Send this side's header."""
        self._sink.send(Frame(encode_header(fields)))

    def flow(self, topic: str, on_drop: Callable[[DropReason], None]) -> Flow:
        """Return the queue for the messages of a topic, of which the oldest are dropped."""
        return self._sink.flow(topic, on_drop=on_drop)

    def is_overdue(self) -> bool:
        """Return True if the peer has not sent its header in time."""
        return not self._has_header and time.monotonic() - self._opened > CONNECT_SECONDS

    def refuse(self, error: str) -> None:
        """Send an error in place of a header, and close the connection."""
        self.send_header({"error": error})
        self.finish()

    def finish(self) -> None:
        """Close the connection after what is queued."""
        self._release()
        if self._flow_control is not None:
            self._flow_control.when_empty(self._sink.close)

    def close(self) -> None:
        """Close the connection; no-op if it is closed."""
        self._release()
        self._sink.close()

    def _release(self) -> None:
        self.ready.set()
        self.ended.set()


def _ignore(*_: object) -> None:
    pass


def _state(network: Network, accept: Accept, *, has_status: bool = False) -> ListenerState:
    wire = partial(TcprosWire, network.in_batch, has_status)
    return ListenerState(accept, wire, _LIMITS, None, "tcpros", buffers=network.frames)


def serve(network: Network, host: str, accept: Callable[[Link], None]) -> AbstractAsyncContextManager[int]:
    """Accept the connections of other programs to one node within the block, which gets the port."""

    def make(sink: Sink, peer: PeerInfo) -> Link:
        link = Link(network, sink, peer.address)
        accept(link)
        return link

    state = _state(network, make)
    return listening(state, state.attach, host, 0)


@asynccontextmanager
async def connected(
    network: Network, host: str, port: int, *, has_status: bool = False
) -> AsyncIterator[Link]:
    """Connect to another node for the length of the block.

    Args:
        has_status: True for a service, whose responses have a status.

    Raises:
        Ros1Error: the connection fails.
    """
    links: list[Link] = []
    attached = anyio.Event()

    def make(sink: Sink, _peer: PeerInfo) -> Link:
        links.append(Link(network, sink, host))
        attached.set()
        return links[0]

    state = _state(network, make, has_status=has_status)
    address = RemoteAddress(host, port, is_held_back=state.buffers.has_much_unread)
    async with background_tasks() as tasks:
        try:
            with anyio.fail_after(CONNECT_SECONDS):
                await stream_driver().connect(address, state.attach, tasks)
                await attached.wait()
        except TimeoutError as error:
            raise Ros1Error(
                f"{host}:{port} cannot be reached: no answer within {CONNECT_SECONDS:g} s"
            ) from error
        except OSError as error:
            why = os.strerror(error.errno) if error.errno and error.errno > 0 else error
            kind = Unreachable if isinstance(error, ConnectionRefusedError) else Ros1Error
            raise kind(f"{host}:{port} cannot be reached: {why}") from error
        try:
            yield links[0]
        finally:
            links[0].close()
            for connection in tuple(state.connections):
                connection.abort()


async def exchange_headers(link: Link, fields: Mapping[str, str]) -> dict[str, str]:
    """Send a header and return that of the peer.

    Raises:
        Ros1Error: the peer refuses, or does not answer in time.
    """
    link.send_header(fields)
    try:
        with anyio.fail_after(CONNECT_SECONDS):
            await link.ready.wait()
    except TimeoutError:
        raise Ros1Error(f"{link.peer} does not answer within {CONNECT_SECONDS:g} s") from None
    error = link.header.get("error") or link.reason
    if error:
        raise Ros1Error(f"{link.peer} refuses the connection: {error[:500]}")
    return link.header


async def request_topic(uri: str, caller: str, topic: str) -> tuple[str, int]:
    """Ask a publisher for the address of its topic.

    Raises:
        Ros1Error: it cannot be reached, or offers no TCP.
    """
    match await rpc.call(uri, "requestTopic", caller, topic, [["TCPROS"]]):
        case ["TCPROS", str(host), int(port)]:
            return host, port
    raise Ros1Error(f"{uri} does not offer {topic} over TCP")
