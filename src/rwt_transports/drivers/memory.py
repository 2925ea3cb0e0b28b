"""Peers in the same process, for tests and for embedding: no sockets, no tasks, no clock; everything
happens at once.

:class:`MemoryPeer` meets an endpoint frame by frame, without any wire. :class:`MemoryDriver` moves bytes,
so that a wire can be driven like over a network, byte by byte where that is wanted, and with a reader that
stops.
"""

from __future__ import annotations

from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import AbstractAsyncContextManager, asynccontextmanager
from time import time_ns

from rwt_protocol.transport import (
    AS_MANY_AS_FIT,
    Accept,
    DropReason,
    Endpoint,
    Flow,
    FlowRules,
    Frame,
    PeerInfo,
    Traffic,
)
from rwt_transports.api import Attach, BindAddress, DriverCallbacks


class MemoryPeer:
    """The other side of an endpoint; frames arrive as the very objects that were sent.

    Args:
        accept: makes the endpoint, as for a listener.
        peer: what the endpoint is told about this peer.

    Attributes:
        received: frames in the order they were sent, with the flow of each in `topics`; None is the
            control lane.
        closed: code and reason once either side has closed, else None.
    """

    def __init__(self, accept: Accept, peer: PeerInfo | None = None) -> None:
        self.received: list[Frame] = []
        self.topics: list[str | None] = []
        self.closed: tuple[int, str] | None = None
        self.endpoint = accept(_PeerSink(self), peer or PeerInfo("memory"))

    def send(self, message: str | bytes) -> None:
        """Hand one message to the endpoint; `bytes` are a binary one."""
        if self.closed is None:
            binary = isinstance(message, bytes)
            self.endpoint.receive(message if isinstance(message, bytes) else message.encode(), binary)

    def take(self) -> list[bytes]:
        """The messages received since the last call."""
        taken = [frame.data for frame in self.received]
        self.received.clear()
        self.topics.clear()
        return taken

    def close(self, code: int = 1000, reason: str = "") -> None:
        """Close the connection, from either side; the endpoint is told once."""
        if self.closed is None:
            self.closed = (code, reason)
            self.endpoint.closed(code, reason)


class _PeerSink:
    """What the endpoint of a :class:`MemoryPeer` writes to."""

    __slots__ = ("_peer",)

    def __init__(self, peer: MemoryPeer) -> None:
        self._peer = peer

    def send(self, frame: Frame, topic: str | None = None) -> None:
        if self._peer.closed is None:
            self._peer.received.append(frame)
            self._peer.topics.append(topic)

    def flow(
        self,
        topic: str,
        rules: FlowRules = AS_MANY_AS_FIT,
        *,
        on_drop: Callable[[DropReason], None] | None = None,
        time_ns: Callable[[], int] = time_ns,
    ) -> Flow:
        return _PeerFlow(self, topic)

    def close(self, code: int = 1000, reason: str = "") -> None:
        self._peer.close(code, reason)

    def hand_over(self, endpoint: Endpoint) -> None:
        self._peer.endpoint = endpoint

    @property
    def backlog(self) -> int:
        return 0

    @property
    def traffic(self) -> Traffic:
        return Traffic()


class _PeerFlow:
    """One topic's way to a :class:`MemoryPeer`, which is never slow."""

    __slots__ = ("_sink", "_topic")

    def __init__(self, sink: _PeerSink, topic: str) -> None:
        self._sink = sink
        self._topic = topic

    def send(self, frame: Frame) -> None:
        self._sink.send(frame, self._topic)

    def send_message(self, pieces: Sequence[Frame], expires_ns: int = 0) -> None:
        for frame in pieces:
            self._sink.send(frame, self._topic)

    def configure(self, rules: FlowRules) -> None:
        """Rules are for slow readers."""

    def close(self) -> None:
        """There are no drops to report."""


class MemoryPipe:
    """One connection of a :class:`MemoryDriver`, seen from the peer's side.

    Attributes:
        stalled: True while the peer reads nothing, so that the other side's bytes pile up there.
        paused: True while the other side takes nothing; :meth:`send` hands over all the same.
        ended: True once the other side has said that nothing more comes, or has closed.
        closed: True once the connection is gone.
    """

    def __init__(self, attach: Attach, address: str, port: int) -> None:
        self.stalled = False
        self.paused = False
        self.ended = False
        self.closed = False
        self._closing = False
        self._taken = bytearray()
        self.callbacks: DriverCallbacks
        attach(_PipeLink(self), address, port)

    def send(self, data: bytes) -> None:
        """Bytes go to the other side."""
        view = memoryview(data)
        while view and not self.closed:
            space = self.callbacks.get_buffer()
            if space is None:
                self.callbacks.receive(bytes(view))
                break
            count = min(len(space), len(view))
            space[:count] = view[:count]
            space.release()
            self.callbacks.buffer_updated(count)
            view = view[count:]
        self.pump()

    def receive(self) -> bytes:
        """Everything that has come since the last call."""
        self.pump()
        taken = bytes(self._taken)
        self._taken.clear()
        return taken

    def take(self, most: int = 1) -> None:
        """Read `most` times, as a slow peer does."""
        for _ in range(most):
            data = self.callbacks.take()
            if data is not None:
                self._taken += data

    def send_eof(self) -> None:
        """Say that nothing more will come."""
        if not self.closed:
            self.callbacks.eof()
            self.pump()

    def cut(self) -> None:
        """Be gone without a word."""
        if not self.closed:
            self.closed = self.ended = True
            self.callbacks.lost()

    def pump(self) -> None:
        """Move what the other side has to send."""
        while not self.stalled and not self.closed:
            data = self.callbacks.take()
            if data is None:
                break
            self._taken += data
        if self._closing and not self.stalled:
            self.cut()

    def begin_closing(self) -> None:
        """The other side closes once its bytes have been taken."""
        self._closing = True


class _PipeLink:
    """The link of a :class:`MemoryPipe`; satisfies :class:`rwt_transports.api.Link`."""

    __slots__ = ("_pipe",)

    def __init__(self, pipe: MemoryPipe) -> None:
        self._pipe = pipe

    def set_callbacks(self, callbacks: DriverCallbacks) -> None:
        self._pipe.callbacks = callbacks

    def wake(self) -> None:
        """Nothing to do: the peer looks when it wants to."""

    def finish(self) -> None:
        self._pipe.ended = True

    def close(self) -> None:
        self._pipe.begin_closing()

    def abort(self) -> None:
        self._pipe.cut()

    def pause(self) -> None:
        self._pipe.paused = True

    def resume(self) -> None:
        self._pipe.paused = False


class MemoryDriver:
    """Serves peers of the same process; satisfies :class:`rwt_transports.api.Driver`."""

    def __init__(self) -> None:
        self._attach: Attach | None = None

    def serve(self, address: BindAddress, attach: Attach) -> AbstractAsyncContextManager[int]:
        """Accept :meth:`connect` within the block; gives the port asked for."""
        return self._serve(address.port, attach)

    @asynccontextmanager
    async def _serve(self, port: int, attach: Attach) -> AsyncIterator[int]:
        self._attach = attach
        try:
            yield port
        finally:
            self._attach = None

    def connect(self, address: str = "memory", port: int = 0) -> MemoryPipe:
        """A new peer. Raises ConnectionRefusedError when nobody serves."""
        if self._attach is None:
            raise ConnectionRefusedError("nobody serves this driver")
        return MemoryPipe(self._attach, address, port)
