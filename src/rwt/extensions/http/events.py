"""Server-sent events (the HTML standard, section 9.2): one bounded queue per reader; drops are reported."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from typing import Final

import anyio

from rwt.extensions.http.representations import json_of
from rwt_interfaces.payload import Payload
from rwt_protocol.codecs import Encoding
from rwt_protocol.frames import Buffer, Burst, Frame
from rwt_protocol.payloads import PublishedMessage
from rwt_transports.endpoint import DropReason, FlowRules

KEEP_ALIVE_SECONDS: Final = 15.0
"""Idle time after which a comment is sent, so that proxies keep the connection open, in seconds."""

_KEEP_ALIVE: Final = b": nothing new\n\n"
STREAM_BYTES: Final = 4 * 1024 * 1024
"""Bytes queued for the reader of one event stream; beyond it, the oldest events are dropped."""

_CHUNK_BYTES: Final = 256 * 1024
_SPACES: Final = bytes.maketrans(b"\r\n", b"  ")


def _whole(frame: Frame) -> bytes:
    return frame.data


def one_line(json: Buffer) -> bytes:
    """Return JSON without line breaks: they only occur between tokens, where spaces replace them."""
    data = bytes(json)
    return data.translate(_SPACES) if b"\n" in data or b"\r" in data else data


def event(data: object, name: str = "", id: str = "") -> bytes:
    """Return an event whose data is a value of plain objects and payloads, as JSON."""
    head = (f"event: {name}\n" if name else "") + (f"id: {id}\n" if id else "")
    return head.encode() + b"data: " + one_line(json_of(data)) + b"\n\n"


def payload_event(payload: Payload, name: str) -> bytes:
    """Return an event whose data is a message."""
    return f"event: {name}\ndata: ".encode() + one_line(payload.json()) + b"\n\n"


def _sample_encoder(topic: str) -> Callable[[PublishedMessage], Frame]:
    """Return the encoder of samples as events; the event id is the time of publishing in nanoseconds."""

    def encode(sample: PublishedMessage) -> Frame:
        head = b"id: %d\ndata: " % sample.stamp_ns
        return Frame(head, *map(one_line, sample.payload.json_parts()), b"\n\n")

    return encode


SAMPLES: Final = Encoding("events", 0, _sample_encoder)
"""Samples as events of the default name, ``message``."""


class EventQueue:
    """Queue of events for one reader: a :class:`rwt_transports.endpoint.Flow` and an asynchronous iterator.

    When it is full, the oldest samples are dropped (`on_drop`); notices and ends are not.
    """

    def __init__(
        self, depth: int, max_bytes: int, on_drop: Callable[[DropReason], None], on_close: Callable[[], None]
    ) -> None:
        self._depth = depth
        self._max_bytes = max_bytes
        self._on_drop = on_drop
        self._on_close = on_close
        self._waiting: deque[bytes] = deque()
        self._own: deque[bytes] = deque()
        self._size = 0
        self._awake = anyio.Event()
        self._ended = False
        self._closed = False

    # -- sending: methods of Flow ----------------------------------------------------------------------------

    def send(self, frame: Frame) -> None:
        """Queue one sample."""
        self.put(frame.framed(_whole))

    def put(self, data: bytes) -> None:
        """Queue the bytes of one event; the oldest samples are dropped for it."""
        if self._ended:
            return
        if len(data) > self._max_bytes:  # It would displace all others, and still not fit.
            self._on_drop(DropReason.SIZE)
            return
        self._waiting.append(data)
        self._size += len(data)
        while self._size > self._max_bytes or len(self._waiting) > self._depth:
            reason = DropReason.BACKLOG if self._size > self._max_bytes else DropReason.QUEUE
            self._size -= len(self._waiting.popleft())
            self._on_drop(reason)
        self._awake.set()

    def join(self, burst: Burst) -> bool:
        """No-op: each sample is queued on its own."""
        return False

    def send_message(self, pieces: Sequence[Frame], expires_ns: int = 0) -> None:
        """Queue one sample; it is sent whole."""
        for piece in pieces:
            self.send(piece)

    def configure(self, rules: FlowRules) -> None:
        """No-op: the rules are constructor arguments."""

    def tell(self, data: bytes) -> None:
        """Queue an event that is not dropped, in front of the samples."""
        if not self._ended:
            self._own.append(data)
            self._awake.set()

    def end(self) -> None:
        """Accept no further events; queued ones are still sent."""
        self._ended = True
        self._awake.set()

    def close(self, last: bytes = b"") -> None:
        """Discard the queue and accept no further events. Idempotent.

        Args:
            last: event that the reader still receives.
        """
        self._ended = True
        self._waiting.clear()
        self._own.clear()
        if last:
            self._own.append(last)
        self._size = 0
        self._awake.set()
        if not self._closed:
            self._closed = True
            self._on_close()

    # -- reading -------------------------------------------------------------------------------------------

    def __aiter__(self) -> EventQueue:
        return self

    async def __anext__(self) -> bytes:
        if not (self._own or self._waiting):
            if self._ended:
                raise StopAsyncIteration
            self._awake = anyio.Event()
            with anyio.move_on_after(KEEP_ALIVE_SECONDS):
                await self._awake.wait()
            if not (self._own or self._waiting):
                if self._ended:
                    raise StopAsyncIteration
                # A comment, so that proxies do not close a silent response.
                return _KEEP_ALIVE
        return self._take()

    def _take(self) -> bytes:
        taken = list(self._own)
        self._own.clear()
        # Joined up to a limit: one write per event would cost more, and a copy of all would take long.
        room = _CHUNK_BYTES
        while self._waiting and room > 0:
            data = self._waiting.popleft()
            self._size -= len(data)
            room -= len(data)
            taken.append(data)
        return b"".join(taken)

    async def aclose(self) -> None:
        """Release the queue: the reader disconnected, or the stream has ended."""
        self.close()
