"""A station and simulated vehicles, with a radio in simulated time."""

from __future__ import annotations

from collections.abc import AsyncIterator, Callable
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import dataclass
from typing import Any, Final

import pytest

from rwt_graph import MemoryGraph, Node, SimulatedClock
from rwt_mavlink import MavlinkSettings, Station
from rwt_mavlink.simulation.air import Air
from rwt_mavlink.simulation.vehicle import SimulatedVehicle

__all__ = ["anyio_backend", "flight", "world"]

START_NS: Final = 1_767_225_600_000_000_000


@pytest.fixture(scope="module")
def anyio_backend() -> object:
    return "asyncio"


@dataclass
class World:
    """A graph with a user, and stations that share a radio with vehicles."""

    air: Air
    graph: MemoryGraph
    users: list[Node]
    stack: AsyncExitStack
    stations: list[Station]

    @property
    def user(self) -> Node:
        return self.users[0]

    @property
    def vehicle(self) -> SimulatedVehicle:
        return self.air.vehicles[0]

    async def call(self, service: str, request: dict[str, Any] | None = None) -> Any:
        """Call a service while time passes."""
        return await self.air.during(lambda: self.ask(service, request))

    async def ask(self, service: str, request: dict[str, Any] | None = None, station: int = 0) -> Any:
        """Call a service of a station."""
        return await self.users[station].call(service, request, timeout=None)

    def hear(self, topic: str) -> list[Any]:
        """Messages of a topic, as they arrive."""
        heard: list[Any] = []
        self.user.subscribe(topic, heard.append)
        return heard


@asynccontextmanager
async def _world(
    vehicles: list[SimulatedVehicle], seed: int, settings: list[dict[str, Any]]
) -> AsyncIterator[World]:
    clock = SimulatedClock(START_NS)
    air = Air(clock, vehicles, seed)
    async with MemoryGraph(clock=clock) as graph, AsyncExitStack() as stack:
        stations, users = [], []
        for number, each in enumerate(settings):
            # A second station has a graph of its own, with the same names.
            own = graph if not number else await stack.enter_async_context(MemoryGraph(clock=clock))
            table = MavlinkSettings(link="udp://127.0.0.1:14550", **each)
            stations.append(await stack.enter_async_context(Station(own, table, air.open)))
            users.append(Node(own, "user"))
        await air.run(2.0)
        yield World(air, graph, users, stack, stations)


@pytest.fixture
def world() -> Callable[..., Any]:
    """Opens a world: vehicles, seed, settings of each station."""

    def opened(
        *vehicles: SimulatedVehicle, seed: int = 0, settings: list[dict[str, Any]] | None = None
    ) -> Any:
        return _world(list(vehicles) or [SimulatedVehicle()], seed, settings or [{}])

    return opened


@pytest.fixture
async def flight(world: Any) -> AsyncIterator[World]:
    """A world with one vehicle and a good radio."""
    async with world() as opened:
        yield opened
