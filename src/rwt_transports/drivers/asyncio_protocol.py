"""asyncio's own sockets, the fast driver: bytes come by callback, and what a loop turn produced is written
at once."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import os
import socket
import traceback
from collections import deque
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import AbstractAsyncContextManager, ExitStack, asynccontextmanager, nullcontext
from functools import partial
from time import monotonic
from typing import Final, cast
from weakref import WeakValueDictionary

import anyio
from anyio.abc import TaskGroup

from rwt_protocol.frames import Buffer
from rwt_transports.api import (
    Attach,
    BindAddress,
    DriverCallbacks,
    Gathering,
    HangUp,
    Link,
    RemoteAddress,
)
from rwt_transports.drivers.sockets import (
    HELD_BACK_SECONDS,
    READ_SECONDS,
    UNSENT_BYTES,
    Handshakes,
    accept_peers,
    bind_tcp,
    bind_unix,
    hang_up_of,
    remove_unix,
)
from rwt_transports.drivers.task_link import NO_CALLBACKS
from rwt_transports.drivers.tls_buffers import ENCRYPTED_BYTES, forget_protocol, spare_buffers
from rwt_transports.errors import log_exception

logger = logging.getLogger("rwt_transports")

READ_BYTES = 64 * 1024
"""Bytes read at once; enough for hundreds of small messages, and little to copy when a large one begins."""
BACKLOG = 512
GATHERED_BYTES = 64 * 1024
"""Less than this goes through asyncio's transport: what one call more or less costs is then little."""

ENCRYPTING_SECONDS = 0.002
"""Of one turn, for one connection; what is begun by then is ended."""

WRITE_SECONDS = 0.01
"""Of one turn, for all connections together: those that it does not reach write in the next one."""

WATCHED_BYTES = 4096
"""Of what the network does not take, asyncio's transport keeps a copy of this much."""

SEGMENT_BYTES = 64 * 1024
"""As far as this the kernel goes beyond a bound, since it takes whole segments."""


class _Turn:
    """One loop turn after the other: the links that have something to write, flushed together, and how much
    of large messages was received.

    To receive ten million bytes, and to unmask them when the last has come, takes milliseconds. Where many
    connections do so at once, those beyond the turn's share are handed what has come for them in a later one.

    Args:
        loop: whose turns they are.
        is_held_back: whether nothing more of large messages is to be handed on for now.

    Attributes:
        is_full: whether this turn has received as much of large messages as one may.
        buffer: where small messages are received.
    """

    __slots__ = (
        "__weakref__",
        "_is_counting",
        "_late",
        "_received",
        "_waiting",
        "buffer",
        "is_full",
        "is_held_back",
        "loop",
    )

    def __init__(self, loop: asyncio.AbstractEventLoop, is_held_back: Callable[[], bool] = bool) -> None:
        self.loop = loop
        self.is_held_back = is_held_back
        self.buffer = bytearray(READ_BYTES)
        self._waiting: list[_Link] = []
        self._late: deque[_Link] = deque()
        self._received = 0.0  # seconds
        self._is_counting = False
        self.is_full = False

    def note(self, seconds: float) -> None:
        """Count time for which a large message was received."""
        self._received += seconds
        self.is_full = self._received > READ_SECONDS or bool(self._late)
        if not self._is_counting:
            self._is_counting = True
            self.loop.call_soon(self._next)

    def put_off(self, link: _Link) -> None:
        """Let `link` take what it has received in a later turn, behind those that wait already."""
        self._late.append(link)
        self.note(0.0)

    def _next(self) -> None:
        """A new turn has begun."""
        self._is_counting = self.is_full = False
        self._received = 0.0
        while self._late and self._received <= READ_SECONDS and not self.is_held_back():
            self._late.popleft().take_late()
        if self._late and self.is_held_back():
            self._is_counting = self.is_full = True
            self.loop.call_later(HELD_BACK_SECONDS, self._next)
        elif self._late:
            self.note(0.0)

    def add(self, link: _Link) -> None:
        if not self._waiting:
            self.loop.call_soon(self._flush)
        self._waiting.append(link)

    def _flush(self) -> None:
        waiting, self._waiting = self._waiting, []
        over = monotonic() + WRITE_SECONDS
        for at, link in enumerate(waiting, 1):
            if at > 1 and monotonic() > over:
                for late in waiting[at - 1 :]:
                    self.add(late)
                return
            try:
                link.flush()
            except Exception:
                # One failure must not keep the others of this turn waiting.
                log_exception("writing to a connection failed; cutting it")
                link.abort()


_turns: Final[WeakValueDictionary[tuple[asyncio.AbstractEventLoop, Callable[[], bool]], _Turn]] = (
    WeakValueDictionary()
)
"""Those of each event loop."""


def _turn_of(is_held_back: Callable[[], bool]) -> _Turn:
    """What all connections of this event loop share that are held back together, of however many
    listeners."""
    loop = asyncio.get_running_loop()
    return _turns.setdefault((loop, is_held_back), _Turn(loop, is_held_back))


class _Link(asyncio.BufferedProtocol):
    """One socket; satisfies :class:`rwt_transports.api.Link`."""

    __slots__ = (
        "_attach",
        "_bounded",
        "_callbacks",
        "_direct",
        "_file",
        "_gathering",
        "_is_ended",
        "_is_paused",
        "_late",
        "_loop",
        "_open",
        "_resuming",
        "_since",
        "_socket",
        "_tls",
        "_transport",
        "_turn",
        "_view",
        "_writable",
        "wake",
    )

    def __init__(self, attach: Attach, turn: _Turn) -> None:
        self._attach = attach
        self._view = memoryview(turn.buffer)
        self._callbacks: DriverCallbacks = NO_CALLBACKS  # until it is attached
        self._direct = False
        self._open = False
        self._writable = True
        self._resuming = False
        self._file = -1  # of the socket, where bytes may go to it past the transport
        self._socket = -1  # the same, whatever speaks over it
        self._bounded: socket.socket | None = None  # where the kernel takes no more than UNSENT_BYTES
        self._gathering: Gathering | None = None
        self._is_paused = False
        self._late = 0  # bytes that were received, and have to wait for a turn
        self._is_ended = False  # the peer has said so, behind those bytes
        self._since = 0.0  # when it began to receive
        self._turn = turn
        self._loop = turn.loop
        self.wake: Callable[[], None] = _nothing

    # -- asyncio's callbacks -------------------------------------------------------------------------------

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """A peer has connected."""
        # A cast, since the transports of other event loops (uvloop) are no subclass of asyncio's.
        transport = cast("asyncio.Transport", transport)
        # Paused as soon as the network takes less than all; TLS would pause for good at 0.
        transport.set_write_buffer_limits(high=1, low=0)
        self._transport = transport
        self.wake = partial(self._turn.add, self)  # Not before: one that is never made would be a cycle.
        self._tls = transport.get_extra_info("sslcontext") is not None
        self._open = True
        if self._tls:
            spare_buffers(transport)
        self._socket = transport.get_extra_info("socket").fileno()
        if not self._tls and isinstance(self._loop, asyncio.SelectorEventLoop) and hasattr(os, "writev"):
            self._file = self._socket
            self._bounded = _bounded(transport.get_extra_info("socket"))
        name = transport.get_extra_info("peername")
        address, port = (str(name[0]), int(name[1])) if isinstance(name, tuple) else ("", 0)
        self._attach(self, address, port)

    def get_buffer(self, sizehint: int) -> memoryview:
        """Where the next bytes go: into a large message, or into the buffer that all connections share."""
        space = self._callbacks.get_buffer()
        if space is None:
            self._direct = False
            return self._view
        self._direct = True
        self._since = monotonic()
        return space[:READ_BYTES] if self._turn.is_full else space

    def buffer_updated(self, nbytes: int) -> None:
        """`nbytes` have arrived in the buffer that :meth:`get_buffer` gave."""
        if not self._direct:
            self._callbacks.receive(bytes(self._view[:nbytes]))
            if nbytes == READ_BYTES and self._file >= 0:
                self._read_on()
        elif self._turn.is_full or self._turn.is_held_back():
            self._late = nbytes
            self._transport.pause_reading()
            self._turn.put_off(self)
        else:
            self._callbacks.buffer_updated(nbytes)
            self._turn.note(monotonic() - self._since)

    def _read_on(self) -> None:
        """Receive more of a large message that has begun, without another look at all sockets."""
        if self._is_paused or self._transport.is_closing() or self._turn.is_full:
            return
        if self._turn.is_held_back():
            return
        space = self._callbacks.get_buffer()
        if space is None:
            return
        began = monotonic()
        try:
            nbytes = os.readv(self._file, (space,))
        except OSError:
            return  # There is nothing yet, or the transport will see what is wrong.
        if nbytes:  # Else the peer has ended, which the transport will see.
            self._callbacks.buffer_updated(nbytes)
            self._turn.note(monotonic() - began)

    def take_late(self) -> None:
        """Take what was received in a turn that was full already."""
        nbytes, self._late = self._late, 0
        if not nbytes:
            return
        self._since = monotonic()
        try:
            self._callbacks.buffer_updated(nbytes)
        finally:
            self._turn.note(monotonic() - self._since)
            if not self._is_paused:
                self.resume()

    def eof_received(self) -> bool:
        """The peer will send nothing more; the connection decides whether to close, except in TLS."""
        if self._late or self._is_paused:  # In TLS the end comes together with the last bytes.
            self._is_ended = True
        else:
            self._callbacks.eof()
        return not self._tls

    def connection_lost(self, exc: Exception | None) -> None:
        """The socket is gone."""
        self._open = False
        if not self._is_ended:
            self._late = 0
            self._lose()

    def _end(self) -> None:
        """Say that the peer has ended, which had to wait for what it sent before."""
        if self._is_ended and not (self._late or self._is_paused):
            self._is_ended = False
            self._callbacks.eof()
            if not self._open:
                self._lose()

    def _lose(self) -> None:
        """Say that the connection is over, and refer to nothing that refers to this link: cycles would stay
        until a full collection of garbage."""
        callbacks, self._callbacks, self._gathering = self._callbacks, NO_CALLBACKS, None
        self.wake = _nothing
        if self._tls:
            forget_protocol(self._transport)
        callbacks.lost()

    def pause_writing(self) -> None:
        """The network takes no more for now."""
        self._writable = False

    def resume_writing(self) -> None:
        """The network has taken everything."""
        self._writable = True
        self._resuming = True
        try:
            self._callbacks.progress()
            if self._tls:
                self.wake()  # To encrypt takes time, of which many connections at once have a share each.
            else:
                self.flush()
        finally:
            self._resuming = False

    # -- Link ----------------------------------------------------------------------------------------------

    def set_callbacks(self, callbacks: DriverCallbacks) -> None:
        """Call `callbacks` from now on."""
        self._callbacks = callbacks
        self._gathering = callbacks if self._file >= 0 and isinstance(callbacks, Gathering) else None

    def flush(self) -> None:
        """Write what there is, as far as the network takes it."""
        gathering, transport = self._gathering, self._transport
        if gathering is None:
            self._flush_one_by_one()
            return
        # Small data goes through the transport, and large data by one `writev`: `transport.writelines` copies
        # the pieces before Python 3.12, and always copies what the socket does not accept.
        write, more = transport.write, True
        while more and self._writable and self._open:
            pieces, more = gathering.take_pieces()
            size = len(pieces[0]) if len(pieces) == 1 else sum(map(len, pieces))
            if (
                size >= GATHERED_BYTES
                and not transport.get_write_buffer_size()
                and not transport.is_closing()
            ):
                left = self._gathered(pieces, size)
                if left:
                    # The transport watches the socket: it reports when it is writable again, or fails.
                    first = memoryview(left[0])
                    gathering.put_back((first[WATCHED_BYTES:], *left[1:]))
                    write(first[:WATCHED_BYTES])
                    more = True
            else:
                for piece in pieces:
                    write(piece)

    def _flush_one_by_one(self) -> None:
        """Write through the transport, which encrypts, or past which nothing can be written."""
        if self._tls and isinstance(self._callbacks, Gathering):
            self._flush_encrypted(self._callbacks)
            return
        take = self._callbacks.take
        write = self._transport.write
        while self._writable and self._open:
            data = take()
            if data is None:
                return
            write(data)

    def _takes_more(self) -> bool:
        """Whether the network does."""
        return self._writable and self._open

    def _flush_encrypted(self, gathering: Gathering) -> None:
        """Write a little at a time: what is encrypted waits in a buffer that never shrinks again."""
        write, over = self._transport.write, monotonic() + ENCRYPTING_SECONDS
        more = True
        while more and self._takes_more():
            pieces, more = gathering.take_pieces()
            for at, piece in enumerate(pieces):
                view = memoryview(piece)
                for start in range(0, len(view), ENCRYPTED_BYTES):
                    if not self._takes_more():
                        gathering.put_back((view[start:], *pieces[at + 1 :]))
                        return
                    write(view[start : start + ENCRYPTED_BYTES])
            if monotonic() > over:
                self.wake()
                return

    def _gathered(self, pieces: Sequence[Buffer], size: int) -> Sequence[Buffer]:
        """Write pieces by one call, past the transport, in which nothing waits; returns what is left."""
        try:
            sent = os.writev(self._file, pieces)
        except OSError:
            return pieces
        if sent == size:
            return ()
        left = _without(pieces, sent)
        return left if self._bounded is None else self._gathered_beyond(self._bounded, left, size - sent)

    def _gathered_beyond(
        self, bounded: socket.socket, pieces: Sequence[Buffer], size: int
    ) -> Sequence[Buffer]:
        """Write the rest of pieces of which the kernel has as much unsent as it may; returns what is left.

        The rest of a message that has begun to go out stands in front of the newest sample wherever it is
        kept. Kept here, it goes on only when this process has a turn for it, and the peer, which is done with
        the first part, waits for that; so does who sends no more before the peer has it.
        """
        room = UNSENT_BYTES + SEGMENT_BYTES + size
        try:
            bounded.setsockopt(socket.IPPROTO_TCP, socket.TCP_NOTSENT_LOWAT, room)
            sent = os.writev(self._file, pieces)
        except OSError:
            return pieces
        finally:
            with contextlib.suppress(OSError):  # The connection may be gone.
                bounded.setsockopt(socket.IPPROTO_TCP, socket.TCP_NOTSENT_LOWAT, UNSENT_BYTES)
        return _without(pieces, sent) if sent < size else ()

    def finish(self) -> None:
        """Half-close, or close where TLS has no such thing."""
        if self._transport.can_write_eof() and not self._transport.is_closing():
            try:
                self._transport.write_eof()
            except OSError:
                self.abort()  # The peer has gone, and nobody has looked since.
        else:
            self.close()

    def close(self) -> None:
        """Close after what was written has gone out."""
        self._close(self._transport.close)

    def abort(self) -> None:
        """Close at once."""
        self._close(self._transport.abort)

    def _close(self, how: Callable[[], None]) -> None:
        if self._resuming:
            # A transport that is closed while it says that it can be written to is closed twice.
            self._loop.call_soon(how)
        else:
            how()

    def pause(self) -> None:
        """Read nothing for now."""
        self._is_paused = True
        self._transport.pause_reading()

    def resume(self) -> None:
        """Read from the peer again."""
        self._is_paused = False
        if self._is_ended:
            self._loop.call_soon(self._end)  # Whoever resumes has more to hand on first.
        elif self._open and not self._late:
            self._transport.resume_reading()

    def hang_up(self) -> HangUp:
        """Whether the peer has hung up, which nobody sees while nothing is read from it."""
        return hang_up_of(self._socket) if self._open else HangUp.GONE


def _nothing() -> None:
    """There is nothing to write any more."""


def _bounded(sock: socket.socket) -> socket.socket | None:
    """The socket, if :mod:`rwt_transports.drivers.sockets` has bounded what the kernel holds of it unsent."""
    try:
        unsent = sock.getsockopt(socket.IPPROTO_TCP, socket.TCP_NOTSENT_LOWAT)
    except (OSError, AttributeError):  # A Unix socket, or a system without such a bound.
        return None
    return sock if unsent == UNSENT_BYTES else None


def _without(pieces: Sequence[Buffer], size: int) -> Sequence[Buffer]:
    """The pieces without so many bytes in front, which are less than all."""
    left = list(pieces)
    while size >= len(left[0]):
        size -= len(left.pop(0))
    left[0] = memoryview(left[0])[size:]
    return left


class AsyncioDriver:
    """TCP and Unix sockets, plain or in TLS, on the running asyncio loop; satisfies
    :class:`rwt_transports.api.Driver` and :class:`rwt_transports.api.Connector`."""

    async def connect(self, address: RemoteAddress, attach: Attach, tasks: TaskGroup) -> None:
        """Reach the other side; its bytes come by callbacks of the loop, without a task."""
        loop = asyncio.get_running_loop()
        make_link = partial(_Link, attach, _turn_of(address.is_held_back))
        if address.path:
            await loop.create_unix_connection(make_link, address.path, ssl=address.tls)
        else:
            await loop.create_connection(make_link, address.host, address.port, ssl=address.tls)

    def serve(self, address: BindAddress, attach: Attach) -> AbstractAsyncContextManager[int]:
        """Accept peers within the block; gives the port in use, 0 for a Unix socket."""
        return self._serve(address, attach)

    @asynccontextmanager
    async def _serve(self, address: BindAddress, attach: Attach) -> AsyncIterator[int]:
        loop = asyncio.get_running_loop()
        sockets = (
            [bind_unix(address.path)]
            if address.path
            else await bind_tcp(address.host, address.port, shared=address.shared)
        )
        turn = _turn_of(address.is_held_back)
        port = 0 if address.path else int(sockets[0].getsockname()[1])
        patience = address.handshake_seconds if address.tls else None
        addresses, handshakes = address.addresses, Handshakes()

        async def open_link(accepted: tuple[socket.socket, tuple[object, ...]]) -> None:
            with ExitStack() as counted:
                if address.tls is not None:
                    host = str(accepted[1][0])
                    addresses.enter(host)
                    counted.callback(addresses.leave, host)
                    if addresses.is_flooding(host):
                        accepted[0].close()
                        return

                def attach_counted(link: Link, host: str, port: int) -> None:
                    counted.close()  # From here on the connection counts itself.
                    attach(link, host, port)

                make_link = partial(_Link, attach_counted, turn)
                try:
                    with handshakes.one() if address.tls is not None else nullcontext():
                        await loop.connect_accepted_socket(
                            make_link, accepted[0], ssl=address.tls, ssl_handshake_timeout=patience
                        )
                except OSError as error:
                    logger.info("a connection did not come about: %s", error)
                    # Its frames refer to it, and to what a handshake in TLS takes: a cycle that would stay.
                    traceback.clear_frames(error.__traceback__)
                except Exception:
                    log_exception("a connection failed as it came")

        try:
            async with anyio.create_task_group() as tasks:
                for each in sockets:
                    each.listen(BACKLOG)
                    tasks.start_soon(
                        accept_peers,
                        partial(loop.sock_accept, each),
                        lambda accepted: tasks.start_soon(open_link, accepted),
                    )
                yield port
                tasks.cancel_scope.cancel()
        finally:
            for each in sockets:
                with contextlib.suppress(ValueError, NotImplementedError):
                    loop.remove_reader(each)  # A cancelled sock_accept may leave it.
                each.close()
            if address.path:
                remove_unix(address.path)
