"""TCPROS connections: a header from each side, then frames."""

from __future__ import annotations

import socket
import time
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Final, TypeAlias

import anyio

from rwt.extensions.ros1.wire import rpc
from rwt.extensions.ros1.wire.sockets import READ_BYTES, Frame, Stream, connect
from rwt.extensions.ros1.wire.tcpros import MESSAGE_BYTES, Frames, decode_header, encode_header
from rwt_graph.errors import Ros1Error, WireError

if TYPE_CHECKING:
    from rwt.extensions.ros1.wire.sockets import Sockets

#: Seconds to connect, and seconds to wait for the peer's header.
CONNECT_SECONDS: Final = 5.0

#: Maximum bytes of incomplete frames of all connections.
_MOST_RECEIVED: Final = 256 * 1024 * 1024

OnLink: TypeAlias = "Callable[[Link], None]"
OnFrame: TypeAlias = "Callable[[Link, bytes | memoryview], None]"


class Link:
    """TCPROS connection.

    Attributes:
        header: fields that the peer sent; empty before.
        peer: address of the peer.
        on_header: called with the peer's header.
        on_frame: called with each frame after it.
        on_close: called once when the peer has closed the connection or has broken the rules.
        frames: splitter of the received bytes.
        ready: set when the header has arrived, or the connection is closed.
        closed: set when the connection is closed by either side.
        reason: why the peer's side has ended it.
    """

    def __init__(self, sockets: Sockets, sock: socket.socket, peer: str) -> None:
        self.header: dict[str, str] = {}
        self.peer = peer
        self.on_header: OnLink = _ignore
        self.on_frame: OnFrame = _ignore_frame
        self.on_close: OnLink = _ignore
        self.frames = Frames(buffers=sockets.buffers)
        self.ready = anyio.Event()
        self.closed = anyio.Event()
        self.reason = ""
        self._has_header = False
        self._sockets = sockets
        self._held = 0
        self._opened = time.monotonic()
        self.stream = Stream(sockets, sock, self._on_data, self._on_lost)

    @property
    def caller(self) -> str:
        """Name of the peer's node."""
        return self.header.get("callerid", "")

    def _on_data(self, data: bytes) -> None:
        for frame in self.frames.feed(data):
            self._on_frame(frame)
            if self.stream.closed:
                return
        self._note_held()

    def space(self) -> memoryview:
        return self.frames.space()

    def filled(self, count: int) -> None:
        frame = self.frames.filled(count)
        if frame is not None:
            self._on_frame(frame)
        if not self.stream.closed:
            self._note_held()

    def _on_frame(self, frame: bytes | memoryview) -> None:
        if self._has_header:
            self.on_frame(self, frame)
            return
        self._has_header = True
        self.header = decode_header(bytes(frame))
        self.frames.most = MESSAGE_BYTES
        self.on_header(self)
        self.ready.set()

    def _note_held(self) -> None:
        """Count the bytes of an incomplete frame."""
        frames = self.frames
        held = frames.memory
        if held != self._held:
            self._sockets.receiving += held - self._held
            self._held = held
            if held and self._sockets.receiving > _MOST_RECEIVED:
                raise WireError("too many large messages are being received")
        self.stream.large = self if frames.held + frames.missing >= READ_BYTES else None

    def send_header(self, fields: Mapping[str, str]) -> None:
        """Send this side's header."""
        self.stream.send(Frame((encode_header(fields),)))

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
        self.stream.finish()

    def _on_lost(self, reason: str) -> None:
        self.reason = reason
        self._release()
        self.on_close(self)

    def close(self) -> None:
        """Close the connection."""
        self._release()
        self.stream.close()

    def _release(self) -> None:
        self._sockets.receiving -= self._held
        self._held = 0
        self.frames.forget()
        self.ready.set()
        self.closed.set()


def _ignore(_link: Link) -> None:
    pass


def _ignore_frame(_link: Link, _frame: bytes | memoryview) -> None:
    pass


async def open_link(sockets: Sockets, host: str, port: int) -> Link:
    """Connect to another node.

    Raises:
        Ros1Error: the connection fails.
    """
    try:
        with anyio.fail_after(CONNECT_SECONDS):
            sock = await connect(host, port)
    except (OSError, TimeoutError) as error:
        why = f"no answer within {CONNECT_SECONDS:g} s" if isinstance(error, TimeoutError) else error
        raise Ros1Error(f"{host}:{port} cannot be reached: {why}") from error
    return Link(sockets, sock, host)


async def exchange_headers(link: Link, fields: Mapping[str, str]) -> dict[str, str]:
    """Send a header and return that of the peer; the link is closed on errors.

    Raises:
        Ros1Error: the peer refuses, or does not answer in time.
    """
    link.send_header(fields)
    try:
        with anyio.fail_after(CONNECT_SECONDS):
            await link.ready.wait()
        error = link.header.get("error") or link.reason
        if error:
            raise Ros1Error(f"{link.peer} refuses the connection: {error[:500]}")
    except TimeoutError:
        link.close()
        raise Ros1Error(f"{link.peer} does not answer within {CONNECT_SECONDS:g} s") from None
    except BaseException:
        link.close()
        raise
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
