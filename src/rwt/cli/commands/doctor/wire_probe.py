"""Minimal rosbridge client that sends single ops and keeps every frame as it arrived.

`rwt doctor` checks the encodings themselves, which a full client would decode and hide.
"""

from __future__ import annotations

import json
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final

import anyio

from rwt_protocol.codecs import ENCODINGS, SELECTABLE
from rwt_protocol.codecs.base import Codec, DecodeFailure
from rwt_protocol.frames import Frame
from rwt_protocol.limits import WireLimits
from rwt_protocol.payloads import Decoded
from rwt_transports.endpoint import PeerInfo, Sink

_LIMITS: Final = WireLimits(max_depth=64)
"""Maximum nesting depth of a message of the server."""

#: Limits of what a server can make the probe keep.
_COMPLAINTS: Final = 1000
_COMPLAINT_CHARS: Final = 500
_UNREAD_FRAMES: Final = 256


@dataclass(frozen=True, slots=True)
class ReceivedFrame:
    """Message of the server.

    Attributes:
        encoding: name of the encoding; `none` for text.
        size: length in bytes.
        op: decoded op; empty if the encoding is unknown.
    """

    encoding: str
    size: int
    op: Mapping[str, Any]

    @property
    def values(self) -> Mapping[str, Any]:
        """Values of a service response; empty if the op has none."""
        values = self.op.get("values")
        return values if isinstance(values, dict) else {}

    def is_op(self, name: str, **members: object) -> bool:
        """True if this is an op of that name with these members."""
        return self.op.get("op") == name and all(self.op.get(key) == value for key, value in members.items())


class WireProbe:
    """Probe of one connection; pass :meth:`accept` to :func:`rwt_transports.connect.connect`.

    Attributes:
        complaints: texts of the `status` messages received.
        closed_with: close code and reason, once the server has closed the connection.
    """

    def __init__(self) -> None:
        self.complaints: list[str] = []
        self.closed_with: tuple[int, str] | None = None
        self._sink: Sink | None = None
        self._received: deque[ReceivedFrame] = deque(maxlen=_UNREAD_FRAMES)
        self._awake = anyio.Event()

    def accept(self, sink: Sink, peer: PeerInfo) -> WireProbe:
        """Called when the connection has opened."""
        self._sink = sink
        return self

    def receive(self, data: bytes, binary: bool) -> None:
        """Receive a message; satisfies :class:`rwt_transports.endpoint.Endpoint`."""
        first = data[:1] if binary else b""
        of_binary = (each for each in SELECTABLE if first and first in each.first_bytes)
        encoding = next(of_binary, ENCODINGS["none"])
        op = _decoded(data, encoding.codec and encoding.codec())
        frame = ReceivedFrame(encoding.name, len(data), op)

        if frame.is_op("status") and len(self.complaints) < _COMPLAINTS:
            self.complaints.append(str(frame.op.get("msg", ""))[:_COMPLAINT_CHARS])
        self._received.append(frame)
        self._awake.set()

    def closed(self, code: int, reason: str) -> None:
        """Called when the connection has closed."""
        self.closed_with = (code, reason)
        self._awake.set()

    def send(self, op: str, **members: object) -> None:
        """Send an op."""
        assert self._sink is not None  # Nothing is sent before the connection is open.
        self._sink.send(Frame(json.dumps({"op": op, **members}).encode()))

    async def expect(self, wanted: Callable[[ReceivedFrame], bool], patience: float) -> ReceivedFrame | None:
        """Return the next frame that matches, dropping those before it; None on timeout."""
        with anyio.move_on_after(patience):
            while True:
                while self._received:
                    frame = self._received.popleft()
                    if wanted(frame):
                        return frame
                if self.closed_with is not None:
                    return None
                self._awake = anyio.Event()
                await self._awake.wait()
        return None

    async def call(self, service: str, patience: float) -> ReceivedFrame | None:
        """Call a service without arguments; None on timeout."""
        id = f"doctor:{service}"
        self.send("call_service", service=service, id=id, args={})
        return await self.expect(
            # Old servers send status messages without an id, which may be the answer.
            lambda frame: (
                frame.is_op("service_response", id=id)
                or (frame.is_op("status") and frame.op.get("id") in (None, id))
            ),
            patience,
        )


def _decoded(data: bytes, codec: Codec | None) -> Mapping[str, Any]:
    if codec is not None:
        members = codec.split(data, _LIMITS)[0]
        if isinstance(members, DecodeFailure):
            return {}
        return {name: each.value if isinstance(each, Decoded) else each for name, each in members.items()}
    try:
        found = json.loads(data)
    except (ValueError, RecursionError):
        return {}
    return found if isinstance(found, dict) else {}
