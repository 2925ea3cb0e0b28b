"""Wire format of TCPROS: connection headers and length-prefixed frames. Without I/O."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Final, cast

from rwt_graph.errors import WireError
from rwt_protocol.frames import Buffer, Frame, Framing
from rwt_transports.api import WireEvents, drop_message
from rwt_transports.limits import Limits
from rwt_transports.websocket.close_codes import POLICY, PROTOCOL_ERROR
from rwt_transports.wires.receive_buffer import ReceiveBufferPool

#: Maximum bytes of a connection header, which contains the definition of a message.
HEADER_BYTES: Final = 512 * 1024

#: Maximum number of fields of a connection header.
_MOST_FIELDS: Final = 64

#: Maximum bytes of a value that is neither a definition nor an error.
_VALUE_BYTES: Final = 4096

#: Maximum bytes of a message, request or response.
MESSAGE_BYTES: Final = 128 * 1024 * 1024

#: Minimum bytes of a frame that is received in a buffer of the pool, and delivered as a view of it.
LARGE_BYTES: Final = 64 * 1024


def length_prefix(length: int) -> bytes:
    """Return the prefix of a frame of that many bytes."""
    return length.to_bytes(4, "little")


def frame_of(parts: tuple[Buffer, ...], status: bytes = b"") -> Frame:
    """Return a frame with its length, and the status of a response before that."""
    return Frame(status + length_prefix(sum(map(len, parts))), *parts)


def encode_header(fields: Mapping[str, str]) -> bytes:
    """Return a connection header as a frame."""
    lines = [f"{name}={value}".encode() for name, value in fields.items()]
    body = b"".join(length_prefix(len(line)) + line for line in lines)
    return length_prefix(len(body)) + body


def decode_header(body: bytes) -> dict[str, str]:
    """Return the fields of a connection header, given without its length.

    Raises:
        WireError: it is not a connection header.
    """
    fields: dict[str, str] = {}
    at = 0
    while at < len(body):
        start = at + 4
        at = start + int.from_bytes(body[at:start], "little")
        name, equals, value = body[start:at].partition(b"=")
        if at > len(body) or not equals or len(fields) >= _MOST_FIELDS:
            raise WireError("a connection header of ROS 1 is malformed")
        if len(value) > _VALUE_BYTES and name not in (b"message_definition", b"error"):
            raise WireError("a value in a connection header of ROS 1 is too long")
        fields[name.decode(errors="replace")] = value.decode(errors="replace")
    return fields


class TcprosWire:
    """Frames of one connection: a 4-byte little-endian length, then that many bytes. The first is a header.

    The transports' own stream wires copy a message out of their buffer; here, images of megabytes are most
    of the traffic, so that large frames are received where they stay, and delivered as views.

    Attributes by purpose:

    * Wiring: ``_events``, ``_buffers``, ``_in_batch``, ``message``.
    * Stream: ``_rest`` (bytes that were not read yet), ``_is_held`` (True while no frame is delivered),
      ``_is_over`` (True once nothing more is read), ``_most`` (maximum bytes of the next frame).
    * Status: ``_has_status`` (True if one byte before each length tells success, as in responses of
      services), ``_is_success`` (that of the current frame).
    * Incomplete frame: ``_size`` (its bytes; 0 between frames), ``_filled`` (those that have arrived), and
      ``_buffer``.

    Implements :class:`rwt_transports.api.Wire`, and its :class:`~rwt_transports.api.HoldableWire`.

    Args:
        in_batch: calls a function that delivers frames.
        has_status: True for the connection of a service's client. The header has no status.
    """

    __slots__ = (
        "_buffer", "_buffers", "_events", "_filled", "_has_status", "_in_batch", "_is_held", "_is_over",
        "_is_success", "_most", "_rest", "_size", "message",
    )  # fmt: skip

    framing = Framing(lambda frame: frame.data, lambda frame: frame.parts)

    def __init__(
        self,
        in_batch: Callable[[Callable[[], None]], None],
        has_status: bool,
        events: WireEvents,
        _limits: Limits,
        buffers: ReceiveBufferPool,
    ) -> None:
        self._events = events
        self._buffers = buffers
        self._in_batch = in_batch
        self.message: Callable[[bytes, bool], None] = drop_message
        self._has_status = has_status
        self._is_success = True
        self._is_held = self._is_over = False
        self._most = HEADER_BYTES
        self._rest = b""
        self._buffer = bytearray()
        self._size = self._filled = 0

    def feed(self, data: bytes) -> None:
        self._rest += data
        if not self._is_held and not self._is_over:
            self._in_batch(self._read)

    def hold(self) -> None:
        """Deliver no more frames until :meth:`go_on`, even of the same read."""
        self._is_held = True

    def go_on(self) -> None:
        self._is_held = False
        self.feed(b"")

    def get_buffer(self) -> memoryview | None:
        """Return the rest of a large frame's buffer; None otherwise."""
        if self._size < LARGE_BYTES or self._rest or self._is_held:
            return None
        self._grow()
        return memoryview(self._buffer)[self._filled : self._size]

    def buffer_updated(self, count: int) -> None:
        self._filled += count
        if self._filled == self._size:
            self._in_batch(self._read_large)

    def give_up(self, reason: str) -> None:
        self._size, self._buffer = 0, bytearray()
        self._end(POLICY, reason)

    def close(self, _code: int, _reason: str) -> bytes:
        """Deliver no more frames. Returns nothing to send: the protocol has no close."""
        self._is_over = True
        self.message = drop_message
        return b""

    def ping(self) -> bytes:
        """Return nothing to send: the protocol has no ping."""
        return b""

    def _end(self, code: int, reason: str) -> None:
        self._is_over = True
        self._events.ended(code, reason, agreed=False)

    def _read(self) -> None:
        data, self._rest = self._rest, b""
        try:
            at = self._take_frames(data)
        except WireError as error:
            self._end(PROTOCOL_ERROR, str(error))
        else:
            self._rest = b"" if self._is_over else data[at:]

    def _take_frames(self, data: bytes) -> int:
        """Deliver the frames of some bytes; returns the position of what is left."""
        at, end = 0, len(data)
        while not self._is_held and not self._is_over:
            if self._size:
                at = self._fill(data, at)
                if self._size:
                    return at
                continue
            has_status = self._has_status and self._most == MESSAGE_BYTES
            start = at + 4 + has_status
            if start > end:
                return at
            size = int.from_bytes(data[start - 4 : start], "little")
            if size > self._most:
                raise WireError(f"a frame of {size} bytes was announced, {self._most} is the limit")
            self._is_success = not has_status or data[at] == 1
            at = start + size
            if at <= end:
                self._deliver(data[start:at])
                continue
            at = start
            self._size, self._filled = size, 0
            self._buffer = self._buffers.take(size) if size >= LARGE_BYTES else bytearray(size)
            self._note_held()
        return at

    def _fill(self, data: bytes, at: int) -> int:
        """Add bytes to the incomplete frame, and deliver it when it is complete; returns the position behind
        them."""
        with memoryview(data) as view:
            while at < len(data) and self._filled < self._size:
                count = min(len(data) - at, min(len(self._buffer), self._size) - self._filled)
                self._buffer[self._filled : self._filled + count] = view[at : at + count]
                at += count
                self._filled += count
                self._grow()
        if self._filled == self._size:
            self._complete()
        return at

    def _read_large(self) -> None:
        try:
            self._complete()
        except WireError as error:
            self._end(PROTOCOL_ERROR, str(error))

    def _grow(self) -> None:
        """Enlarge a full buffer, in proportion to what has arrived and not to what was announced.

        Called while the driver has no view of it. The steps are small, since many connections may need one in
        the same turn of the event loop.
        """
        missing = self._size - self._filled
        if missing and self._filled == len(self._buffer):
            self._buffer.extend(bytes(min(missing, LARGE_BYTES)))
            self._note_held()

    def _note_held(self) -> None:
        if self._size >= LARGE_BYTES:
            self._buffers.hold(self, len(self._buffer), self._events.holder)

    def _complete(self) -> None:
        buffer, size = self._buffer, self._size
        self._buffer, self._size = bytearray(), 0
        if size < LARGE_BYTES:
            self._deliver(bytes(buffer))
            return
        self._buffers.release(self)
        # The endpoints of this wire take views, others do not: see `Endpoint.receive`.
        body = cast("bytes", self._buffers.lend(buffer, size))
        self._most = MESSAGE_BYTES
        self._buffers.hand_on(self.message, body, self._is_success)

    def _deliver(self, body: bytes) -> None:
        self._most = MESSAGE_BYTES
        self.message(body, self._is_success)
