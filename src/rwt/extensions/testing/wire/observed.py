"""Layer between transport and bridge that records messages and injects faults.

It wraps `Accept`, `Sink` and `Endpoint` of :mod:`rwt_transports.endpoint`; the server above and the transport
below are the real ones.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

from rwt.access.settings import SettingsError
from rwt.extensions.testing.wire.faults import PASS, Faults, Subject
from rwt.extensions.testing.wire.transcript import Transcript, shown_bytes, shown_frame
from rwt_protocol.codecs import bson_codec
from rwt_protocol.errors import EncodingUnavailable
from rwt_protocol.frames import Burst, Frame
from rwt_protocol.ops import Direction, Op
from rwt_protocol.session import Refusal, Session
from rwt_transports.api import OversizeAware
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
from rwt_transports.errors import Refused
from rwt_transports.shared_pool import Holder

if TYPE_CHECKING:
    from rwt_graph.api import Graph
    from rwt_graph.clock import Clock
    from rwt_protocol.codecs.base import Codec


class ObservedWire:
    """Records and disturbs every connection of a server, as its `middleware`.

    Args:
        graph: graph of the robot; faults follow its clock and run on its thread.
        bson: True if the server speaks only BSON.

    Attributes:
        faults: active faults.

    Raises:
        SettingsError: BSON requires a package that is not installed.
    """

    def __init__(self, graph: Graph, *, bson: bool = False) -> None:
        self.faults = Faults(self._hang_up)
        self.transcript = Transcript(graph.clock.monotonic)
        self._graph = graph
        self.clock = graph.clock
        self._codec = _bson() if bson else None
        self._open: dict[int, Sink] = {}
        self._count = 0

    @property
    def client_count(self) -> int:
        """Number of connected clients."""
        return len(self._open)

    def middleware(self, accept: Accept) -> Accept:
        """Wrap the accept function of a listener."""
        return partial(self._accept, accept)

    def _accept(self, accept: Accept, sink: Sink, info: PeerInfo) -> Endpoint:
        status = self.faults.refusal()
        if status is not None:
            self.transcript.note(0, f"from {info.address} was refused by a fault: {status}")
            raise Refused(status, "refused by a fault of the test")
        number = self._count = self._count + 1
        observed = _ObservedSink(self, sink, number)
        try:
            endpoint = accept(observed, info)
        except Refused as refused:
            self.transcript.note(number, f"was refused: {refused.status} {refused}")
            raise
        self._open[number] = sink
        self.transcript.note(number, f"came from {info.address or '?'} over {info.transport}")
        observed.endpoint = _ObservedEndpoint(self, endpoint, observed, number)
        return observed.endpoint

    def session(self, direction: Direction) -> Session:
        """Return a session that only parses messages."""
        return Session(direction=direction, codec=self._codec)

    def left(self, number: int, code: int, reason: str) -> None:
        """Record that a client has disconnected."""
        self._open.pop(number, None)
        self.transcript.note(number, f"left: {code} {reason}".rstrip())

    def _hang_up(self, code: int, reason: str) -> int:
        sinks = tuple(self._open.values())

        def close() -> None:
            for sink in sinks:
                sink.close(code, reason)

        self._graph.run_on_graph(close)
        return len(sinks)


def _bson() -> Codec:
    try:
        return bson_codec()
    except EncodingUnavailable as missing:
        raise SettingsError(f"`bson_only_mode`: {missing.reason}") from None


def _subjects(items: Sequence[Op | Refusal]) -> list[Subject]:
    subjects = []
    for item in items:
        if isinstance(item, Refusal):
            subjects.append((item.op, item.name))
            continue
        names = (getattr(item, member, None) for member in ("topic", "service", "action"))
        subjects.append((item.op, next((name for name in names if name), "")))
    return subjects


class _ObservedEndpoint:
    def __init__(self, wire: ObservedWire, inner: Endpoint, sink: _ObservedSink, number: int) -> None:
        self._wire = wire
        self.inner = inner
        self._sink = sink
        self._number = number
        self._session = wire.session(Direction.TO_SERVER)
        self._over = False

    def receive(self, data: bytes, binary: bool) -> None:
        wire = self._wire
        # The name is known only after the last fragment: parse fragments even if no fault is active.
        subjects = _subjects(self._session.decode(data, binary, time.monotonic()))
        action = wire.faults.action_for("server", subjects) if wire.faults else PASS
        wire.transcript.message(self._number, "→", shown_bytes(data, binary), action.remark)
        for _ in range(action.copies):
            if action.delay <= 0:
                self.inner.receive(data, binary)
            else:
                wire.clock.call_later(action.delay, partial(self._receive_late, bytes(data), binary))

    def _receive_late(self, data: bytes, binary: bool) -> None:
        if not self._over:
            self.inner.receive(data, binary)

    def oversized(self, size: int, limit: int, head: bytes) -> None:
        self._wire.transcript.message(self._number, "→", f"<{size} bytes: too large, skipped>")
        if isinstance(self.inner, OversizeAware):
            self.inner.oversized(size, limit, head)

    def closed(self, code: int, reason: str) -> None:
        self._over = True
        self._sink.over = True
        self._wire.left(self._number, code, reason)
        self.inner.closed(code, reason)


class _ObservedSink:
    def __init__(self, wire: ObservedWire, inner: Sink, number: int) -> None:
        self.wire = wire
        self.inner = inner
        self.number = number
        self.over = False
        self.endpoint: _ObservedEndpoint | None = None
        self.slow_reader = SlowReader(wire.clock, lambda: wire.faults.read_rate)
        self._session = wire.session(Direction.TO_CLIENT)

    def send(self, frame: Frame) -> None:
        subjects = _subjects(self._session.decode(frame.data, frame.binary, time.monotonic()))
        self.pass_on(frame, subjects, None, lambda: self.inner.send(frame))

    def flow(
        self,
        topic: str,
        rules: FlowRules = AS_MANY_AS_FIT,
        *,
        on_drop: Callable[[DropReason], None] | None = None,
        time_ns: Callable[[], int] = time.time_ns,
    ) -> Flow:
        def dropped(reason: DropReason) -> None:
            self.wire.transcript.note(self.number, f"✗ a message on {topic} was dropped: {reason}")
            if on_drop is not None:
                on_drop(reason)

        inner = self.inner.flow(topic, rules, on_drop=dropped, time_ns=time_ns)
        return _ObservedFlow(self, inner, topic, rules, dropped)

    def pass_on(
        self, frame: Frame, subjects: list[Subject], flow: _ObservedFlow | None, send: Callable[[], None]
    ) -> None:
        if self.over:
            return
        action = self.wire.faults.action_for("client", subjects) if self.wire.faults else PASS
        self.wire.transcript.message(self.number, "←", shown_frame(frame), action.remark)
        for _ in range(action.copies):
            if action.delay <= 0:
                self._now(flow, send)
            else:
                self.wire.clock.call_later(action.delay, partial(self._now, flow, send))

    def _now(self, flow: _ObservedFlow | None, send: Callable[[], None]) -> None:
        if self.over:
            return
        if self.slow_reader.idle and self.wire.faults.read_rate is None:
            send()
        else:
            self.slow_reader.put(send, flow)

    def close(self, code: int = 1000, reason: str = "") -> None:
        self.slow_reader.flush()
        self.inner.close(code, reason)

    def count_for(self, holder: Holder) -> None:
        self.inner.count_for(holder)

    def hand_over(self, endpoint: Endpoint) -> None:
        if self.over:
            self.inner.hand_over(endpoint)
        elif self.endpoint is not None:
            self.endpoint.inner = endpoint

    @property
    def received(self) -> int:
        return self.inner.received

    @property
    def backlog(self) -> int:
        return self.inner.backlog

    @property
    def traffic(self) -> Traffic:
        return self.inner.traffic


@dataclass(eq=False)
class _ObservedFlow:
    sink: _ObservedSink
    inner: Flow
    topic: str
    rules: FlowRules
    on_drop: Callable[[DropReason], None]

    def send(self, frame: Frame) -> None:
        self.sink.pass_on(frame, [("publish", self.topic)], self, lambda: self.inner.send(frame))

    def join(self, burst: Burst) -> bool:
        return False

    def send_message(self, pieces: Sequence[Frame], expires_ns: int = 0) -> None:
        send = partial(self.inner.send_message, pieces, expires_ns)
        self.sink.pass_on(pieces[0], [("publish", self.topic)], self, send)

    def configure(self, rules: FlowRules) -> None:
        self.rules = rules
        self.inner.configure(rules)

    def close(self) -> None:
        self.inner.close()


#: Maximum number of queued messages per client, over all topics; beyond it, the oldest of a topic is dropped.
MOST_WAITING = 10_000


class SlowReader:
    """Sends messages at the rate of a slow reader, in order.

    Args:
        read_rate: returns the current rate in messages per second; None for no limit, which flushes the
            queue.
    """

    def __init__(self, clock: Clock, read_rate: Callable[[], float | None]) -> None:
        self._clock = clock
        self._read_rate = read_rate
        self._waiting: deque[tuple[Callable[[], None], _ObservedFlow | None]] = deque()
        self._ticking = False

    @property
    def idle(self) -> bool:
        """True if the queue is empty."""
        return not self._waiting

    def put(self, send: Callable[[], None], flow: _ObservedFlow | None) -> None:
        """Queue a message; it is sent at once if the queue is empty.

        Args:
            flow: flow of the topic, whose oldest messages may be dropped; None for a reply, which never is.
        """
        if flow is not None:
            if flow.rules.depth is not None:
                while sum(each is flow for _, each in self._waiting) >= max(1, flow.rules.depth):
                    self._drop_oldest(DropReason.QUEUE, flow)
            if len(self._waiting) >= MOST_WAITING:
                self._drop_oldest(DropReason.BACKLOG)
        self._waiting.append((send, flow))
        if not self._ticking:
            self._tick()

    def _drop_oldest(self, reason: DropReason, only: _ObservedFlow | None = None) -> None:
        for item in self._waiting:
            flow = item[1]
            if flow is not None and only in (None, flow):
                self._waiting.remove(item)
                flow.on_drop(reason)
                return

    def _tick(self) -> None:
        self._ticking = False
        read_rate = self._read_rate()
        if read_rate is None:
            self.flush()
        elif self._waiting:
            self._ticking = True
            self._clock.call_later(1.0 / read_rate, self._tick)
            self._waiting.popleft()[0]()

    def flush(self) -> None:
        """Send all queued messages now."""
        while self._waiting:
            self._waiting.popleft()[0]()
