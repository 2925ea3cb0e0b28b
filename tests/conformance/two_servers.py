"""Two of our servers, joined over Zenoh: a case's first client is at one, the rest at the other."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import dataclass, field
from functools import partial

from rosbridge_conformance.runner import Conditions, Run, run_cases
from rosbridge_conformance.suite.case import Case
from rosbridge_conformance.suite.target import Target
from rosbridge_conformance.wire.pace import RealPace
from rosbridge_conformance.wire.wires import Wire
from rwt.extensions.zenoh import ZenohGraph
from rwt.rosapi import Rosapi
from rwt.rosbridge.bridge import Bridge
from rwt.settings.models import Settings
from rwt_interfaces.distro import JAZZY
from rwt_interfaces.registry import Registry
from rwt_transports.endpoint import Accept
from tests.conformance.memory_server import MemoryWire
from tests.zenoh_links import QUICK, free_endpoint


@dataclass(slots=True)
class TwoServers:
    """Where clients can go."""

    first: Accept
    second: Accept
    _begun: set[str] = field(default_factory=set)

    async def dial(self, tag: str) -> Wire:
        """The first client of a case, of which each has a tag of its own, or another one of it."""
        accept = self.second if tag in self._begun else self.first
        self._begun.add(tag)
        return MemoryWire(accept)

    async def play(self, cases: tuple[Case, ...], target: Target, jobs: int) -> Run:
        """Play cases, so many at a time, in real time: the threads of Zenoh know no other."""
        conditions = Conditions(jobs=jobs, framing="messages")
        return await run_cases(cases, target, self.dial, "two servers", conditions, RealPace())


@asynccontextmanager
async def two_servers() -> AsyncIterator[TwoServers]:
    """Run them until the block is left; each has a rosapi of its own."""
    endpoint = free_endpoint()
    async with AsyncExitStack() as stack:
        graphs = [
            await stack.enter_async_context(
                ZenohGraph(Registry(JAZZY), listen=listen, connect=connect, config=QUICK)
            )
            for listen, connect in (([endpoint], []), ([], [endpoint]))
        ]
        accepts: list[Accept] = []
        for graph in graphs:
            stack.callback(Rosapi(graph).close)
            bridge = Bridge(graph, Settings())
            stack.callback(bridge.close)
            accepts.append(partial(bridge.accept, loopback=True))
        yield TwoServers(accepts[0], accepts[1])
