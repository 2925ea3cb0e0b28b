"""Our server in this process on a simulated clock, as the suite's player sees servers: wires and a pace."""

from __future__ import annotations

import asyncio
import time
from collections import deque
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import asynccontextmanager, closing
from dataclasses import dataclass
from functools import partial

from rosbridge_conformance.runner import Conditions, Run, run_cases
from rosbridge_conformance.suite.case import Case
from rosbridge_conformance.suite.target import Target
from rosbridge_conformance.wire.wires import Dial, Wire, WireClosed, framing_of
from rwt.extensions.tf_stream import Tf2WebRepublisher
from rwt.rosapi import Rosapi
from rwt.rosbridge.bridge import Bridge
from rwt.settings.models import Settings
from rwt_graph.clock import SimulatedClock
from rwt_graph.memory.graph import MemoryGraph
from rwt_interfaces.distro import DISTROS
from rwt_interfaces.registry import Registry
from rwt_protocol.frames import Burst, Frame
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

Spoil = Callable[[Accept], Accept]
"""Puts a fault between the wire and the server."""

_TURNS = 6
_TICK = 0.01
_NO_TIME = 1e-6


class _ClientEnd:
    """Sink of the endpoint, with everything written to it; satisfies
    :class:`rwt_transports.endpoint.Sink`."""

    def __init__(self, accept: Accept) -> None:
        self.frames: deque[Frame] = deque()
        self.close_code: int | None = None
        self.changed = asyncio.Event()
        self.received = 0
        self.endpoint = accept(self, PeerInfo("memory", "192.0.2.1"))

    def send(self, frame: Frame) -> None:
        if self.close_code is None:
            self.frames.append(frame)
            self.changed.set()

    def flow(
        self,
        topic: str,
        rules: FlowRules = AS_MANY_AS_FIT,
        *,
        on_drop: Callable[[DropReason], None] | None = None,
        time_ns: Callable[[], int] = time.time_ns,
    ) -> Flow:
        return _ClientFlow(self)

    def close(self, code: int = 1000, reason: str = "") -> None:
        if self.close_code is None:
            self.close_code = code
            self.changed.set()
            self.endpoint.closed(code, reason)

    def count_for(self, holder: Holder) -> None:
        """No-op: there is no pool of connections."""

    def hand_over(self, endpoint: Endpoint) -> None:
        self.endpoint = endpoint

    @property
    def backlog(self) -> int:
        return 0

    @property
    def traffic(self) -> Traffic:
        return Traffic()


class _ClientFlow:
    """One topic's way to a client that is never slow."""

    def __init__(self, client: _ClientEnd) -> None:
        self.send = client.send

    def join(self, burst: Burst) -> bool:
        return False

    def send_message(self, pieces: Sequence[Frame], expires_ns: int = 0) -> None:
        for frame in pieces:
            self.send(frame)

    def configure(self, rules: FlowRules) -> None:
        """Rules are for slow readers."""

    def close(self) -> None:
        """No-op: nothing is dropped."""


class MemoryWire(Wire):
    """A connection without a network."""

    def __init__(self, accept: Accept) -> None:
        self._client = _ClientEnd(accept)

    async def send(self, data: str | bytes) -> None:
        if self._client.close_code is not None:
            raise WireClosed(self._client.close_code)
        binary = isinstance(data, bytes)
        self._client.received += 1
        self._client.endpoint.receive(data if isinstance(data, bytes) else data.encode(), binary)

    async def receive(self) -> str | bytes:
        client = self._client
        while not client.frames:
            if client.close_code is not None:
                raise WireClosed(client.close_code)
            client.changed.clear()
            await client.changed.wait()
        frame = client.frames.popleft()
        return frame.data if frame.binary else frame.data.decode()

    async def close(self, *, abruptly: bool = False) -> None:
        self._client.close(1006 if abruptly else 1000)


class VirtualPace:
    """A simulated clock; time passes only while somebody waits."""

    def __init__(self, clock: SimulatedClock) -> None:
        self._clock = clock

    def now(self) -> float:
        return self._clock.monotonic()

    async def sleep(self, seconds: float) -> None:
        await self._turn()
        until = self.now() + seconds
        while (left := until - self.now()) > _NO_TIME:
            self._clock.advance(min(left, _TICK))
            await asyncio.sleep(0)
        await self._turn()

    async def wait(self, event: asyncio.Event, seconds: float) -> bool:
        await self._turn()
        until = self.now() + seconds
        while not event.is_set() and (left := until - self.now()) > _NO_TIME:
            self._clock.advance(min(left, _TICK))
            await asyncio.sleep(0)
        return event.is_set()

    async def _turn(self) -> None:
        for _ in range(_TURNS):
            await asyncio.sleep(0)


@dataclass(frozen=True, slots=True)
class MemoryServer:
    """A server that runs.

    Attributes:
        clock: its time.
        accept: what connections go to.
    """

    clock: SimulatedClock
    accept: Accept

    async def dial(self, tag: str) -> Wire:
        return MemoryWire(self.accept)

    async def play(
        self, cases: tuple[Case, ...], target: Target, url: str = "memory", dial: Dial | None = None
    ) -> Run:
        """Play cases one by one, in memory unless `dial` connects otherwise."""
        conditions = Conditions(jobs=1, framing="messages" if dial is None else framing_of(url))
        pace = VirtualPace(self.clock)
        return await run_cases(cases, target, dial or self.dial, url, conditions, pace)


@asynccontextmanager
async def memory_server(
    distro: str,
    settings: Settings | None = None,
    spoil: Spoil | None = None,
    make_graph: Callable[[Registry, SimulatedClock], MemoryGraph] = MemoryGraph,
) -> AsyncIterator[MemoryServer]:
    """Run a server until the block is left."""
    clock = SimulatedClock(start_ns=time.time_ns())
    graph = make_graph(Registry(DISTROS[distro]), clock)
    async with graph:
        with Rosapi(graph), closing(Tf2WebRepublisher(graph)):
            bridge = Bridge(graph, settings or Settings())
            accept: Accept = partial(bridge.accept, loopback=True)
            yield MemoryServer(clock, spoil(accept) if spoil else accept)
            bridge.close()
