"""Opening a listener: a URL, an accept function, and plain HTTP routes beside it."""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import replace
from ssl import SSLContext

import anyio
import anyio.lowlevel

from rwt_protocol.transport import Accept
from rwt_transports.api import Driver
from rwt_transports.background import TaskStarter
from rwt_transports.connection import ListenerState, MakeWire
from rwt_transports.drivers.anyio_stream import AnyioDriver
from rwt_transports.drivers.asyncio_protocol import AsyncioDriver
from rwt_transports.errors import BadUrl
from rwt_transports.http import Routes
from rwt_transports.limits import Limits
from rwt_transports.urls import ListenUrl, parse_listen_url
from rwt_transports.websocket.close_codes import GOING_AWAY

TICK_SECONDS = 0.5


class OpenListener:
    """A listener that is open; satisfies :class:`rwt_transports.api.Listener`."""

    __slots__ = ("_state", "url")

    def __init__(self, url: str, state: ListenerState) -> None:
        self.url = url
        self._state = state

    @property
    def connections(self) -> int:
        """How many peers are connected, plain HTTP included."""
        return len(self._state.connections)

    async def ended(self) -> None:
        """Wait until the listener has nothing left to serve. That of ``stdio:`` ends with its one peer, any
        other when its block is left."""
        await self._state.ended.wait()


@asynccontextmanager
async def listen(
    url: str,
    accept: Accept,
    *,
    routes: Routes | None = None,
    limits: Limits | None = None,
    driver: Driver | None = None,
    tls: SSLContext | None = None,
    bson: bool = False,
    shared: bool = False,
) -> AsyncIterator[OpenListener]:
    """Accept peers on `url` within the block, for example ``ws://127.0.0.1:9090``; port 0 picks a free one.

    Leaving the block closes every peer with 1001 and waits up to ``limits.close_seconds`` for them.

    Args:
        url: where to listen; :data:`rwt_transports.urls.SCHEMES` lists the schemes.
        accept: makes the endpoint of each new peer; may raise :exc:`~rwt_transports.errors.Refused`.
        routes: plain HTTP requests that the same port answers.
        limits: bounds per listener and per connection.
        tls: certificate and key for the schemes that encrypt (``wss``, ``tcps``).
        bson: whether every message is a BSON document; on a stream it says itself where it ends (BSN-03).
        shared: whether other processes listen on the same TCP port, see
            :func:`rwt_transports.shared_port.hold_port`.
        driver: what moves the bytes; by default the fastest one for the scheme and the running event loop.

    Raises:
        BadUrl: the URL is not one to listen on.
        ListenError: the address cannot be had.
    """
    target = parse_listen_url(url, tls)
    chosen = Limits() if limits is None else limits
    make_wire = target.scheme.wire(bson=bson)
    if make_wire is None:
        raise BadUrl(f"cannot listen on {url!r}: BSON is not spoken over {target.name}; use ws:// or tcp://")
    state = _listener_state(target, accept, make_wire, chosen, routes)
    mover = driver or (target.scheme.make_driver or fastest_driver)()
    failure: Exception | None = None
    async with (
        mover.serve(replace(target.address, shared=shared), state.attach) as port,
        anyio.create_task_group() as tasks,
    ):
        state.tasks = TaskStarter()
        tasks.start_soon(state.tasks.run, tasks)
        tasks.start_soon(_tick, state)
        try:
            yield OpenListener(target.with_port(port), state)
        except Exception as error:
            # Raised again below, so that the caller gets the exception itself and not a group around it.
            failure = error
        finally:
            with anyio.CancelScope(shield=True):
                await _close_all(state, chosen.close_seconds)
            tasks.cancel_scope.cancel()
    if failure is not None:
        raise failure


def _listener_state(
    target: ListenUrl, accept: Accept, make_wire: MakeWire, limits: Limits, routes: Routes | None
) -> ListenerState:
    scheme = target.scheme
    return ListenerState(
        accept,
        make_wire,
        limits,
        (routes or Routes()) if scheme.http else None,
        target.name,
        single=scheme.single,
        idle_seconds=limits.idle_peer_seconds if scheme.expires else 0.0,
        max_message_size=scheme.max_message_size,
    )


def fastest_driver() -> Driver:
    """The driver for the event loop that is running."""
    try:
        asyncio.get_running_loop()
    except RuntimeError:
        return AnyioDriver()
    return AsyncioDriver()


async def _tick(state: ListenerState) -> None:
    while True:
        state.tick(time.monotonic())
        await anyio.sleep(TICK_SECONDS)


async def _close_all(state: ListenerState, patience: float) -> None:
    """Ask all peers to go; cut those that have not gone in `patience` seconds."""
    state.close(GOING_AWAY, "the server is going away")
    with anyio.move_on_after(patience):
        await state.emptied()
    state.abort()
    await state.emptied()
