"""A connection without a network: bytes go over at once, to a reader that may be slow or stop."""

from __future__ import annotations

from rwt_transports.api import Attach, DriverCallbacks


class MemoryPipe:
    """One connection, seen from the peer's side.

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
            pieces, _ = self.callbacks.take()
            self._taken += b"".join(pieces)

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
            pieces, _ = self.callbacks.take()
            if not pieces:
                break
            self._taken += b"".join(pieces)
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
        """No-op: the peer polls."""

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
