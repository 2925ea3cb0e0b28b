"""Wire of the WebSocket protocol (RFC 6455) after its handshake.

The handshake is in :mod:`rwt_transports.websocket.handshake`. Frames are read with as few copies as Python
allows: a message costs one pass, which unmasks it; a large one is received into the buffer that it is
    unmasked from. Outgoing frames of a server are the same bytes for every peer, so they are built once per
    frame.

Text is checked for UTF-8 only with ``strict_utf8``: section 8.1 would end the connection with 1007, but a
robot's bridge rejects the one bad message and keeps its client. Everything else follows the RFC.
"""

from __future__ import annotations

import secrets
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import Enum
from struct import Struct

try:
    from websockets.speedups import apply_mask
except ImportError:  # no compiled extension for this interpreter
    from websockets.utils import apply_mask

from rwt_protocol.frames import Buffer, Frame, Framing
from rwt_protocol.states import StateEnum
from rwt_transports.api import HEAD_BYTES, WireEvents, drop_message
from rwt_transports.limits import Limits
from rwt_transports.websocket.close_codes import (
    INVALID_DATA,
    NO_STATUS,
    POLICY,
    PROTOCOL_ERROR,
    TOO_BIG,
    may_travel,
)
from rwt_transports.wires.receive_buffer import ReceiveBufferPool

CONTINUATION, TEXT, BINARY, CLOSE, PING, PONG = 0x0, 0x1, 0x2, 0x8, 0x9, 0xA

DIRECT_BYTES = 32 * 1024
"""If less than this is missing, a copy from the shared buffer is cheaper than another read."""

ALL_DIRECT_BYTES = 1024 * 1024
"""Messages of this size are received directly up to their last byte: unmasking them takes long, and the
driver has to see when they are complete."""

SMALL_PART_BYTES = 16 * 1024
"""Smaller parts are joined with the header rather than written separately."""

_OTHER_FRAMES_PER_TURN = 64
"""Maximum number of frames other than whole small messages in one turn of the event loop: pings, fragments
and compressed messages cost more, and those that are no message reach no endpoint, which could pause."""

_LONGEST_SMALL_HEADER = 8
"""Size of the header of a masked frame of less than 64 KiB, including its key."""

_SHORT = Struct("!BB").pack
_MEDIUM = Struct("!BBH").pack
_LONG = Struct("!BBQ").pack
_UINT16 = Struct("!H")
_SMALL_HEADERS = {op: tuple(_SHORT(0x80 | op, n) for n in range(126)) for op in (TEXT, BINARY)}


def _server_header(frame: Frame) -> bytes:
    size = frame.size
    opcode = BINARY if frame.binary else TEXT
    if size < 126:
        return _SMALL_HEADERS[opcode][size]
    if size < 65536:
        return _MEDIUM(0x80 | opcode, 126, size)
    return _LONG(0x80 | opcode, 127, size)


def server_whole(frame: Frame) -> bytes:
    """Return a message as one unmasked frame."""
    size = frame.size
    if size < 65536:
        # Nearly all messages; without the call of `_server_header`.
        opcode = BINARY if frame.binary else TEXT
        header = _SMALL_HEADERS[opcode][size] if size < 126 else _MEDIUM(0x80 | opcode, 126, size)
        return b"".join((header, *frame.parts))
    return b"".join((_server_header(frame), *frame.parts))


def _server_joined(frames: Sequence[Frame]) -> bytes:
    parts: list[Buffer] = []
    for frame in frames:
        parts.append(_server_header(frame))
        parts += frame.parts
    return b"".join(parts)


def _server_apart(frames: Sequence[Frame]) -> Sequence[bytes]:
    """Return the pieces between the gaps of several messages, each with a gap after its first part."""
    apart: list[bytes] = []
    last: tuple[Buffer, ...] = ()
    for frame in frames:
        apart.append(b"".join((*last, _server_header(frame), frame.parts[0])))
        last = frame.parts[1:]
    apart.append(b"".join(last))
    return apart


def server_pieces(frame: Frame) -> tuple[Buffer, ...]:
    """Return a message as one unmasked frame in pieces, with its large parts uncopied."""
    pieces: list[Buffer] = []
    small: list[Buffer] = [_server_header(frame)]
    for part in frame.parts:
        if len(part) < SMALL_PART_BYTES:
            small.append(part)
        else:
            pieces += (b"".join(small), part)
            small = []
    if small:
        pieces.append(b"".join(small))
    return tuple(pieces)


def _client_whole(frame: Frame) -> bytes:
    return pack(BINARY if frame.binary else TEXT, frame.data, masked=True)


SERVER_FRAMING = Framing(server_whole, server_pieces, joined=_server_joined, apart=_server_apart)
"""One unfragmented, unmasked WebSocket frame (RFC 6455 section 5.2)."""
CLIENT_FRAMING = Framing(_client_whole, lambda frame: (_client_whole(frame),))
"""One unfragmented frame masked with a key of its own, as a client must send it (RFC 6455 section 5.3)."""


def close_payload(code: int, reason: str) -> bytes:
    """Return the body of a close frame; the reason is cut to 123 bytes (RFC 6455 section 5.5.1)."""
    if not may_travel(code):
        return b""
    # The cut may fall within a character: decoding drops its rest, since a reason must be UTF-8.
    text = reason.encode("utf-8", "replace")[:123]
    return _UINT16.pack(code) + text.decode("utf-8", "ignore").encode()


def pack(opcode: int, payload: Buffer, *, masked: bool) -> bytes:
    """Return one final frame; `opcode` may have reserved bits set."""
    size = len(payload)
    bit = 0x80 if masked else 0
    if size < 126:
        header = _SHORT(0x80 | opcode, bit | size)
    elif size < 65536:
        header = _MEDIUM(0x80 | opcode, bit | 126, size)
    else:
        header = _LONG(0x80 | opcode, bit | 127, size)
    if not masked:
        return b"".join((header, payload))
    key = _masking_key()
    return b"".join((header, key, apply_mask(payload, key)))


# Shared by all connections: a key is used once, and each is as unpredictable as the next.
_keys: list[bytes] = []


def _masking_key() -> bytes:
    """Return four unpredictable bytes (RFC 6455 section 5.3), drawn in batches because that is cheaper."""
    try:
        return _keys.pop()
    except IndexError:
        pool = secrets.token_bytes(4 * 256)
        _keys.extend(pool[at : at + 4] for at in range(4, len(pool), 4))
        return pool[:4]


class ProtocolViolation(Exception):
    """The peer broke the protocol. Never leaves the wire, which answers it with a close frame."""

    def __init__(self, code: int, reason: str) -> None:
        super().__init__(reason)
        self.code = code


@dataclass(slots=True, eq=False)
class _Staged:
    """Frame whose payload is incomplete."""

    first: int
    key: bytes
    size: int
    buffer: bytearray
    filled: int = 0

    def grow(self) -> None:
        """Enlarge the buffer, in proportion to what has arrived and not to what was announced."""
        # Not in place: the driver may still have a view of it.
        larger = bytearray(min(self.size, 4 * len(self.buffer)))
        larger[: self.filled] = self.buffer
        self.buffer = larger


class _SkippedHead:
    """First bytes of a message that is skipped.

    Attributes:
        message_bytes: size of the message, as far as known.
        start: bytes so far.
    """

    __slots__ = ("_key", "_masked", "_missing", "message_bytes", "start")

    def __init__(self, message_bytes: int, start: bytes) -> None:
        self.message_bytes = message_bytes
        self.start = start
        self._key = b""
        self._masked = b""
        self._missing = 0

    def begin_frame(self, key: bytes, size: int) -> None:
        self._key = key
        self._missing = min(HEAD_BYTES - len(self.start), size)

    def add(self, data: bytes) -> bool:
        """Add masked bytes of the frame. Returns True once nothing is missing from this frame."""
        self._masked += data[: self._missing - len(self._masked)]
        if len(self._masked) < self._missing:
            return False
        self.start += apply_mask(self._masked, self._key) if self._key else self._masked
        return True


class _WireState(StateEnum):
    OPEN = "CLOSING", "ENDED"
    CLOSING = "ENDED"
    ENDED = ()


class _Progress(Enum):
    """Message that is in progress between two frames."""

    NONE = "none"
    FRAGMENTED = "fragmented"
    SKIPPED = "skipped"


class WebSocketWire:
    """Frames of one connection, as a server or a client.

    Life cycle::

        OPEN ── close() ──> CLOSING ── close frame of the peer, or a violation ──> ENDED
          └──────────────── close frame of the peer, or a violation ─────────────────^

    * **OPEN**: messages go to `message`.
    * **CLOSING**: the close frame is sent; messages are dropped, and frames are read up to the peer's close
      frame.
    * **ENDED**: nothing is read, and nothing is sent.

    Reading, within OPEN and CLOSING: a message is in progress or not (``_progress``); a frame may be
    incomplete in one of three ways: its header (``_tail``), a payload to keep (``_staged``) or a payload to
    skip (``_skip`` > 0).

    Attributes by purpose:

    * Role and limits: ``_server``, ``_small_frames`` (mask bit, bytes of the shortest header, and maximum
      size of the frames that arrive), ``_max_size``, ``_strict`` (True if text must be UTF-8), ``_events``,
      ``_buffers``.
    * ``_state``: state of the connection.
    * ``_progress``: **NONE** between messages; **FRAGMENTED** after the first fragment of one, with
      ``_parts`` (its payload so far) and ``_parts_binary``; **SKIPPED** while one that is too large is
      skipped, with ``_head`` (its first bytes, until they are reported).
    * ``_is_usual``: True if ``_progress`` is **NONE**, for speed.
    * Frame: ``_tail``, ``_staged``, ``_skip`` (bytes to skip), ``_skip_last`` (True if that frame ends its
      message).
    * ``_is_held``: True while nothing more is read, see :meth:`hold`.

    Args:
        server: True for the server's side: incoming frames must be masked, outgoing ones are not.
    """

    __slots__ = (
        "_buffers", "_events", "_head", "_is_held", "_is_usual", "_max_size", "_parts", "_parts_binary",
        "_progress", "_server", "_skip", "_skip_last", "_small_frames", "_staged", "_state", "_strict",
        "_tail", "framing", "message",
    )  # fmt: skip

    def __init__(
        self, events: WireEvents, limits: Limits, buffers: ReceiveBufferPool, *, server: bool = True
    ) -> None:
        self._events = events
        self._server = server
        self.limit(limits.message_bytes)
        self.framing = SERVER_FRAMING if server else CLIENT_FRAMING
        self._strict = limits.strict_utf8
        self._buffers = buffers
        self.message: Callable[[bytes, bool], None] = drop_message
        self._state = _WireState.OPEN
        self._progress = _Progress.NONE
        self._is_usual = True
        self._parts = bytearray()
        self._parts_binary = False
        self._head: _SkippedHead | None = None
        self._tail = b""
        self._staged: _Staged | None = None
        self._skip = 0
        self._skip_last = False
        self._is_held = False

    def limit(self, size: int) -> None:
        self._max_size = size
        self._small_frames = (0x80, 6, size) if self._server else (0, 2, size)

    # -- outgoing ------------------------------------------------------------------------------------------

    def close(self, code: int, reason: str) -> bytes:
        """Start the closing handshake (RFC 6455 section 7.1.2). Returns nothing if it has begun already."""
        if self._state is not _WireState.OPEN:
            return b""
        self._state = self._state.become(_WireState.CLOSING)
        self.message = drop_message
        return pack(CLOSE, close_payload(code, reason), masked=not self._server)

    def ping(self) -> bytes:
        return b"" if self._state is not _WireState.OPEN else pack(PING, b"", masked=not self._server)

    # -- incoming ------------------------------------------------------------------------------------------

    def feed(self, data: bytes) -> None:
        position = 0
        mask_bit, header_bytes, most = self._small_frames
        others = 0
        try:
            if self._staged is not None:
                position = self._stage(self._staged, data, 0)
            elif self._tail:
                data = self._tail + data
                self._tail = b""
            end = len(data)
            while position < end and self._state is not _WireState.ENDED:
                # Kept here, since the driver keeps nothing: up to one read.
                if self._is_held:
                    self._tail = data[position:]
                    return
                if self._skip:
                    position = self._skip_some(data, position, end)
                    continue
                # Whole messages of less than 64 KiB, nearly all that peers send: final text or binary frames
                # without reserved bits. Anything else is left to `_read_frame`, which checks the rules. Local
                # names, and no calls but those of C and of the endpoint: the loop runs once per message.
                while self._is_usual and not self._is_held and end - position >= _LONGEST_SMALL_HEADER:
                    first = data[position]
                    # Negative or above 127 if the mask bit is wrong.
                    size = data[position + 1] - mask_bit
                    start = position + header_bytes
                    if size == 126:
                        size = data[position + 2] << 8 | data[position + 3]
                        start += 2
                        if size < 126:
                            break
                    elif size > 126:
                        break
                    stop = start + size
                    if (first != 0x81 and first != 0x82) or size < 0 or stop > end or size > most:
                        break
                    payload = data[start:stop]
                    if mask_bit:
                        payload = apply_mask(payload, data[start - 4 : start])
                    position = stop
                    if self._strict and first == 0x81:
                        _require_utf8(payload)
                    # Without `_deliver`: messages of less than 64 KiB do not matter to the pool.
                    self.message(payload, first == 0x82)
                if position == end or self._is_held:
                    continue
                following = self._read_frame(data, position, end)
                if following == position:
                    self._tail = data[position:]
                    return
                position = following
                others += 1
                if others == _OTHER_FRAMES_PER_TURN:
                    self._is_held = True
                    self._events.read_on_later()
        except ProtocolViolation as violation:
            self._fail(violation.code, str(violation))

    def hold(self) -> None:
        """Stop reading until :meth:`go_on`: one read may have thousands of messages, or inflate to a
        thousand times its size."""
        self._is_held = True

    def go_on(self) -> None:
        self._is_held = False
        self.feed(b"")

    def get_buffer(self) -> memoryview | None:
        """Return the rest of a large payload's buffer, if receiving there saves a copy."""
        staged = self._staged
        if staged is None or (staged.size - staged.filled < DIRECT_BYTES and staged.size < ALL_DIRECT_BYTES):
            return None
        return memoryview(staged.buffer)[staged.filled : staged.size]

    def buffer_updated(self, count: int) -> None:
        staged = self._staged
        if staged is None:
            return
        # The driver has written into the buffer itself: no bytes are copied here.
        staged.filled += count
        if staged.filled == staged.size:
            try:
                self._unstage(staged)
            except ProtocolViolation as violation:
                self._fail(violation.code, str(violation))
        elif staged.filled == len(staged.buffer):
            self._grow(staged)

    def give_up(self, reason: str) -> None:
        self._fail(POLICY, reason)

    def _fail(self, code: int, reason: str) -> None:
        if self._state is _WireState.ENDED:
            return
        # Before the change of state, since `close` answers only in OPEN: a CLOSING connection has sent its
        # close frame.
        answer = self.close(code, reason)
        self._state = self._state.become(_WireState.ENDED)
        # The incomplete message is never delivered: it must not count towards the limit of the pool.
        self._buffers.release(self)
        self._staged = None
        self._parts = bytearray()
        if answer:
            self._events.answer(answer)
        self._events.ended(code, reason, agreed=False)

    def _read_frame(self, data: bytes, position: int, end: int) -> int:
        """Read the frame at `position`. Returns the position of the next one, or `position` if the header is
        incomplete."""
        if end - position < 2:
            return position
        first = data[position]
        second = data[position + 1]
        size = second & 0x7F
        start = position + 2
        if size > 125:
            start += 2 if size == 126 else 8
            if start > end:
                return position
            size = _long_size(data[position + 2 : start])
        if second > 127:
            start += 4
        if start > end:
            return position
        self._check(first, size, masked=second > 127)
        key = data[start - 4 : start] if second > 127 else b""
        return self._read_any(data, first, key, start, size)

    def _check(self, first: int, size: int, *, masked: bool) -> None:
        """Check the header rules of RFC 6455 sections 5.1, 5.2, 5.4 and 5.5."""
        opcode = first & 0x0F
        if first & 0x70:
            raise ProtocolViolation(PROTOCOL_ERROR, "a reserved bit is set and no extension was negotiated")
        if opcode not in (CONTINUATION, TEXT, BINARY, CLOSE, PING, PONG):
            raise ProtocolViolation(PROTOCOL_ERROR, f"opcode {opcode} is reserved")
        if masked is not self._server:
            raise ProtocolViolation(PROTOCOL_ERROR, "a client must mask its frames, a server must not")
        if opcode >= CLOSE:
            if size > 125:
                raise ProtocolViolation(PROTOCOL_ERROR, "a control frame holds at most 125 bytes")
            if first < 0x80:
                raise ProtocolViolation(PROTOCOL_ERROR, "a control frame cannot be fragmented")
        elif opcode == CONTINUATION and self._progress is _Progress.NONE:
            raise ProtocolViolation(PROTOCOL_ERROR, "a continuation frame without a message to continue")
        elif opcode != CONTINUATION and self._progress is not _Progress.NONE:
            raise ProtocolViolation(
                PROTOCOL_ERROR, "a new message before the last fragment of the one before"
            )

    def _read_any(self, data: bytes, first: int, key: bytes, start: int, size: int) -> int:
        """Read a checked frame of any kind. Returns the position of the next one, or the end of `data`."""
        # Control frames have no limit but 125 bytes, and may come between the frames of a skipped message.
        if first & 0x0F < CLOSE and not self._admit(first, size):
            self._skip = size
            self._skip_last = first > 127
            if self._head is not None:
                self._head.begin_frame(key, size)
            if size == 0:
                self._skipped()
            return start
        if start + size > len(data):
            # Small payloads have a buffer of exactly their size: they are not worth a place in the pool.
            buffer = self._buffers.take(size) if size >= DIRECT_BYTES else bytearray(size)
            staged = self._staged = _Staged(first, key, size, buffer)
            if size >= DIRECT_BYTES:
                self._buffers.hold(self, len(self._parts) + len(buffer), self._events.holder)
            return self._stage(staged, data, start)
        payload = data[start : start + size]
        self._frame(first, apply_mask(payload, key) if key else payload)
        return start + size

    # -- messages over the limit ---------------------------------------------------------------------------

    def _admit(self, first: int, size: int) -> bool:
        """Return True if a data frame is within the limit of its message. The first that is not is reported,
        and may be skipped."""
        if self._progress is _Progress.SKIPPED:
            return False
        total = len(self._parts) + size
        if total <= self._max_size:
            return True
        # While CLOSING no answer can be sent, so a large message ends the connection at once.
        if self._state is not _WireState.OPEN or not self._events.oversized(total):
            raise self._too_big(total)
        # Earlier fragments count as the head: the op and the id are usually in the first bytes.
        self._head = _SkippedHead(total, bytes(self._parts[:HEAD_BYTES]))
        self._begin(first, _Progress.SKIPPED)
        self._parts = bytearray()
        return False

    def _too_big(self, size: int) -> ProtocolViolation:
        text = f"a message of {size} bytes; the limit is {self._max_size} (max_message_size)"
        return ProtocolViolation(TOO_BIG, text)

    def _skip_some(self, data: bytes, position: int, end: int) -> int:
        count = min(self._skip, end - position)
        head = self._head
        if head is not None and head.add(data[position : position + min(count, HEAD_BYTES)]):
            self._head = None
            self._events.oversized_head(head.message_bytes, head.start)
        self._skip -= count
        if not self._skip:
            self._skipped()
        return position + count

    def _skipped(self) -> None:
        if self._skip_last:
            self._end_message()

    # -- payloads that arrive in pieces --------------------------------------------------------------------

    def _stage(self, staged: _Staged, data: bytes, position: int) -> int:
        """Copy the received part of the payload into its buffer. Returns the position behind it."""
        end = min(len(data), position + staged.size - staged.filled)
        # The pool may give the message up, when it begins and whenever it grows.
        while position < end and self._staged is staged:
            count = min(end - position, len(staged.buffer) - staged.filled)
            with memoryview(data) as view:
                staged.buffer[staged.filled : staged.filled + count] = view[position : position + count]
            staged.filled += count
            position += count
            if staged.filled == len(staged.buffer) < staged.size:
                self._grow(staged)
        if staged.filled == staged.size and self._staged is staged:
            self._unstage(staged)
        return position

    def _grow(self, staged: _Staged) -> None:
        staged.grow()
        self._buffers.hold(self, len(self._parts) + len(staged.buffer), self._events.holder)

    def _unstage(self, staged: _Staged) -> None:
        self._staged = None
        if staged.size >= DIRECT_BYTES:
            self._buffers.release(self)
        with memoryview(staged.buffer) as whole, whole[: staged.size] as view:
            payload = apply_mask(view, staged.key) if staged.key else bytes(view)
        if staged.size >= DIRECT_BYTES:
            self._buffers.give(staged.buffer)
        self._frame(staged.first, payload)

    # -- whole frames --------------------------------------------------------------------------------------

    def _frame(self, first: int, payload: bytes) -> None:
        opcode = first & 0x0F
        if opcode == PING:
            if self._state is _WireState.OPEN:
                self._events.pong(pack(PONG, payload, masked=not self._server))
        elif opcode == CLOSE:
            self._close_frame(payload)
        elif opcode != PONG:
            self._data_frame(first, payload)

    def _data_frame(self, first: int, payload: bytes) -> None:
        last = first > 127
        if last and self._progress is _Progress.NONE:
            self._deliver(payload, first & 0x0F == BINARY)
            return
        self._begin(first, _Progress.FRAGMENTED)
        self._parts += payload
        if len(self._parts) >= DIRECT_BYTES:
            self._buffers.hold(self, len(self._parts), self._events.holder)
        if last:
            # The parts are dropped before the endpoint runs, so that a large message is in memory once.
            whole = bytes(self._parts)
            self._end_message()
            self._deliver(whole, self._parts_binary)

    def _begin(self, first: int, progress: _Progress) -> None:
        # Continuation frames do not repeat the kind of their message (RFC 6455 section 5.4).
        if self._progress is _Progress.NONE:
            self._parts_binary = first & 0x0F == BINARY
        self._progress = progress
        self._is_usual = False

    def _end_message(self) -> None:
        self._buffers.release(self)
        self._parts = bytearray()
        self._progress = _Progress.NONE
        self._is_usual = True

    def _deliver(self, payload: bytes, binary: bool) -> None:
        if self._strict and not binary:
            _require_utf8(payload)
        if len(payload) < DIRECT_BYTES:
            self.message(payload, binary)
        else:
            self._buffers.hand_on(self.message, payload, binary)

    def _close_frame(self, payload: bytes) -> None:
        """End the connection: the peer closes, or agrees to (RFC 6455 sections 5.5.1 and 7.4)."""
        code, reason = _parse_close(payload)
        answer = self.close(code, reason)
        self._state = self._state.become(_WireState.ENDED)
        if answer:
            self._events.answer(answer)
        self._events.ended(code, reason, agreed=True)


def _require_utf8(payload: bytes) -> None:
    """Raise ProtocolViolation if a text message is not UTF-8."""
    try:
        payload.decode()
    except UnicodeDecodeError:
        raise ProtocolViolation(INVALID_DATA, "a text message must be UTF-8") from None


def _long_size(field: bytes) -> int:
    """Return a length of two or eight bytes, which must use the shortest form (RFC 6455 section 5.2)."""
    size = int.from_bytes(field, "big")
    if size < 126 or (len(field) == 8 and size < 65536):
        raise ProtocolViolation(PROTOCOL_ERROR, "a payload length must use the shortest form")
    if size >> 63:
        raise ProtocolViolation(PROTOCOL_ERROR, "the first bit of a payload length must be 0")
    return size


def _parse_close(payload: bytes) -> tuple[int, str]:
    if not payload:
        return NO_STATUS, ""
    if len(payload) == 1:
        raise ProtocolViolation(PROTOCOL_ERROR, "a close frame needs two bytes for its code")
    (code,) = _UINT16.unpack_from(payload)
    if not may_travel(code):
        raise ProtocolViolation(PROTOCOL_ERROR, f"close code {code} may not travel in a frame")
    try:
        return code, payload[2:].decode()
    except UnicodeDecodeError:
        raise ProtocolViolation(INVALID_DATA, "the reason of a close frame must be UTF-8") from None
