"""A rosbridge client whose wire is a list."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from rwt_bridge.bridge import Bridge
from rwt_bridge.doorstep import Doorstep
from rwt_bridge.peer import Peer
from rwt_protocol.frames import Frame, Lane, PeerInfo

Message = dict[str, Any]


class Client:
    """One rosbridge client whose wire is two lists."""

    def __init__(
        self,
        bridge: Bridge,
        address: str = "127.0.0.1",
        *,
        path: str = "/",
        headers: Mapping[str, str] | None = None,
        loopback: bool = True,
    ) -> None:
        self.frames: list[tuple[Frame, Lane, str]] = []
        self.close_code: int | None = None
        self.close_reason = ""
        info = PeerInfo("memory", address=address, path=path, headers=headers or {})
        self.endpoint = bridge.accept(self, info, loopback=loopback)

    def send(self, frame: Frame, lane: Lane = Lane.CONTROL, topic: str = "") -> None:
        self.frames.append((frame, lane, topic))

    def close(self, code: int = 1000, reason: str = "") -> None:
        self.close_code = code
        self.close_reason = reason

    @property
    def peer(self) -> Peer:
        """What the bridge holds of this client, once it has let it in."""
        if isinstance(self.endpoint, Doorstep):
            assert self.endpoint.peer is not None
            return self.endpoint.peer
        assert isinstance(self.endpoint, Peer)
        return self.endpoint

    @property
    def backlog(self) -> int:
        return 0

    def say(self, op: str, **fields: object) -> None:
        """Send one op."""
        self.say_raw(json.dumps({"op": op, **fields}))

    def say_raw(self, text: str | bytes, binary: bool = False) -> None:
        self.endpoint.receive(text.encode() if isinstance(text, str) else text, binary)

    def heard(self) -> list[Message]:
        """Everything that has come since the last time."""
        frames, self.frames = self.frames, []
        return [json.loads(frame.data) for frame, _, _ in frames]

    def heard_of(self, topic: str) -> list[Any]:
        """The messages of one topic that have come."""
        return [message["msg"] for message in self.heard() if message.get("topic") == topic]

    def leave(self) -> None:
        self.endpoint.closed(1001, "gone")
