"""Small wrong behaviours, put between the wire and a right server: what it hears or says is altered.

Each stands for a slip that is easily made inside a server. A fault is a name, the cases that have to find it,
and a function for one direction.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from time import time_ns

from rosbridge_conformance.suite.values import Json
from rwt_protocol.frames import Burst, Frame
from rwt_transports.endpoint import (
    AS_MANY_AS_FIT,
    Accept,
    DropReason,
    Endpoint,
    Flow,
    FlowRules,
    PeerInfo,
    Sink,
    Traffic,
)
from rwt_transports.shared_pool import Holder

Message = dict[str, Json]


@dataclass(slots=True)
class Memory:
    """State of a fault: of one connection, and of the whole server."""

    server: dict[str, Json]
    here: dict[str, Json] = field(default_factory=dict)


Alter = Callable[[Message, Memory], list[Message] | None]
"""From one message to those that go on in its place; None leaves it as it is."""


def on(op: str, change: Callable[[Message], Message | None]) -> Alter:
    """Alter messages of one op; None drops them."""

    def alter(message: Message, memory: Memory) -> list[Message] | None:
        if message.get("op") != op:
            return None
        changed = change(dict(message))
        return [] if changed is None else [changed]

    return alter


def put(op: str, **fields: Json) -> Alter:
    return on(op, lambda message: {**message, **fields})


def without(op: str, *keys: str) -> Alter:
    return on(op, lambda message: {name: value for name, value in message.items() if name not in keys})


def drop(op: str, when: Callable[[Message], bool] = lambda message: True) -> Alter:
    return on(op, lambda message: None if when(message) else message)


def twice(op: str) -> Alter:
    return lambda message, memory: [message, message] if message.get("op") == op else None


@dataclass(frozen=True, slots=True)
class Fault:
    """One wrong behaviour.

    Attributes:
        name: what the server does wrong.
        cases: globs of the cases (by id or rule) that ask about it.
        hears: alters what clients send.
        says: alters text frames to clients.
        says_bytes: alters binary frames to clients.
        ros: the ROS generation of the server it is put into.
    """

    name: str
    cases: tuple[str, ...]
    hears: Alter | None = None
    says: Alter | None = None
    says_bytes: Callable[[bytes], bytes] | None = None
    ros: int = 2

    def spoil(self, accept: Accept) -> Accept:
        """The server with the fault in it."""
        server: dict[str, Json] = {}

        def spoilt(sink: Sink, info: PeerInfo) -> Endpoint:
            memory = Memory(server)
            spoilt_sink = _SpoiltSink(sink, self, memory)
            spoilt_sink.endpoint = _SpoiltEndpoint(accept(spoilt_sink, info), self, memory)
            return spoilt_sink.endpoint

        return spoilt


def altered(alter: Alter, data: bytes, memory: Memory) -> list[bytes]:
    """The messages in place of one; text that is no object goes through."""
    try:
        value = json.loads(data)
    except ValueError:
        return [data]
    outcome = alter(value, memory) if isinstance(value, dict) else None
    return [data] if outcome is None else [json.dumps(message).encode() for message in outcome]


class _SpoiltEndpoint(Endpoint):
    def __init__(self, endpoint: Endpoint, fault: Fault, memory: Memory) -> None:
        self.inner = endpoint
        self._fault = fault
        self._memory = memory

    def receive(self, data: bytes, binary: bool) -> None:
        hears = self._fault.hears
        for message in [data] if hears is None or binary else altered(hears, data, self._memory):
            self.inner.receive(message, binary)

    def closed(self, code: int, reason: str) -> None:
        self.inner.closed(code, reason)


class _SpoiltSink(Sink):
    def __init__(self, sink: Sink, fault: Fault, memory: Memory) -> None:
        self._sink = sink
        self._fault = fault
        self._memory = memory
        self.endpoint: _SpoiltEndpoint | None = None

    def altered(self, frame: Frame) -> list[Frame]:
        """The frames in place of one."""
        if frame.binary:
            alter = self._fault.says_bytes
            return [frame if alter is None else Frame(alter(frame.data), binary=True)]
        if self._fault.says is None:
            return [frame]
        return [Frame(data) for data in altered(self._fault.says, frame.data, self._memory)]

    def send(self, frame: Frame) -> None:
        for altered in self.altered(frame):
            self._sink.send(altered)

    def flow(
        self,
        topic: str,
        rules: FlowRules = AS_MANY_AS_FIT,
        *,
        on_drop: Callable[[DropReason], None] | None = None,
        time_ns: Callable[[], int] = time_ns,
    ) -> Flow:
        return _SpoiltFlow(self._sink.flow(topic, rules, on_drop=on_drop, time_ns=time_ns), self)

    def close(self, code: int = 1000, reason: str = "") -> None:
        self._sink.close(code, reason)

    def count_for(self, holder: Holder) -> None:
        self._sink.count_for(holder)

    def hand_over(self, endpoint: Endpoint) -> None:
        assert self.endpoint is not None
        self.endpoint.inner = endpoint

    @property
    def received(self) -> int:
        return self._sink.received

    @property
    def backlog(self) -> int:
        return self._sink.backlog

    @property
    def traffic(self) -> Traffic:
        return self._sink.traffic


class _SpoiltFlow(Flow):
    def __init__(self, flow: Flow, sink: _SpoiltSink) -> None:
        self._flow = flow
        self._sink = sink

    def send(self, frame: Frame) -> None:
        for altered in self._sink.altered(frame):
            self._flow.send(altered)

    def join(self, burst: Burst) -> bool:
        return False

    def send_message(self, pieces: Sequence[Frame], expires_ns: int = 0) -> None:
        for piece in pieces:
            self.send(piece)

    def configure(self, rules: FlowRules) -> None:
        self._flow.configure(rules)

    def close(self) -> None:
        self._flow.close()
