"""JSON objects one after the other on a stream of bytes, as a wire (TCP-01 to TCP-03).

Nothing separates the objects and nothing announces their length: an object ends with the brace that closes
it. The scanner reads braces and quotes only, keeps its position between reads, and never reads a byte
twice, so that cuts inside a character, an escape or a string have no effect. Text between
objects that is not blank is delivered as a separate message, so that the endpoint can reject it.

There is no binary on this wire (TCP-05): a binary frame is logged and left out.

A datagram (UDP-01) has one or more objects, and none continues in the next. Each outgoing frame is one
datagram; what does not fit is logged and left out: to divide it is for the sender (`fragment_size`).
"""

from __future__ import annotations

import logging
import re
from collections import deque
from typing import Final

from rwt_protocol.frames import Buffer, Frame, Framing
from rwt_transports.api import HEAD_BYTES, WireEvents
from rwt_transports.limits import DATAGRAM_BYTES, Limits
from rwt_transports.websocket.close_codes import POLICY
from rwt_transports.wires.receive_buffer import ReceiveBufferPool
from rwt_transports.wires.stream import ByteStreamWire, framing_of

logger = logging.getLogger("rwt_transports.json_stream")

END = b"\0"
"""End of a frame for the driver of datagrams. No JSON text holds this byte (RFC 8259 section 7)."""

WAITING_BYTES: Final = 4 * DATAGRAM_BYTES
"""Bytes of datagrams that wait for the turn of their peer."""

STRAY_BYTES = 1024
"""Maximum bytes between objects that are delivered at once."""

#: Beginning of a browser's request. Any web page can send HTTP requests with any body to any port: their
#: content must not be executed, because the origin of the page is not checked.
_HTTP_REQUEST = re.compile(rb"\s*[A-Z]+ [/*h]")
_BLANK = re.compile(rb"\s+")
_STRUCTURE = re.compile(rb'[{}"]')
_IN_STRING = re.compile(rb'["\\]')
_BACKSLASH, _QUOTE, _OPEN = b'\\"{'


def _framing(end: bytes = b"", place: str = "on a JSON stream", most: int | None = None) -> Framing:
    def pieces(frame: Frame) -> tuple[Buffer, ...]:
        if frame.binary:
            logger.warning("a binary message of %d bytes has no place %s; left out", frame.size, place)
        elif most is not None and frame.size > most:
            logger.warning(
                "a message of %d bytes does not fit a datagram and was left out: the limit is %d; ask for "
                "`fragment_size`, or connect by tcp://",
                frame.size,
                most,
            )
        else:
            return (*frame.parts, end) if end else frame.parts
        return ()

    return framing_of(pieces)


PLAIN = _framing()
"""Objects with nothing between them, as clients of ROS 1's TCP server expect (TCP-02)."""
LINES = _framing(b"\n")
"""One object per line, for programs that read lines."""
DATAGRAMS = _framing(END, "in a JSON datagram", DATAGRAM_BYTES)
"""One frame, and where it ends."""


class JsonStreamWire(ByteStreamWire):
    """Objects of one connection over TCP."""

    __slots__ = ("_depth", "_fresh", "_in_string", "_scanned", "_skipping")

    framing = PLAIN

    def __init__(self, events: WireEvents, limits: Limits, buffers: ReceiveBufferPool) -> None:
        super().__init__(events, limits, buffers)
        self._scanned = 0  # bytes of the buffer that were scanned
        self._depth = 0
        self._in_string = False
        self._skipping = False
        self._fresh = True  # nothing was delivered yet

    def feed(self, data: bytes) -> None:
        self._buffer += data
        self._take_steps()
        # What follows the end is dropped, and its memory freed before the link is gone.
        if self._over:
            self._buffer.clear()
        # Checked while the object is incomplete: its end may never come.
        elif self._depth and len(self._buffer) > self._max_size:
            self._too_large()
        self._count_held()

    def _step(self) -> bool:
        if self._depth == 0:
            return self._between()
        match = (_IN_STRING if self._in_string else _STRUCTURE).search(self._buffer, self._scanned)
        if match is None:
            self._scanned = len(self._buffer)
            return False
        found = self._buffer[match.start()]
        if found == _BACKSLASH:
            self._scanned = match.start()
            # The escaped character has not arrived: wait at the backslash, so that a quote is not missed.
            if match.end() == len(self._buffer):
                return False
            self._scanned = match.end() + 1
            return True
        self._scanned = match.end()
        if found == _QUOTE:
            self._in_string = not self._in_string
        else:
            self._depth += 1 if found == _OPEN else -1
            if self._depth == 0:
                self._hand_over(self._scanned)
        return True

    def _between(self) -> bool:
        """Deliver non-blank bytes outside of objects, up to the next opening brace or line."""
        buffer = self._buffer
        blank = _BLANK.match(buffer)
        if blank is not None:
            del buffer[: blank.end()]
        start = buffer.find(b"{")
        line = buffer.find(b"\n") + 1
        if start == 0:
            self._depth = self._scanned = 1
            return True
        if line and (start < 0 or line < start):
            self._hand_over(line)
        elif start > 0:
            self._hand_over(start)
        elif len(buffer) > STRAY_BYTES:
            self._hand_over(STRAY_BYTES)
        else:
            return False
        return bool(self._buffer)

    def _hand_over(self, end: int) -> None:
        message = bytes(self._buffer[:end])
        # Cheap: CPython advances the start of a bytearray, and moves no bytes.
        del self._buffer[:end]
        self._scanned = 0
        if self._skipping:
            self._skipping = False
        elif len(message) > self._max_size:
            self._report(len(message), message)
        # Only the first message: later ones come from a peer that has sent JSON, as no browser does first.
        elif self._fresh and _HTTP_REQUEST.match(message):
            self._end(POLICY, "this port speaks JSON, not HTTP: web pages use ws://")
        elif message.strip():
            self._hand_on(message, False)
        self._fresh = False

    def _too_large(self) -> None:
        """Drop the beginning of an object over the limit, and continue counting its braces."""
        if not self._skipping:
            self._report(len(self._buffer), bytes(self._buffer[:HEAD_BYTES]))
            self._skipping = True
        # Nesting and string state are kept in attributes, so scanned bytes are not needed to find the end.
        del self._buffer[: self._scanned]
        self._scanned = 0

    def _report(self, size: int, message: bytes) -> None:
        if self._may_skip(size):
            self._events.oversized_head(size, message[:HEAD_BYTES])


class JsonLinesWire(JsonStreamWire):
    """Objects of one connection over a Unix socket or standard input and output."""

    __slots__ = ()

    framing = LINES


class JsonDatagramWire(JsonStreamWire):
    """Objects of one peer in datagrams.

    Datagrams that arrive while the wire is held wait for it, up to `WAITING_BYTES`. Further ones are lost, as
    others are in the network: datagrams cannot be held back.
    """

    __slots__ = ("_waiting", "_waiting_bytes")

    framing = DATAGRAMS

    def __init__(self, events: WireEvents, limits: Limits, buffers: ReceiveBufferPool) -> None:
        super().__init__(events, limits, buffers)
        self._waiting: deque[bytes] = deque()
        self._waiting_bytes = 0

    def feed(self, data: bytes) -> None:
        """Read one datagram; an object that is not whole is delivered, so that the endpoint can reject it."""
        if self._is_held:
            if self._waiting_bytes + len(data) <= WAITING_BYTES:
                self._waiting.append(data)
                self._waiting_bytes += len(data)
            return
        super().feed(data)
        if not self._is_held:
            self._end_datagram()

    def go_on(self) -> None:
        super().go_on()
        while self._waiting and not self._is_held:
            data = self._waiting.popleft()
            self._waiting_bytes -= len(data)
            self.feed(data)

    def _end_datagram(self) -> None:
        # State ends with the datagram: datagrams may be lost, so the rest of an object may never come.
        if self._buffer and not self._over:
            self._hand_over(len(self._buffer))
        self._buffer.clear()
        self._scanned = self._depth = 0
        self._in_string = self._skipping = False
