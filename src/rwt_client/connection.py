"""Connecting to a robot, and reconnecting."""

from __future__ import annotations

import ssl
from collections.abc import AsyncIterator, Callable, Mapping, Sequence
from contextlib import AbstractAsyncContextManager, asynccontextmanager
from functools import partial
from typing import Final, Literal, TypedDict

import anyio
import anyio.lowlevel
from anyio.abc import TaskStatus

from rwt_client.errors import BadAddress, CannotConnect, ConnectionClosed, ConnectionLost
from rwt_client.events import ConnectionEvent
from rwt_client.robot import Robot
from rwt_client.wire.arrays import ArrayKind, check_kind
from rwt_client.wire.session import ReconnectingSession
from rwt_protocol.errors import Level
from rwt_protocol.limits import WireLimits
from rwt_transports.background import TaskStarter, background_tasks
from rwt_transports.backoff import Backoff
from rwt_transports.connect import OutgoingConnection
from rwt_transports.connect import connect as connect_transport
from rwt_transports.drivers.in_process import InProcessEnd, connect_in_process
from rwt_transports.endpoint import Accept
from rwt_transports.errors import BadUrl, TransportError
from rwt_transports.limits import Limits
from rwt_transports.schemes import carries_binary

RECONNECT = Backoff()
"""Default of :func:`connect`: retries without limit."""

_FAREWELL_SECONDS: Final = 2.0
_FOREVER: Final = float("inf")


Dialled = OutgoingConnection | InProcessEnd

Dial = Callable[[Accept], AbstractAsyncContextManager[Dialled]]
"""Opens one connection for the length of a block. Raises TransportError."""


class ConnectKeywords(TypedDict, total=False):
    """Keyword arguments of :func:`connect`."""

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
        timeout: seconds to connect, and default timeout of every call; None waits without limit.
        reconnect: policy for a lost connection; None does not reconnect.
        arrays: default type of numeric arrays: ``list``, or ``numpy``.
        ros_version: 1 or 2; None asks the robot.
        fetch_types: use the robot's definitions of its topics' types in place of the standard ones.
        status_level: minimum severity of status messages from the server; None requests none.
        headers: request headers, for ``ws`` and ``wss``.
        tls: verification of the server's certificate; by default against the system's authorities.
        limits: limits of the connection, such as the maximum size of a message.
        ice_servers: STUN and TURN servers for ``webrtc+http`` and ``webrtc+https``, each like
            ``{"urls": "turn:turn.example.org", "username": "…", "credential": "…"}``; by default those that
            the robot names. An empty list uses none.

    Raises:
        BadAddress: the URL is invalid.
        CannotConnect: the connection failed; with the reason.
        ValueError: `arrays` has another value.
    """
    check_kind(arrays)
    bounds = limits or Limits()
    wire_limits = WireLimits(bounds.message_bytes, fragment_characters=2 * bounds.message_bytes)
    session = ReconnectingSession(status_level, wire_limits)
    dial: Dial
    if isinstance(target, str):
        name, binary = target, carries_binary(target)
        patience = _FOREVER if timeout is None else timeout
        dial = partial(
            connect_transport, target, limits=bounds, tls=tls, headers=headers, timeout=patience,
            ice_servers=ice_servers,
        )  # fmt: skip
    else:
        name, binary, dial = "memory", True, partial(connect_in_process, target)
    reconnector = _Reconnector(session, dial, reconnect)
    async with background_tasks() as tasks:
        starter = TaskStarter()
        tasks.start_soon(starter.run, tasks)
        robot = Robot(
            name, session, starter, reconnector.drain, timeout=timeout, arrays=arrays, binary=binary
        )
        try:
            try:
                await tasks.start(reconnector.run)
            except BadUrl as error:
                raise BadAddress(str(error)) from error
            except TransportError as error:
                raise CannotConnect(str(error)) from error
            await robot.identify(ros_version, fetch_types)
            yield robot
        finally:
            with anyio.move_on_after(_FAREWELL_SECONDS):
                await reconnector.drain()
            session.close(ConnectionClosed("the connection was closed by this program"))


class _Reconnector:
    """Connects a session, and reconnects it whenever the connection is lost."""

    def __init__(self, session: ReconnectingSession, dial: Dial, backoff: Backoff | None) -> None:
        self._session = session
        self._dial = dial
        self._backoff = backoff
        self._dialled: Dialled | None = None

    async def run(self, *, task_status: TaskStatus[None]) -> None:
        await self._stay_connected(task_status.started)
        while await self._come_back():
            pass

    async def drain(self) -> None:
        if self._dialled is None or not self._session.backlog:
            await anyio.lowlevel.checkpoint()
            return
        async with anyio.create_task_group() as tasks:
            scope = tasks.cancel_scope

            async def cancel_when_lost() -> None:
                await self._session.ended()
                scope.cancel()

            tasks.start_soon(cancel_when_lost)
            await self._dialled.drained()
            scope.cancel()

    async def _stay_connected(self, begun: Callable[[], object]) -> None:
        async with self._dial(self._session.accept) as self._dialled:
            begun()
            await self._session.ended()
        self._dialled = None

    async def _come_back(self) -> bool:
        text = "the connection was lost"
        for attempt, delay in enumerate(() if self._backoff is None else self._backoff.delays(), 1):
            self._session.events.publish(ConnectionEvent("retrying", text, attempt, delay))
            await anyio.sleep(delay)
            try:
                await self._stay_connected(lambda: None)
            except TransportError as error:
                text = str(error)
            else:
                return True
        self._session.close(ConnectionLost(f"{text}, and it is not tried again"))
        return False
