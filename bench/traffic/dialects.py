"""Dialects of the load: rosbridge for this server and the relay, Foxglove's protocol for its SDK."""

from __future__ import annotations

import json
import struct
import zlib
from collections.abc import Mapping
from typing import Final, Protocol

from bench.traffic.messages import Stream
from bench.traffic.wire import BINARY, masked
from rwt_protocol.codecs import JSON
from rwt_protocol.ops import Direction, Publish
from rwt_protocol.session import Session

FOXGLOVE_CHANNEL: Final = 1
"""The id of the one channel of `bench/peers/foxglove_sdk.py`."""


DEFLATE: Final = "deflate"
"""As a `compression`: JSON over a WebSocket that compresses its messages."""
PER_MESSAGE_DEFLATE: Final = "permessage-deflate; server_no_context_takeover"
"""The extension that such a reader asks for: each message can be read by itself (RFC 7692)."""


class WrongAnswer(Exception):
    """A server did not do what the load asked for, so there is nothing to measure."""


class Dialect(Protocol):
    """Dialect of a load. `advertise`, `subscribe` and `publish` return frames, ready to be sent.

    Attributes:
        subprotocol: what the WebSocket handshake asks for; empty for none.
    """

    subprotocol: str

    def advertise(self, stream: Stream) -> bytes:
        """Become the publisher of a stream."""
        ...

    def subscribe(self, stream: Stream, compression: str) -> bytes:
        """Ask for a stream in one encoding."""
        ...

    def publish(self, stream: Stream, message: Mapping[str, object]) -> bytes:
        """One message."""
        ...

    def delivered(self, stream: Stream, data: bytes, compression: str) -> object:
        """The message that a delivery holds; None where the load has no reader for the encoding.

        Raises:
            WrongAnswer: it is no delivery of the stream in that encoding.
        """
        ...


class Rosbridge:
    """rosbridge v2, in JSON texts."""

    subprotocol = ""

    def advertise(self, stream: Stream) -> bytes:
        return masked(stream.advertise())

    def subscribe(self, stream: Stream, compression: str) -> bytes:
        return masked(stream.subscribe("none" if compression == DEFLATE else compression))

    def publish(self, stream: Stream, message: Mapping[str, object]) -> bytes:
        return masked(stream.publish(message))

    def delivered(self, stream: Stream, data: bytes, compression: str) -> object:
        text = _text_of(data, compression)
        if text is None:
            return None
        op = json.loads(text)
        if (op.get("op"), op.get("topic")) != ("publish", stream.topic):
            raise WrongAnswer(f"a subscriber of {stream.topic} got {data[:300]!r}")
        return op.get("msg")


def _text_of(data: bytes, compression: str) -> bytes | None:
    """A delivery as JSON; None for `cbor-raw`, of which only the envelope is looked at.

    Raises:
        WrongAnswer: it is not in that encoding.
    """
    if compression == "none":
        return data
    if compression == DEFLATE:
        return zlib.decompressobj(-zlib.MAX_WBITS).decompress(data + b"\x00\x00\xff\xff")
    (op,) = Session(direction=Direction.TO_CLIENT).decode(data, compression != "png", 0.0)
    if not isinstance(op, Publish):
        raise WrongAnswer(f"asked for {compression}, got {data[:300]!r}")
    return None if compression == "cbor-raw" else JSON.encode(op).data


class Foxglove:
    """Foxglove's WebSocket protocol (https://github.com/foxglove/ws-protocol): JSON texts to agree upon
    channels, binary frames for messages, whose payload is the JSON of the message alone."""

    subprotocol = "foxglove.sdk.v1"

    _MESSAGE = 0x01
    _PUBLISH = struct.Struct("<BI").pack
    _DELIVERY = struct.Struct("<BIQ")
    _SUBSCRIPTION = 1

    def advertise(self, stream: Stream) -> bytes:
        channel = {"id": 1, "topic": stream.topic, "encoding": "json", "schemaName": stream.type}
        return self._text(op="advertise", channels=[channel])

    def subscribe(self, stream: Stream, compression: str) -> bytes:
        if compression != "none":
            raise WrongAnswer("Foxglove's SDK relays the publisher's encoding alone")
        wanted = {"id": self._SUBSCRIPTION, "channelId": FOXGLOVE_CHANNEL}
        return self._text(op="subscribe", subscriptions=[wanted])

    def publish(self, stream: Stream, message: Mapping[str, object]) -> bytes:
        payload = json.dumps(message, separators=(",", ":")).encode()
        return masked(self._PUBLISH(self._MESSAGE, 1) + payload, BINARY)

    def delivered(self, stream: Stream, data: bytes, compression: str) -> object:
        head = self._DELIVERY
        if len(data) <= head.size or head.unpack_from(data)[:2] != (self._MESSAGE, self._SUBSCRIPTION):
            raise WrongAnswer(f"a subscriber of {stream.topic} got {data[:300]!r}")
        return json.loads(data[head.size :])

    @staticmethod
    def _text(**op: object) -> bytes:
        return masked(json.dumps(op, separators=(",", ":")).encode())


ROSBRIDGE: Final[Dialect] = Rosbridge()
FOXGLOVE: Final[Dialect] = Foxglove()
