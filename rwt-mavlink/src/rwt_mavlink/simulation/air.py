"""Radio in simulated time: loss, delay, duplicates and gaps between stations and vehicles, from one seed."""

from __future__ import annotations

import random
from collections.abc import AsyncIterator, Awaitable, Callable, Sequence
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from functools import partial
from heapq import heappop, heappush
from typing import Final, TypeVar

import anyio
import anyio.lowlevel

from rwt_graph import SimulatedClock
from rwt_mavlink.link.addresses import LinkAddress
from rwt_mavlink.link.links import Link, Source
from rwt_mavlink.simulation.vehicle import SimulatedVehicle

T = TypeVar("T")

STEP_SECONDS: Final = 0.05

#: Turns of the event loop after each step, in which stations receive, decide and send.
_TURNS: Final = 12


@dataclass(frozen=True, slots=True)
class Weather:
    """Faults of the radio, in each direction.

    Attributes:
        loss: probability that a frame is lost.
        duplicates: probability that a frame of a vehicle arrives twice.
        delay: maximum delay of a frame in seconds.
        gap_every: mean seconds between gaps; 0 for none.
        gap_seconds: duration of a gap, in which all frames are lost.
    """

    loss: float = 0.0
    duplicates: float = 0.0
    delay: float = 0.0
    gap_every: float = 0.0
    gap_seconds: float = 2.0


@dataclass
class Antenna(Link):
    """Link of one station.

    Attributes:
        is_cut: True to lose all frames.
    """

    air: Air
    number: int
    is_cut: bool = False
    gap_until: float = 0.0
    arrived: list[tuple[bytes, Source]] = field(default_factory=list)
    wake: anyio.Event = field(default_factory=anyio.Event)

    is_datagrams = True

    async def receive(self) -> tuple[bytes, Source]:
        """Return the next frame that arrived."""
        while not self.arrived:
            self.wake = anyio.Event()
            await self.wake.wait()
        return self.arrived.pop(0)

    async def send(self, data: bytes, source: Source) -> None:
        """Send a frame to a vehicle."""
        self.air.transmit(self, data, source)

    def arrive(self, data: bytes, source: Source) -> None:
        """Receive a frame."""
        self.arrived.append((data, source))
        self.wake.set()


class Air:
    """Radio between stations and vehicles.

    Args:
        clock: simulated clock, which :meth:`run` advances.
        vehicles: vehicles; the number of one is its source.
        seed: seed of all faults.

    Attributes:
        weather: present faults.
        vehicles: vehicles.
        antennas: links of stations, in the order in which they were opened.
        dice: source of random numbers.
    """

    def __init__(self, clock: SimulatedClock, vehicles: Sequence[SimulatedVehicle], seed: int = 0) -> None:
        self._clock = clock
        self._order = 0
        self._flying: list[tuple[float, int, Callable[[], None]]] = []
        self.weather = Weather()
        self.vehicles = list(vehicles)
        self.antennas: list[Antenna] = []
        self.dice = random.Random(seed)

    @asynccontextmanager
    async def open(self, address: LinkAddress) -> AsyncIterator[Link]:
        """Open the link of a station, in place of a socket."""
        antenna = Antenna(self, len(self.antennas))
        self.antennas.append(antenna)
        try:
            yield antenna
        finally:
            antenna.is_cut = True

    def transmit(self, antenna: Antenna, data: bytes, source: Source) -> None:
        """Send a frame of a station to a vehicle."""
        if isinstance(source, int) and source < len(self.vehicles):
            self._launch(antenna, partial(self.vehicles[source].receive, data), 0.0)

    async def run(self, seconds: float) -> None:
        """Let time pass."""
        for _ in range(max(1, round(seconds / STEP_SECONDS))):
            self._clock.advance(STEP_SECONDS)
            now = self._clock.monotonic()
            for antenna in self.antennas:
                if self.weather.gap_every and self.dice.random() < STEP_SECONDS / self.weather.gap_every:
                    antenna.gap_until = now + self.weather.gap_seconds
            while self._flying and self._flying[0][0] <= now:
                heappop(self._flying)[2]()
            for number, vehicle in enumerate(self.vehicles):
                vehicle.step(now)
                frames, vehicle.outbox = vehicle.outbox, []
                for frame in frames:
                    for antenna in self.antennas:
                        arrive = partial(antenna.arrive, frame, number)
                        self._launch(antenna, arrive, self.weather.duplicates)
            for _ in range(_TURNS):
                await anyio.lowlevel.checkpoint()

    async def until(self, condition: Callable[[], object], seconds: float = 600.0) -> None:
        """Let time pass until a condition is true.

        Raises:
            TimeoutError: it is still false.
        """
        for _ in range(round(seconds / STEP_SECONDS)):
            if condition():
                return
            await self.run(STEP_SECONDS)
        raise TimeoutError(f"the condition is false after {seconds:g} s of simulated time")

    async def during(self, function: Callable[[], Awaitable[T]], seconds: float = 600.0) -> T:
        """Let time pass while a coroutine function runs, and return its result."""
        outcome: list[T | Exception] = []

        async def run() -> None:
            try:
                outcome.append(await function())
            except Exception as error:
                outcome.append(error)

        async with anyio.create_task_group() as tasks:
            tasks.start_soon(run)
            await self.until(lambda: outcome, seconds)
        if isinstance(outcome[0], Exception):
            raise outcome[0]
        return outcome[0]

    def _launch(self, antenna: Antenna, arrive: Callable[[], None], duplicates: float) -> None:
        weather, now = self.weather, self._clock.monotonic()
        if antenna.is_cut or now < antenna.gap_until or self.dice.random() < weather.loss:
            return
        for _ in range(2 if self.dice.random() < duplicates else 1):
            self._order += 1
            heappush(self._flying, (now + self.dice.random() * weather.delay, self._order, arrive))
