"""JSON objects in datagrams, as a wire (UDP-01): one or more in each, none across two.

A datagram is read as :mod:`rwt_transports.wires.json_stream` reads a stream; an object that is not whole when
its datagram ends is handed over as it is, so that the endpoint can refuse it. Each outgoing frame is one
datagram, and what does not fit is logged and left out: to divide it is for the sender (`fragment_size`).
"""

from __future__ import annotations

import logging

from rwt_protocol.frames import Buffer, Frame
from rwt_transports.api import Framing, WireEvents
from rwt_transports.limits import Limits
from rwt_transports.wires.json_stream import JsonStreamWire
from rwt_transports.wires.receive_buffer import ReceiveBufferPool

logger = logging.getLogger("rwt_transports.json_datagrams")

DATAGRAM_BYTES = 65_507
"""The largest UDP payload over IPv4 (65,535 bytes less the headers of RFC 791 and RFC 768)."""

END = b"\0"
"""Where a frame ends in what a driver takes. No JSON text holds this byte (RFC 8259 section 7)."""


class JsonDatagramWire(JsonStreamWire):
    """Objects of one peer; arguments as for the stream."""

    __slots__ = ()

    def feed(self, data: bytes) -> None:
        """Read one datagram; each of its objects goes to :attr:`message` within the call."""
        super().feed(data)
        self.end_of_datagram()


def _pieces(frame: Frame) -> tuple[Buffer, ...]:
    if frame.binary:
        logger.warning("a binary message of %d bytes has no place in a JSON datagram; left out", frame.size)
    elif frame.size > DATAGRAM_BYTES:
        logger.warning(
            "a message of %d bytes does not fit a datagram and was left out: the limit is %d; ask for "
            "`fragment_size`, or connect by tcp://",
            frame.size,
            DATAGRAM_BYTES,
        )
    else:
        return (*frame.parts, END)
    return ()


DATAGRAMS = Framing(lambda frame: b"".join(_pieces(frame)), _pieces)
"""One frame, and where it ends."""


def json_datagrams(events: WireEvents, limits: Limits, _buffers: ReceiveBufferPool) -> JsonDatagramWire:
    """Return the wire of a peer over UDP."""
    return JsonDatagramWire(events, max_size=limits.message_bytes, framing=DATAGRAMS)
