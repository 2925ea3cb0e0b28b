"""Opening a listener: a URL, an accept function, and plain HTTP routes beside it."""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator, Callable, Coroutine
from contextlib import asynccontextmanager

import anyio
import anyio.lowlevel
from anyio.abc import TaskGroup

from rwt_protocol.frames import Accept

from .api import Driver
from .connection import Reception
from .drivers.anyio_stream import AnyioDriver
from .drivers.asyncio_protocol import AsyncioDriver
from .http import Routes
from .limits import Limits
from .urls import ListenUrl, parse_listen_url

TICK_SECONDS = 0.5
GOING_AWAY = 1001


class OpenListener:
    """A listener that is open; satisfies :class:`rwt_transports.api.Listener`."""

    __slots__ = ("_reception", "url")

    def __init__(self, url: str, reception: Reception) -> None:
        self.url = url
        self._reception = reception

    @property
    def connections(self) -> int:
        """How many peers are connected, plain HTTP included."""
        return len(self._reception.connections)


@asynccontextmanager
async def listen(
    url: str,
    accept: Accept,
    *,
    routes: Routes | None = None,
    limits: Limits | None = None,
    driver: Driver | None = None,
) -> AsyncIterator[OpenListener]:
    """Accept peers on `url` within the block, for example ``ws://127.0.0.1:9090``; port 0 picks a free one.

    Leaving the block closes every peer with 1001 and waits up to ``limits.close_seconds`` for them.

    Args:
        url: where to listen; :data:`rwt_transports.urls.SCHEMES` lists the schemes.
        accept: makes the endpoint of each new peer; may raise :exc:`~rwt_transports.errors.Refused`.
        routes: plain HTTP requests that the same port answers.
        limits: bounds per listener and per connection.
        driver: what moves the bytes; by default the fastest one for the running event loop.

    Raises:
        BadUrl: the URL is not one to listen on.
        ListenError: the address cannot be had.
    """
    place = parse_listen_url(url)
    chosen = Limits() if limits is None else limits
    try:
        async with anyio.create_task_group() as tasks:
            try:
                reception = _reception(place, accept, routes, chosen, tasks)
                attach = reception.attach
                async with (driver or fastest_driver()).serve(place.host, place.port, attach) as port:
                    tasks.start_soon(_tick, reception)
                    try:
                        yield OpenListener(place.with_port(port), reception)
                    finally:
                        with anyio.CancelScope(shield=True):
                            await _close_all(reception, chosen.close_seconds)
            finally:
                # Only now: a cancelled scope would put its own exception in the place of the caller's.
                tasks.cancel_scope.cancel()
    except BaseExceptionGroup as group:
        error = _only(group)
        raise error from error.__cause__


def _only(group: BaseExceptionGroup[BaseException]) -> BaseException:
    """That task groups are at work in here is not the caller's business: one error is raised as itself."""
    error: BaseException = group
    while isinstance(error, BaseExceptionGroup) and len(error.exceptions) == 1:
        error = error.exceptions[0]
    return error


def _reception(
    place: ListenUrl, accept: Accept, routes: Routes | None, limits: Limits, tasks: TaskGroup
) -> Reception:
    def spawn(work: Callable[[], Coroutine[object, object, None]]) -> None:
        tasks.start_soon(work)

    pages = (routes or Routes()) if place.scheme.http else None
    return Reception(accept, place.scheme.make_wire, limits, pages, spawn, place.name)


def fastest_driver() -> Driver:
    """The driver for the event loop that is running."""
    try:
        asyncio.get_running_loop()
    except RuntimeError:
        return AnyioDriver()
    return AsyncioDriver()


async def _tick(reception: Reception) -> None:
    while True:
        reception.tick(time.monotonic())
        await anyio.sleep(TICK_SECONDS)


async def _close_all(reception: Reception, patience: float) -> None:
    """Ask all peers to go; cut those that have not gone in `patience` seconds."""
    reception.close(GOING_AWAY, "the server is going away")
    with anyio.move_on_after(patience):
        await reception.emptied()
    reception.abort()
    await reception.emptied()
