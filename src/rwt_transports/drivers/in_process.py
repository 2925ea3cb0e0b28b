"""Pair of endpoints in one process: each receives the other's frames one loop turn later, unencoded."""

from __future__ import annotations

from collections import deque
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import asynccontextmanager
from time import time_ns

import anyio
import anyio.lowlevel

from rwt_protocol.frames import Burst, Frame
from rwt_transports.background import background_tasks
from rwt_transports.endpoint import (
    AS_MANY_AS_FIT,
    Accept,
    DropReason,
    Endpoint,
    Flow,
    FlowRules,
    PeerInfo,
    Traffic,
)
from rwt_transports.shared_pool import Holder


class InProcessEnd:
    """Sink of one of the two endpoints. Implements :class:`rwt_transports.endpoint.Sink`."""

    __slots__ = ("_closing", "_frames", "_size", "awake", "opposite", "other", "received")

    def __init__(self, awake: anyio.Event) -> None:
        self.awake = awake
        self._frames: deque[Frame] = deque()
        self._size = 0
        self.received = 0
        self._closing: tuple[int, str] | None = None
        self.other: Endpoint | None = None
        self.opposite = self

    def send(self, frame: Frame) -> None:
        if self._closing is None:
            self._frames.append(frame)
            self._size += frame.size
            self.awake.set()

    def close(self, code: int = 1000, reason: str = "") -> None:
        if self._closing is None:
            self._closing = (code, reason)
            self.awake.set()

    def hand_over(self, endpoint: Endpoint) -> None:
        if self.opposite.other is None:
            endpoint.closed(*(self._closing or (1000, "")))
        else:
            self.opposite.other = endpoint

    def count_for(self, holder: Holder) -> None:
        """No-op: there is no pool of connections."""

    def flow(
        self,
        topic: str,
        rules: FlowRules = AS_MANY_AS_FIT,
        *,
        on_drop: Callable[[DropReason], None] | None = None,
        time_ns: Callable[[], int] = time_ns,
    ) -> Flow:
        return _EndFlow(self)

    @property
    def backlog(self) -> int:
        return self._size

    @property
    def traffic(self) -> Traffic:
        return Traffic(queued_messages=len(self._frames), queued_bytes=self._size)

    async def drained(self) -> None:
        """Return at once: there is no network."""
        await anyio.lowlevel.checkpoint()

    def deliver(self) -> tuple[int, str] | None:
        """Deliver sent frames; return code and reason once this side is closed."""
        self.opposite.received += self._size
        for _ in range(len(self._frames)):
            frame = self._frames.popleft()
            self._size -= frame.size
            if self.other is not None:
                self.other.receive(frame.data, frame.binary)
        return None if self._frames else self._closing


class _EndFlow:
    """Flow of one topic to the other side, which is never slow."""

    __slots__ = ("_end",)

    def __init__(self, end: InProcessEnd) -> None:
        self._end = end

    def send(self, frame: Frame) -> None:
        self._end.send(frame)

    def join(self, burst: Burst) -> bool:
        return False

    def send_message(self, pieces: Sequence[Frame], expires_ns: int = 0) -> None:
        for frame in pieces:
            self._end.send(frame)

    def configure(self, rules: FlowRules) -> None:
        """No-op: rules only apply to slow readers."""

    def close(self) -> None:
        """No-op: nothing is dropped."""


@asynccontextmanager
async def connect_in_process(far: Accept, near: Accept) -> AsyncIterator[InProcessEnd]:
    """Connect the endpoints of two accept functions for the length of the block.

    The block continues when a side closes, which calls the `closed` of both endpoints. Leaving it closes with
    1000.

    Args:
        far: factory of the endpoint that is connected to; it is asked first, and may raise
            :exc:`~rwt_transports.errors.Refused`.
        near: factory of the connecting side's endpoint.
    """
    awake = anyio.Event()
    ours, theirs = InProcessEnd(awake), InProcessEnd(awake)
    ours.opposite, theirs.opposite = theirs, ours
    ours.other = far(theirs, PeerInfo("memory"))
    theirs.other = near(ours, PeerInfo("memory"))
    async with background_tasks() as tasks:
        tasks.start_soon(_pump, ours, theirs)
        try:
            yield ours
        finally:
            ours.close(1000, "")
            # The other side still receives frames sent before the close.
            _end(ours, theirs, ours.deliver() or (1000, ""))


async def _pump(ours: InProcessEnd, theirs: InProcessEnd) -> None:
    while True:
        awake = anyio.Event()
        ours.awake = theirs.awake = awake
        for end in (ours, theirs):
            closing = end.deliver()
            if closing is not None:
                _end(ours, theirs, closing)
                return
        if not (ours.backlog or theirs.backlog):
            await awake.wait()
        else:
            await anyio.lowlevel.checkpoint()


def _end(ours: InProcessEnd, theirs: InProcessEnd, closing: tuple[int, str]) -> None:
    for end in (ours, theirs):
        end.close(*closing)
        endpoint, end.other = end.other, None
        if endpoint is not None:
            endpoint.closed(*closing)
