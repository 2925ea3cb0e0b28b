"""A rosbridge client whose wire is a list."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from time import time_ns
from typing import Any

from rwt.rosbridge.bridge import Bridge
from rwt.rosbridge.peer import Peer
from rwt_protocol.frames import Burst, Frame
from rwt_transports.endpoint import AS_MANY_AS_FIT, DropReason, Endpoint, FlowRules, PeerInfo, Traffic
from rwt_transports.shared_pool import Holder

Message = dict[str, Any]


class RecordingFlow:
    """One topic's way to a client: what the bridge asked of it."""

    def __init__(
        self, client: Client, topic: str, rules: FlowRules, on_drop: Callable[[DropReason], None] | None
    ) -> None:
        self._client = client
        self.topic = topic
        self.rules = rules
        self.drop = on_drop
        self.expiries: list[int] = []
        self.closed = False

    def send(self, frame: Frame) -> None:
        self._client.frames.append((frame, self.topic))

    def join(self, burst: Burst) -> bool:
        return False

    def send_message(self, pieces: Sequence[Frame], expires_ns: int = 0) -> None:
        self.expiries.append(expires_ns)
        for frame in pieces:
            self.send(frame)

    def configure(self, rules: FlowRules) -> None:
        self.rules = rules

    def close(self) -> None:
        self.closed = True


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
        self.frames: list[tuple[Frame, str | None]] = []
        self.flows: dict[str, RecordingFlow] = {}
        self.traffic = Traffic()
        self.received = 0
        self.close_code: int | None = None
        self.close_reason = ""
        info = PeerInfo("memory", address=address, path=path, headers=headers or {})
        self.endpoint = bridge.accept(self, info, loopback=loopback)

    def send(self, frame: Frame) -> None:
        self.frames.append((frame, None))

    def flow(
        self,
        topic: str,
        rules: FlowRules = AS_MANY_AS_FIT,
        *,
        on_drop: Callable[[DropReason], None] | None = None,
        time_ns: Callable[[], int] = time_ns,
    ) -> RecordingFlow:
        self.flows[topic] = RecordingFlow(self, topic, rules, on_drop)
        return self.flows[topic]

    def close(self, code: int = 1000, reason: str = "") -> None:
        self.close_code = code
        self.close_reason = reason

    def count_for(self, holder: Holder) -> None:
        """No-op: there is no pool of connections."""

    def hand_over(self, endpoint: Endpoint) -> None:
        self.endpoint = endpoint

    @property
    def peer(self) -> Peer:
        """State of this client in the bridge, once it is admitted."""
        assert isinstance(self.endpoint, Peer)
        return self.endpoint

    @property
    def backlog(self) -> int:
        return 0

    def say(self, op: str, **fields: object) -> None:
        """Send one op."""
        self.say_raw(json.dumps({"op": op, **fields}))

    def say_raw(self, text: str | bytes, binary: bool = False) -> None:
        self.received += 1
        self.endpoint.receive(text.encode() if isinstance(text, str) else text, binary)

    def heard(self) -> list[Message]:
        """Everything that has come since the last time."""
        frames, self.frames = self.frames, []
        return [json.loads(frame.data) for frame, _ in frames]

    def heard_of(self, topic: str) -> list[Any]:
        """The messages of one topic that have come."""
        return [message["msg"] for message in self.heard() if message.get("topic") == topic]

    def leave(self) -> None:
        self.endpoint.closed(1001, "gone")
