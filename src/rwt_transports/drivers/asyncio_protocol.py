"""Driver for asyncio: bytes arrive by callback, and the output of one event loop turn is written together."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import os
import socket
import traceback
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import ExitStack, asynccontextmanager, nullcontext
from functools import partial
from time import monotonic
from typing import Final, cast
from weakref import WeakValueDictionary

import anyio
from anyio.abc import TaskGroup

from rwt_protocol.frames import Buffer
from rwt_protocol.states import StateEnum
from rwt_transports.api import (
    NO_CALLBACKS,
    Attach,
    BindAddress,
    Delivery,
    DriverCallbacks,
    HangUp,
    Link,
    RemoteAddress,
)
from rwt_transports.background import background_tasks, ignore
from rwt_transports.drivers.asyncio_cycles import cut_cycles
from rwt_transports.drivers.sockets import (
    UNSENT_BYTES,
    Handshakes,
    accept_peers,
    bind,
    cause_of,
    delivery_of,
    detect_lost_peers,
    hang_up_of,
    remove_unix,
)
from rwt_transports.drivers.tls_buffers import ENCRYPTED_BYTES, forget_protocol, spare_buffers
from rwt_transports.errors import log_exception
from rwt_transports.outbox import TAKE_BYTES
from rwt_transports.scheduler import READING, WRITING, Scheduler

logger = logging.getLogger("rwt_transports")

READ_BYTES = 64 * 1024
"""Maximum size of one read: holds hundreds of small messages, and is cheap to copy when a large message
begins."""
BACKLOG = 512
GATHER_BYTES = 1024 * 1024
"""Bytes of large messages in one `writev`."""
GATHERED_BYTES = 64 * 1024
"""Minimum size for `writev`, bypassing asyncio's transport; for smaller data the gain is negligible."""

WATCHED_BYTES = 4096
"""Bytes of an incomplete write that go to asyncio's transport, which copies them and watches the socket."""

SEGMENT_BYTES = 64 * 1024
"""Bytes by which the kernel may exceed its limit of unsent bytes: it accepts whole segments."""


class _LoopShare:
    """Resources that the links of one event loop share.

    Receiving and unmasking ten megabytes takes milliseconds. When many connections do so at once, those
    beyond the budget deliver their bytes in a later turn.

    Attributes:
        buffer: receive buffer for small messages.
        reading: scheduler of the receiving of large messages.
        writing: scheduler of the flushing of links.
    """

    __slots__ = ("__weakref__", "buffer", "loop", "reading", "writing")

    def __init__(self, is_held_back: Callable[[], bool] = bool) -> None:
        self.loop = asyncio.get_running_loop()
        self.buffer = bytearray(READ_BYTES)
        self.reading = Scheduler.of_loop(READING, is_held_back)
        self.writing = Scheduler.of_loop(WRITING)


_shares: Final[WeakValueDictionary[tuple[asyncio.AbstractEventLoop, Callable[[], bool]], _LoopShare]] = (
    WeakValueDictionary()
)
"""Shares by event loop and hold-back function; an entry ends with its last user."""


def _share_of(is_held_back: Callable[[], bool]) -> _LoopShare:
    return _shares.setdefault((asyncio.get_running_loop(), is_held_back), _LoopShare(is_held_back))


class _LinkState(StateEnum):
    NEW = "OPEN"
    OPEN = "ENDING", "LOST"
    ENDING = "OPEN", "CUT"
    CUT = "LOST"
    LOST = ()


class _SocketLink(asyncio.BufferedProtocol):
    """Socket of one peer; implements :class:`rwt_transports.api.Link`.

    Life cycle::

        NEW ── connection_made ──> OPEN ── connection_lost ──> LOST
                                   ^  │                          ^
                     end reported  │  │ eof_received             │ end reported
                                   │  v                          │
                                  ENDING ── connection_lost ──> CUT

    * **NEW**: no transport; callbacks are `NO_CALLBACKS`.
    * **OPEN**: attached to a connection. Independently of each other, the connection may pause reading
      (``_is_paused``), received bytes may wait for a turn (``_late`` > 0, the transport is paused), and the
      socket may accept no more bytes (not ``_writable``).
    * **ENDING**: the end of stream arrived while reading was paused or bytes waited. It is reported behind
      them.
    * **CUT**: as ENDING, and the socket is lost meanwhile, which is reported after the end.
    * **LOST**: callbacks are `NO_CALLBACKS` again; ``wake`` does nothing.

    Attributes by purpose:

    * Wiring: ``_attach``, ``_callbacks``, ``_share``, ``wake`` (schedules :meth:`flush`).
    * Socket: ``_transport``, ``_tls`` (True under TLS), ``_socket`` (file descriptor), ``_file`` (the
      descriptor if reads and writes may bypass the transport, else -1), ``_bounded`` (the socket if the
      kernel bounds its unsent bytes).
    * Reading: ``_view`` (shared buffer), ``_direct`` (True if the buffer in use belongs to a large message),
      ``_since`` (monotonic time at which the read began), ``_late``, ``_is_paused``.
    * Writing: ``_writable``, ``_resuming`` (True inside :meth:`resume_writing`).
    """

    __slots__ = (
        "_attach", "_bounded", "_callbacks", "_direct", "_file", "_is_paused", "_late",
        "_resuming", "_share", "_since", "_socket", "_state", "_tls", "_transport", "_view", "_writable",
        "wake",
    )  # fmt: skip

    def __init__(self, attach: Attach, share: _LoopShare) -> None:
        self._state = _LinkState.NEW
        self._attach = attach
        self._callbacks: DriverCallbacks = NO_CALLBACKS
        self._share = share
        self.wake: Callable[[], None] = ignore
        self._socket = self._file = -1
        self._bounded: socket.socket | None = None
        self._view = memoryview(share.buffer)
        self._direct = False
        self._since = 0.0
        self._late = 0
        self._is_paused = False
        self._writable = False
        self._resuming = False

    # -- asyncio's callbacks -------------------------------------------------------------------------------

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        # cast(): uvloop's transports do not subclass asyncio's.
        transport = cast("asyncio.Transport", transport)
        # Pause writing as soon as one byte is left over. With high=0, TLS would pause for good.
        transport.set_write_buffer_limits(high=1, low=0)
        self._transport = transport
        # Only here: on a link that never connects, it would be a reference cycle.
        self.wake = partial(self._share.writing.wait, self.flush)
        self._tls = transport.get_extra_info("sslcontext") is not None
        self._state = self._state.become(_LinkState.OPEN)
        self._writable = True
        if self._tls:
            spare_buffers(transport)
        self._socket = transport.get_extra_info("socket").fileno()
        loop = self._share.loop
        if not self._tls and isinstance(loop, asyncio.SelectorEventLoop) and hasattr(os, "writev"):
            self._file = self._socket
            self._bounded = _bounded(transport.get_extra_info("socket"))
        name = transport.get_extra_info("peername")
        address, port = (str(name[0]), int(name[1])) if isinstance(name, tuple) else ("", 0)
        self._attach(self, address, port)

    def get_buffer(self, sizehint: int) -> memoryview:
        space = self._callbacks.get_buffer()
        if space is None:
            self._direct = False
            return self._view
        self._direct = True
        self._since = monotonic()
        # A full turn bounds what may wait as late bytes: one short read for each connection.
        return space[:READ_BYTES] if self._share.reading.must_wait else space

    def buffer_updated(self, nbytes: int) -> None:
        """Deliver `nbytes` received into the buffer from :meth:`get_buffer`, or queue for a later turn."""
        if not self._direct:
            self._callbacks.receive(bytes(self._view[:nbytes]))
            # A full buffer most likely ends within a large message, whose rest has arrived as well.
            if nbytes == READ_BYTES and self._file >= 0:
                self._read_on()
        elif self._share.reading.must_wait:
            self._late = nbytes
            self._transport.pause_reading()
            self._share.reading.wait(self._take_late)
        else:
            self._callbacks.buffer_updated(nbytes)
            self._share.reading.note(monotonic() - self._since)

    def _read_on(self) -> None:
        """Read more of the current large message without waiting for the event loop's next poll."""
        if self._is_paused or self._transport.is_closing() or self._share.reading.must_wait:
            return
        space = self._callbacks.get_buffer()
        if space is None:
            return
        began = monotonic()
        try:
            nbytes = os.readv(self._file, (space,))
        except OSError:
            return  # No data yet, or an error that the transport will report.
        if nbytes:  # 0 means end of stream, which the transport will report.
            self._callbacks.buffer_updated(nbytes)
            self._share.reading.note(monotonic() - began)

    def _take_late(self) -> None:
        # 0 if the connection was lost meanwhile.
        nbytes, self._late = self._late, 0
        if not nbytes:
            return
        self._since = monotonic()
        try:
            self._callbacks.buffer_updated(nbytes)
        finally:
            self._share.reading.note(monotonic() - self._since)
            if not self._is_paused:
                self.resume()

    def eof_received(self) -> bool:
        """Report the end of stream, after pending bytes. Returns True (keep open), except under TLS."""
        if self._late or self._is_paused:  # Under TLS the end can arrive together with the last bytes.
            self._state = self._state.become(_LinkState.ENDING)
        else:
            self._callbacks.eof()
        return not self._tls

    def connection_lost(self, exc: Exception | None) -> None:
        self._writable = False
        if self._state is _LinkState.ENDING:
            self._state = self._state.become(_LinkState.CUT)
        else:
            self._late = 0
            self._lose()

    def _end(self) -> None:
        if self._late or self._is_paused:
            return
        if self._state is _LinkState.ENDING:
            self._state = self._state.become(_LinkState.OPEN)
            self._callbacks.eof()
        elif self._state is _LinkState.CUT:
            self._callbacks.eof()
            self._lose()

    def _lose(self) -> None:
        """Report the loss and drop all references: a cycle would live until a full garbage collection."""
        self._state = self._state.become(_LinkState.LOST)
        callbacks, self._callbacks = self._callbacks, NO_CALLBACKS
        self.wake = ignore
        if self._tls:
            forget_protocol(self._transport)
        callbacks.lost()

    def pause_writing(self) -> None:
        self._writable = False

    def resume_writing(self) -> None:
        self._writable = True
        self._resuming = True  # Defers a close, see :meth:`_close`.
        try:
            self._callbacks.progress()
            if self._tls:
                self.wake()  # Encryption takes time: flush within the turn's budget, not here.
            else:
                self.flush()
        finally:
            self._resuming = False

    # -- Link ----------------------------------------------------------------------------------------------

    def set_callbacks(self, callbacks: DriverCallbacks) -> None:
        self._callbacks = callbacks

    def flush(self) -> None:
        """Write pending data until the socket accepts no more; close the link if that fails."""
        try:
            # Only asyncio's own transport without TLS lets others write to its socket.
            if self._file >= 0:
                self._flush_gathered()
            else:
                self._flush_in_chunks(ENCRYPTED_BYTES if self._tls else TAKE_BYTES)
        except Exception:
            log_exception("writing to a connection failed; cutting it")
            self.abort()

    def _flush_gathered(self) -> None:
        """Write small data through the transport, and large data with one `writev`.

        `transport.writelines` copies the pieces before Python 3.12, and always copies what the socket does
        not accept.
        """
        transport, callbacks, more = self._transport, self._callbacks, True
        while more and self._writable:
            pieces, more = callbacks.take(GATHER_BYTES)
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
                    callbacks.put_back((first[WATCHED_BYTES:], *left[1:]))
                    transport.write(first[:WATCHED_BYTES])
                    more = True
            else:
                for piece in pieces:
                    transport.write(piece)

    def _flush_in_chunks(self, chunk_bytes: int) -> None:
        """Write in chunks, as long as the transport accepts more. Under TLS they are small: the buffer for
        encrypted bytes never shrinks.

        Beyond the share of `WRITING`, pieces that were taken are written, and the rest waits for the next
        turn.
        """
        write, over, more = self._transport.write, monotonic() + WRITING.share, True
        while more and self._writable:
            pieces, more = self._callbacks.take()
            for at, piece in enumerate(pieces):
                view = memoryview(piece)
                for start in range(0, len(view), chunk_bytes):
                    if not self._takes_more():
                        self._callbacks.put_back((view[start:], *pieces[at + 1 :]))
                        return
                    write(view[start : start + chunk_bytes])
            if more and monotonic() > over:
                self.wake()
                return

    def _takes_more(self) -> bool:
        return self._writable

    def _gathered(self, pieces: Sequence[Buffer], size: int) -> Sequence[Buffer]:
        """Write pieces with one `writev` and return the rest. The transport's buffer must be empty."""
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
        """Write the rest of a partly sent message past the kernel's bound, and return what is still left.

        Wherever the rest is buffered, it delays the newest sample. In the kernel it is sent at once. Here it
        would wait for a turn of this process, and the peer, and any sender that waits for the peer, would
        wait with it.
        """
        room = UNSENT_BYTES + SEGMENT_BYTES + size
        try:
            bounded.setsockopt(socket.IPPROTO_TCP, socket.TCP_NOTSENT_LOWAT, room)
            sent = os.writev(self._file, pieces)
        except OSError:
            return pieces
        finally:
            with contextlib.suppress(OSError):  # The connection may be lost.
                bounded.setsockopt(socket.IPPROTO_TCP, socket.TCP_NOTSENT_LOWAT, UNSENT_BYTES)
        return _without(pieces, sent) if sent < size else ()

    def finish(self) -> None:
        """Half-close the connection; close it under TLS, which cannot half-close."""
        if self._transport.can_write_eof() and not self._transport.is_closing():
            try:
                self._transport.write_eof()
            except OSError:
                self.abort()  # The peer has disconnected, and the transport has not noticed yet.
        else:
            self.close()

    def close(self) -> None:
        self._close(self._transport.close)

    def abort(self) -> None:
        self._close(self._transport.abort)

    def _close(self, how: Callable[[], None]) -> None:
        if self._resuming:
            # A transport that is closed inside its resume_writing() is closed twice.
            self._share.loop.call_soon(how)
        else:
            how()

    def pause(self) -> None:
        self._is_paused = True
        self._transport.pause_reading()

    def resume(self) -> None:
        self._is_paused = False
        if self._state in (_LinkState.ENDING, _LinkState.CUT):
            self._share.loop.call_soon(self._end)  # Not immediately: the caller delivers buffered data first.
        elif self._state is _LinkState.OPEN and not self._late:
            self._transport.resume_reading()

    def hang_up(self) -> HangUp:
        return (
            hang_up_of(self._socket) if self._state in (_LinkState.OPEN, _LinkState.ENDING) else HangUp.GONE
        )

    def delivery(self) -> Delivery:
        return delivery_of(self._transport.get_extra_info("socket"))


def _bounded(sock: socket.socket) -> socket.socket | None:
    try:
        unsent = sock.getsockopt(socket.IPPROTO_TCP, socket.TCP_NOTSENT_LOWAT)
    except (OSError, AttributeError):  # A Unix socket, or a system without such a bound.
        return None
    return sock if unsent == UNSENT_BYTES else None


def _without(pieces: Sequence[Buffer], size: int) -> Sequence[Buffer]:
    """Return `pieces` without their first `size` bytes; `size` is less than the total."""
    left = list(pieces)
    while size >= len(left[0]):
        size -= len(left.pop(0))
    left[0] = memoryview(left[0])[size:]
    return left


async def _accept(listening: socket.socket) -> tuple[socket.socket, tuple[object, ...]]:
    """Accept a connection.

    If `loop.sock_accept()` is cancelled in the turn in which a connection arrives, it fails in a callback,
    and leaves that connection open.
    """
    while True:
        try:
            accepted, address = listening.accept()
        except (BlockingIOError, InterruptedError):
            await anyio.wait_readable(listening)
        else:
            accepted.setblocking(False)
            return accepted, address


class AsyncioDriver:
    """TCP and Unix sockets, with or without TLS, on the running asyncio loop.

    Implements :class:`rwt_transports.api.Driver` and :class:`rwt_transports.api.Connector`.
    """

    async def connect(self, address: RemoteAddress, attach: Attach, tasks: TaskGroup) -> None:
        """Connect to `address` and attach the link. Starts no task: bytes arrive by callback."""
        cut_cycles()
        loop = asyncio.get_running_loop()
        make_link = partial(_SocketLink, attach, _share_of(address.is_held_back))
        if address.path:
            await loop.create_unix_connection(make_link, address.path, ssl=address.tls)
        else:
            transport, _ = await loop.create_connection(
                make_link, address.host, address.port, ssl=address.tls
            )
            detect_lost_peers(transport.get_extra_info("socket"))

    @asynccontextmanager
    async def serve(self, address: BindAddress, attach: Attach) -> AsyncIterator[int]:
        cut_cycles()
        loop = asyncio.get_running_loop()
        sockets, port = await bind(address)
        share = _share_of(address.is_held_back)
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
                    counted.close()  # The attached connection does its own counting.
                    attach(link, host, port)

                make_link = partial(_SocketLink, attach_counted, share)
                try:
                    with handshakes.one(str(accepted[1][0])) if address.tls is not None else nullcontext():
                        await loop.connect_accepted_socket(
                            make_link, accepted[0], ssl=address.tls, ssl_handshake_timeout=patience
                        )
                except OSError as error:
                    host = str(accepted[1][0]) if accepted[1] else address.path
                    logger.info("no connection with %s: %s", host, cause_of(error))
                    # Break the cycle error → frames → error: it would keep the memory of the TLS handshake.
                    traceback.clear_frames(error.__traceback__)
                except Exception:
                    log_exception("a new connection failed")

        try:
            async with background_tasks() as tasks:
                for each in sockets:
                    each.listen(BACKLOG)
                    tasks.start_soon(
                        accept_peers,
                        partial(_accept, each),
                        lambda accepted: tasks.start_soon(open_link, accepted),
                    )
                yield port
        finally:
            for each in sockets:
                each.close()
            if address.path:
                remove_unix(address.path)
