"""Our server in this process on a simulated clock, as the suite's player sees servers: wires and a pace."""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, closing
from dataclasses import dataclass
from functools import partial

from conformance.runner import Conditions, Run, run_cases
from conformance.suite.case import Case
from conformance.suite.target import Target
from conformance.wire.wires import Dial, Wire, WireClosed, framing_of
from rwt.settings.models import Settings
from rwt_bridge.bridge import Bridge
from rwt_graph.clock import SimulatedClock
from rwt_graph.memory.graph import MemoryGraph
from rwt_interfaces.distro import DISTROS
from rwt_interfaces.registry import Registry
from rwt_nodes.rosapi import Rosapi
from rwt_nodes.tf import Tf2WebRepublisher
from rwt_protocol.transport import Accept, Frame, PeerInfo
from rwt_transports.drivers.memory import MemoryPeer

Spoil = Callable[[Accept], Accept]
"""Puts a fault between the wire and the server."""

_TURNS = 6
_TICK = 0.01
_NO_TIME = 1e-6


class _Arrivals(list[Frame]):
    """What a peer has received; tells when there is more."""

    def __init__(self) -> None:
        super().__init__()
        self.more = asyncio.Event()

    def append(self, frame: Frame) -> None:
        super().append(frame)
        self.more.set()


class MemoryWire(Wire):
    """A connection without a network."""

    def __init__(self, accept: Accept) -> None:
        self._arrivals = _Arrivals()
        self._taken = 0
        self._peer = MemoryPeer(accept, PeerInfo("memory", "192.0.2.1"))
        self._arrivals += self._peer.received
        self._peer.received = self._arrivals

    async def send(self, data: str | bytes) -> None:
        if self._peer.closed is not None:
            raise WireClosed(self._peer.closed[0])
        self._peer.send(data)

    async def receive(self) -> str | bytes:
        while self._taken == len(self._arrivals):
            if self._peer.closed is not None:
                raise WireClosed(self._peer.closed[0])
            self._arrivals.more.clear()
            try:
                async with asyncio.timeout(0.02):
                    await self._arrivals.more.wait()
            except TimeoutError:
                continue  # A close makes no noise here, so it is looked for.
        frame = self._arrivals[self._taken]
        self._taken += 1
        return frame.data if frame.binary else frame.data.decode()

    async def close(self, *, abruptly: bool = False) -> None:
        self._peer.close(1006 if abruptly else 1000)


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
