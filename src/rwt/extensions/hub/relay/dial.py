"""Dial-out: a robot behind a NAT opens the connections and serves clients over them.

The other end is a :mod:`rwt.extensions.hub.hub`. Idle connections are kept open there; each is
assigned to one client and then replaced by another.
"""

from __future__ import annotations

import logging
import secrets
from collections.abc import AsyncIterator, Callable
from contextlib import AbstractAsyncContextManager, asynccontextmanager
from dataclasses import dataclass
from functools import partial
from ssl import SSLContext

import anyio
from anyio.abc import TaskGroup, TaskStatus

from rwt.extensions.hub.relay.pages import PageServer
from rwt.extensions.hub.relay.protocol import (
    INSTANCE,
    NAME_RULE,
    REPLACED,
    ROBOTS,
    BadAssignment,
    decode_assignment,
    is_robot_name,
)
from rwt_transports.background import TaskStarter, background_tasks
from rwt_transports.backoff import Backoff
from rwt_transports.connect import OutgoingConnection, connect
from rwt_transports.connection import CONNECTIONS
from rwt_transports.endpoint import Accept, Endpoint, Identify, PeerInfo, Sink, anonymous
from rwt_transports.errors import BadUrl, Refused, TransportError, log_exception
from rwt_transports.http.addresses import AddressCount, holder_of
from rwt_transports.http.routes import HttpRequest, Routes
from rwt_transports.limits import Limits
from rwt_transports.schemes import parse_connect_url
from rwt_transports.shared_pool import Holder, Share, SharedPool
from rwt_transports.websocket.close_codes import (
    GOING_AWAY,
    INTERNAL_ERROR,
    POLICY,
    PROTOCOL_ERROR,
    TOO_BIG,
    TRY_AGAIN_LATER,
)
from rwt_transports.wires.receive_buffer import ReceiveBufferPool

logger = logging.getLogger("rwt.extensions.hub.relay.dial")

IDLE_CONNECTIONS = 2
"""Number of idle connections: as many clients can connect at once without another round trip."""

BACKOFF = Backoff(first=0.5, longest=30.0, jitter=0.5)
STEADY_SECONDS = 5.0
"""Minimum duration of a connection to the hub; a shorter one counts as a failure. In seconds."""
MANY_FAILURES = 20
"""Enough for the longest wait."""


@dataclass(slots=True)
class RelayStatus:
    """Status of one outgoing connection to a hub.

    Attributes:
        url: URL of the hub, with the robot's path.
        idle: number of connections without a client.
        clients: number of connections with a client.
        failures: attempts that failed since the last success.
        error: reason of the last failure; empty after a success.
    """

    url: str
    idle: int = 0
    clients: int = 0
    failures: int = 0
    error: str = ""

    @property
    def connected(self) -> bool:
        """True if a new client can be served."""
        return self.idle > 0


@asynccontextmanager
async def dial(
    url: str,
    accept: Accept,
    *,
    token: str | None = None,
    limits: Limits | None = None,
    addresses: AddressCount | None = None,
    identify: Identify = anonymous,
    buffers: ReceiveBufferPool | None = None,
    routes: Routes | None = None,
    tls: SSLContext | None = None,
    backoff: Backoff = BACKOFF,
) -> AsyncIterator[RelayStatus]:
    """Serve the clients of a hub within the block; reconnects if the hub is unavailable.

    Args:
        url: ``wss://HUB/robots/NAME`` or ``ws://HUB/robots/NAME``; NAME is what clients call the robot.
        accept: makes the endpoint of each client; may raise :exc:`~rwt_transports.errors.Refused`, and the
            client is closed with 1008 and the reason, since it is connected to the hub already.
        token: token of the robot for the hub.
        addresses: counts the clients of each address that the hub names; one of its own by default.
        identify: returns the credential of a client or request; by default none are needed.
        buffers: what large messages of all clients are received in; of its own by default.
        routes: pages for requests from the hub.
        tls: how to check the hub's certificate; by default against the system's authorities.
        backoff: delays between attempts, and their number.

    Raises:
        BadUrl: the URL is not a hub's URL of a robot.
    """
    check_dial_url(url)
    headers = {INSTANCE: secrets.token_hex(8)}
    if token is not None:
        headers["Authorization"] = f"Bearer {token}"
    status = RelayStatus(url)
    chosen = limits or Limits()
    pool = buffers or chosen.receive_pool()
    connect_one = partial(connect, url, limits=chosen, buffers=pool, tls=tls, headers=headers)
    counted = addresses or AddressCount(chosen.connections_per_address)
    robot = _Robot(
        status, accept, routes or Routes(), backoff, connect_one, counted, chosen.connections, identify
    )
    async with background_tasks() as tasks:
        tasks.start_soon(robot.starter.run, tasks)
        tasks.start_soon(robot.run, tasks)
        try:
            yield status
        finally:
            with anyio.move_on_after(chosen.close_seconds, shield=True):
                await robot.leave()


def check_dial_url(url: str) -> None:
    """Check a dial-out URL.

    Raises:
        BadUrl: the URL is invalid; the text gives the fault and an example.
    """
    example = "for example wss://hub.example/robots/my_robot"
    try:
        target = parse_connect_url(url)
    except BadUrl as error:
        raise BadUrl(f"cannot dial {url!r}: expected the WebSocket URL of a hub, {example}") from error
    if not target.scheme.http:
        raise BadUrl(f"cannot dial {url!r}: a hub is reached by ws:// or wss://, {example}")
    name = target.path.removeprefix(ROBOTS)
    if not target.path.startswith(ROBOTS) or not is_robot_name(name):
        raise BadUrl(f"cannot dial {url!r}: its path must be {ROBOTS}NAME, {example}; a name is {NAME_RULE}")


_ConnectOne = Callable[[Accept], AbstractAsyncContextManager[OutgoingConnection]]


class _Robot:
    """Connections of one dial-out.

    Args:
        most: maximum number of clients, which share it.
        identify: returns the credential of a client or request.

    Attributes:
        starter: starts the tasks that serve pages.
    """

    def __init__(
        self,
        status: RelayStatus,
        accept: Accept,
        routes: Routes,
        backoff: Backoff,
        connect_one: _ConnectOne,
        addresses: AddressCount,
        most: int,
        identify: Identify,
    ) -> None:
        self.starter = TaskStarter()
        self._status = status
        self._accept = accept
        self._routes = routes
        self._backoff = backoff
        self._connect_one = connect_one
        self._addresses = addresses
        self._pool = SharedPool(CONNECTIONS, most)
        self._identify = identify
        self._fewer = anyio.Event()
        self._open: set[OutgoingConnection] = set()
        self._running = anyio.CancelScope()
        self._shaky = 0  # failures before the connections that have not lasted yet

    async def run(self, tasks: TaskGroup) -> None:
        with self._running:
            await self._keep(tasks)

    async def leave(self) -> None:
        self._running.cancel()
        connections = tuple(self._open)
        for connection in connections:
            connection.close(GOING_AWAY, "the server is going away")
        for connection in connections:
            await connection.ended()

    async def _keep(self, tasks: TaskGroup) -> None:
        status = self._status
        while True:
            while status.idle >= IDLE_CONNECTIONS:
                self._fewer = anyio.Event()
                await self._fewer.wait()
            if status.failures:
                delay = self._backoff.delay(status.failures)
                if delay is None:
                    logger.error("gave up dialling %s: %s", status.url, status.error)
                    return
                await anyio.sleep(delay)
            try:
                await tasks.start(self._serve)
            except TransportError as error:
                self._failed(str(error))

    async def _serve(self, *, task_status: TaskStatus[None]) -> None:
        idle = _IdleConnection(self)
        async with self._connect_one(idle.open) as connection:
            opened = anyio.current_time()
            self._opened()
            self._open.add(connection)
            task_status.started()
            await connection.ended()
            self._open.discard(connection)
        if idle.has_client:
            self._addresses.leave(idle.address)
            if idle.share is not None:
                self._pool.release(idle.share)
            self._status.clients -= 1
            return
        self._status.idle -= 1
        if self._running.cancel_called:
            return
        if idle.code == REPLACED:
            # Reconnecting would displace the program that now has the name.
            self._shaky = MANY_FAILURES
        elif anyio.current_time() - opened >= STEADY_SECONDS:
            self._shaky = 0
        self._failed(f"the hub closed the connection: {idle.ending}", before=self._shaky)
        self._fewer.set()

    def _opened(self) -> None:
        status = self._status
        if not status.idle and not status.clients:
            logger.info("dialled in at %s", status.url)
        status.idle += 1
        self._shaky = max(self._shaky, status.failures)
        status.failures = 0
        status.error = ""

    def serve(self, connection: _IdleConnection, sink: Sink, info: PeerInfo | HttpRequest) -> Endpoint:
        """Return the endpoint of the client or the request that was assigned to a connection.

        Raises:
            Refused: there are too many clients, or the server refuses this one.
        """
        status = self._status
        status.idle -= 1
        status.clients += 1
        self._shaky = 0
        self._fewer.set()
        self._addresses.enter(info.address)
        self._addresses.check(info.address)
        holder = self._holder_of(info)
        sink.count_for(holder)
        connection.share = self._pool.take(holder, partial(sink.close, TRY_AGAIN_LATER))
        if isinstance(info, HttpRequest):
            page = PageServer(sink, self._routes, info)
            self.starter.start_soon(page.run)
            return page
        return self._accept(sink, info)

    def _holder_of(self, info: PeerInfo | HttpRequest) -> Holder:
        if isinstance(info, HttpRequest):
            info = PeerInfo("http", info.address, 0, info.target, info.headers)
        return holder_of(info.address, self._identify(info) or "")

    def _failed(self, why: str, *, before: int = 0) -> None:
        status = self._status
        status.failures = max(status.failures, before) + 1
        level = logging.WARNING if why != status.error else logging.DEBUG
        status.error = why
        logger.log(level, "cannot serve at %s: %s; trying again", status.url, why)


class _IdleConnection:
    """Endpoint of a connection to the hub, until its client's endpoint takes over.

    Attributes:
        has_client: True if a client was assigned to it, admitted or not.
        share: its share of the connections of the robot; None without a client.
        code: close code; 0 if a client's endpoint took over.
    """

    def __init__(self, robot: _Robot) -> None:
        self._robot = robot
        self.address = ""
        self.share: Share | None = None
        self.has_client = False
        self.code = 0
        self.ending = ""

    def open(self, sink: Sink, info: PeerInfo) -> Endpoint:
        self._sink = sink
        return self

    def receive(self, data: bytes, binary: bool) -> None:
        sink = self._sink
        try:
            info = decode_assignment(data)
        except BadAssignment as error:
            sink.close(PROTOCOL_ERROR, str(error))
            return
        self.has_client = True
        self.address = info.address
        try:
            sink.hand_over(self._robot.serve(self, sink, info))
        except Refused as refused:
            sink.close(POLICY, refused.reason)
        except Exception:
            log_exception("the accept function failed for a client at %s", info.address)
            sink.close(INTERNAL_ERROR, "internal error")

    def oversized(self, size: int, limit: int, head: bytes) -> None:
        self._sink.close(TOO_BIG, f"a message of {size} bytes; the limit is {limit} (message_bytes)")

    def closed(self, code: int, reason: str) -> None:
        self.code = code
        self.ending = f"{code} {reason}".strip()
