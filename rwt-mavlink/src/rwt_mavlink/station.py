"""Ground station: a link to vehicles, its own heartbeat, and a node for each vehicle."""

from __future__ import annotations

import logging
from collections import deque
from collections.abc import Callable
from contextlib import AbstractAsyncContextManager
from types import TracebackType
from typing import Final, Self

import anyio
from anyio.abc import TaskGroup

from rwt_graph import Graph
from rwt_mavlink.link.addresses import LinkAddress, parse_link
from rwt_mavlink.link.frames import FrameReader, FrameWriter, MavlinkMessage, dialect
from rwt_mavlink.link.links import Link, LinkClosed, Source, open_link
from rwt_mavlink.node import VehicleNode
from rwt_mavlink.presence import CLASH_SECONDS
from rwt_mavlink.protocol.errors import Unavailable
from rwt_mavlink.protocol.exchange import Identity
from rwt_mavlink.settings import MavlinkSettings
from rwt_mavlink.vehicle import Vehicle

logger = logging.getLogger(__name__)

_BEAT_SECONDS: Final = 1.0
_RETRY_SECONDS: Final = 1.0
#: Frames that wait for the link; older ones are dropped, as if the link had lost them.
_QUEUED_FRAMES: Final = 1024
#: Sources that get heartbeats, and the time for which they do after they were heard.
_MAX_SOURCES: Final = 64
_SOURCE_SECONDS: Final = 30.0


class Station:
    """Ground station, within its `async with` block.

    The attributes but `vehicles` belong to the link, which is opened again when it fails.

    Args:
        graph: running graph.
        settings: settings of the table `[mavlink]`.
        opening: opens the link.

    Attributes:
        vehicles: nodes of the vehicles, by system id.
    """

    def __init__(
        self,
        graph: Graph,
        settings: MavlinkSettings,
        opening: Callable[[LinkAddress], AbstractAsyncContextManager[Link]] = open_link,
    ) -> None:
        self._clock = graph.clock
        self._settings = settings
        self._opening = opening
        self._writer = FrameWriter(settings.system, settings.component)
        self._queue: deque[tuple[bytes, Source]] = deque(maxlen=_QUEUED_FRAMES)
        self._queued = anyio.Event()
        self._known: tuple[Source, ...] = ()
        self._sources: dict[Source, float] = {}
        self._ignored: set[int] = set()
        self._clash_until = 0.0
        self._tasks: TaskGroup
        own = Identity(settings.system, settings.component)
        self.vehicles = {
            system: VehicleNode(
                graph,
                self._vehicle(graph, own, system),
                settings,
                lambda: self.problem,
            )
            for system in settings.systems
        }

    async def __aenter__(self) -> Self:
        self._tasks = anyio.create_task_group()
        await self._tasks.__aenter__()
        self._tasks.start_soon(self._run_link)
        self._tasks.start_soon(self._beat)
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> bool | None:
        self._tasks.cancel_scope.cancel()
        try:
            return await self._tasks.__aexit__(kind, error, trace)
        finally:
            for node in self.vehicles.values():
                node.close()

    def _vehicle(self, graph: Graph, own: Identity, system: int) -> Vehicle:
        timeout, rate = self._settings.timeout, self._settings.stream_rate
        return Vehicle(graph.clock, own, system, timeout, rate, self._send, self._check)

    @property
    def problem(self) -> str:
        """Reason why this station may not command vehicles; empty if it may."""
        if self._clock.monotonic() >= self._clash_until:
            return ""
        return (
            f"another ground station has the system id {self._settings.system} and the component id"
            f" {self._settings.component}, too: set another `mavlink.component`"
        )

    def _check(self) -> None:
        if reason := self.problem:
            raise Unavailable(reason)

    # -- link ------------------------------------------------------------------------------------------------

    async def _run_link(self) -> None:
        address = parse_link(self._settings.link)
        last = ""
        while True:
            try:
                async with self._opening(address) as link, anyio.create_task_group() as tasks:
                    last = ""
                    self._known = link.known
                    self._sources = {}
                    tasks.start_soon(self._send_queued, link)
                    await self._receive(link)
            except* (LinkClosed, OSError) as group:
                text = str(group.exceptions[0])
                if text != last:
                    last = text
                    logger.warning("the link %s failed, trying again: %s", self._settings.link, text)
            await self._clock.sleep(_RETRY_SECONDS)

    async def _receive(self, link: Link) -> None:
        reader = FrameReader()
        while True:
            data, source = await link.receive()
            if link.is_datagrams:
                reader = FrameReader()  # A frame that was cut off must not take the next datagram with it.
            for message in reader.decode(data):
                self._take(message, source)

    def _take(self, message: MavlinkMessage, source: Source) -> None:
        system, now = message.get_srcSystem(), self._clock.monotonic()
        if system == self._settings.system and message.get_srcComponent() == self._settings.component:
            if not self.problem:
                logger.error("another ground station has the ids of this one")
            self._clash_until = now + CLASH_SECONDS
        elif system in self.vehicles:
            if source in self._sources or len(self._sources) < _MAX_SOURCES:
                self._sources[source] = now
            self.vehicles[system].vehicle.receive(message, source)
        elif system not in self._ignored:
            self._ignored.add(system)
            logger.info("ignoring system %d, which is not in `mavlink.systems`", system)

    def _send(self, message: MavlinkMessage, source: Source) -> None:
        self._queue.append((self._writer.encode(message), source))
        self._queued.set()

    async def _send_queued(self, link: Link) -> None:
        while True:
            while self._queue:
                await link.send(*self._queue.popleft())
            self._queued = anyio.Event()
            await self._queued.wait()

    # -- time ------------------------------------------------------------------------------------------------

    async def _beat(self) -> None:
        beat = dialect.MAVLink_heartbeat_message(
            dialect.MAV_TYPE_GCS, dialect.MAV_AUTOPILOT_INVALID, 0, 0, dialect.MAV_STATE_ACTIVE, 3
        )
        while True:
            now = self._clock.monotonic()
            self._sources = {each: at for each, at in self._sources.items() if now - at < _SOURCE_SECONDS}
            if self._settings.heartbeat:
                for source in dict.fromkeys((*self._known, *self._sources)):
                    self._send(beat, source)
            for node in self.vehicles.values():
                node.vehicle.tick()
            await self._clock.sleep(_BEAT_SECONDS)
