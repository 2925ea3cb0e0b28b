"""A client of the bridge in this process that counts what a WebSocket would have carried to it."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from time import time_ns
from typing import Any

import cbor2

from rwt.rosbridge import Bridge
from rwt_protocol.frames import Burst, Frame
from rwt_transports.endpoint import AS_MANY_AS_FIT, DropReason, Endpoint, FlowRules, PeerInfo, Traffic
from rwt_transports.shared_pool import Holder

Take = Callable[[Any], None]


class CountingClient:
    """One client; satisfies :class:`rwt_transports.endpoint.Sink`.

    Attributes:
        received: bytes so far, with the WebSocket headers that a server adds.
    """

    def __init__(self, bridge: Bridge, take: Take) -> None:
        self.received = 0
        self.traffic = Traffic()
        self._take = take
        info = PeerInfo("memory", address="127.0.0.1", path="/")
        self._endpoint = bridge.accept(self, info, loopback=True)

    def say(self, **op: object) -> None:
        """Send an op."""
        self._endpoint.receive(json.dumps(op).encode(), False)

    def send(self, frame: Frame) -> None:
        """Take a frame."""
        self.received += frame.size + header_size(frame.size)
        data = bytes(frame.data)
        self._take(cbor2.loads(data) if frame.binary else json.loads(data))

    def join(self, burst: Burst) -> bool:
        """Take each frame by itself."""
        return False

    def send_message(self, pieces: Sequence[Frame], expires_ns: int = 0) -> None:
        """Take a message."""
        for piece in pieces:
            self.send(piece)

    def flow(
        self,
        topic: str,
        rules: FlowRules = AS_MANY_AS_FIT,
        *,
        on_drop: Callable[[DropReason], None] | None = None,
        time_ns: Callable[[], int] = time_ns,
    ) -> CountingClient:
        """Return this client, which is the flow of every topic and never held back."""
        return self

    def configure(self, rules: FlowRules) -> None:
        """No-op: nothing is held back."""

    def close(self, code: int = 1000, reason: str = "") -> None:
        """No-op."""

    def count_for(self, holder: Holder) -> None:
        """No-op: there is no pool of connections."""

    def hand_over(self, endpoint: Endpoint) -> None:
        """Speak with another endpoint."""
        self._endpoint = endpoint

    @property
    def backlog(self) -> int:
        """Return 0: frames are not queued."""
        return 0


def header_size(payload: int) -> int:
    """Bytes in front of a frame from a server (RFC 6455, section 5.2)."""
    return 2 if payload < 126 else 4 if payload < 65536 else 10
