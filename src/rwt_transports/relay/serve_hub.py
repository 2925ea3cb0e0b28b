"""Opening a hub: a :class:`rwt_transports.relay.hub.Hub` behind a listener."""

from __future__ import annotations

import time
from collections.abc import AsyncIterator, Collection
from contextlib import asynccontextmanager
from dataclasses import dataclass
from ssl import SSLContext

import anyio

from rwt_transports.background import background_tasks
from rwt_transports.limits import Limits
from rwt_transports.listener import listen
from rwt_transports.relay.hub import GRACE_SECONDS, Hub, Robot, hub_routes

TICK_SECONDS = 0.5


@dataclass(frozen=True, slots=True)
class OpenHub:
    """A hub that is open.

    Attributes:
        url: where it listens, with the actual port.
    """

    url: str
    _hub: Hub

    @property
    def robots(self) -> tuple[Robot, ...]:
        """Those that have dialled in, by name."""
        return self._hub.robots


@asynccontextmanager
async def open_hub(
    url: str,
    *,
    tokens: Collection[str] = (),
    limits: Limits | None = None,
    tls: SSLContext | None = None,
    grace: float = GRACE_SECONDS,
) -> AsyncIterator[OpenHub]:
    """Let robots dial in at `url` within the block, and clients reach them; leaving it closes all with 1001.

    Args:
        url: ``ws://HOST:PORT`` or ``wss://HOST:PORT``; port 0 picks a free one.
        tokens: bearer tokens of which a robot must show one; none lets every robot in.
        limits: bounds of the listener and of each connection.
        tls: certificate and key for ``wss``.
        grace: seconds for which a robot without a connection still counts as here, and its clients wait.

    Raises:
        BadUrl: the URL is not one to listen on.
        ListenError: the address cannot be had.
    """
    hub = Hub(tokens, grace)
    async with (
        listen(url, hub.accept, routes=hub_routes(hub), limits=limits, tls=tls) as listener,
        background_tasks() as tasks,
    ):
        tasks.start_soon(_tick, hub)
        yield OpenHub(listener.url, hub)


async def _tick(hub: Hub) -> None:
    while True:
        hub.tick(time.monotonic())
        await anyio.sleep(TICK_SECONDS)
