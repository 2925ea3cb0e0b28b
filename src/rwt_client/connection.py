"""Connecting to a robot, and staying connected."""

from __future__ import annotations

import ssl
from collections.abc import AsyncIterator, Awaitable, Callable, Mapping, Sequence
from contextlib import AbstractAsyncContextManager, asynccontextmanager
from functools import partial
from typing import TYPE_CHECKING, Final, Literal, TypedDict, Unpack

import anyio
import anyio.lowlevel

from rwt_client.errors import BadAddress, CannotConnect, ConnectionClosed, ConnectionLost
from rwt_client.events import ConnectionEvent
from rwt_client.robot import Robot
from rwt_client.wire.arrays import ArrayKind, check_kind
from rwt_client.wire.session import ReconnectingSession
from rwt_protocol.errors import Level
from rwt_protocol.limits import WireLimits
from rwt_transports.background import TaskStarter, background_tasks
from rwt_transports.backoff import Backoff
from rwt_transports.connect import ConnectOptions
from rwt_transports.connect import connect as connect_transport
from rwt_transports.drivers.in_process import connect_in_process
from rwt_transports.endpoint import Accept
from rwt_transports.errors import BadUrl, TransportError
from rwt_transports.limits import Limits
from rwt_transports.schemes import carries_binary

if TYPE_CHECKING:
    from anyio.abc import TaskGroup, TaskStatus

RECONNECT = Backoff()
"""Default of :func:`connect`: retries without limit."""

_FAREWELL_SECONDS: Final = 2.0
_FOREVER: Final = float("inf")


Drained = Callable[[], Awaitable[None]]
"""Waits until everything sent on one connection has gone out."""

Dial = Callable[[Accept], AbstractAsyncContextManager[Drained]]
"""Opens one connection for the length of a block. Raises TransportError."""


class ConnectKeywords(TypedDict, total=False):
    """The keyword arguments of :func:`connect`."""

    timeout: float | None
    reconnect: Backoff | None
    arrays: ArrayKind
    ros_version: Literal[1, 2] | None
    fetch_types: bool
    status_level: Level | None
    headers: Mapping[str, str] | None
    tls: ssl.SSLContext | None
    limits: Limits | None
    ice_servers: Sequence[Mapping[str, str]] | None


@asynccontextmanager
async def connect(
    target: str | Accept,
    *,
    timeout: float | None = 10.0,
    reconnect: Backoff | None = RECONNECT,
    arrays: ArrayKind = "list",
    ros_version: Literal[1, 2] | None = None,
    fetch_types: bool = True,
    status_level: Level | None = "warning",
    headers: Mapping[str, str] | None = None,
    tls: ssl.SSLContext | None = None,
    limits: Limits | None = None,
    ice_servers: Sequence[Mapping[str, str]] | None = None,
) -> AsyncIterator[Robot]:
    """Connect to a robot for the length of the block, on asyncio or trio.

    Args:
        target: ``ws://``, ``wss://``, ``tcp://`` or ``tcps://`` with host and port, ``unix:///path``,
            ``stdio:COMMAND``, or the accept function of a server in the same process
            (``Bridge(graph).accept``).
        timeout: seconds to connect in, and what every call waits by default; None waits as long as it takes.
        reconnect: how to come back when the connection is lost; None does not.
        arrays: what numeric arrays become where nothing else is asked for: ``list``, or ``numpy``.
        ros_version: 1 or 2; None asks the robot.
        fetch_types: take the definitions of the robot's topics, which win over the standard ones.
        status_level: of which complaints the server is asked to tell; None asks for none.
        headers: request headers, for ``ws`` and ``wss``.
        tls: how to check the server's certificate; by default against the system's authorities.
        limits: bounds of the connection, among them the largest message.
        ice_servers: STUN and TURN servers for ``webrtc+http`` and ``webrtc+https``, each like
            ``{"urls": "turn:turn.example.org", "username": "…", "credential": "…"}``; by default those that
            the robot names, and an empty list asks none.

    Raises:
        BadAddress: the URL is not one to connect to.
        CannotConnect: there is no connection; says why.
        ValueError: `arrays` is another word.
    """
    check_kind(arrays)
    bounds = limits or Limits()
    wire_limits = WireLimits(bounds.message_bytes, fragment_characters=2 * bounds.message_bytes)
    session = ReconnectingSession(status_level, wire_limits)
    dial = _dial(target, bounds, timeout, headers, tls, ice_servers)
    reconnector = _Reconnector(session, dial, reconnect)
    name = target if isinstance(target, str) else "memory"
    async with background_tasks() as tasks:
        binary = not isinstance(target, str) or carries_binary(target)
        starter = TaskStarter()
        tasks.start_soon(starter.run, tasks)
        robot = Robot(
            name, session, starter, reconnector.drain, timeout=timeout, arrays=arrays, binary=binary
        )
        try:
            await _begin(reconnector, tasks)
            await robot.identify(ros_version, fetch_types)
            yield robot
        finally:
            with anyio.move_on_after(_FAREWELL_SECONDS):
                await reconnector.drain()
            session.close(ConnectionClosed("the connection was closed by this program"))


async def _begin(reconnector: _Reconnector, tasks: TaskGroup) -> None:
    try:
        await tasks.start(reconnector.run)
    except BadUrl as error:
        raise BadAddress(str(error)) from error
    except TransportError as error:
        raise CannotConnect(str(error)) from error


def _dial(
    target: str | Accept,
    limits: Limits,
    timeout: float | None,
    headers: Mapping[str, str] | None,
    tls: ssl.SSLContext | None,
    ice_servers: Sequence[Mapping[str, str]] | None,
) -> Dial:
    """Return a function that opens a connection to `target`."""
    if not isinstance(target, str):
        return partial(_dial_memory, target)
    patience = _FOREVER if timeout is None else timeout
    return partial(
        _dial_url,
        target,
        limits=limits,
        tls=tls,
        headers=headers,
        timeout=patience,
        ice_servers=ice_servers,
    )


@asynccontextmanager
async def _dial_url(url: str, accept: Accept, **options: Unpack[ConnectOptions]) -> AsyncIterator[Drained]:
    async with connect_transport(url, accept, **options) as outgoing:
        yield outgoing.drained


@asynccontextmanager
async def _dial_memory(server: Accept, accept: Accept) -> AsyncIterator[Drained]:
    async with connect_in_process(accept, server):
        yield anyio.lowlevel.checkpoint


class _Reconnector:
    """Connects a session, and again whenever the connection is lost."""

    def __init__(self, session: ReconnectingSession, dial: Dial, backoff: Backoff | None) -> None:
        self._session = session
        self._dial = dial
        self._backoff = backoff
        self._drained: Drained | None = None

    async def run(self, *, task_status: TaskStatus[None]) -> None:
        """Connect; whenever the connection is lost, connect again, until there is no hope.

        Raises:
            TransportError: the first connection could not be had.
        """
        await self._stay_connected(task_status.started)
        while await self._come_back():
            pass

    async def drain(self) -> None:
        """Wait until everything sent so far was handed to the network, or the connection is gone."""
        if self._drained is None or not self._session.backlog:
            await anyio.lowlevel.checkpoint()
            return
        async with anyio.create_task_group() as tasks:
            tasks.start_soon(self._cancel_when_lost, tasks.cancel_scope)
            await self._drained()
            tasks.cancel_scope.cancel()

    async def _cancel_when_lost(self, scope: anyio.CancelScope) -> None:
        await self._session.ended()
        scope.cancel()

    async def _stay_connected(self, begun: Callable[[], object]) -> None:
        async with self._dial(self._session.accept) as self._drained:
            begun()
            await self._session.ended()
        self._drained = None

    async def _come_back(self) -> bool:
        """Connect again and stay so until that connection is lost, too; False when it is given up."""
        text = "the connection was lost"
        for attempt, delay in enumerate(() if self._backoff is None else self._backoff.delays(), 1):
            self._session.events.tell(ConnectionEvent("retrying", text, attempt, delay))
            await anyio.sleep(delay)
            try:
                await self._stay_connected(_nothing)
            except TransportError as error:
                text = str(error)
            else:
                return True
        self._session.close(ConnectionLost(f"{text}, and it is not tried again"))
        return False


def _nothing() -> None:
    """No-op: no task waits for a restored connection."""
